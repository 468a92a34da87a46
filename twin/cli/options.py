"""Options: types and parsers of options that several commands share.

They are: a store by path or address; an engine; mission numbers; a plot's path; numbers by name;
and durations, typed as 90min, 6h or 2d, or as a bare number in the option's unit.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from tyro.constructors import PrimitiveConstructorSpec

from twin.errors import InputError
from twin.records.storage.store_path import StorePath, Url, store_path

StoreArgument = Annotated[
    StorePath,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="STORE",
        instance_from_str=lambda words: store_path(words[0]),
        is_instance=lambda value: isinstance(value, Path | Url),
        str_from_instance=lambda value: [str(value)],
    ),
]
"""Type of an argument: the path of a folder, or s3://BUCKET/NAME, gs://... or az://..."""
PLOT_FORMATS = (".png", ".pdf", ".svg")
SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""[s] Length of each unit that may follow a number"""
METAVAR = "DURATION"  # name of a duration in a help text
_WRITTEN = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*([a-z]*)", re.IGNORECASE)
NONE = "is no duration: give a number with s, min, h or d, such as 6h or 90min; a bare number is in"
SPELLED = {
    "s": "s", "sec": "s", "second": "s", "min": "min", "minute": "min", "h": "h", "hr": "h",
    "hour": "h", "d": "d", "day": "d", "week": None, "month": None, "year": None,
}  # fmt: skip
"""Words for units of time, in the singular, and the unit that each means; None: not accepted"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineOption:
    """Base of the commands that fly missions: adds `--engine`."""

    engine: Literal["mujoco", "lanes"] = "mujoco"
    """physics engine: mujoco, the twin; or lanes, the batched Fossen model for many vehicles,
    without contacts and without Python between its steps. docs/howto/lanes.md compares them
    """


def parse_rows(text: str) -> list[int] | None:
    """Parse mission numbers from a text such as "0-11,14"; None for "all".

    Raises:
      InputError: the text does not follow the form.
    """
    if text.strip() == "all":
        return None
    rows: list[int] = []
    try:
        for part in text.split(","):
            first, _, last = part.strip().partition("-")
            rows += range(int(first), int(last or first) + 1)
    except ValueError:
        rows = []
    if not rows:
        raise InputError(f"--missions {text!r} must be all, or numbers such as 0-11,14")
    return list(dict.fromkeys(rows))


def check_plot_path(path: Path | None) -> None:
    """Raise InputError for a plot that could not be written, before anything is flown."""
    if path is None:
        return
    if path.suffix.lower() not in PLOT_FORMATS or path.is_dir():
        raise InputError(f"--plot {str(path)!r} must be a file ending in {', '.join(PLOT_FORMATS)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write plot {path}: {error.strerror or error}") from error


def parse_numbers(option: str, texts: Sequence[str], what: str) -> dict[str, float]:
    """Parse numbers by name, from texts such as "mass=70" or "rudder=0.1,elevator=0".

    Raises:
      InputError: a text is no list of names with finite numbers, or gives a name twice.
    """
    numbers: dict[str, float] = {}
    for text in ",".join(texts).split(",") if texts else ():
        name, _, number = (word.strip() for word in text.partition("="))
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not (name and math.isfinite(value)):
            raise InputError(f"--{option} {text!r} must be {what}")
        if name in numbers:
            raise InputError(f"--{option} gives {name} twice; once is enough")
        numbers[name] = value
    return numbers


def duration(text: str, unit: str) -> float:
    """Parse a duration and convert it to a unit.

    Args:
      text: duration such as 6h, 90min, 45s or 2d; a bare number is in `unit`.
      unit: unit of the result: s, min, h or d.

    Raises:
      InputError: the text has no number, or another unit.
    """
    found = _read(text, unit)
    if found is None:
        raise InputError(f"{text!r} {NONE} {unit}")
    return found


def _read(text: str, unit: str) -> float | None:
    found = _WRITTEN.fullmatch(text.strip())
    own = found and (found[2].lower() or unit)
    if found is None or own not in SECONDS or not math.isfinite(float(found[1])):
        return None
    return float(found[1]) if own == unit else float(found[1]) * SECONDS[own] / SECONDS[unit]


def apart(number: str, word: str) -> str | None:
    """Message for a duration that was typed as two words; None if the two are no duration.

    Args:
      number: first word, given as the duration.
      word: second word, such as weeks.
    """
    found = _WRITTEN.fullmatch(number)
    spoken = word.lower()
    spoken = spoken if spoken in SPELLED else spoken.removesuffix("s")
    if found is None or found[2] or spoken not in SPELLED:
        return None
    unit = SPELLED[spoken]
    right = f"{number}{unit}" if unit else "42d"
    return (
        f"'{number} {word}' is no duration: write number and unit as one word, with s, min, h or "
        f"d, such as {right}"
    )


def _typed(word: str, unit: str) -> float:
    if word.strip().lower() in ("nan", "inf", "-inf"):
        return float(word)  # the command that uses the duration checks its range
    found = _read(word, unit)
    if found is None:  # the parser's own message names the option
        raise ValueError(f"{word!r} {NONE} {unit}")
    return found


def _option(unit: str) -> PrimitiveConstructorSpec[float]:
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{METAVAR}[{unit}]",
        instance_from_str=lambda words: _typed(words[0], unit),
        is_instance=lambda value: isinstance(value, int | float),
        str_from_instance=lambda value: [f"{value:g}{unit}"],
    )


Seconds = Annotated[float, _option("s")]
"""Type of an option: a duration [s]; a bare number is in seconds"""
Hours = Annotated[float, _option("h")]
"""Type of an option: a duration [h]; a bare number is in hours"""
