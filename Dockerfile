# The service over HTTP and WebSocket: docker compose up. `make viewer` before it puts the page in; without it there is none.
FROM python:3.12-slim AS build
WORKDIR /build
COPY requirements/serve.lock requirements/
RUN python -m venv /opt/signsplice && /opt/signsplice/bin/python -m pip install --no-cache-dir --only-binary :all: \
    --require-hashes --requirement requirements/serve.lock
COPY pyproject.toml hatch_build.py README.md LICENSE NOTICE ./
COPY LICENSES LICENSES
COPY src src
RUN /opt/signsplice/bin/python -m pip install --no-cache-dir --no-deps --no-build-isolation .

FROM python:3.12-slim
RUN useradd --system --no-create-home signsplice
COPY --from=build /opt/signsplice /opt/signsplice
USER signsplice
EXPOSE 8000
HEALTHCHECK --start-period=60s --interval=30s --timeout=5s CMD ["/opt/signsplice/bin/python", "-c", \
    "from urllib.request import urlopen; urlopen('http://127.0.0.1:8000/healthz', timeout=4)"]
ENTRYPOINT ["/opt/signsplice/bin/signsplice", "serve", "--host", "0.0.0.0"]
