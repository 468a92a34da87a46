"""Units of logs: values are converted from the unit that a file declares to that of a store.

The rule for every kind of log: a declared unit is converted. Values that contradict it make the log
suspect, or are repaired and counted if only one other unit is possible. A unit is guessed from the
values only if none is declared.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.tally import Doubt, Tally
from twin.errors import InputError, unknown_name
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

PRACTICAL = "psu"
"""Practical salinity: files write 35 in units of `1`, `psu` or `1e-3`, and 0.035 in kg/kg."""
_BASES = {PRACTICAL: "1e-3", "A h": "A.h"}
"""UDUNITS' names of a store's units, if they differ."""
_NOTHING = frozenset(
    {"", "-", "--", "?", "none", "null", "nan", "n/a", "na", "unknown", "undefined", "unset",
     "no_unit", "nodim", "tbd"}
)  # fmt: skip
"""Words in place of a unit that declare no unit."""

_WORDS: dict[str, dict[str, str]] = {
    "": {
        "deg": "degree", "degs": "degree", "degheading": "degree", "deglatitude": "degree",
        "deglongitude": "degree", "arcdeg": "degree", "deg/s": "degree/s",
        "deg s-1": "degree/s", "deg/sec": "degree/s", "rev/s": "turn/s", "hz": "turn/s",
        "kn": "knot", "kts": "knot", "ms-1": "m/s", "cms-1": "cm/s", "kph": "km/h",
        "nmi": "nautical_mile", "cubic_meter": "m3", "cubic_metre": "m3", "ccm": "cm3",
        "cubic centimeters": "cm3", "cubic centimetres": "cm3",
        "pa": "Pa", "hpa": "hPa", "kpa": "kPa", "mpa": "MPa", "inhg": "inHg", "inches hg": "inHg",
        "mhos/m": "S/m", "mho/m": "S/m", "mho m-1": "S/m", "mhos m-1": "S/m",
        "mmho/cm": "mS/cm", "mmhos/cm": "mS/cm", "s/m": "S/m",
        "ms/cm": "mS/cm", "ms cm-1": "mS/cm", "s m-1": "S/m", "us/cm": "uS/cm", "ms/m": "mS/m",
        "degc": "degC", "deg c": "degC", "deg_c": "degC", "degree c": "degC", "degrees c": "degC",
        "deg. c": "degC", "degrees celsius": "degC", "degree celsius": "degC", "its-90": "degC",
        "degc (its-90)": "degC", "deg f": "degF", "degf": "degF", "degrees f": "degF",
        "amp-hrs": "A.h", "amp-hr": "A.h", "amphr": "A.h", "amp hours": "A.h", "ah": "A.h",
        "a h": "A.h", "mamp-hrs": "mA.h", "mah": "mA.h", "um": "umol/L", "um/l": "umol/L",
        "micromolar": "umol/L", "ntu": "1", "ftu": "1",
    },
    "degree": {"decimal degrees": "degree", "dd": "degree"},
    "degree_Celsius": {"c": "degC", "°c": "degC", "f": "degF", "k": "K"},
    "m": {"um": "um"},
    "m s-2": {"g": "gravity", "mg": "1e-3 gravity"},
    "V": {"v": "V", "mv": "mV"},
    "A": {"a": "A", "ma": "mA"},
    "W": {"w": "W", "mw": "mW"},
    PRACTICAL: {
        "1": "1e-3", "psu": "1e-3", "pss": "1e-3", "pss-78": "1e-3", "pss78": "1e-3",
        "pss_78": "1e-3", "ppt": "1e-3", "‰": "1e-3", "per mille": "1e-3", "o/oo": "1e-3",
        "dimensionless": "1e-3", "unitless": "1e-3", "practical salinity units": "1e-3",
        "practical salinity unit": "1e-3", "practical": "1e-3",
    },
    "umol L-1": {
        **dict.fromkeys(("ml/l", "ml l-1", "ml.l-1", "milliliter/liter"), "44.6596 umol/L"),
        **dict.fromkeys(("mg/l", "mg l-1", "mg.l-1", "milligram/liter"), "31.2512 umol/L"),
    },
    "1": {"psu": "1", "pss-78": "1", "dimensionless": "1", "unitless": "1"},
}  # fmt: skip
"""Vendors' words in small letters and their UDUNITS names, by the store's unit or ("") for all.
Oxygen: 22.3916 litres are one mole (SCOR working group 142), and 31.9988 g."""
_USUAL: dict[str, tuple[str, ...]] = {
    "degree": ("deg", "degree", "degrees", "rad", "radian", "radians"),
    "rad s-1": ("rad/s", "rad s-1", "deg/s", "deg s-1", "rpm", "rev/s"),
    "m s-1": ("m/s", "m s-1", "cm/s", "mm/s", "km/h", "knot", "knots", "kn", "kt", "ft/s"),
    "m s-2": ("m/s2", "m/s^2", "m s-2", "g", "mg"),
    "m": ("m", "meter", "metre", "cm", "mm", "km", "inch", "in", "ft", "fathom"),
    "dbar": ("dbar", "decibar", "bar", "mbar", "hPa", "kPa", "Pa", "MPa", "psi"),
    "cm3": ("cm3", "cc", "ml", "l", "liter", "litre", "m3", "m^3"),
    "kg": ("kg", "g", "gram"),
    "A h": ("A h", "Ah", "amp-hrs", "mAh"),
    "V": ("V", "volt", "volts", "mV"),
    "A": ("A", "amp", "ampere", "mA"),
    "W": ("W", "watt", "mW"),
    "Pa": ("Pa", "hPa", "mbar", "kPa", "inHg"),
    "kg m-3": ("kg/m3", "kg/m^3", "kg m-3", "g/cm3"),
    "S m-1": ("S/m", "S m-1", "mS/cm"),
    "degree_Celsius": ("degC", "celsius", "degree_Celsius", "C", "K", "kelvin", "degF"),
    PRACTICAL: ("1", "psu", "PSS-78", "1e-3", "g/kg", "kg/kg"),
    "1": ("1", "%"),
}
"""Words that error messages offer, by the store's unit; other UDUNITS words are accepted."""
SECONDS = {
    "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9,
    "min": 60.0, "h": 3600.0, "hour": 3600.0, "day": 86400.0, "days": 86400.0,
}  # fmt: skip
"""Units of a clock in lower case, and their length [s]."""


