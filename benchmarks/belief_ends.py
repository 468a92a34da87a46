"""Parameter estimates updated dive by dive, against one fit to all dives.

    python -m benchmarks.belief_ends STORE [STORE ...] [--json]

The stores are those of `factory import`, with attitude. For each deployment `twin identify` fits
drag and neutral density to all dives at once, from the shipped vehicle of the log's type.
`follow_parameters` estimates them dive by dive. Without random walks, the last estimate must equal
the fit. With the walks of `twin watch`, the smoothed walk's mean is compared with the fit. `off` is
the difference divided by the root of the sum of both variances. `white` is the root mean square of
the normalised innovations, 1 if their size is as stated.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import command
from glider_twin_ops.health.answers import FOLLOWED, Beliefs, follow_parameters
from twin.identify import identify, load_calibration, load_logs
from twin.identify.logged_missions import start_vehicle
from twin.records.logged import LogStore


def compared(store: Path, name: str, rows: Sequence[int]) -> list[dict[str, Any]]:
    """Table row of each parameter of a deployment."""
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
    """Last estimates, or means of the smoothed walks."""
    value = float(beliefs.value(name, smoothed=True).mean())
    own = float(beliefs.deviation(name, smoothed=True).mean())
    return {
        which: value,
        f"{which} +-": own,
        f"{which} off": abs(value - fit) / float(np.hypot(own, deviation)),
    }


def main(stores: command.Positional[tuple[Path, ...]], *, json: bool = False) -> None:
    """Print a row a parameter. stores: of logs with attitude."""
    found: list[dict[str, Any]] = []
    for store in stores:
        with LogStore(store) as logs:
            places = {name: logs.missions_of(name) for name in dict.fromkeys(logs.deployments)}
        for name, rows in places.items():
            found += compared(store, name, rows)
    command.say({"beliefs": found}, found, json=json)


if __name__ == "__main__":
    sys.exit(command.run(main))
