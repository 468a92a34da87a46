#!/usr/bin/env bash
# Makes .venv-lerobot with LeRobot, whose own reader then opens `factory export --to lerobot` in the
# tests. Not part of `make setup`: it needs torch below 2.11, which takes 8.4 GB with CUDA's libraries
# where pip finds no CPU build.
# Usage: scripts/lerobot.sh [PYTHON]
set -euo pipefail
cd "$(dirname "$0")/.."

if ! .venv-lerobot/bin/python -m pip --version >/dev/null 2>&1; then
    rm -rf .venv-lerobot
    "${1:-python3}" -m venv .venv-lerobot
fi
.venv-lerobot/bin/python -m pip install --quiet --disable-pip-version-check lerobot==0.4.4
touch .venv-lerobot/.installed
