"""Times of surfacings: how often a forecast's interval holds the next ones of real deployments.

    python -m benchmarks.surfacing_times FOLDER [--json]

FOLDER is as of `benchmarks.surfacings`. From its fifth dive on, each deployment is asked for the
times of the next, the second and the fourth surfacing, by what its dives so far have told: stays at
the surface and how well dives keep the time (`Rhythm`). Those
beyond a hole in the log are left out. Printed is the part that comes within the interval of 90 %,
its median width, and by how much the middle is off in the median, beside a rival that lets dives
follow each other without a stay, as long as the median of the last five.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.surfacings import stores_in
from glider_twin_ops.forecast.expected_dive import Rhythm, SurfacingSchedule
from glider_twin_ops.forecast.logged_leg import DiveTime, dive_times
from twin.cli.text_table import format_table
from twin.records.logged import LogStore

AHEAD = (1, 2, 4)
KNOWN, DRAWS, LEAST = 4, 400, 8
"""Dives before the first forecast, draws, and dives of a deployment that is asked"""
MINUTE = 60.0


def told(dives: Sequence[DiveTime]) -> list[tuple[int, bool, float, float, float]]:
    """Of each forecast: surfacings ahead, whether the interval held it, its width, and by how much
    its middle and the rival were off [s]."""
    schedule, rng = SurfacingSchedule(), np.random.default_rng(0)
    found = []
    for k, dive in enumerate(dives):
        rhythm = Rhythm.of(schedule, dives[:k]) if k >= KNOWN else None
        if rhythm is not None:
            drawn = rhythm.draw(DRAWS, max(AHEAD), 0.0, rng)
            usual = float(np.median([one.end - one.begin for one in dives[max(0, k - 5) : k]]))
            ends = np.cumsum(drawn.stays + usual * (1.0 + drawn.late[:, None]), axis=1)
            for ahead in AHEAD:
                stays = [one.stay for one in dives[k : k + ahead]]
                if len(stays) < ahead or not np.isfinite(stays).all():
                    continue  # beyond the log, or beyond a hole in which it may have come up
                came = dives[k + ahead - 1].end - dives[k - 1].end
                low, middle, high = np.quantile(ends[:, ahead - 1], [0.05, 0.5, 0.95])
                off, rival = abs(came - middle), abs(came - ahead * usual)
                found.append((ahead, bool(low <= came <= high), high - low, off, rival))
        schedule.learn(dive)
    return found


def rows_of(name: str, found: Sequence[tuple[int, bool, float, float, float]]) -> dict[str, Any]:
    """A row of the table."""
    row: dict[str, Any] = {"deployment": name}
    for ahead in AHEAD:
        some = np.array([one[1:] for one in found if one[0] == ahead])
        held, width, off, rival = (
            (some[:, 0].mean(), *np.median(some[:, 1:], axis=0) / MINUTE)
            if len(some)
            else [float("nan")] * 4
        )
        row |= {
            f"{ahead}: in 90 %": round(float(held), 2),
            "width [min]" if ahead == 1 else f"width {ahead}": round(float(width)),
            "off [min]" if ahead == 1 else f"off {ahead}": round(float(off), 1),
            "rival [min]" if ahead == 1 else f"rival {ahead}": round(float(rival), 1),
        }
    return {**row, "surfacings": sum(one[0] == 1 for one in found)}


def main() -> None:
    """Print a row a deployment, and one of all."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows, every = [], []
    with tempfile.TemporaryDirectory() as work:
        for store in stores_in(options.folder, Path(work)):
            with LogStore(store) as logs:
                for name in dict.fromkeys(logs.deployments):
                    dives = dive_times(logs, name).dives
                    if len(dives) >= LEAST:
                        found = told(dives)
                        every += found
                        rows.append(rows_of(name, found))
    rows.append(rows_of("all", every))
    print(json.dumps(rows) if options.json else format_table(rows))


if __name__ == "__main__":
    main()
