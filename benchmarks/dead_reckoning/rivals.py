"""Rivals: methods that predict surge and sway of the test missions.

A method of one's own is a file with

    LABELS = "none"        # or "dvl": what it adapts on in a test mission's first dives
    def predict(train, test, seed, seconds):
        "Path of the training and of the test store -> predictions by dives adapted on."

which gives back {0: Dataset, ...} as `benchmarks.dead_reckoning.scoring` describes it.
"""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from benchmarks.dead_reckoning.scoring import VELOCITIES
from twin.errors import InputError, unknown_name

Predicted = dict[int, xr.Dataset]


class Rival(NamedTuple):
    """A method."""

    predict: Callable[..., Predicted]
    labels: str = "none"
    """what it adapts on, `none` or `dvl`"""


def table(rows: Mapping[int, Mapping[str, Any]]) -> xr.Dataset:
    """Surge and sway by mission as a Dataset; shorter missions end in NaN."""
    longest = max(len(row["surge"]) for row in rows.values())
    filled = {
        name: np.stack([np.pad(np.asarray(row[name], np.float32), (0, longest - len(row[name])),
                               constant_values=np.nan) for row in rows.values()])
        for name in VELOCITIES
    }  # fmt: skip
    data = {name: (("mission", "time"), values) for name, values in filled.items()}
    return xr.Dataset(data, coords={"mission": list(rows)})


def baseline(name: str) -> Rival:
    """A method that learns nothing, of `twin.seams.BASELINES`."""

    def predict(train: Path, test: Path, seed: int, seconds: float) -> Predicted:
        from learn.data.dataset import Selection
        from twin.records.reader import MissionStore
        from twin.seams import BASELINES

        with MissionStore(test) as reader:
            vehicle = reader.vehicle
        runner, rows = BASELINES[name](vehicle=vehicle), {}
        with Selection(test, runner.needs(vehicle)) as selection:
            for mission in selection.each():
                said = runner.estimate(mission.signals, mission.period)
                rows[mission.index] = {v: getattr(said, v) for v in VELOCITIES}
        return {0: table(rows)}

    return Rival(predict)


def network(**settings: Any) -> Rival:
    """Networks of `learn fit`."""

    def predict(train: Path, test: Path, seed: int, seconds: float) -> Predicted:
        from learn.api import fit

        with tempfile.TemporaryDirectory(prefix="dead_reckoning_") as folder:
            run = fit(
                train, folder=Path(folder) / "run", seed=seed, seconds=seconds, members=1,
                workers=2, **settings,
            )  # fmt: skip
            return {0: table({one.mission: vars(one) for one in run.predict(test)})}

    return Rival(predict)


RIVALS: Mapping[str, Rival] = {
    "constant angle": baseline("pitch_plus_alpha"),
    "steady flight": baseline("steady_flight"),
    "EKF": baseline("ekf"),
    "elman": network(network="elman"),
    "gru": network(network="gru"),
    "tcn": network(network="tcn"),
    "ema": network(network="ema"),
}
"""`elman` is the paper's; `gru` and `tcn` are what later work takes; `ema` is the default here."""


def chosen(names: str, own: Path | None) -> dict[str, Rival]:
    """The methods of a list of names, and one of a file.

    Raises:
      InputError: no such method, or a file without `predict`.
    """
    found = {}
    for name in names.split(",") if names else RIVALS:
        if name not in RIVALS:
            raise InputError(unknown_name("method", name, RIVALS))
        found[name] = RIVALS[name]
    if own is not None:
        spec = importlib.util.spec_from_file_location(own.stem, own)
        if spec is None or spec.loader is None or not own.exists():
            raise InputError(f"--method {own}: give a Python file")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        if not callable(getattr(module, "predict", None)):
            raise InputError(f"{own} has no function predict(train, test, seed, seconds)")
        found[own.stem] = Rival(module.predict, getattr(module, "LABELS", "none"))
    return found
