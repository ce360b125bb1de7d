# An image in which `make demo` and `make test` run without downloading anything:
#   docker build -t v3studio .                            # CPU build of PyTorch
#   docker build -t v3studio:cuda --build-arg TORCH=cuda .    # CUDA build; run it with: docker run --gpus all
#   docker run --rm -v "$PWD/takes:/takes" v3studio make demo DEMO_TAKE=/takes/demo
ARG BASE=debian:12-slim
FROM ${BASE}

RUN apt-get update \
    && apt-get install -y --no-install-recommends ca-certificates git make python3 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /v3studio
# First what changes rarely, so that a change of our code does not download the packages again.
COPY Makefile pyproject.toml requirements.lock requirements-dev.lock ./
COPY scripts scripts
ARG TORCH=cpu
# The tests' set too: then `make test` holds in a container without a network.
RUN bash scripts/system_packages.sh --tests && rm -rf /var/lib/apt/lists/*
RUN PIP_NO_CACHE_DIR=1 V3STUDIO_TORCH=${TORCH} bash scripts/setup.sh --packages-only dev

COPY . .
# Tests list our files by `git ls-files`, and the history is not copied into the image.
RUN git init --quiet && make setup-tests

ENV PATH=/v3studio/.venv/bin:$PATH
CMD ["v3studio", "--help"]
