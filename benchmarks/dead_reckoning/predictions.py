"""Predictions: surge and sway of test missions by a method, read from a file and checked.

    netCDF   surge, sway (mission, time) [m/s], or (dives, mission, time), where the coordinate
             `dives` is the number of dives that the method adapted on; NaN after a mission's end.
             surge_interval [m/s], optional: half width that holds 68 % of the errors of surge
    CSV      mission, time_s, surge, sway [, surge_interval] [, dives], a line for every sample

`mission` is the row in the test store, from 0. The module does not need torch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from twin.errors import InputError
from twin.numbers import Array

Predicted = dict[int, xr.Dataset]
VELOCITIES = ("surge", "sway")
INTERVAL = "surge_interval"
AXES = ("mission", "time")
ALL_DIVES = "all dives"
"""Label of a method that is also fitted to the depths and fixes of the scored dives"""
LABELS = ("none", "dvl", ALL_DIVES)
SAME_STEP = 1e-3
"""[1] Largest relative difference of a table's time between samples from the store's"""


class Rival(NamedTuple):
    """Method that is compared."""

    predict: Callable[..., Predicted]
    labels: str = "none"
    """Data that the method adapts on besides the glider's own sensors, one of LABELS"""
    trained: bool = False
    """True if the method reads the training store and depends on the seed"""


def table(rows: Mapping[int, Mapping[str, Any]]) -> xr.Dataset:
    """Data set of surge, sway and any interval, by mission; shorter missions end in NaN."""
    longest = max(len(row["surge"]) for row in rows.values())
    names = [name for name in (*VELOCITIES, INTERVAL) if all(name in row for row in rows.values())]
    filled = {
        name: np.stack([np.pad(np.asarray(row[name], np.float32), (0, longest - len(row[name])),
                               constant_values=np.nan) for row in rows.values()])
        for name in names
    }  # fmt: skip
    data = {name: (("mission", "time"), values) for name, values in filled.items()}
    return xr.Dataset(data, coords={"mission": list(rows)})


