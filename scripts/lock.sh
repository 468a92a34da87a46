#!/usr/bin/env bash
# Writes constraints.txt from a fresh environment: the newest versions that each pyproject.toml allows.
# Usage: scripts/lock.sh [PYTHON]; run it with the oldest supported Python, since its pins
# must also install on the newer ones.
set -euo pipefail
cd "$(dirname "$0")/.."

python=${1:-python3}
torch=2.13.0 # changed by hand only: another version trains other weights

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"$python" -m venv "$scratch/venv"
"$scratch/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    -e '.[dev]' -e plugins/hubs -e plugins/ops -e plugins/pipelines -e 'plugins/protocols[test]' -e plugins/vision "torch==$torch"

{
    echo "# Exact versions of everything that \`make setup\` installs. Written by scripts/lock.sh; do not edit."
    "$scratch/venv/bin/python" -m pip list --format=freeze --exclude-editable --disable-pip-version-check |
        tr '[:upper:]' '[:lower:]' |
        sed -e '/^pip==/d' -e 's/^\(torch==[^+]*\)+.*/\1/' |
        LC_ALL=C sort
} >"$scratch/constraints.txt"
mv "$scratch/constraints.txt" constraints.txt
