#!/usr/bin/env bash
# Makes stand-ins for the images that Dockerfile and docker-compose.yml begin with, where none can be pulled: as root, with
# Docker's engine running and debootstrap. FOLDER keeps what was downloaded. Prints the variables that compose is to be given.
#   tests/containers/make_bases.sh FOLDER > bases.env
set -euo pipefail
FOLDER=${1:?name a folder for what is downloaded and unpacked}
DEBIAN=${DEBIAN_RELEASE:-bookworm}
VERSITYGW=$(PATH="${XDG_CACHE_HOME:-$HOME/.cache}/trifarm/bin:$PATH" command -v versitygw) ||
  { echo "versitygw is missing; 'make homes' installs it" >&2; exit 1; }
mkdir -p "$FOLDER/packages"

if ! docker image inspect trifarm-stand-in-python > /dev/null 2>&1; then
  rm -rf "$FOLDER/root"
  debootstrap --variant=minbase --cache-dir="$(realpath "$FOLDER/packages")" \
    --include=ca-certificates,python3,python3-pip,python3-venv "$DEBIAN" "$FOLDER/root" >&2
  # As the official image has it: 'python', and a pip that installs for everybody.
  ln -sf python3 "$FOLDER/root/usr/bin/python"
  rm -f "$FOLDER"/root/usr/lib/python3*/EXTERNALLY-MANAGED "$FOLDER"/root/var/cache/apt/archives/*.deb
  # What this machine needs to reach its package index; a site's own bases would have the same.
  [ ! -e /etc/pip.conf ] || cp /etc/pip.conf "$FOLDER/root/etc/"
  cp /etc/ssl/certs/ca-certificates.crt "$FOLDER/root/etc/ssl/certs/"
  tar -C "$FOLDER/root" -c . | docker import - trifarm-stand-in-python >&2
  rm -rf "$FOLDER/root"
fi

docker build --quiet --network host --tag trifarm-stand-in-postgres - >&2 <<'DOCKERFILE'
FROM trifarm-stand-in-python
RUN apt-get update -q && apt-get install -y -q --no-install-recommends postgresql && rm -rf /var/lib/apt/lists/* \
    && mkdir -p /var/lib/postgresql/data && chown postgres /var/lib/postgresql/data \
    # As in the official image: a disk in memory that is mounted there takes this mode over.
    && chmod 3777 /var/run/postgresql
# What the official image does with its variables, as far as the compose file uses them.
RUN printf '%s\n' '#!/bin/sh' 'set -eu' 'bin=$(echo /usr/lib/postgresql/*/bin)' 'data=/var/lib/postgresql/data' \
      'if [ ! -e "$data/PG_VERSION" ]; then' \
      '  printf %s "$POSTGRES_PASSWORD" > /tmp/word' \
      '  "$bin/initdb" -D "$data" -U "$POSTGRES_USER" --pwfile=/tmp/word --auth-host=scram-sha-256 --auth-local=trust -E UTF8 --locale=C.UTF-8' \
      '  rm /tmp/word' \
      '  echo "host all all all scram-sha-256" >> "$data/pg_hba.conf"' \
      '  "$bin/pg_ctl" -D "$data" -o "-c listen_addresses= -k /tmp" -w start' \
      '  "$bin/createdb" -h /tmp -U "$POSTGRES_USER" "$POSTGRES_DB" || true' \
      '  "$bin/pg_ctl" -D "$data" -m fast -w stop' \
      'fi' 'exec "$bin/postgres" -D "$data" -c "listen_addresses=*" -k /var/run/postgresql' > /usr/local/bin/begin \
    && chmod 755 /usr/local/bin/begin
USER postgres
ENTRYPOINT ["/usr/local/bin/begin"]
DOCKERFILE

mkdir -p "$FOLDER/s3"
cp "$VERSITYGW" "$FOLDER/s3/versitygw"
printf '%s\n' 'FROM trifarm-stand-in-python' \
  'RUN apt-get update -q && apt-get install -y -q --no-install-recommends wget && rm -rf /var/lib/apt/lists/*' \
  'COPY versitygw /usr/local/bin/versitygw' > "$FOLDER/s3/Dockerfile"
docker build --quiet --network host --tag trifarm-stand-in-s3 "$FOLDER/s3" >&2

echo PYTHON_IMAGE=trifarm-stand-in-python
echo POSTGRES_IMAGE=trifarm-stand-in-postgres
echo S3_IMAGE=trifarm-stand-in-s3
