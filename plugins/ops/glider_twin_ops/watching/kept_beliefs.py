"""Kept beliefs: what the dives say of the vehicle, one after another, as `beliefs.zarr`.

Channels of health over all dives, and parameters of the vehicle over the last ones.

A function of `log.zarr`, the vehicle and the rate of false alarms alone: no path and no time of a
run is in it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.health import CHANNELS, Beliefs, DeploymentHealth
from twin.records import is_derived, write_zarr
from twin.records.storage import whole_folder

if TYPE_CHECKING:
    import xarray as xr

BELIEFS = "beliefs.zarr"
DIVE, CHANNEL = "dive", "channel"
FOLLOWED, PARAMETER = "followed_dive", "parameter"
LEVELS = {
    "level": "level of the channel after the dive",
    "deviation": "standard deviation of the level",
    "innovation": "dive's value less the level before it, over its standard deviation",
    "expected": "variance of that difference",
    "gain": "part of the difference by which the level moved",
}


def kept_beliefs(
    health: DeploymentHealth,
    vehicle: str,
    followed: Beliefs | None = None,
    followed_dives: Sequence[int] = (),
) -> xr.Dataset:
    """What is believed after each dive.

    Args:
      vehicle: name of the one whose flight model judged.
      followed: parameters over the last dives; None where the log does not tell them.
      followed_dives: numbers of these dives.

    Returns:
      `value`, `level`, `deviation`, `innovation`, `expected` and `gain`, (dive, channel), in the
      unit of each channel; `evidence` (dive,), log of the odds of a fault; `time` (dive,), UTC of
      the middle of each dive; attributes with the verdict. With `followed`: `parameter_value` and
      `parameter_deviation`, (followed_dive, parameter), each in the parameter's unit.
    """
    import xarray as xr

    numbers = np.array(health.dives, np.int64)
    count = len(numbers)
    fields = {"value": (health.values, "value of the channel in the dive")}
    fields |= {name: (getattr(health.levels, name), says) for name, says in LEVELS.items()}
    arrays = {
        name: ((DIVE, CHANNEL), np.asarray(values[:count], float), {"long_name": says})
        for name, (values, says) in fields.items()
    }
    evidence = np.where(np.isfinite(health.evidence), health.evidence, np.nan)
    middle = (np.round(health.time * 1e3)).astype("datetime64[ms]").astype("datetime64[ns]")
    said = {"long_name": "log of the odds of a fault after the dive", "threshold": health.threshold}
    found = xr.Dataset(
        {
            **arrays,
            "evidence": ((DIVE,), evidence, said),
            "unit": ((CHANNEL,), _words([one.unit for one in CHANNELS])),
            "says": ((CHANNEL,), _words([one.says for one in CHANNELS])),
        },
        coords={
            DIVE: numbers,
            CHANNEL: _words([one.name for one in CHANNELS]),
            "time": ((DIVE,), middle),
        },
        attrs={
            "title": "What the dives of a deployment say of its vehicle",
            "deployment": health.name,
            "vehicle": vehicle,
            "verdict": json.dumps(health.describe(), sort_keys=True),
        },
    )
    return found if followed is None else found.merge(_parameters(followed, followed_dives))


def _parameters(followed: Beliefs, dives: Sequence[int]) -> xr.Dataset:
    import xarray as xr

    names = [one.name for one in followed.parameters]
    value, deviation = (
        np.stack([tell(name) for name in names], axis=1)
        for tell in (followed.value, followed.deviation)
    )
    said = "of the vehicle after the dive"
    return xr.Dataset(
        {
            "parameter_value": ((FOLLOWED, PARAMETER), value, {"long_name": f"parameter {said}"}),
            "parameter_deviation": (
                (FOLLOWED, PARAMETER), deviation, {"long_name": "standard deviation of it"},
            ),
            "parameter_unit": (
                (PARAMETER,), _words([one.unit for one in followed.parameters]),
            ),
        },
        coords={FOLLOWED: np.array(dives, np.int64), PARAMETER: _words(names)},
    )  # fmt: skip


def _words(texts: list[str]) -> NDArray[np.object_]:
    return np.array(texts, dtype=object)  # zarr has no name for texts of a fixed width yet


def write_beliefs(dataset: xr.Dataset, folder: Path) -> Path:
    """Write `folder/beliefs.zarr`, in the place of an older one.

    Raises:
      WriteError: something else is in the way, or the disk refuses.
    """
    path = folder / BELIEFS
    with whole_folder(path, overwrite=True, ours=is_derived) as place:
        write_zarr(dataset, place)
    return path
