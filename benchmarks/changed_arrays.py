"""What changes between two stores of one recipe, array by array, as a table in Markdown.

    python -m benchmarks.changed_arrays OLD.zarr NEW.zarr

For a new version of the physics: the old store is made by the program before it. Angles are
compared the short way round.
"""

from __future__ import annotations

import sys

import numpy as np
import xarray as xr


def main() -> int:
    """Print the table; 2 for other arguments."""
    if len(sys.argv) != 3:
        print("usage: python -m benchmarks.changed_arrays OLD.zarr NEW.zarr", file=sys.stderr)
        return 2
    old, new = (xr.open_zarr(path, decode_times=False) for path in sys.argv[1:])
    same, rows = [], []
    for name in sorted(set(map(str, old.variables)) & set(map(str, new.variables))):
        a, b = old[name].values, new[name].values
        if a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f"):
            same.append(name)
            continue
        if a.shape != b.shape or a.dtype.kind not in "fiu":
            rows.append(f"| `{name}` | | other shape or text | |")
            continue
        change = b.astype(float) - a.astype(float)
        if old[name].attrs.get("units") == "degree":
            change = (change + 180.0) % 360.0 - 180.0
        rms, largest = np.sqrt(np.nanmean(change**2)), np.nanmax(np.abs(change))
        unit = old[name].attrs.get("units", "1")
        rows.append(f"| `{name}` | {unit} | {np.nanstd(a):.3g} | {rms:.3g} | {largest:.3g} |")
    print("| array | unit | its deviation | RMS of the change | largest change |")
    print("|---|---|---|---|---|")
    print("\n".join(rows))
    print(f"\nEqual bit for bit, {len(same)}: {', '.join(f'`{n}`' for n in same)}.")
    for what, names in (
        ("New", set(new.variables) - set(old.variables)),
        ("Gone", set(old.variables) - set(new.variables)),
    ):
        if names:
            print(f"\n{what}: {', '.join(f'`{n}`' for n in sorted(map(str, names)))}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