def read_predictions(path: Path, period: float) -> Predicted:
    """Read predictions from a file, by the number of dives adapted on; 0 is always there.

    Args:
      path: .nc or .csv.
      period: [s] between samples of the test store.

    Raises:
      InputError: an unreadable file, a missing variable or column, or other times than the store's.
    """
    if path.suffix not in (".nc", ".csv") or not path.is_file():
        why = "there is no such file" if path.suffix in (".nc", ".csv") else "give .nc or .csv"
        raise InputError(f"--predictions {path}: {why}")
    try:
        data = _table(path, period) if path.suffix == ".csv" else xr.load_dataset(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {str(error).splitlines()[0]}") from None
    if path.suffix == ".nc" and "time" in data.coords:
        _check_times(np.asarray(data["time"].values), period, path)
    if "dives" not in data.dims:
        return checked({0: data}, str(path))
    return checked({int(d): data.sel(dives=d) for d in data.dives.values}, str(path))


def _table(path: Path, period: float) -> xr.Dataset:
    import pandas as pd

    table = pd.read_csv(path)
    if gone := {"mission", "time_s", *VELOCITIES} - set(table.columns):
        raise InputError(f"{path} lacks the column {sorted(gone)[0]}")
    parts = ["mission", *(["dives"] if "dives" in table else [])]
    for name in (*parts, "time_s", *VELOCITIES):
        table[name] = pd.to_numeric(table[name])
    table = table.sort_values([*parts, "time_s"], kind="stable")
    for which, own in table.groupby(parts)["time_s"]:
        name = ", ".join(f"{p} {w:g}" for p, w in zip(parts, which, strict=True))
        _check_times(own.to_numpy(float), period, f"{path}, {name}")
    table["time"] = table.groupby(parts).cumcount()
    names = [name for name in (*VELOCITIES, INTERVAL) if name in table]
    index = [name for name in ("dives", *AXES) if name in table]
    return table.set_index(index)[names].to_xarray()


def _check_times(times: NDArray[Any], period: float, place: object) -> None:
    """Require times from 0 in steps of `period` [s]; a netCDF may count samples instead."""
    if not np.issubdtype(times.dtype, np.number):
        raise InputError(f"{place}: time is no seconds since the mission's first sample")
    counted = np.arange(times.size)
    steps = (period, 1.0) if np.issubdtype(times.dtype, np.integer) else (period,)
    if any(np.allclose(times, step * counted, rtol=SAME_STEP, atol=0.1 * step) for step in steps):
        return
    begins, step = float(times[0]), float(np.median(np.diff(times))) if times.size > 1 else 0.0
    raise InputError(
        f"{place}: times begin at {begins:g} s with a sample every {step:g} s; the store has one "
        f"every {period:g} s from 0 on, each once"
    )


def checked(said: object, source: str) -> Predicted:
    """Check predictions that a method returned or a file holds, and return them.

    Raises:
      InputError: `said` is something else; the message names `source`.
    """
    wanted = "{0: Dataset with surge and sway over mission and time}, by dives adapted on"
    keyed = isinstance(said, Mapping) and not isinstance(said, xr.Dataset)
    if not isinstance(said, Mapping) or not keyed or 0 not in said:
        held = f"the keys {[*said]}" if isinstance(said, Mapping) and keyed else type(said).__name__
        raise InputError(f"{source} gives {held}; wanted is {wanted}")
    found: Predicted = {}
    for dives, data in said.items():
        if not isinstance(data, xr.Dataset):
            raise InputError(f"{source} gives {type(data).__name__} for {dives} dives: {wanted}")
        if gone := set(VELOCITIES) - set(map(str, data.data_vars)):
            raise InputError(f"{source} lacks the variable {sorted(gone)[0]}")
        for name in (*VELOCITIES, *([INTERVAL] if INTERVAL in data else [])):
            if set(data[name].dims) != set(AXES):
                raise InputError(
                    f"{source}: {name} has the dimensions {', '.join(map(str, data[name].dims))}; "
                    "wanted are mission and time"
                )
        if INTERVAL in data and float(data[INTERVAL].min()) < 0.0:
            raise InputError(f"{source}: surge_interval is below 0 somewhere")
        if "mission" not in data.coords:
            data = data.assign_coords(mission=np.arange(data.sizes["mission"]))
        found[int(dives)] = data.transpose(*AXES)
    return found


def velocities_of(
    said: xr.Dataset, mission: int, samples: int, needed: NDArray[np.bool_] | None = None
) -> tuple[Array, Array]:
    """Predicted surge and sway at each sample of a mission.

    Args:
      said: predictions.
      mission: row of the test store.
      samples: number of samples of the mission.
      needed: samples that must be finite, (samples,); default all.

    Raises:
      InputError: the mission is missing, has another length, or is not finite where needed.
    """
    known = said.mission.values
    if mission not in known:
        raise InputError(
            f"the predictions lack mission {mission}; they have {len(known)}, {known.min()} to "
            f"{known.max()}, and a mission is its row in the test store, from 0"
        )
    found = []
    for name in VELOCITIES:
        values = np.asarray(said[name].sel(mission=mission).values, np.float64)
        given = int(np.flatnonzero(np.isfinite(values)).max(initial=-1)) + 1
        ends = needed is None and given != samples
        if ends or values.size < samples or np.isfinite(values[samples:]).any():
            raise InputError(
                f"the predicted {name} of mission {mission} has {given} samples, the store "
                f"{samples}"
            )
        values = values[:samples]
        bad = ~np.isfinite(values) & (True if needed is None else needed)
        if bad.any():
            raise InputError(
                f"the predicted {name} of mission {mission} is not finite at sample "
                f"{np.flatnonzero(bad)[0]}"
            )
        found.append(values)
    return found[0], found[1]
