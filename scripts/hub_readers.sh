#!/usr/bin/env bash
# Makes .venv-hub with the reader of Hugging Face data sets, which the tests of exports call. It has
# an environment of its own: datasets needs an older fsspec than the rest.
# Usage: scripts/hub_readers.sh [PYTHON]
set -euo pipefail
cd "$(dirname "$0")/.."

if ! .venv-hub/bin/python -m pip --version >/dev/null 2>&1; then
    rm -rf .venv-hub
    "${1:-python3}" -m venv .venv-hub
fi
.venv-hub/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
    datasets==4.8.5 'huggingface-hub>=0.34,<2' pyarrow==26.0.1 pandas==3.1.1
touch .venv-hub/.installed
