# Two images from one installation: "api" (HTTP, dispatcher and bus router) and "robot" (simulated robots).
#   docker build --target api --tag trifarm-api .
#   docker build --target robot --tag trifarm-robot .

ARG PYTHON_IMAGE=python:3.11-slim

FROM ${PYTHON_IMAGE} AS installed
ENV PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 ORT_DISABLE_TELEMETRY=1
WORKDIR /opt/trifarm
# The pins change seldom, so that this layer is kept when only our code changes.
COPY constraints.txt pyproject.toml README.md LICENSE ./
RUN python -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['dependencies'], sep='\n')" \
      > /tmp/requirements.txt \
    && pip install --requirement /tmp/requirements.txt --constraint constraints.txt \
    && rm /tmp/requirements.txt
COPY api_schemas api_schemas
COPY sim_backend sim_backend
COPY robot_farm robot_farm
COPY services services
COPY client_cli client_cli
RUN pip install --no-deps . \
    && useradd --create-home --uid 10001 trifarm \
    && mkdir /data \
    && chown trifarm /data
# Away from the sources, so that what runs is what was installed.
WORKDIR /home/trifarm
USER trifarm
VOLUME /data

FROM installed AS robot
ENTRYPOINT ["python", "-m", "robot_farm"]
CMD ["--help"]

FROM installed AS api
EXPOSE 8787 7447
ENTRYPOINT ["python", "-m", "services"]
CMD ["serve", "--data", "/data", "--host", "0.0.0.0", "--port", "8787", "--bus", "tcp/0.0.0.0:7447"]
