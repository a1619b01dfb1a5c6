# CarlaLoc without a screen and without a GPU:
#   docker build -t carlaloc . && docker run --rm -v "$PWD:/data" -w /data carlaloc record --duration 20 --out drive.mcap
FROM python:3.11-slim-bookworm AS libraries

# The libraries of .ci/system-libraries: OpenGL by software, and what Embree and libusb users need.
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        libegl1 \
        libgl1 \
        libgl1-mesa-dri \
        libidn2-0 \
        libusb-1.0-0 \
    && rm -rf /var/lib/apt/lists/*
RUN useradd --create-home driver

# For .devcontainer, where `make setup` installs the checkout that is mounted.
FROM libraries AS development
RUN apt-get update \
    && apt-get install -y --no-install-recommends git make \
    && rm -rf /var/lib/apt/lists/*
USER driver

FROM libraries
COPY . /opt/carlaloc
RUN pip install --no-cache-dir "/opt/carlaloc[slam,report]" && rm -rf /opt/carlaloc

# Built towns and compiled code are kept here; mount a volume to keep them between runs.
ENV CARLALOC_CACHE=/var/cache/carlaloc
RUN mkdir -p /var/cache/carlaloc && chown driver /var/cache/carlaloc
USER driver
ENTRYPOINT ["carlaloc"]
CMD ["--help"]
