"""Whether ten hours of both presets have the arrays that they had, bit for bit.

    python -m benchmarks.unchanged_arrays
    python -m benchmarks.unchanged_arrays --write    # after a change of the physics on purpose

The same for one hour is in the tests. Hashes: tests/data/arrays.json.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from unchanged import KEPT, PRESETS, SEED, differences, expected_hashes

from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from twin.records.storage.checksums import array_checksums

HOURS = (1, 10)


def made(hours: int, preset: str) -> dict[str, str]:
    """Hashes of the arrays that this program makes."""
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "missions.zarr"
        generate(make_recipe(preset=preset, hours=hours, seed=SEED), store)
        return array_checksums(store)


def main() -> int:
    """Say what differs, 1 when something does; or keep the hashes of now."""
    found = {h: {preset: made(h, preset) for preset in PRESETS} for h in HOURS}
    if sys.argv[1:] == ["--write"]:
        kept = {f"{h} h": found[h] for h in HOURS}
        KEPT.write_text(json.dumps(kept, indent=0) + "\n", encoding="utf-8")
        return 0
    changed = 0
    for preset in PRESETS:
        names = differences(found[10][preset], expected_hashes(10, preset))
        changed += len(names)
        verdict = f"DIFFERENT: {', '.join(names)}" if names else "all equal"
        print(f"{preset}, 10 h, {len(found[10][preset])} arrays: {verdict}")
    return int(changed > 0)


if __name__ == "__main__":
    sys.exit(main())
