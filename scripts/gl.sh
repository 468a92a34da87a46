#!/usr/bin/env bash
# Makes sure that MuJoCo can draw without a screen (EGL). Installs Debian's packages when it may;
# otherwise it names them and lets everything that draws nothing go on.
set -euo pipefail
cd "$(dirname "$0")/.."

# EGL itself, the OpenGL library that PyOpenGL calls, and Mesa's driver that draws on the CPU.
packages="libegl1 libopengl0 libgl1-mesa-dri"
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
    export DEBIAN_FRONTEND=noninteractive
    # shellcheck disable=SC2086
    if apt-get update -qq >/dev/null &&
        apt-get install -y -qq --no-install-recommends $packages >/dev/null && draws; then
        touch "$stamp"
        exit 0
    fi
fi
echo "setup: no EGL context could be made, so renders will not work; on Debian: apt-get install $packages" >&2
