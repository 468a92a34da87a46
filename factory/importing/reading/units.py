"""Units as logs write them, and the factor of each to the unit of the schema."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name

Array = NDArray[np.float64]

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
