#!/usr/bin/env bash
# The main job from end to end, into demo/, which is overwritten. The first picture comes after the
# first command.
set -euo pipefail
cd "$(dirname "$0")/.."

export PATH="$PWD/.venv/bin:$PATH"
rm -rf demo
mkdir demo
cd demo

# Shows what comes and the command as a user would type it.
step() {
    echo
    echo "# $1 ($SECONDS s)"
    shift
    echo "\$ $*"
    "$@"
}

step "a glider flies for an hour through eddies and the wind's drift, which turns with depth" \
    twin simulate --current geostrophic:surface=0.25,direction=50,scale=60+ekman:tau=0.1,direction=20,lat=45 \
    --out run.zarr --plot run.png
echo "open demo/run.png"
step "the same hour as a page that plays in any browser" \
    twin render run.zarr --html dive.html
echo "open demo/dive.html"
# a picture needs OpenGL; without it the rest of the demonstration stands
step "and as a picture" \
    twin render run.zarr --out dive.png || echo "no picture: see the message above"
step "ten hours of missions, each with a vehicle, a plan and a current of its own" \
    factory generate --hours 10
step "networks learn surge and sway from them in 10 s, and are judged on missions that they never saw" \
    learn fit --name demo --seconds 10 --members 1

cat <<END

Done in $SECONDS s. Open
    demo/run.png                         depth, track, current and actuators of the hour
    demo/dive.html, demo/dive.png        the hour to watch
    demo/runs/demo/report/index.html     how far off the networks are, and the older methods
The data are demo/run.zarr and demo/data/missions.zarr: xarray.open_zarr reads both.

To try next, with .venv/bin on the path (source .venv/bin/activate):
    twin vehicles                                                 other vehicles: simulate --vehicle
    twin simulate --navigate ekf --sensors field --out own.zarr   guided by what is known on board
    factory generate --preset field --hours 20 --out field.zarr   sensor errors, tides, GPS
    learn fit field.zarr --seconds 30                             networks for these missions
docs/gallery.md has pictures of what else there is, docs/index.md leads on.
END
