# The toolbox without QGIS: docker build -t lidar-toolbox .
#   docker run --rm --network none -v "$PWD:/data" lidar-toolbox info town.laz
FROM python:3.12-slim AS build
WORKDIR /source
COPY pyproject.toml README.md LICENSE CHANGELOG.md ./
COPY metadata metadata
COPY toolbox toolbox
COPY algorithms algorithms
RUN python -m venv /opt/toolbox && /opt/toolbox/bin/pip install --no-cache-dir .

FROM python:3.12-slim
COPY --from=build /opt/toolbox /opt/toolbox
# numba needs a folder for compiled loops that the user may write to, and libgomp for its threads;
# rasterio needs libexpat. All else that the wheels ask for is in them or in the image of Python.
RUN apt-get update && apt-get install --yes --no-install-recommends libexpat1 libgomp1 \
    && rm -rf /var/lib/apt/lists/* && useradd --create-home toolbox
ENV NUMBA_CACHE_DIR=/home/toolbox/.cache/numba
USER toolbox
WORKDIR /data
ENTRYPOINT ["/opt/toolbox/bin/lidar-toolbox"]
CMD ["--help"]