def unit_of(name: str) -> str:
    """Unit of a signal in a store; `PRACTICAL` for salinities."""
    return PRACTICAL if name.endswith("salinity") else VARIABLES[name].units


def known_units(wanted: str) -> tuple[str, ...]:
    """Usual words for units that can be converted to a unit of the schema."""
    return _USUAL.get(wanted, (wanted,))


def is_declared(unit: str) -> bool:
    """True if a file's word for a unit declares one."""
    return _plain(unit) not in _NOTHING


def in_unit(values: Array, unit: str, wanted: str, subject: str) -> Array:
    """Convert values from a written unit to the schema's; "" is taken as the schema's.

    Raises:
      InputError: the unit is unknown (the nearest is offered), or of another quantity.
    """
    if not is_declared(unit) or unit == wanted:
        return values
    found = _conversion(unit, wanted)
    if isinstance(found, str):
        raise InputError(f"{subject}: {_refusal(unit, wanted, found)}")
    factor, zero = found
    return values if (factor, zero) == (1.0, 0.0) else values * factor + zero


def is_of(unit: str, wanted: str) -> bool:
    """True if a declared unit can be converted to the wanted unit."""
    return is_declared(unit) and not isinstance(_conversion(unit, wanted), str)


def is_known(unit: str) -> bool:
    """True if a word is a unit of any quantity."""
    return any(_unit(text) is not None for text in _readings(unit, ""))


def factor_of(unit: str, wanted: str) -> float:
    """Size of a known unit in the wanted unit."""
    found = _conversion(unit, wanted)
    if isinstance(found, str):
        raise InputError(_refusal(unit, wanted, found))
    return found[0]


def declared(
    values: Array,
    unit: str,
    wanted: str,
    subject: str,
    tally: Tally,
    *,
    native: str = "",
    deployment: str = "",
) -> Array | None:
    """Convert values from the unit that a file declares; None if it is of another quantity.

    An unknown unit leaves the values in the format's own unit and makes the log suspect. A variable
    of another quantity is left out and reported by name.

    Args:
      unit: as the file writes it; empty if it declares none.
      wanted: unit of the schema; `PRACTICAL` for practical salinity, which has none.
      subject: name of the variable, for the report.
      native: unit of the format if none is declared [default: the wanted one].
      deployment: deployment of the values, if known.
    """
    taken = unit_to_take(
        unit, wanted, subject, tally, native=native or wanted, deployment=deployment,
        count=int(np.isfinite(values).sum()),
    )  # fmt: skip
    return None if taken is None else in_unit(values, taken, wanted, subject)


def converted(
    columns: Mapping[str, Array],
    units: Mapping[str, str],
    wanted: Mapping[str, str],
    tally: Tally,
    *,
    native: Mapping[str, str] = MappingProxyType({}),
    deployment: str = "",
) -> dict[str, Array]:
    """Convert the columns that `wanted` names; leave out columns of another quantity.

    Args:
      columns: by name, as the file has them.
      units: units that the file declares, by name.
      native: units of the format if they differ from the wanted ones.
    """
    found: dict[str, Array | None] = dict(columns)
    for name in [one for one in columns if one in wanted]:
        found[name] = declared(
            columns[name], units.get(name, ""), wanted[name], name, tally,
            native=native.get(name, ""), deployment=deployment,
        )  # fmt: skip
    return {name: values for name, values in found.items() if values is not None}


