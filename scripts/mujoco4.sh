#!/usr/bin/env bash
# Makes .venv-mujoco4: this package with MuJoCo 4, without PyTorch and dm_control. A test flies there
# what it flies in .venv, and compares. It has an environment of its own: dm-control, which .venv
# has, needs an older MuJoCo.
# Usage: scripts/mujoco4.sh [PYTHON]
set -euo pipefail
cd "$(dirname "$0")/.."

if ! .venv-mujoco4/bin/python -m pip --version >/dev/null 2>&1; then
    rm -rf .venv-mujoco4
    "${1:-python3}" -m venv .venv-mujoco4
fi
constraints=$(mktemp)
trap 'rm -f "$constraints"' EXIT
grep -v '^mujoco' constraints.txt >"$constraints"
.venv-mujoco4/bin/python -m pip install --quiet --disable-pip-version-check \
    --constraint "$constraints" 'mujoco==4.*' '.[gym]'
touch .venv-mujoco4/.installed
