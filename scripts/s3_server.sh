#!/usr/bin/env bash
# Makes .venv-s3 with moto, the S3 server that tests of object storages start. It has an environment
# of its own: botocore needs an older python-dateutil than the rest.
# Usage: scripts/s3_server.sh [PYTHON]
set -euo pipefail
cd "$(dirname "$0")/.."

if ! .venv-s3/bin/python -m pip --version >/dev/null 2>&1; then
    rm -rf .venv-s3
    "${1:-python3}" -m venv .venv-s3
fi
.venv-s3/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
    'moto[s3]==5.2.5' flask==3.1.3 flask-cors==6.0.5
touch .venv-s3/.installed
