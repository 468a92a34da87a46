"""netCDF-4 and HDF5 files (MATLAB v7.3 among them): opened with errors that say what is wrong.

Units as logs write them, and the factor of each to the unit of the schema.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.columns import parse_stamps, unix_seconds
from factory.importing.tally import Tally
from twin.bounded import check_unpacked
from twin.errors import InputError, unknown_name

Array = NDArray[np.float64]


def open_netcdf(path: Path) -> Any:
    """A netCDF or HDF5 file for reading.

    Raises:
      InputError: it is neither, or truncated.
    """
    import netCDF4

    # limits that do not fit the variable's own kind of number are not used: no word of a library
    # that names neither the file nor the variable
    warnings.filterwarnings("ignore", r"WARNING: \w+ not used since it", UserWarning)
    try:
        file = netCDF4.Dataset(path)
    except (OSError, RuntimeError) as error:
        with path.open("rb") as raw:
            start = raw.read(8)
        known = start.startswith((b"CDF", b"\x89HDF")) or b"MATLAB" in start
        why = "truncated or damaged" if known else "of another format"
        raise InputError(
            f"{path.name} cannot be opened as netCDF-4 or HDF5: {why} ({type(error).__name__})"
        ) from error
    try:
        check_unpacked(_declared(file), path.stat().st_size, path.name)
    except InputError:
        file.close()
        raise
    return file


def _declared(group: Any) -> float:
    """Bytes of the values that a file or group says it has: a number is read as eight."""
    own = sum(
        float(variable.size) * (1 if getattr(variable.dtype, "kind", "") == "S" else 8)
        for variable in group.variables.values()
    )
    return own + sum(_declared(inner) for inner in group.groups.values())


def as_array(values: object) -> Array:
    """Any numbers as a float64 array; masked ones are NaN."""
    filled = np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan)
    return np.asarray(filled, np.float64).ravel()


def holds_arrays(path: Path) -> bool:
    """Whether a file is netCDF or HDF5 by its first bytes; MATLAB puts 512 bytes before them."""
    with path.open("rb") as file:
        start = file.read(600)
    return start.startswith((b"CDF", b"\x89HDF")) or start[512:516] == b"\x89HDF"


def variable_names(path: Path) -> list[str]:
    """Names of the variables and groups of a netCDF or HDF5 file; errors as `open_netcdf`."""
    with open_netcdf(path) as file:
        return [*file.variables, *file.groups]


def attributes_of(variable: Any) -> dict[str, Any]:
    """Attributes by name."""
    return {name: variable.getncattr(name) for name in variable.ncattrs()}


def text_of(variable: Any) -> str:
    """A text, whether stored as one or letter by letter; empty for None."""
    if variable is None:
        return ""
    value = variable[...]
    if getattr(value, "dtype", None) is not None and value.dtype.kind == "S":
        return b"".join(np.ma.filled(value, b"").ravel()).decode("utf-8", "replace").strip("\0 ")
    return str(value)


_UNITS_SINCE = re.compile(r"(\w+) since (.+)")
_SECONDS_IN = {
    "nanoseconds": 1e-9, "microseconds": 1e-6, "milliseconds": 1e-3, "seconds": 1.0,
    "minutes": 60.0, "hours": 3600.0, "days": 86400.0,
}  # fmt: skip


def seconds_of(time: Array, attributes: Mapping[str, Any], subject: str, tally: Tally) -> Array:
    """Unix seconds by the variable's units, or by size where it has none.

    Raises:
      InputError: units that are no times.
    """
    units = str(attributes.get("units", ""))
    if " since " not in units:
        return unix_seconds(time, subject, tally)
    match = _UNITS_SINCE.fullmatch(units.strip())
    unit = match[1].lower() if match else ""
    factor = _SECONDS_IN.get(unit if unit.endswith("s") else f"{unit}s")
    if match is None or factor is None:
        raise InputError(f"{subject}: its time has unknown units {units!r}")
    zero = parse_stamps(np.array([_whole_stamp(match[2])]))[0]
    if not np.isfinite(zero):
        raise InputError(f"{subject}: its time has unknown units {units!r}")
    return zero + factor * time


def _whole_stamp(word: str) -> str:
    """A written moment with microseconds at most: datetime reads no more digits."""
    word = re.sub(r"(\.\d{6})\d+", r"\1", word.strip().removesuffix(" UTC").removesuffix(" GMT"))
    # 2010-7-29 13:31:4
    date, _, clock = word.replace("T", " ").partition(" ")
    date = "-".join(part.zfill(2) for part in date.split("-"))
    return f"{date} {clock}".strip()


_DEGREES = 180.0 / np.pi
_INCH, _FOOT, _NAUTICAL_MILE = 0.0254, 0.3048, 1852.0
"""[m] by definition"""
_GRAVITY = 9.80665
"""[m s-2] standard gravity, by definition"""
KELVIN = 273.15

_TABLE: dict[str, dict[str, float]] = {
    "degree": {
        "deg": 1.0, "degree": 1.0, "degrees": 1.0, "arcdeg": 1.0, "°": 1.0,
        "rad": _DEGREES, "radian": _DEGREES, "radians": _DEGREES,
    },
    "rad s-1": {
        "rad/s": 1.0, "rad s-1": 1.0, "rad/sec": 1.0,
        "deg/s": 1.0 / _DEGREES, "degree/s": 1.0 / _DEGREES, "deg s-1": 1.0 / _DEGREES,
        "rpm": 2.0 * np.pi / 60.0, "rev/s": 2.0 * np.pi,
    },
    "m s-1": {
        "m/s": 1.0, "m s-1": 1.0, "meter_per_second": 1.0, "cm/s": 1e-2, "mm/s": 1e-3,
        "km/h": 1.0 / 3.6, "knot": _NAUTICAL_MILE / 3600.0, "knots": _NAUTICAL_MILE / 3600.0,
        "kn": _NAUTICAL_MILE / 3600.0, "kt": _NAUTICAL_MILE / 3600.0, "ft/s": _FOOT,
    },
    "m s-2": {"m/s2": 1.0, "m/s^2": 1.0, "m s-2": 1.0, "g": _GRAVITY, "mg": 1e-3 * _GRAVITY},
    "m": {
        "m": 1.0, "meter": 1.0, "metre": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3,
        "inch": _INCH, "in": _INCH, "ft": _FOOT,
    },
    "dbar": {
        "dbar": 1.0, "decibar": 1.0, "bar": 10.0, "mbar": 1e-2, "hpa": 1e-2, "kpa": 0.1,
        "pa": 1e-4, "pascal": 1e-4, "mpa": 100.0, "psi": 0.6894757,
    },
    "cm3": {
        "cm3": 1.0, "cc": 1.0, "ml": 1.0, "l": 1e3, "liter": 1e3, "litre": 1e3,
        "m3": 1e6, "m^3": 1e6, "cubic_meter": 1e6,
    },
    "kg": {"kg": 1.0, "gram": 1e-3},
    "A h": {"a h": 1.0, "ah": 1.0, "amp-hrs": 1.0, "amphr": 1.0, "mah": 1e-3, "mamp-hrs": 1e-3},
    "V": {"v": 1.0, "volt": 1.0, "volts": 1.0, "mv": 1e-3},
    "A": {"a": 1.0, "amp": 1.0, "amps": 1.0, "ampere": 1.0, "ma": 1e-3},
    "W": {"w": 1.0, "watt": 1.0, "watts": 1.0, "mw": 1e-3},
    "Pa": {"pa": 1.0, "pascal": 1.0, "hpa": 100.0, "mbar": 100.0, "kpa": 1e3, "inhg": 3386.389},
    "kg m-3": {"kg/m3": 1.0, "kg/m^3": 1.0, "kg m-3": 1.0, "g/cm3": 1e3},
    "S m-1": {"s/m": 1.0, "s m-1": 1.0, "ms/cm": 0.1},
    "degree_Celsius": {
        "degc": 1.0, "celsius": 1.0, "degree_celsius": 1.0, "°c": 1.0, "c": 1.0,
        "k": 1.0, "kelvin": 1.0,
    },
    "1": {"1": 1.0, "psu": 1.0, "pss-78": 1.0, "%": 1e-2},
}  # fmt: skip
"""By unit of the schema: units as written, in lower case, and the factor from them."""
SECONDS = {
    "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9,
    "min": 60.0, "h": 3600.0, "hour": 3600.0, "day": 86400.0, "days": 86400.0,
}  # fmt: skip
"""Units of time, in lower case, in seconds."""


def known_units(wanted: str) -> tuple[str, ...]:
    """Units that can be converted to one of the schema."""
    return tuple(_TABLE.get(wanted, {wanted: 1.0}))


def in_unit(values: Array, unit: str, wanted: str, subject: str) -> Array:
    """Values in the wanted unit of the schema, by the unit that the file writes; "" is taken as it.

    Raises:
      InputError: an unknown unit (the nearest is offered), or one of another quantity.
    """
    if not unit or unit == wanted:
        return values
    word = unit.strip().lower()
    of_quantity = _TABLE.get(wanted, {})
    if word in of_quantity:
        if word in ("k", "kelvin"):
            return values - KELVIN
        return values * of_quantity[word]
    other = next((base for base, names in _TABLE.items() if word in names), None)
    if other is not None:
        raise InputError(
            f"{subject}: unit {unit!r} is not one of {wanted}, it is one of {other}; take "
            f"{', '.join(known_units(wanted))}"
        )
    raise InputError(
        f"{subject}: unit {unit!r} is not one of {wanted}: "
        f"{unknown_name('unit', unit, known_units(wanted))}"
    )
