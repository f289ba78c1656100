# gtf-tune with pycolmap's GLOMAP and COLMAP, on the CPU.
#
#     docker build -t gtf-tune .
#     docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" gtf-tune tune photos/ --minutes 30
FROM python:3.12-slim
# Debian removes old versions of its packages, so that pinned ones could not be installed a month later.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends git libgl1 libglib2.0-0 libgomp1 \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /opt/gtf-tune
COPY pyproject.toml constraints.txt README.md LICENSE CHANGELOG.md ./
COPY gtf_tune gtf_tune
RUN pip install --no-cache-dir -c constraints.txt '.[postgres,heic]'
ENV GTF_TUNE_CACHE_DIR=/work/.gtf-tune-cache
WORKDIR /work
ENTRYPOINT ["gtf-tune"]
CMD ["--help"]