def unit_to_take(
    unit: str,
    wanted: str,
    subject: str,
    tally: Tally,
    *,
    native: str,
    deployment: str = "",
    count: int = 1,
) -> str | None:
    """Choose the declared unit, else the format's own; leave out another quantity and return None.

    Args: see `declared`; count: number of values concerned.
    """
    if not is_declared(unit):
        return native
    found = _conversion(unit, wanted)
    if not isinstance(found, str):
        return unit
    if found:
        tally.add("left out", subject, max(count, 1), _refusal(unit, wanted, found))
        return None
    why = f"its unit {unit[:_LONGEST]!r} is not known: taken as {native}"
    if count and Doubt(subject, why, deployment) in tally.doubts:  # reported for another file
        tally.add("suspect", subject, count, why)
    elif count:
        tally.doubt(subject, why, count, deployment=deployment)
    return native


def _refusal(unit: str, wanted: str, other: str) -> str:
    unit = unit[:_LONGEST]
    words = known_units(wanted)
    if other:
        return (
            f"unit {unit!r} is not one of {wanted}, it is one of {other}; take {', '.join(words)}"
        )
    return f"unit {unit!r} is not one of {wanted}: {unknown_name('unit', unit, words)}"


def _plain(unit: str) -> str:
    return " ".join(unit.strip("\0 \t\n").split()).lower()


_ASIDE = re.compile(r"\s*[(\[,;].*")
"""Pattern of words after a unit, as in `degrees (clockwise from true north)`."""
_DIRECTION = re.compile(r"(?:arc)?deg(?:ree)?s?[ _.]?(?:t|m|true|mag|magnetic|north|east|n|e)")
_LONGEST = 100
"""Maximum number of characters of a unit; a longer word is a text."""
_PER = re.compile(r"\s*(?:_per_|\bper\b)\s*")


def _readings(unit: str, wanted: str) -> list[str]:
    """Texts by which UDUNITS may know a word, the likeliest first."""
    found: list[str] = []
    if len(unit) > _LONGEST:
        return []
    whole = " ".join(unit.strip("\0 \t\n").split())
    for written in dict.fromkeys((whole, _ASIDE.sub("", whole))):
        plain = written.lower()
        found += [_WORDS[table][plain] for table in (wanted, "") if plain in _WORDS.get(table, {})]
        if wanted == "degree" and _DIRECTION.fullmatch(plain):
            found.append("degree")
        found += [written, plain, _PER.sub("/", plain)]
    return [text for text in dict.fromkeys(found) if text]


@functools.lru_cache(maxsize=1024)
def _conversion(unit: str, wanted: str) -> tuple[float, float] | str:
    """Factor and offset from a unit to the wanted one; if impossible, its quantity's unit or ""."""
    base = _unit(_BASES.get(wanted, wanted))
    other = ""
    for text in _readings(unit, wanted):
        one = _unit(text)
        if one is None:
            continue
        # to UDUNITS an angle is a plain number
        if one.is_convertible(base) and _is_angle(one) == _is_angle(base):
            zero = float(one.convert(0.0, base))
            factor = float(one.convert(1.0, base)) - zero
            if np.isfinite([factor, zero]).all() and factor:
                return _round(factor), _round(zero)
        other = other or _quantity(one)
    return other


def _unit(text: str) -> Any:
    """Parse a text as a UDUNITS unit; None if UDUNITS does not know it."""
    import cf_units  # deferred: the help of the commands does without

    try:
        found = cf_units.Unit(text)
    except ValueError:
        return None
    return None if found.is_unknown() or found.is_no_unit() else found


def _is_angle(unit: Any) -> bool:
    return "rad" in str(unit.definition)


def _quantity(unit: Any) -> str:
    """Store's unit that a unit can be converted to, else the unit's definition."""
    for base in (one for one in _USUAL if one != PRACTICAL):
        its = _unit(_BASES.get(base, base))
        if unit.is_convertible(its) and _is_angle(unit) == _is_angle(its):
            return base
    return str(unit.definition)


def _round(value: float) -> float:
    """Round a conversion's number if this removes only the library's rounding error."""
    short = float(f"{value:.12g}")
    return short if abs(short - value) <= 1e-14 * abs(value) else value


_LITRES = 5.0
"""[cm3] Smallest range of a pump; a smaller number must be litres, or m3 if below 0.005."""
_STILL = 1e-5
"""[m3] Smallest range from which the unit is inferred; a smaller one is an idle pump."""
_LARGEST_PUMP = 3000.0
"""[cm3] Largest volume; values beyond it are sentinels and do not count."""


def to_cm3(values: Array, subject: str, tally: Tally) -> Array:
    """Convert a pumped volume without a unit to cm3; its range shows litres and m3."""
    good = values[np.isfinite(values)]
    good = good[np.abs(good) <= _LARGEST_PUMP]
    span = float(np.ptp(np.percentile(good, [1.0, 99.0]))) if good.size >= 20 else 0.0
    if not _STILL < span < _LITRES:
        return values
    factor, unit = (1e3, "litres") if span > _LITRES * 1e-3 else (1e6, "m3")
    tally.add("repaired", subject, good.size, f"was in {unit} where cm3 is native")
    return values * factor
