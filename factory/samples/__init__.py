"""Samples: write logs of an imaginary glider in every layout that the import reads.

    import factory
    from factory import samples

    flight = samples.Flight(dives=3, depth=60.0)
    paths = samples.write("seaglider", "logs", flight)
    factory.import_logs("seaglider", paths, "real.zarr", **samples.options("seaglider", "logs"))

Sample logs serve tests of readers and mappings, tutorials, and a first import without a log.
`Flight` has the true motion. Values in the logs are exact, unless a format rounds them.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from factory.seams import IMPORTERS
from twin.errors import InputError, UnknownName
from twin.geodesy import from_tangent_plane
from twin.numbers import Array as Array
from twin.plugins import imported

if TYPE_CHECKING:
    import netCDF4

START = 1_700_000_000.0
"""[s] Unix time at which a flight begins, at the surface"""
LATITUDE, LONGITUDE = 49.5, -58.0
"""[degree] Position at which a flight begins"""
MAPPING = "mine.toml"
"""Name of the mapping file beside samples of a format that needs one"""
DIVES = 'vehicle = "test vehicle"\nrows = "dives"\n\n[signals]\n'
"""Mapping that `write` puts beside recordings of known topics: it only says that rows are dives."""


@dataclasses.dataclass(frozen=True)
class Flight:
    """Saw-tooth dives of a glider, with a surface drift before each dive and after the last.

    The glider moves at `speed` along its pitch, without angle of attack, in a uniform current.
    """

    dives: int = 3
    depth: float = 60.0
    """[m] Turning depth of every dive"""
    pitch: float = 26.0
    """[degree] Magnitude of pitch: nose down in descents, nose up in climbs"""
    speed: float = 0.4
    """[m/s] Speed through the water"""
    heading: float = 40.0
    """[degree true] Heading"""
    north: float = 0.08
    """[m/s] Current toward north"""
    east: float = -0.05
    """[m/s] Current toward east"""
    surface: float = 300.0
    """[s] Duration of a surface drift; the fixes of a Seaglider need 150 s."""
    step: float = 4.0
    """[s] Time between samples, unless a layout has its own spacing"""
    variation: float = -20.0
    """[degree] Magnetic variation, east positive"""
    swing: float = 0.0
    """[degree] Amplitude of slow oscillations of pitch and heading; about 1 for a vehicle at sea"""

    @property
    def leg(self) -> float:
        """[s] Duration of a descent, and of a climb."""
        return float(self.depth / (self.speed * np.sin(np.radians(self.pitch))))

    @property
    def cycle(self) -> float:
        """[s] Duration of a surface drift and a dive together."""
        return self.surface + 2.0 * self.leg

    @property
    def time(self) -> Array:
        """[s] Unix times of all samples."""
        end = self.dives * self.cycle + self.surface
        return START + np.arange(0.0, end, self.step)

    def state(self, time: Array) -> dict[str, Array]:
        """Compute the true motion at unix times [s].

        Returns:
          depth [m]; pitch, heading [degree]; speed [m/s]; pump [cm3]; north, east [m] from the
          start; under, 1 under water; dive, its number from 0.
        """
        since = time - START
        cycle = np.minimum(np.floor(since / self.cycle), self.dives)
        dive = np.clip(since - cycle * self.cycle - self.surface, 0.0, 2.0 * self.leg)
        dive = np.where(cycle < self.dives, dive, 0.0)
        under = dive > 0.0
        down, up = under & (dive < self.leg), under & (dive >= self.leg)
        rate = self.speed * np.sin(np.radians(self.pitch))
        through = (cycle * 2.0 * self.leg + dive) * self.speed * np.cos(np.radians(self.pitch))
        azimuth = np.radians(self.heading)
        pitch = np.where(down, -self.pitch, np.where(up, self.pitch, 0.0))
        return {
            "depth": np.where(down, rate * dive, np.where(up, rate * (2 * self.leg - dive), 0.0)),
            "pitch": pitch + np.where(under, self.swing * np.sin(0.07 * time), 0.0),
            "pump": np.where(down, -230.0, 230.0),
            "heading": self.heading + self.swing * np.sin(0.05 * time),
            "speed": self.speed + 0.01 * self.swing * np.sin(0.06 * time),
            "north": through * np.cos(azimuth) + self.north * since,
            "east": through * np.sin(azimuth) + self.east * since,
            "under": under.astype(float),
            "dive": cycle,
        }

    def dive_times(self, dive: int) -> tuple[float, float]:
        """Return the unix times [s] at which a dive, counted from 0, begins and ends."""
        start = START + dive * self.cycle + self.surface
        return start, start + 2.0 * self.leg

    def position(self, time: Array) -> tuple[Array, Array]:
        """Compute latitude and longitude [degree] at unix times [s]."""
        state = self.state(np.asarray(time, float))
        return from_tangent_plane(state["north"], state["east"], LATITUDE, LONGITUDE)

    def displacement(self, start: float, end: float) -> tuple[float, float]:
        """Compute the displacement north and east [m] between two unix times [s]."""
        state = self.state(np.array([start, end]))
        return float(np.diff(state["north"])[0]), float(np.diff(state["east"])[0])

    def with_fixes(self) -> tuple[Array, dict[str, Array]]:
        """Return all sample times, and the state with latitude, longitude (NaN in dives)."""
        time = self.time
        state = self.state(time)
        places = (np.where(state["under"] > 0.0, np.nan, one) for one in self.position(time))
        return time, {**state, **dict(zip(("latitude", "longitude"), places, strict=True))}


SHORT = Flight(dives=2, depth=20.0, surface=200.0, swing=1.0)
"""Flight of 18 minutes, the default of `write`"""
Writer = Callable[[Path, Flight], list[Path]]
"""Function that writes a flight into a folder and returns the files for an import"""


def formats() -> dict[str, tuple[str, ...]]:
    """Return the layouts of each format of log, also of plugins; the first is `write`'s default."""
    return {name: tuple(_layouts(name)) for name in IMPORTERS if IMPORTERS[name].samples}


