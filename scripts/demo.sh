#!/usr/bin/env bash
# The main job from end to end, into demo/, which is overwritten.
set -euo pipefail
cd "$(dirname "$0")/.."

out=demo
rm -rf "$out"
mkdir "$out"
export PATH="$PWD/.venv/bin:$PATH"

# Shows each command as a user would type it.
step() {
    echo "\$ $*"
    "$@"
}

step twin simulate --out "$out/run.zarr" --plot "$out/run.png"
