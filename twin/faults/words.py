"""Words: faults as the command line gives them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from twin.errors import InputError, unknown_name
from twin.faults.base import FAULTS, Fault

FROM = "from"
"""Names the time at which a fault begins"""
UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""[s] in a unit of time"""


def parse_faults(words: str | Sequence[str]) -> tuple[Fault, ...]:
    """Faults of words such as `fouling:per_day=0.02,from=3d` or `wing_lost:side=port`.

    Settings are the kind's fields; `from` is a time with its unit (s, min, h, d), 0 by default.

    Raises:
      InputError: an unknown kind or setting, or a value that cannot be.
    """
    given = [words] if isinstance(words, str) else list(words)
    return tuple(_parse(word) for word in given)


def _parse(word: str) -> Fault:
    name, _, rest = word.strip().partition(":")
    kind = FAULTS[name.strip()]
    fields = {f.name: f for f in dataclasses.fields(kind) if f.name != "start"}
    known = [*fields, FROM]
    settings: dict[str, float | str] = {}
    for item in filter(None, (part.strip() for part in rest.split(","))):
        key, sign, value = (text.strip() for text in item.partition("="))
        if not sign:
            raise InputError(
                f"fault {word!r}: {item!r} must be NAME=VALUE, with NAME of {', '.join(known)}"
            )
        if key not in known:
            raise InputError(f"fault {name!r}: {unknown_name('setting', key, known)}")
        if key == FROM:
            settings["start"] = _seconds(word, value)
        elif fields[key].type in ("str", str):
            settings[key] = value
        else:
            settings[key] = _number(word, key, value)
    return kind(**settings)  # type: ignore[arg-type]


def _number(word: str, key: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise InputError(f"fault {word!r}: {key}={value} must be a number") from None


def _seconds(word: str, value: str) -> float:
    """A time with its unit, such as 3d."""
    digits = value.rstrip("abcdefghijklmnopqrstuvwxyz").strip()
    unit = value[len(digits) :].strip() or "s"
    if unit not in UNITS:
        raise InputError(f"fault {word!r}: {unknown_name('unit of time', unit, UNITS)}")
    return _number(word, FROM, digits) * UNITS[unit]
