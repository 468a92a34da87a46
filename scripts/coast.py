"""Coast file `twin/show/figures/coast.npz` for maps, made from the world's land as TopoJSON.

    python scripts/coast.py land-50m.json

`land-50m.json` is part of world-atlas 2.0.2 (npm), which holds Natural Earth 4.1.0, 1:50m land;
`twin/show/figures/coast.md` states source and licence. Nothing is simplified: the file keeps the
integer grid (0.0036 degree of longitude, 0.0017 of latitude) as steps from point to point.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

OUT = Path(__file__).resolve().parents[1] / "twin" / "show" / "figures" / "coast.npz"


def rings(topology: dict) -> list[np.ndarray]:
    """Closed rings of the land on the file's integer grid, each (points, 2): x, y."""
    arcs = [np.cumsum(np.array(arc, np.int64), axis=0) for arc in topology["arcs"]]

    def join(indices: list[int]) -> np.ndarray:
        parts = [arcs[i] if i >= 0 else arcs[~i][::-1] for i in indices]
        return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])

    shapes = topology["objects"]["land"]["geometries"]
    return [join(ring) for shape in shapes for polygon in shape["arcs"] for ring in polygon]


def main(source: Path) -> int:
    """Write the file and print its size."""
    topology = json.loads(source.read_text())
    found = rings(topology)
    starts = np.array([ring[0] for ring in found], np.int32)
    steps = np.concatenate([np.diff(ring, axis=0) for ring in found])
    wide = np.abs(steps).max()
    np.savez_compressed(
        OUT,
        starts=starts,
        steps=steps.astype(np.int16 if wide < 2**15 else np.int32),
        lengths=np.array([len(ring) for ring in found], np.int32),
        scale=np.array(topology["transform"]["scale"]),
        offset=np.array(topology["transform"]["translate"]),
    )
    print(f"{OUT}: {len(found)} rings, {len(steps)} steps, {OUT.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
