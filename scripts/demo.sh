#!/usr/bin/env bash
# The main job from end to end, into demo/, which is overwritten.
set -euo pipefail
cd "$(dirname "$0")/.."

export PATH="$PWD/.venv/bin:$PATH"
rm -rf demo
mkdir demo
cd demo

# Shows each command as a user would type it.
step() {
    echo
    echo "\$ $*"
    "$@"
}

step twin simulate --out run.zarr --plot run.png
step factory generate --hours 10
step learn fit --name demo
# pictures need OpenGL; without it the rest of the demonstration stands
step twin render run.zarr --out dive.png || echo "no picture: see the message above"

echo
echo "mission:  demo/run.png, demo/run.zarr"
echo "missions: demo/data/missions.zarr"
echo "report:   demo/runs/demo/report/index.html"
