#!/usr/bin/env bash
# Makes sure that the tests of pages find a browser. Installs Debian's chromium when it may;
# otherwise it names it, and those tests skip themselves.
set -euo pipefail

if command -v chromium >/dev/null || command -v chromium-browser >/dev/null ||
    command -v google-chrome >/dev/null; then
    exit 0
fi
if [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
    echo "setup: installing chromium for the tests of pages" >&2
    export DEBIAN_FRONTEND=noninteractive
    if apt-get update -qq >/dev/null &&
        apt-get install -y -qq --no-install-recommends chromium >/dev/null; then
        exit 0
    fi
fi
echo "setup: there is no browser, so the tests of pages skip themselves; on Debian: apt-get install chromium" >&2
