# Two images, one for each program: "api" (HTTP, dispatcher, bus router; no physics, no learning) and "robot" (simulated robots).
#   docker build --target api --tag trifarm-api .
#   docker build --target robot --tag trifarm-robot .
# and "s3", the S3 server of the compose file without root. A site's own bases: --build-arg PYTHON_IMAGE=..., S3_IMAGE=...

ARG PYTHON_IMAGE=python:3.11-slim
ARG S3_IMAGE=versity/versitygw:v1.8.0

FROM ${S3_IMAGE} AS s3
# A new volume takes over whom its folder belongs to; each bucket is a folder of it.
USER root
RUN mkdir -p /files/trifarm && chown -R 10001:10001 /files
USER 10001
VOLUME /files

FROM ${PYTHON_IMAGE} AS python
ENV PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 ORT_DISABLE_TELEMETRY=1
RUN useradd --create-home --uid 10001 trifarm && mkdir /data && chown trifarm /data
WORKDIR /opt/trifarm
# The pins change seldom, so that the layers after these are kept when only our code changes.
COPY constraints.txt pyproject.toml README.md LICENSE ./

FROM python AS api
RUN python -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['dependency-groups']['api-image'], sep='\n')" \
      > /tmp/needed.txt \
    && pip install --requirement /tmp/needed.txt --constraint constraints.txt && rm /tmp/needed.txt
COPY api_schemas api_schemas
COPY jail jail
COPY trial_logs trial_logs
COPY report_views report_views
COPY services services
RUN pip install --no-deps .
# Away from the sources, so that what runs is what was installed.
WORKDIR /home/trifarm
USER trifarm
# What is missing shows here, not when the first user comes.
RUN python -c "import services.router, services.serve, services.policies.jailed_conversion"
VOLUME /data
EXPOSE 8787 7447
ENTRYPOINT ["python", "-m", "services"]
CMD ["serve", "--data", "/data", "--host", "0.0.0.0", "--port", "8787", "--bus", "tcp/0.0.0.0:7447"]

FROM python AS robot
RUN python -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['dependency-groups']['robot-image'], sep='\n')" \
      > /tmp/needed.txt \
    && pip install --requirement /tmp/needed.txt --constraint constraints.txt && rm /tmp/needed.txt
COPY api_schemas api_schemas
COPY jail jail
COPY trial_logs trial_logs
COPY report_views report_views
COPY sim_backend sim_backend
COPY robot_farm robot_farm
RUN pip install --no-deps .
WORKDIR /home/trifarm
USER trifarm
# Robots find their functions compiled.
RUN python -m sim_backend.warm_up && python -c "import robot_farm.robot"
VOLUME /data
ENTRYPOINT ["python", "-m", "robot_farm"]
CMD ["--help"]
