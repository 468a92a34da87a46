"""Trajectory: the signals and states of one simulated mission as named arrays in NED and FRD.

The names are the schema's: `true_*` for the truth, `commanded_*` for setpoints; the sensor models
add `measured_*`. `schema.VARIABLES` describes each signal.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.errors import InputError, UnknownName
from twin.lazy import resolve
from twin.numbers import Array
from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.coordinates import (
    DATETIME,
    FLOWN,
    LATITUDE,
    LONGITUDE,
    START_LATITUDE,
    START_LONGITUDE,
    START_TIME,
    sample_variables,
    unix_milliseconds,
    unix_seconds,
)
from twin.records.schema import TIME, variable

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


INNOVATIONS = "fix_innovations"
"""[1] Key in the provenance of a navigated run: squared innovation of each fix after a dive"""


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Trajectory(Mapping[str, Array]):
    """Mission sampled at a fixed period: a mapping from signal names to arrays.

    `signals` maps schema names to float64 arrays of shape (time,). `states` (time, columns) holds
    MuJoCo's qpos, qvel, act and ctrl, from which any sample can be rendered or resumed; for a
    glider these have 9, 8, 3 and 3 numbers.
    """

    time: Array
    """[s] since the start, shape (time,)."""
    signals: dict[str, Array]
    states: Array
    state_columns: tuple[str, ...] = ()
    """Name of each column of `states`; empty if unknown"""
    complete: bool = True
    """False when the simulation stopped early (unstable)."""
    provenance: dict[str, Any] = dataclasses.field(default_factory=dict)
    """End and origin of the run: reason, vehicle, mission, scenario and sensors as JSON"""

    def __getitem__(self, name: str) -> Array:
        try:
            return self.signals[name]
        except KeyError:
            raise UnknownName("signal of this trajectory", name, self.signals) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.signals)

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def __len__(self) -> int:
        """Number of signals; `len(trajectory.time)` is the number of samples."""
        return len(self.signals)

    def __repr__(self) -> str:
        vehicle, mission = (self.provenance.get(name) for name in ("vehicle", "mission"))
        flown = f"{vehicle or 'vehicle'} on {mission!r}" if mission else vehicle
        parts = [flown, f"{len(self.time)} samples"]
        if len(self.time):
            parts.append(f"{self.time[-1] - self.time[0]:g} s")
        if len(self.time) and all(f"true_{n}" in self.signals for n in VELOCITY):
            parts.append(f"{self.distance_through_water()[-1]:.0f} m through the water")
        parts.append(f"{len(self)} signals")
        if "ended" in self.provenance:
            parts.append(f"ended: {self.provenance['ended']}")
        return f"<Trajectory: {', '.join(filter(None, parts))}>"

    def _repr_html_(self) -> str:
        """Table and plot of depth over time, for notebooks."""
        from twin.notebook import card, line

        time, depth = self.time.tolist(), self.signals.get("true_depth", self.time[:0]).tolist()
        rows: dict[str, object] = {
            name: self.provenance[name]
            for name in ("vehicle", "mission", "ended")
            if self.provenance.get(name)
        }
        rows |= {"samples": len(time), "signals": len(self)}
        if time:
            rows["duration"] = f"{time[-1] - time[0]:g} s"
        return card("Trajectory", rows, line(time, depth, "depth [m]", down=True) if depth else "")

    @property
    def actuators(self) -> tuple[str, ...]:
        """The vehicle's moving parts: X for each true_X that has a commanded_X."""
        return actuator_names(self.signals)

    def to_xarray(self) -> xr.Dataset:
        """Return the signals (time,) in full precision, with the schema's units and CF attributes.

        If the provenance has a start position, the dataset has `latitude` and `longitude` (time,);
        if it has a start time, the dataset has `datetime` (time,).
        """
        import xarray as xr

        signals = {name: (TIME, self[name], variable(name).attributes()) for name in self}
        found: dict[str, Any] = {}
        if START_LATITUDE in self.provenance and "true_north" in self:
            found |= zip((LATITUDE, LONGITUDE), self.geographic_position(), strict=True)
        if START_TIME in self.provenance:
            start = unix_seconds(self.provenance[START_TIME])
            found[DATETIME] = unix_milliseconds(start, self.time)
        coordinates = sample_variables(found, FLOWN, (TIME,))
        about = {"units": "s", "long_name": "time since the start"}
        coordinates[TIME] = (TIME, self.time, about)
        return xr.Dataset(signals, coordinates, {**SIMULATED_ATTRIBUTES, **self._attributes()})

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a zarr store (.zarr) or netCDF (.nc), which `twin.open_trajectory` reads.

        Raises:
          InputError: `path` ends neither in .zarr nor in .nc.
          WriteError: `path` exists and may not be replaced, or the disk refuses."""
        dataset = resolve("twin.records.mission_dataset:dataset_of")
        made = dataset([self], attributes=self._attributes())
        written: Path = resolve("twin.records.store:save_missions")(made, path, overwrite=overwrite)
        return written

    def _attributes(self) -> dict[str, Any]:
        """Provenance that a file's attributes can hold: texts and numbers."""
        return {
            name: value
            for name, value in self.provenance.items()
            if name not in SIMULATED_ATTRIBUTES and isinstance(value, str | int | float)
        }

    def plot(self, figure: str = "overview", **options: Any) -> Figure:
        """Plot a figure of the mission: save it with `.savefig(path)`, or show it in a notebook.

        Args:
          figure: one of `twin.figure_names()`.
          options: options of that figure, such as tracks=[...] or colour="pitch".

        Raises:
          UnknownName: no such figure.
          InputError: the trajectory lacks a signal that the figure shows."""
        drawn: Figure = resolve("twin.show.figures.base:figure")(self, figure, **options)
        return drawn

    @property
    def position(self) -> Array:
        """North, east, depth [m], shape (time, 3)."""
        return np.stack([self[f"true_{n}"] for n in ("north", "east", "depth")], axis=-1)

    @property
    def v_rel(self) -> Array:
        """Surge, sway, heave through the water [m/s], body FRD, shape (time, 3)."""
        return np.stack([self[f"true_{n}"] for n in VELOCITY], axis=-1)

    def geographic_position(self) -> tuple[Array, Array]:
        """Return true latitude and longitude [degree, WGS84], each of shape (time,).

        Raises:
          InputError: the provenance has no start position, as in stores of earlier versions.
        """
        from twin.geodesy import from_tangent_plane, wrap_longitude

        if START_LATITUDE not in self.provenance:
            raise InputError(
                "this trajectory has no place on Earth: fly it with "
                'start={"latitude": 49.0, "longitude": -16.0}'
            )
        place = (self.provenance[START_LATITUDE], self.provenance[START_LONGITUDE])
        latitude, longitude = from_tangent_plane(self["true_north"], self["true_east"], *place)
        return latitude, wrap_longitude(longitude)

    def distance_through_water(self) -> Array:
        """Path length through the water [m] up to each sample, shape (time,)."""
        return cumulative(np.linalg.norm(self.v_rel, axis=-1), self.time)

    def track_through_water(self) -> Array:
        """Displacement north, east [m] relative to the water up to each sample, shape (time, 2)."""
        north = self["true_velocity_north"] - self["true_current_north"]
        east = self["true_velocity_east"] - self["true_current_east"]
        return np.stack([cumulative(north, self.time), cumulative(east, self.time)], axis=-1)


