"""Belief ends: whether beliefs that are moved on dive by dive end where one fit to all dives does.

    python -m benchmarks.belief_ends STORE [STORE ...] [--json]

The stores are those of `factory import`, with attitude. For each deployment `twin identify` fits
drag and neutral density to all dives at once, from the shipped vehicle of the log's kind, and
`follow_parameters` follows them dive by dive: without walks, which is the same question
and shall have the same answer, and with the walks that `twin watch` gives them, whose middle is
that of the dives looked back at. `off` is the difference over the root of the sum of both squared
deviations, `white` the root mean square of the walks' innovations, which is 1 where they are as
large as they say.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.health.beliefs import FOLLOWED, Beliefs, follow_parameters
from twin.cli.text_table import format_table
from twin.identify import identify, load_calibration, load_logs
from twin.identify.logged_missions import start_vehicle
from twin.records.logged import LogStore


def compared(store: Path, name: str, rows: Sequence[int]) -> list[dict[str, Any]]:
    """A row of the table for each parameter of a deployment."""
    logs, calibration = load_logs(store, list(rows)), load_calibration(start_vehicle(store))
    fit = identify(logs, calibration, parameters=FOLLOWED)
    still = follow_parameters(logs, calibration, walks=0.0)
    free = follow_parameters(logs, calibration)
    white = float(np.sqrt(np.nanmean(free.innovation[1:] ** 2)))
    return [
        {
            "deployment": name, "dives": len(still.rows), "parameter": one,
            "fit": fit[one].value, "deviation": fit[one].deviation,
            **_ended("still", still, one, fit[one].value, fit[one].deviation),
            **_ended("walking", free, one, fit[one].value, fit[one].deviation),
            "white": white,
        }
        for one in FOLLOWED
    ]  # fmt: skip


def _ended(
    which: str, beliefs: Beliefs, name: str, fit: float, deviation: float
) -> dict[str, float]:
    """The last belief, or the middle of the walk looked back at."""
    value = float(beliefs.value(name, smoothed=True).mean())
    own = float(beliefs.deviation(name, smoothed=True).mean())
    return {
        which: value,
        f"{which} +-": own,
        f"{which} off": abs(value - fit) / float(np.hypot(own, deviation)),
    }


def main() -> None:
    """Print a row a parameter."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("stores", nargs="+", type=Path, help="stores of logs with attitude")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    given = parser.parse_args()
    found: list[dict[str, Any]] = []
    for store in given.stores:
        with LogStore(store) as logs:
            places = {name: logs.missions_of(name) for name in dict.fromkeys(logs.deployments)}
        for name, rows in places.items():
            found += compared(store, name, rows)
    print(json.dumps({"beliefs": found}) if given.json else format_table(found))


if __name__ == "__main__":
    main()
