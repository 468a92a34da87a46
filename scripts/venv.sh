#!/usr/bin/env bash
# Makes .venv with the versions of constraints.txt and this package installed editable, and beside it
# what s3_server.sh and hub_readers.sh make.
# Usage: scripts/venv.sh [PYTHON]
set -euo pipefail
cd "$(dirname "$0")/.."

python=${1:-python3}

if ! command -v "$python" >/dev/null; then
    echo "setup: '$python' is not there: install Python 3.11 or newer (Debian: apt-get install python3 python3-venv)" >&2
    exit 1
fi
if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "setup: '$python' is $("$python" -V 2>&1), but 3.11 or newer is needed: make setup PYTHON=python3.12, say" >&2
    exit 1
fi
if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
    # Debian splits venv off. Its package is named after the interpreter's minor version.
    package="$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')"
    echo "setup: '$python' cannot make virtual environments: it lacks the package $package" >&2
    export DEBIAN_FRONTEND=noninteractive
    if ! { [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null && apt-get update -qq >/dev/null &&
        apt-get install -y -qq --no-install-recommends "$package" >/dev/null; }; then
        echo "setup: install it (apt-get install $package) and call make again" >&2
        exit 1
    fi
fi

# An environment left by an interrupted run, or made by an interpreter that is gone, is made again.
if ! .venv/bin/python -m pip --version >/dev/null 2>&1; then
    rm -rf .venv
    "$python" -m venv .venv
fi
# The tests' own environments are made meanwhile: pip takes one processor, and waits for its index.
scripts/s3_server.sh .venv/bin/python &
s3=$!
scripts/hub_readers.sh .venv/bin/python &
hub=$!
trap 'kill $s3 $hub 2>/dev/null || true' EXIT
echo "setup: installing the pinned dependencies into .venv (some minutes the first time)" >&2
.venv/bin/python -m pip install --quiet --disable-pip-version-check \
    --constraint constraints.txt --editable '.[dev]' \
    --editable plugins/hubs --editable plugins/ops --editable plugins/pipelines --editable 'plugins/protocols[test]' \
    --editable plugins/vision

# From Python 3.13 on dm-control goes in alone: labmaze, which it asks for, cannot be installed there.
# pyproject.toml names the rest of what it needs. That labmaze is missing is then the one complaint
# that is right.
missing=''
if ! .venv/bin/python -c 'import sys; sys.exit(sys.version_info >= (3, 13))'; then
    .venv/bin/python -m pip install --quiet --disable-pip-version-check \
        --constraint constraints.txt --no-deps dm-control
    missing='^dm-control [^ ]+ requires labmaze, which is not installed\.$'
fi
if ! complaints=$(.venv/bin/python -m pip check --disable-pip-version-check 2>&1); then
    complaints=$(grep -Ev "${missing:-^$}" <<<"$complaints" || true)
    if [ -n "$complaints" ]; then
        echo "$complaints" >&2
        exit 1
    fi
fi
wait $s3
wait $hub
touch .venv/.installed