def cumulative(rate: Array, time: Array) -> Array:
    """Integrate `rate` from 0 by the trapezoidal rule; the result has the shape of `rate`."""
    steps = np.diff(time) * (rate[1:] + rate[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])


def sample_times(count: int, period: float) -> Array:
    """Return the times [s] of `count` samples every `period` [s] from 0, each rounded once.

    Whole seconds are exact, also for periods such as 0.1 that no float holds exactly.
    """
    ratio = Fraction(period).limit_denominator(_FINEST_FRACTION)
    if not math.isclose(ratio, period, rel_tol=1e-15):
        return np.arange(count, dtype=float) * period
    return np.arange(count, dtype=float) * ratio.numerator / ratio.denominator


_FINEST_FRACTION = 10_000
"""Largest denominator of a sample period [s] as a fraction: physics steps are 1e-4 s or longer"""


VELOCITY = ("surge", "sway", "heave")
"""Names of the components of velocity through the water, body FRD"""
SETPOINTS = ("roll", "pitch", "heading", "depth", "speed")
"""Commands of guidance for the vehicle's motion; every other command is a part's position."""


def actuator_names(signals: Iterable[str]) -> tuple[str, ...]:
    """Return the vehicle's moving parts, which have a true position and a command, in order.

    Args:
      signals: names of signals, such as the keys of `trajectory.signals`.
    """
    there = dict.fromkeys(signals)
    names = (name.removeprefix("true_") for name in there if name.startswith("true_"))
    return tuple(n for n in names if n not in SETPOINTS and f"commanded_{n}" in there)
