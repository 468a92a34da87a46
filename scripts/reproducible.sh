#!/usr/bin/env bash
# Builds wheel and source distribution from two clones, with other rights, times and folders, and
# compares their bytes. Prints the sums; ends with 1 where they differ.
# Usage: scripts/reproducible.sh [COMMIT] (default: HEAD); PYTHON chooses the interpreter.
set -euo pipefail
cd "$(dirname "$0")/.."

python=$(realpath -s "${PYTHON:-.venv/bin/python}")
commit=$(git rev-parse "${1:-HEAD}")
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

for mask in 022 077; do
    (
        umask "$mask"
        folder="$scratch/clone-$mask"
        git clone --quiet --no-hardlinks . "$folder"
        git -C "$folder" checkout --quiet "$commit"
        find "$folder" -type f -name '*.py' -exec touch -d "2001-02-0$((${mask:2:1} + 1)) 03:04:05" {} +
        cd "$folder"
        "$python" -m hatchling build >/dev/null 2>&1
        cd dist && sha256sum -- * >"$scratch/sums-$mask"
    )
done
cat "$scratch/sums-022"
if ! cmp -s "$scratch/sums-022" "$scratch/sums-077"; then
    echo "reproducible: the second clone gave other bytes:" >&2
    cat "$scratch/sums-077" >&2
    exit 1
fi
echo "reproducible: the same bytes from two clones"
