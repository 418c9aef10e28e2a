# Runs both commands of the README as an ordinary user:
#     docker build -t grasp . && docker run --rm grasp
# No container engine has built this file yet. Its steps were run by hand in a minimal Debian 12.
FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates make python3 python3-venv \
    && rm -rf /var/lib/apt/lists/*
RUN useradd --create-home lab && install -d -o lab /home/lab/grasp
USER lab
WORKDIR /home/lab/grasp
COPY --chown=lab . .
RUN make install-dev
CMD ["bash", "-c", "make lift && make test"]
