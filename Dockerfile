# curvescan in a container whose kernels are compiled when it is built:
#   docker build --tag curvescan .
#   docker run --rm --volume "$PWD:/data" curvescan slam /data/office.bag --out /data/results
FROM python:3.12-slim AS build
COPY . /source
# what `curvescan --version` says; the image is built without the repository:
#   docker build --build-arg COMMIT="$(git rev-parse HEAD)" --tag curvescan .
ARG COMMIT=""
ENV CURVESCAN_COMMIT=$COMMIT
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels /source

FROM python:3.12-slim
COPY --from=build /wheels /wheels
# the versions that the image was tried with; `make pins` takes new ones
COPY constraints.txt /wheels/
ARG CONSTRAINTS=/wheels/constraints.txt
RUN pip install --no-cache-dir --constraint "$CONSTRAINTS" "$(echo /wheels/*.whl)[cloud,lidar]" && rm -r /wheels

ENV NUMBA_CACHE_DIR=/var/cache/curvescan/kernels \
    MPLCONFIGDIR=/var/cache/curvescan/matplotlib \
    MPLBACKEND=Agg

# Machine code for any processor of this kind: code for the one that builds would be compiled anew on others. The main
# job makes the fonts' cache. Whoever the container runs as may write to the caches.
RUN mkdir -p "$NUMBA_CACHE_DIR" "$MPLCONFIGDIR" \
    && curvescan warm-up --cache "$NUMBA_CACHE_DIR" \
    && NUMBA_CPU_NAME=generic curvescan demo --out /tmp/demo \
    && rm -r /tmp/demo \
    && chmod -R a+rwX /var/cache/curvescan

RUN useradd --create-home curvescan
USER curvescan
WORKDIR /data
ENTRYPOINT ["curvescan"]
CMD ["--help"]
