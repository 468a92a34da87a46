"""Error of corrected tracks under water, smoothed and linear, on simulated missions that surface.

    python -m benchmarks.smoothed_tracks [--seeds 3] [--hours 20] [--json]

Generates stores of the preset `field` (seeds of its own), corrects their tracks by `twin flight` in
both modes, and compares them with the truth between the first and the last fix, deeper than 3 m.
`deviation` is the root of the mean reported variance; `normalised` the root mean square of error
over reported standard deviation (1 is right); `normalised_after` that after the last fix.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import factory
from benchmarks import command
from twin.logs import Flight, estimate_flight
from twin.logs.corrected_track import CORRECTIONS

Array = NDArray[np.float64]

UNDER_WATER = 3.0
"""[m] Depth below which samples count"""
FIRST_SEED = 7100


def errors_of(flight: Flight) -> tuple[Array, Array, float]:
    """Squared error [m2], mean of north and east, and reported variance [m2], under water between
    fixes; and the normalised error after the last fix, NaN if no mission goes on."""
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


def main(*, seeds: int = 3, hours: float = 20.0, json: bool = False) -> None:
    """Print the errors. seeds: number of stores. hours: length of each store."""
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(FIRST_SEED, FIRST_SEED + seeds):
            path = Path(folder) / f"{seed}.zarr"
            factory.generate(path, preset="field", hours=hours, seed=seed)
            rows[str(seed)] = figures(path)
    command.say(rows, [{"seed": seed, **one} for seed, one in rows.items()], json=json)


if __name__ == "__main__":
    sys.exit(command.run(main))
