#!/usr/bin/env bash
# Makes sure that MuJoCo can draw without a screen (EGL). Installs Debian's packages when it may;
# otherwise it names them and lets everything that draws nothing go on.
set -euo pipefail
cd "$(dirname "$0")/.."

packages="libegl1 libgl1-mesa-dri"
stamp=.venv/.gl

draws() {
    MUJOCO_GL=egl .venv/bin/python - >/dev/null 2>&1 <<'PYTHON'
import mujoco

context = mujoco.GLContext(16, 16)
context.make_current()
context.free()
PYTHON
}

if [ -e "$stamp" ] || draws; then
    touch "$stamp"
    exit 0
fi
if [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
    echo "setup: installing $packages for drawing without a screen" >&2
    # shellcheck disable=SC2086
    if (apt-get update -qq && apt-get install -y -qq --no-install-recommends $packages) >&2 && draws; then
        touch "$stamp"
        exit 0
    fi
fi
echo "setup: no EGL context could be made, so renders will not work; on Debian: apt-get install $packages" >&2
