# An image to drive a Python planner in: docs/isolation.md, "In an image".
#
#   python -m pip wheel --no-deps --wheel-dir dist .
#   docker build --tag my-planner --file examples/planner.Dockerfile dist
# By digest, so that the same base is built on everywhere; docker buildx imagetools inspect python:3.12-slim tells a newer one.
FROM python:3.12-slim@sha256:78387bc3881b8273120a12ebe6c1ab22b018ccc2c9adf565ae1ac9b536e184ea
# tsbench without its scenes: they are in a wheel of their own.
COPY tsbench-*.whl /tmp/
RUN python3 -m pip install --no-cache-dir /tmp/tsbench-*.whl && rm /tmp/tsbench-*.whl
# What the planner needs, with its versions:
# RUN python3 -m pip install --no-cache-dir torch==2.6.0
USER nobody
