"""Seaglider science: the file `science` that says how often a Seaglider samples, by depth.

A line for each layer, from the surface down: the depth [m] at which it ends, seconds between
samples, for each sensor a digit (every how many samples it is read; 0 is off), and seconds between
two looks at pitch, roll and depth. Newer vehicles write the last three as `seconds=`, `sensors=`
and `gc=`, and may have more of the kind, which are kept. Lines that begin with a slash are
comments. Both forms are those of the public package basestation3.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from twin.bounded import read_text
from twin.errors import MissionError

SCIENCE = "science"
KEYS = ("seconds", "sensors", "gc")
LEAST_PART, MOST_PART = 0.05, 4.0
"""Of the samples, that a sparser or denser file may have"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScienceLayer:
    """How often it samples down to a depth."""

    depth: str
    """[m], as the file has it; or `loiter`"""
    seconds: float
    """Between samples"""
    sensors: str
    """A digit for each"""
    gc: str
    """[s] between two looks of its guidance"""
    more: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """What else newer vehicles have"""
    named: bool = False
    """Whether the file names its values"""

    def line(self) -> str:
        """As the file has it."""
        values = {"seconds": f"{self.seconds:g}", "sensors": self.sensors, "gc": self.gc}
        values |= self.more
        said = [f"{name}={value}" for name, value in values.items()]
        return " ".join([self.depth, *(said if self.named else list(values.values()))])


def read_science(path: str | Path) -> tuple[ScienceLayer, ...]:
    """The layers of a file, from the surface down.

    Raises:
      MissionError: it cannot be read, holds no layer, or a line is none.
    """
    path = Path(path)
    found: list[ScienceLayer] = []
    for number, line in enumerate(read_text(path, SCIENCE, MissionError).splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("/"):
            continue
        found.append(_layer(f"{path.name} line {number}", words))
    if not found:
        raise MissionError(f"{path.name} has no layer: a line is DEPTH SECONDS SENSORS GC")
    depths = [float(one.depth) for one in found if one.depth != "loiter"]
    if depths != sorted(depths):
        raise MissionError(f"{path.name}: depths must grow from line to line")
    return tuple(found)


def sparser(layers: Sequence[ScienceLayer], part: float) -> tuple[ScienceLayer, ...]:
    """The same layers with a part of the samples, to the second.

    Raises:
      MissionError: a part that leaves nothing, or that no sensor follows.
    """
    if not LEAST_PART <= part <= MOST_PART:
        raise MissionError(
            f"{part:g} of the samples: take a part from {LEAST_PART:g} to {MOST_PART:g}"
        )
    return tuple(
        dataclasses.replace(one, seconds=max(round(one.seconds / part), 1)) for one in layers
    )


def science_text(layers: Sequence[ScienceLayer]) -> str:
    """The text of the file."""
    return "".join(one.line() + "\n" for one in layers)


def _layer(where: str, words: Sequence[str]) -> ScienceLayer:
    named = any("=" in word for word in words)
    if named:
        values = dict(word.partition("=")[::2] for word in words[1:])
    elif len(words) == len(KEYS) + 1:
        values = dict(zip(KEYS, words[1:], strict=True))
    else:
        raise MissionError(f"{where}: {' '.join(words)!r} is no DEPTH SECONDS SENSORS GC")
    for key in KEYS:
        if not values.get(key):
            raise MissionError(f"{where}: {key}= is missing")
    seconds = _number(where, "seconds", values["seconds"])
    _number(where, "gc", values["gc"])
    if words[0] != "loiter":
        _number(where, "depth", words[0])
    if not values["sensors"].isdigit():
        raise MissionError(f"{where}: sensors {values['sensors']!r} must be a digit for each")
    more = {key: value for key, value in values.items() if key not in KEYS}
    return ScienceLayer(
        depth=words[0], seconds=seconds, sensors=values["sensors"], gc=values["gc"], more=more,
        named=named,
    )  # fmt: skip


def _number(where: str, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < 1e5:
        raise MissionError(f"{where}: {name} {text!r} must be a number, 0 or above")
    return value
