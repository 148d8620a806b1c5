#!/usr/bin/env bash
# Installs what the tests of PostgreSQL and S3 run against. What cannot be installed is said, and its tests are skipped.
set -uo pipefail
VERSITYGW=v1.8.0
TOOLS="${XDG_CACHE_HOME:-$HOME/.cache}/trifarm/bin"

database() {
  if ! command -v initdb > /dev/null && ! compgen -G "/usr/lib/postgresql/*/bin/initdb" > /dev/null; then
    if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
      apt-get update -qq && apt-get install -y -qq --no-install-recommends postgresql > /dev/null || echo "PostgreSQL was not installed"
    else
      echo "PostgreSQL is missing: install your system's package 'postgresql', version 15 or newer"
    fi
  fi
}

files() {
  if ! command -v versitygw > /dev/null && [ ! -x "$TOOLS/versitygw" ]; then
    if command -v go > /dev/null; then
      mkdir -p "$TOOLS"
      GOBIN="$TOOLS" go install "github.com/versity/versitygw/cmd/versitygw@$VERSITYGW" || echo "versitygw was not installed"
    else
      echo "versitygw is missing: install Go, or put the program into $TOOLS"
    fi
  fi
}

files &  # compiles for a minute, while the other loads
database
wait
exit 0
