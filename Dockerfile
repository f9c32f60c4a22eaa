# tsbench with pictures, reports and films: docker build -t tsbench .
# Run folders go to the folder that is mounted at /work:
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" tsbench run --planner idm --split dev --out first
# By digest, so that the same base is built on everywhere; docker buildx imagetools inspect python:3.12-slim tells a newer one.
FROM python:3.12-slim@sha256:78387bc3881b8273120a12ebe6c1ab22b018ccc2c9adf565ae1ac9b536e184ea

# SUMO's library is linked against those of a desktop, though it opens no window.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends make libatomic1 libexpat1 libgl1 libx11-6 libxext6 libxrender1 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/tsbench
# What the packages hang on comes first, so that a change of code does not install them again. The build of the editable
# installation asks for the version and for the catalogue.
COPY pyproject.toml requirements.lock Makefile LICENSE README.md ./
COPY tsbench/__init__.py tsbench/__init__.py
COPY sign_catalog sign_catalog
ARG EXTRAS="report video"
RUN make base EXTRAS="$EXTRAS" && rm -rf /root/.cache

COPY . .
RUN .venv/bin/python -m compileall -q tsbench && .venv/bin/tsbench signs list > /dev/null

RUN useradd --no-create-home tsbench && install --directory --owner tsbench /work
USER tsbench
# HOME: any user's, also one without an entry in /etc/passwd.
ENV PATH=/opt/tsbench/.venv/bin:$PATH HOME=/tmp
WORKDIR /work
ENTRYPOINT ["tsbench"]
CMD ["--help"]
