# An image to drive a Python planner in: docs/isolation.md, "In an image".
#
#   python -m pip wheel --no-deps --wheel-dir dist .
#   docker build --tag my-planner --file examples/planner.Dockerfile dist
FROM python:3.12-slim
# tsbench without its scenes: they are in a wheel of their own.
COPY tsbench-*.whl /tmp/
RUN python3 -m pip install --no-cache-dir /tmp/tsbench-*.whl && rm /tmp/tsbench-*.whl
# What the planner needs, with its versions:
# RUN python3 -m pip install --no-cache-dir torch==2.6.0
USER nobody
