"""Error of corrected tracks under water, smoothed and linear, on simulated missions that surface.

    python -m benchmarks.smoothed_tracks [--seeds 3] [--hours 20] [--json]

Generates stores of the preset `field` (seeds of its own), lets `twin flight` correct their tracks
both ways, and compares them with the truth between the first and the last fix, deeper than 3 m.
`deviation` is the mean reported variance's root, `normalised` the root mean square of error by
reported deviation: 1 is right. `normalised_after` is that after the last fix, mean of missions.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import factory
from twin.logs import Flight, estimate_flight
from twin.logs.corrected_track import CORRECTIONS

Array = NDArray[np.float64]

UNDER_WATER = 3.0
"""[m]"""
FIRST_SEED = 7100


def errors_of(flight: Flight) -> tuple[Array, Array, float]:
    """Squared error [m2], mean of north and east, and reported variance [m2] under water between
    fixes; and the error by the deviation after the last one, NaN where no mission goes on."""
    store, missed, said, after = flight.store, [], [], []
    for one in flight.missions:
        mission, count = one.dive.mission, len(one.dive.depth)
        if len(one.fixes) < 2 or one.dive.motion is None:
            continue
        truth = np.stack(
            [store.row(f"true_{n}", mission)[:count].astype(float) for n in ("north", "east")],
            axis=1,
        )
        index = np.arange(count)
        under = store.row("true_depth", mission)[:count] > UNDER_WATER
        square, variance = ((one.position - truth) ** 2).mean(axis=1), one.deviation**2
        if (late := under & (index > one.fixes.sample[-1])).any():
            after.append((square / variance)[late].mean())
        use = under & (index >= one.fixes.sample[0]) & (index <= one.fixes.sample[-1])
        missed.append(square[use])
        said.append(variance[use])
    left = float(np.sqrt(np.mean(after))) if after else math.nan
    return np.concatenate(missed), np.concatenate(said), left


def figures(store: Path) -> dict[str, float]:
    """Errors of both corrections on a store."""
    found: dict[str, float] = {}
    for correction in CORRECTIONS:
        flight = estimate_flight(store, track=correction, thermal_lag=False)
        missed, said, after = errors_of(flight)
        found[f"{correction}_error_m"] = float(np.sqrt(missed.mean()))
        found[f"{correction}_deviation_m"] = float(np.sqrt(said.mean()))
        found[f"{correction}_normalised"] = float(np.sqrt((missed / said).mean()))
        found[f"{correction}_normalised_after"] = after
    found["smoother_by_linear"] = found["smoother_error_m"] / found["linear_error_m"]
    return found


def main(words: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3, help="stores")
    parser.add_argument("--hours", type=float, default=20.0, help="of each store")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    options = parser.parse_args(words)
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(FIRST_SEED, FIRST_SEED + options.seeds):
            path = Path(folder) / f"{seed}.zarr"
            factory.generate(path, preset="field", hours=options.hours, seed=seed)
            rows[str(seed)] = figures(path)
            if not options.json:
                print(seed, {name: round(value, 2) for name, value in rows[str(seed)].items()})
    if options.json:
        print(json.dumps(rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
