"""Values of a mapping's TOML file, each of the kind that its key must have, or refused by name."""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping as Dict
from collections.abc import Sequence
from typing import Any

from twin.errors import InputError, unknown_name


def known_keys(label: str, values: Dict[str, Any], allowed: Sequence[str]) -> None:
    """Refuse a key that is not allowed, with the nearest one."""
    for key in values:
        if key not in allowed:
            raise InputError(f"{label}: {unknown_name('key', key, allowed)}")


def table(label: str, key: str, value: object) -> Dict[str, Any]:
    """A table of keys."""
    if not isinstance(value, dict):
        raise InputError(f"{label}: {key or 'it'} must be a table of keys, not {value!r}")
    return value


def list_of(label: str, key: str, value: object) -> list[Any]:
    """A list."""
    if not isinstance(value, list):
        raise InputError(f"{label}: {key} must be a list, not {value!r}")
    return value


def text(label: str, key: str, value: object) -> str:
    """A text that says something."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{label}: {key} must be a text, not {value!r}")
    return value


def number(label: str, key: str, value: object) -> float:
    """A finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{label}: {key} must be a finite number, not {value!r}")
    return float(value)


def positive(label: str, key: str, value: object) -> float:
    """A number above 0."""
    found = number(label, key, value)
    if not found > 0.0:
        raise InputError(f"{label}: {key} must be above 0, not {found:g}")
    return found


def one_of(label: str, key: str, value: object, allowed: Sequence[str]) -> Any:
    """One of the allowed words."""
    if value not in allowed:
        raise InputError(f"{label}: {unknown_name(key, str(value), allowed)}")
    return value


def moment(label: str, value: object) -> float:
    """Unix time of a TOML date or time, or of one in a text; without a zone it is UTC."""
    found: Any = value
    if isinstance(value, str):
        try:
            found = datetime.datetime.fromisoformat(value)
        except ValueError:
            found = None
    if isinstance(found, datetime.date) and not isinstance(found, datetime.datetime):
        found = datetime.datetime(found.year, found.month, found.day)
    if not isinstance(found, datetime.datetime):
        raise InputError(
            f"{label}: start must be a time such as 2022-06-25T08:00:00Z, not {value!r}"
        )
    if found.tzinfo is None:
        found = found.replace(tzinfo=datetime.UTC)
    return found.timestamp()
