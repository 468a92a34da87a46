"""Propelled runs: public logs of propelled vehicles with a measured velocity, on one time grid.

Inputs of all methods are what a vehicle without a Doppler log has: attitude, its rates, depth and
the propeller's speed, where a log has them. The log's velocity is the truth and never an input.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from factory.importing import import_logs
from twin.errors import TwinError
from twin.identify.logged_missions import body_rates
from twin.navigation.dead_reckoning import Array

PERIOD = 1.0
"""[s] Shortest time between samples; logs of a longer period keep their own"""
MOVING = 0.3
"""[m/s] Surge of the log above which a sample counts as moving"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One run; arrays are (time,)."""

    vehicle: str
    name: str
    period: float
    signals: Mapping[str, Array]
    """roll, pitch, heading (unwrapped) [rad] and rates p, q, r [rad/s]; depth [m] and propeller
    speed, in the log's own unit, where the log has them"""
    surge: Array
    """[m/s] Surge by the Doppler log; NaN without"""
    sway: Array
    slowest: float = MOVING
    """[m/s] Surge above which a sample counts as moving"""

    @property
    def moving(self) -> np.ndarray:
        """Mask of samples that count as moving, (time,)."""
        return np.nan_to_num(self.surge) > self.slowest

    def part(self, span: slice) -> Run:
        """Make a run of some of the samples."""
        cut = {name: values[span] for name, values in self.signals.items()}
        return dataclasses.replace(self, signals=cut, surge=self.surge[span], sway=self.sway[span])


def gridded(
    vehicle: str, name: str, time: Array, columns: Mapping[str, Array], period: float = PERIOD
) -> Run:
    """Make a run from columns: means over each period; inputs without values are interpolated.

    Args:
      columns: signals of a `Run`, but rates are optional, and `surge` and `sway` [m/s].
    """
    place = ((time - time[0]) / period).astype(int)
    count = int(place[-1]) + 1
    found = {}
    for key, values in columns.items():
        known = np.isfinite(values)
        sums = np.bincount(place[known], values[known], count)
        sizes = np.bincount(place[known], minlength=count)
        found[key] = np.where(sizes > 0, sums / np.maximum(sizes, 1), np.nan)
    surge, sway = found.pop("surge"), found.pop("sway")
    index = np.arange(count)
    for key, values in found.items():
        known = np.isfinite(values)
        found[key] = np.interp(index, index[known], values[known])
    if "r" not in found:
        angles = found["roll"], found["pitch"], found["heading"]
        slopes = [np.gradient(angle, period) for angle in angles]
        found |= dict(zip("pqr", body_rates(angles[0], angles[1], *slopes), strict=True))
    return Run(vehicle=vehicle, name=name, period=period, signals=found, surge=surge, sway=sway)


def iver2(folder: Path) -> list[Run]:
    """Read the logs of an Iver2's control computer: no names, blanks between 35 columns.

    The import leaves out rows of less than a minute; four of fourteen runs are shorter.
    """
    runs = []
    for path in sorted(folder.glob("IverControlData-*.log")):
        lines = [line.split() for line in path.read_text("utf-8").splitlines()]
        table = np.array([line for line in lines if len(line) == 35], float)  # the last is cut off
        table[np.abs(table) == 999.0] = np.nan
        roll, pitch, heading = np.deg2rad(table[:, 4:7].T)
        columns = {
            "roll": roll, "pitch": pitch, "heading": np.unwrap(heading), "depth": table[:, 3],
            "propeller": table[:, 19], "power": table[:, 17],
            "surge": -table[:, 10], "sway": -table[:, 11],
        }  # fmt: skip
        runs.append(gridded("Iver2", path.stem.split("-")[1], table[:, 0], columns))
    return runs


def imported(
    kind: str, vehicle: str, folder: Path, *, truth: str = "measured_dvl", **options: Any
) -> list[Run]:
    """Read runs by the project's import; `truth` as in `runs_of`."""
    dataset, report = import_logs(kind, [folder], **options)
    return runs_of(dataset, vehicle, max(PERIOD, report.period), truth)


def runs_of(dataset: xr.Dataset, vehicle: str, period: float, truth: str) -> list[Run]:
    """Make runs from a store; the rows of one deployment are one run.

    Args:
      truth: beginning of the names of the true surge and sway.
    """
    time = dataset["time"].values.astype(float)
    count = dataset["n_samples"].values.astype(int)
    logged = "deployment" in dataset
    names = dataset["deployment"].values if logged else np.arange(count.size)
    start = dataset["start_time"].values if logged else np.zeros(count.size)
    wanted = SIGNALS | {name: (f"{truth}_{name}", 1.0) for name in ("surge", "sway")}
    runs = []
    for name in dict.fromkeys(names.tolist()):
        rows = sorted(np.flatnonzero(names == name), key=lambda k: start[k])
        columns = {
            short: scale
            * np.concatenate([dataset[long].values[k, : count[k]] for k in rows]).astype(float)
            for short, (long, scale) in wanted.items()
            if long in dataset
        }
        clock = np.concatenate([start[k] + time[: count[k]] for k in rows])
        columns["heading"] = np.unwrap(np.nan_to_num(columns["heading"]))
        runs.append(gridded(vehicle, str(name), clock, columns, period))
    return runs


DEGREE = math.pi / 180.0
SIGNALS = {
    "roll": ("measured_roll", DEGREE), "pitch": ("measured_pitch", DEGREE),
    "heading": ("measured_heading", DEGREE), "p": ("measured_roll_rate", 1.0),
    "q": ("measured_pitch_rate", 1.0), "r": ("measured_yaw_rate", 1.0),
    "depth": ("measured_depth", 1.0), "propeller": ("measured_propeller", 1.0),
}  # fmt: skip
"""Signals of a run: name in a store, and factor to the unit here"""


def gather(root: Path) -> tuple[dict[str, list[Run]], dict[str, str]]:
    """Read the runs of each vehicle below a folder of folders, or why they cannot be read."""
    readers: dict[str, tuple[str, Callable[[Path], list[Run]]]] = {
        "Iver2": ("auv_iver2*", iver2),
        "Sailfish": ("auv_sailfish*", partial(imported, "csv", "Sailfish", mapping="sailfish")),
        "LAUV": ("auv_lauv*", partial(imported, "lsf", "LAUV", truth="measured_bottom")),
        "REMUS-600": (
            "auv_remus600*",
            partial(imported, "pd0", "REMUS-600", truth="measured_bottom"),
        ),
    }
    found, refused = {}, {}
    for vehicle, (pattern, read) in readers.items():
        try:
            runs = [run for folder in sorted(root.glob(pattern)) for run in read(folder)]
        except TwinError as error:
            refused[vehicle] = str(error)
            continue
        if runs:
            found[vehicle] = [scaled(run, runs) for run in runs]
    return found, refused


def scaled(run: Run, runs: Sequence[Run]) -> Run:
    """Divide propeller speed and power by the usual ones of a vehicle's runs, velocities unseen."""
    signals = dict(run.signals)
    for name in {"propeller", "power"} & set(signals):
        every = np.concatenate([one.signals[name] for one in runs])
        signals[name] = signals[name] / np.percentile(every[every > 0.05 * every.max()], 50)
    return dataclasses.replace(run, signals=signals)
