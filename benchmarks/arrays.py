"""Arrays of stores: comparison with kept hashes or another store, and lists of reference sets.

    python -m benchmarks.arrays                     # ten hours of both presets beside kept hashes
    python -m benchmarks.arrays --write             # after a change of the physics on purpose
    python -m benchmarks.arrays OLD.zarr NEW.zarr   # for a new version of the physics
    python -m benchmarks.arrays STORE --reference assets/reference/NAME.json

The hashes are in tests/data/arrays.json; the tests compare one hour. Two stores of one recipe, the
old one from the earlier program, are compared in a Markdown table, with angles as the shortest
difference. A new version of the physics needs new lists of its reference sets: generate the store
with the recipe's command, `factory generate --preset PRESET --hours HOURS --seed SEED`.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks import command
from benchmarks.processes import ROOT

sys.path.insert(0, str(ROOT / "tests"))

from unchanged import KEPT, PRESETS, SEED, differences, expected_hashes

from factory.generation.generated_store import open_missions
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from twin.records.storage.checksums import array_checksums

HOURS = (1, 10)


def made(hours: int, preset: str) -> dict[str, str]:
    """Hash the arrays that this program makes."""
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "missions.zarr"
        generate(make_recipe(preset=preset, hours=hours, seed=SEED), store)
        return array_checksums(store)


def changed(old: xr.Dataset, new: xr.Dataset) -> str:
    """Table of the arrays that differ, followed by the names of the others."""
    same, rows = [], []
    for name in sorted(set(map(str, old.variables)) & set(map(str, new.variables))):
        a, b = old[name].values, new[name].values
        unit = old[name].attrs.get("units", "1")
        if a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f"):
            same.append(name)
        elif a.shape != b.shape or a.dtype.kind not in "fiu":
            rows.append([f"`{name}`", "", "other shape or text", "", ""])
        else:
            change = b.astype(float) - a.astype(float)
            if unit == "degree":
                change = (change + 180.0) % 360.0 - 180.0
            sizes = np.nanstd(a), np.sqrt(np.nanmean(change**2)), np.nanmax(np.abs(change))
            rows.append([f"`{name}`", unit, *(f"{size:.3g}" for size in sizes)])
    head = ["array", "unit", "its deviation", "RMS of the change", "largest change"]
    said = [command.markdown(head, rows)]
    gone, more = (
        set(map(str, {*a.variables} - {*b.variables})) for a, b in ((old, new), (new, old))
    )
    for what, names in ((f"Equal bit for bit, {len(same)}", same), ("New", more), ("Gone", gone)):
        if names:
            said.append(f"{what}: {', '.join(f'`{name}`' for name in sorted(names))}.")
    return "\n\n".join(said)


def main(
    stores: command.Positional[tuple[Path, ...]] = (),
    *,
    write: bool = False,
    reference: Path | None = None,
) -> int:
    """Print the differences, with exit code 1 if there are any; or keep the present hashes."""
    if reference is not None:
        (store,) = stores
        missions = open_missions(store)
        entry = {
            **{name: missions.attributes[name] for name in ("preset", "hours", "seed")},
            "physics": int(missions.settings["versions"]["physics"]),
            "arrays": array_checksums(store),
        }
        reference.write_text(json.dumps(entry, indent=1) + "\n")
        return 0
    if stores:
        print(changed(*(xr.open_zarr(path, decode_times=False) for path in stores)))
        return 0
    found = {h: {preset: made(h, preset) for preset in PRESETS} for h in HOURS}
    if write:
        kept = {f"{h} h": found[h] for h in HOURS}
        KEPT.write_text(json.dumps(kept, indent=0) + "\n", encoding="utf-8")
        return 0
    differing = {p: differences(found[10][p], expected_hashes(10, p)) for p in PRESETS}
    for preset, names in differing.items():
        verdict = f"DIFFERENT: {', '.join(names)}" if names else "all equal"
        print(f"{preset}, 10 h, {len(found[10][preset])} arrays: {verdict}")
    return int(any(differing.values()))


if __name__ == "__main__":
    sys.exit(command.run(main))
