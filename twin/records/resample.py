"""Resample: means of a time series over hours or days, directions averaged as directions.

The mean of headings 359 and 1 degree is 0 and not 180, and that of longitudes 179.9 and -179.9 is
180 and not 0: plain `resample(time=...).mean()` of xarray does not know.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.errors import InputError
from twin.records.schema import MISSION, TIME

if TYPE_CHECKING:
    import xarray as xr

DIRECTION, HEADING = "platform_orientation", "_heading"
"""Standard name of angles from north, and how the names of setpoints end, which have none"""
FLAGS = ("measured_phase", "measured_dvl_mode", "commanded_segment")
"""Numbers of kinds, beside what has the attribute `flag_values`"""
SHORTEST = 1e-9
"""Of a mean unit vector that has a direction"""


def resample(series: xr.Dataset, step: str) -> xr.Dataset:
    """Means of what `twin.timeseries` gave over steps of time, each labelled by its beginning.

    Directions and longitudes are averaged on the circle (the angle of the mean unit vector;
    Mardia and Jupp 2000, Directional Statistics, eq. 2.2.4), NaN left out; where they cancel, as
    those of opposite headings, the mean is NaN. Numbers of kinds (`mission`, phase, segment, lock
    of the Doppler log, flags) are those of the first sample. All else has the arithmetic mean of
    its known samples. Steps without samples are NaN.

    Args:
      series: of samples over `time`, in any order.
      step: a length of time as pandas and xarray write it, "10min", "1h", "1D" or "MS" for months,
        or in words, "1 hour".

    Raises:
      InputError: no dataset over `time`, or a step that is not a length of time.
    """
    if TIME not in getattr(series, "indexes", {}) or series.indexes[TIME].dtype.kind != "M":
        raise InputError("resample: give what twin.timeseries gave, a dataset over UTC `time`")
    whole = series.sortby(TIME)
    step = _frequency(step)
    means = whole.resample({TIME: step}).mean(keep_attrs=True)
    names = [str(name) for name in whole.data_vars]
    firsts = [name for name in names if _is_flag(whole[name])]
    if firsts:
        first = whole[firsts].resample({TIME: step}).first(keep_attrs=True)
        means = means.assign({name: first[name] for name in firsts})
    for name in names:
        longitude = whole[name].attrs.get("standard_name") == "longitude"
        if longitude or _is_direction(whole[name]):
            mean = _circular(whole[name], step)
            means[name] = mean if longitude else mean % 360.0
            means[name].attrs.update(whole[name].attrs)
    return means[names]


def _frequency(step: str) -> str:
    """The step as xarray takes it.

    Raises:
      InputError: it is not a length of time.
    """
    import pandas as pd
    from pandas.tseries.frequencies import to_offset

    for read in (to_offset, lambda text: to_offset(pd.Timedelta(text))):
        try:
            # a number alone would be nanoseconds
            offset = read(step) if any(letter.isalpha() for letter in str(step)) else None
        except (ValueError, TypeError, AttributeError):
            continue
        if offset is not None and offset.n > 0:
            return str(offset.freqstr)
    raise InputError(
        f'resample: step {step!r} is not a length of time: give one such as "10min", "1h" or "1D"'
    )


def _circular(angle: xr.DataArray, step: str) -> xr.DataArray:
    """The mean direction of angles [degree] in each step, -180 to 180."""
    import xarray as xr

    radians = np.deg2rad(angle.astype(float))
    parts = xr.Dataset({"sine": np.sin(radians), "cosine": np.cos(radians)})
    means = parts.resample({TIME: step}).mean()
    length = np.hypot(means["sine"], means["cosine"])
    mean = xr.apply_ufunc(np.arctan2, means["sine"], means["cosine"], dask="parallelized")
    found: xr.DataArray = np.rad2deg(mean).where(length > SHORTEST)
    return found


def _is_direction(array: xr.DataArray) -> bool:
    named = array.attrs.get("standard_name") == DIRECTION or str(array.name).endswith(HEADING)
    return named and array.attrs.get("units") == "degree"


def _is_flag(array: xr.DataArray) -> bool:
    return "flag_values" in array.attrs or array.name in (MISSION, *FLAGS)