def _layouts(kind: str) -> Mapping[str, Writer]:
    found: Mapping[str, Writer] | str | None = IMPORTERS[kind].samples
    if not found:
        raise InputError(f"the kind {kind} has no samples; these have: {', '.join(formats())}")
    return imported(found) if isinstance(found, str) else found


def write(
    kind: str, folder: str | Path, flight: Flight = SHORT, *, layout: str | None = None
) -> list[Path]:
    """Write a flight in the format of a vehicle or an archive.

    Args:
      kind: format of log, such as "seaglider"; `formats` lists all.
      folder: folder for the files, made if missing; existing files are replaced.
      layout: layout of the format, such as "dbd" of a Slocum; None takes the first.

    Returns:
      The files that `factory.import_logs` takes, with `options`.

    Raises:
      InputError: an unknown type or layout; the message names the nearest.
      ModuleNotFoundError: a library that writes the format is missing.
    """
    layouts = _layouts(kind)
    layout = next(iter(layouts)) if layout is None else layout
    if layout not in layouts:
        raise UnknownName(f"layout of {kind} samples", layout, layouts)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if IMPORTERS[kind].takes_mapping:
        (folder / MAPPING).write_text(DIVES)  # a writer of tables replaces it with its columns
    return layouts[layout](folder, flight)


def options(kind: str, folder: str | Path, flight: Flight = SHORT) -> dict[str, Any]:
    """Return the options for an import of files from `write`: mapping and magnetic variation.

    Formats whose files contain both have no options.
    """
    if IMPORTERS[kind].takes_mapping:
        return {"mapping": Path(folder) / MAPPING}
    return {"variation_deg": flight.variation} if kind in ("og1", "ngdac") else {}


# --- functions for all writers ------------------------------------------------------------------


def named(write: Callable[[Path, Flight], Path], name: str) -> Writer:
    """Turn a writer of one file into a writer of a folder with the file `name`."""
    return lambda folder, flight: [write(folder / name, flight)]


def write_csv(
    path: Path, columns: Mapping[str, Sequence[Any] | Array], delimiter: str = ","
) -> Path:
    """Write a table, with numbers in all their digits and NaN as an empty cell."""

    def cell(value: Any) -> Any:
        if not isinstance(value, float):
            return value
        return "" if np.isnan(value) else repr(float(value))

    with path.open("w", newline="") as file:
        writer = csv.writer(file, delimiter=delimiter)
        writer.writerow(columns)
        writer.writerows(map(cell, row) for row in zip(*columns.values(), strict=True))
    return path


def add_variables(place: netCDF4.Dataset, variables: Mapping[str, Any]) -> None:
    """Add variables to a netCDF file or a group of it.

    Args:
      variables: for each name a tuple of dimensions, the values in the type to store (a text as
        letters), and optionally units or a dictionary of attributes.
    """
    for name, (dimensions, given, *about) in variables.items():
        values = np.array(list(given), "S1") if isinstance(given, str) else np.asarray(given)
        for dimension, size in zip(dimensions, values.shape, strict=True):
            if dimension not in place.dimensions:
                place.createDimension(dimension, size)
        variable = place.createVariable(name, values.dtype, dimensions)
        for units in about:
            variable.setncatts(units if isinstance(units, dict) else {"units": units})
        variable[...] = values


def write_netcdf(
    path: Path, variables: Mapping[str, Any], mode: Literal["w", "a"] = "w", **attributes: Any
) -> Path:
    """Write variables (see `add_variables`) to a netCDF-4 file; mode "a" adds them to a file."""
    import netCDF4

    with netCDF4.Dataset(path, mode) as file:
        file.setncatts(attributes)
        add_variables(file, variables)
    return path
