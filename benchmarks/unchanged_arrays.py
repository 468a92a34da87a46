"""Whether ten hours of both presets have the arrays that they had at e2ff189, bit for bit.

    python benchmarks/unchanged_arrays.py

The same for one hour is in the tests. Hashes: tests/data/e2ff189/arrays.json.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from unchanged import PRESETS, SEED, array_hashes, differences, expected_hashes

from factory.generation.bulk import generate
from factory.recipe.recipe import make_recipe

HOURS = 10


def main() -> int:
    """Say what differs; 1 when something does."""
    changed = 0
    with tempfile.TemporaryDirectory() as folder:
        for preset in PRESETS:
            store = Path(folder) / f"{preset}.zarr"
            summary = generate(make_recipe(preset=preset, hours=HOURS, seed=SEED), store)
            found, expected = array_hashes(store), expected_hashes(HOURS, preset)
            names = differences(found, expected)
            changed += len(names)
            verdict = f"DIFFERENT: {', '.join(names)}" if names else "all equal"
            print(f"{preset}, {HOURS} h in {summary.wall_s:.1f} s, {len(found)} arrays: {verdict}")
    return int(changed > 0)


if __name__ == "__main__":
    sys.exit(main())
