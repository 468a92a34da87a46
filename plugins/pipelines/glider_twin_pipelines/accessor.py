"""Accessor: flight, currents, track and map of a glider's data set in xarray.

    import glider_twin_pipelines.accessor  # registers `ds.glider`
    import xarray as xr

    ds = xr.open_dataset("deployment.nc")
    ds.glider.flight(vehicle="mine.xml")["VERT_CURR_MODEL"]

Data sets may be those of OceanGliders OG1.0, the National Glider DAC, pyglider and basestation3.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from factory.importing import Tally, sniff
from factory.importing.netcdf import as_array, seconds_of
from glider_twin_pipelines.modelled_log import CURRENTS, POSITIONS, Array, ModelledLog, modelled
from twin.errors import InputError
from twin.logs import DAC, EPOCH, OF_DIVES, PER_DIVE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CLOCKS = ("TIME", "time")
"""Names of the variable of measurement times"""
DESCRIBED = ("units", "long_name", "standard_name")
PAGE = "docs/howto/pipelines.md, your own vehicle"


@xr.register_dataset_accessor("glider")
class GliderAccessor:
    """Accessor `ds.glider`: results of a flight model for the glider's measurements in `ds`.

    Each method takes a vehicle: a file that `twin identify` wrote, or the name of a shipped
    vehicle; None takes the shipped vehicle for the log's type. Each raises InputError if the data
    set has another layout or lacks inputs, and VehicleError if the vehicle is missing.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset
        self._logs: dict[str | None, ModelledLog] = {}

    def flight(self, vehicle: str | None = None) -> xr.Dataset:
        """Speed through the water, angle of attack, vertical velocity of the water [m s-1, degree].

        Values are at the times of the data set, on its own dimension, and NaN between dives;
        `ds.assign(found.data_vars)` adds them.
        """
        names = [n for n in self.log(vehicle).variables if n not in (*POSITIONS, *CURRENTS)]
        return self._at_samples(vehicle, names)

    def track(self, vehicle: str | None = None) -> xr.Dataset:
        """Corrected positions [degree] and their standard deviation [m], at `flight`'s times."""
        return self._at_samples(vehicle, POSITIONS)

    def currents(self, vehicle: str | None = None) -> xr.Dataset:
        """Depth-averaged current of each dive from fix to fix [m s-1], (dac,).

        The standard deviation is that of each component. The time is midway between the fixes; the
        position is the middle sample of the corrected track.
        """
        found = self.log(vehicle).currents
        own = [one.current for one in found]
        arrays: dict[str, Any] = {}
        for name, field in (("north", "north"), ("east", "east"), ("sd", "deviation")):
            said = zip(DESCRIBED, PER_DIVE[f"dac_{name}"], strict=True)
            about = {word: text for word, text in said if text}
            arrays[f"dac_{name}"] = (DAC, np.array([getattr(one, field) for one in own]), about)
        for name, share, word in (
            ("dac_start", 0.0, "the fix before the dive"),
            ("dac_time", 0.5, "the middle between the two fixes"),
            ("dac_end", 1.0, "the fix after the dive"),
        ):
            seconds = np.array([one.start + share * one.duration for one in own])
            moments = np.round(1e3 * seconds).astype("datetime64[ms]").astype("datetime64[ns]")
            about = {"standard_name": EPOCH["standard_name"], "long_name": f"UTC time of {word}"}
            arrays[name] = (DAC, moments, about)
        for axis in ("latitude", "longitude"):
            places = np.array([getattr(one, axis) for one in found])
            arrays[f"dac_{axis}"] = (DAC, places, dict(OF_DIVES[f"dac_{axis}"]))
        return xr.Dataset(arrays, attrs={"source": self.log(vehicle).model})

    def map(self, vehicle: str | None = None) -> Figure:
        """Draw the corrected track on a map, with fixes and depth-averaged currents."""
        from twin.show.figures import MapContent, MapCurrents, draw_map, joined_longitude

        log, found = self.log(vehicle), self.currents(vehicle)
        latitude, longitude = (np.asarray(log.variables[n].values) for n in POSITIONS[:2])
        currents = MapCurrents(
            latitude=found["dac_latitude"].values,
            longitude=found["dac_longitude"].values,
            north=found["dac_north"].values,
            east=found["dac_east"].values,
            name="depth-averaged current of each dive",
        )
        content = MapContent(
            tracks=((latitude, joined_longitude(longitude)),),
            name="corrected track",
            fixes=(log.fixes[0], joined_longitude(log.fixes[1])),
            currents=(currents,) if found.sizes[DAC] else (),
        )
        return draw_map(content)

    def log(self, vehicle: str | None = None) -> ModelledLog:
        """Modelled log behind all other methods; computed once per vehicle."""
        if vehicle not in self._logs:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "data_set.nc"
                try:
                    self._dataset.to_netcdf(path)
                except (ValueError, TypeError, OSError) as error:
                    raise InputError(f"this data set is none for netCDF: {error}") from error
                kind = sniff(path)
                if kind is None:
                    some = ", ".join(map(str, list(self._dataset.variables)[:5])) or "nothing"
                    raise InputError(
                        "this data set is none of OG1.0, the National Glider DAC, pyglider or "
                        f"basestation3; it holds {some}"
                    )
                logs = modelled(kind, [path], vehicle)
            if len(logs) > 1:
                names = ", ".join(log.deployment for log in logs)
                raise InputError(f"this data set holds several deployments, {names}; select one")
            if logs[0].doubt:
                warnings.warn(f"{logs[0].doubt}; identify one: {PAGE}", stacklevel=3)
            self._logs[vehicle] = logs[0]
        return self._logs[vehicle]

    def _at_samples(self, vehicle: str | None, names: Sequence[str]) -> xr.Dataset:
        clock = self._dataset[next(name for name in CLOCKS if name in self._dataset.variables)]
        dimension = clock.dims[0]
        values = self.log(vehicle).at(unix_times(clock))
        made = {n: (dimension, values[n].values, dict(values[n].attributes)) for n in names}
        own = {str(n): c.variable for n, c in self._dataset.coords.items() if c.dims == clock.dims}
        own |= {str(clock.name): clock.variable}
        return xr.Dataset(made, {n: c for n, c in own.items() if n not in made})


def unix_times(clock: xr.DataArray) -> Array:
    """[s] Unix times from xarray's times, decoded or not, (samples,); NaN for missing times."""
    if clock.dtype.kind == "M":
        seconds = clock.values.astype("datetime64[ns]").astype(np.int64) / 1e9
        return np.where(np.isnat(clock.values), np.nan, seconds)
    return seconds_of(as_array(clock.values), clock.attrs, str(clock.name), Tally())
