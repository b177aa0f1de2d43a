# companion on a companion computer, a server or BlueOS: see docs/aboard.md.
#   docker build -t companion .
#   docker run --rm --network host -v "$PWD:/recordings" companion watch udpin:0.0.0.0:14550
FROM python:3.12-slim AS build
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY companion companion
COPY config config
COPY tlogs tlogs
RUN pip install --no-cache-dir --no-compile --prefix=/installed .

FROM python:3.12-slim
COPY --from=build /installed /usr/local
# It runs, or the image is not built; what it imports is compiled by that. All of pymavlink's dialects would be 45 MB more.
RUN companion doctor && companion check demo --fail-on insufficient
RUN useradd --create-home --uid 1000 --groups dialout companion && mkdir /recordings && chown companion /recordings
USER companion
WORKDIR /recordings
VOLUME /recordings
ENV XDG_STATE_HOME=/recordings/.state PYTHONUNBUFFERED=1
STOPSIGNAL SIGTERM
# A BlueOS extension: https://blueos.cloud/docs/latest/development/extensions. {tag} is BlueOS's, the version of the image.
ARG REPOSITORY=OWNER/companion
LABEL version="0.1.0" \
      type="tool" \
      tags='["data-collection", "imu", "ekf"]' \
      authors='[{"name": "The companion developers"}]' \
      company='{"name": "companion", "about": "Does this IMU agree with this autopilot, and which of them is wrong?"}' \
      readme="https://raw.githubusercontent.com/${REPOSITORY}/v{tag}/docs/aboard.md" \
      links="{\"source\": \"https://github.com/${REPOSITORY}\", \"documentation\": \"https://github.com/${REPOSITORY}/blob/main/docs/aboard.md\"}" \
      requirements="core >= 1.1" \
      permissions='{"NetworkMode": "host", "HostConfig": {"Binds": ["/usr/blueos/userdata/companion:/recordings"]}}'
ENTRYPOINT ["companion"]
CMD ["watch", "tcp:127.0.0.1:5777"]
