"""Errors of the three packages: each message is one line that names the offender and the way out.

The command line maps errors to exit codes: `InputError` and its subclasses to 2, every other
`TwinError` to 1. Library users catch the class they care about.

`nearest` finds the name that was probably meant, by its spelling.
"""

from __future__ import annotations

import difflib
import os
import shlex
from collections.abc import Iterable
from typing import Any

CLOSE = 0.6
"""Smallest similarity of two spellings for the one to be suggested for the other; 1 is equal"""
MOST_LETTERS = 1200
"""[character] Longest message; the longest list of allowed names is a little shorter"""
MOST_NAMES, NEAREST = 45, 6
"""MOST_NAMES: maximum number listed in full. NEAREST: number listed of a longer list"""


def nearest(name: str, names: Iterable[str], *, close: float = CLOSE) -> str | None:
    """Return the one of `names` that `name` probably means; None if no name is similar."""
    known = {_plain(one): one for one in sorted(names, reverse=True)}
    given = _plain(name)
    near = difflib.get_close_matches(given, known, n=1, cutoff=close)
    part = [one for one in known if given and f"_{given}_" in f"_{one.replace('.', '_')}_"]
    found = [*near, *sorted(part, key=len)]
    return known[found[0]] if found else None


def _plain(name: str) -> str:
    """Reduce a name to the form in which names are compared: `--Sample-Period`: `sample_period`."""
    return str(name).lower().replace("-", "_").strip("_")


class TwinError(Exception):
    """Base of every error that the three packages raise on purpose.

    The middle of a very long message is left out.
    """

    exit_code = 1

    def __init__(self, *args: Any) -> None:
        if args and isinstance(args[0], str):
            args = (shortened(args[0]), *args[1:])
        super().__init__(*args)


class InputError(TwinError, ValueError):
    """Unusable input of the caller; nothing was changed."""

    exit_code = 2


class UnknownName(InputError, KeyError):
    """Unknown name; a `KeyError` too, as mappings raise. The message offers the nearest name."""

    def __init__(self, kind: str, name: str, allowed: Iterable[str], *, hint: str = ""):
        super().__init__(unknown_name(kind, name, allowed) + hint)
        self.name = name

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError would put it in quotes

    def __reduce__(self) -> tuple[Any, ...]:
        return _unknown_again, (str(self), self.name)


def _unknown_again(message: str, name: str) -> UnknownName:
    """Rebuild an `UnknownName` that another process raised."""
    error = UnknownName.__new__(UnknownName, message)
    error.args, error.name = (message,), name
    return error


class VehicleError(InputError):
    """A vehicle file lacks an element or holds a wrong one."""


class MissionError(InputError):
    """A mission plan is impossible or names something unknown."""


class CurrentError(InputError):
    """A current field cannot be built or read, or does not cover the mission."""


class FloorError(InputError):
    """A sea floor cannot be built or read, or does not suit the mission."""


class StoreError(InputError):
    """A store is missing, damaged, of another schema, or in the way."""


class WriteError(StoreError):
    """The disk refuses a write, or a foreign file is in the way; nothing was changed."""


class OddFile(OSError):
    """A path leads to a pipe, a device or a folder in place of a file."""


class LayoutError(TwinError):
    """MuJoCo's C structs are not laid out as the native callbacks need."""


class NoSteadyState(TwinError):
    """These actuator positions have no steady glide, or none that is stable."""


class SimulationUnstable(TwinError):
    """A simulation diverged; `partial` holds its trajectory until then."""

    def __init__(self, message: str, *, mission: int, time_s: float, partial: Any = None):
        super().__init__(message)
        self.mission, self.time_s, self.partial = mission, time_s, partial


class StepTooLong(InputError, SimulationUnstable):
    """A time step too long for stable integration of the vehicle, refused before the flight."""

    def __init__(self, message: str):
        SimulationUnstable.__init__(self, message, mission=0, time_s=0.0)


class InaccurateStep(UserWarning):
    """A time step whose error is 1 mm/s or more, reported before the flight."""


def shortened(text: str) -> str:
    """Leave out the middle of a message that has more than `MOST_LETTERS` characters."""
    if len(text) <= MOST_LETTERS:
        return text
    half = MOST_LETTERS // 2
    return f"{text[:half]} [...] {text[-half:]}"


def quoted(path: str | os.PathLike[str]) -> str:
    """Quote a path or name for a shell, for a command that a message suggests."""
    return shlex.quote(str(path))


def shown(value: object) -> str:
    """Text of a value for a message: its repr, cut after 60 characters."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to print an integer of thousands of digits
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:60]}..."


def unknown_name(kind: str, name: str, allowed: Iterable[str]) -> str:
    """Message of one line for a name that is not among `allowed`, with the nearest allowed name."""
    names = sorted(allowed)
    near = nearest(name, names, close=0.5)
    hint = f": did you mean {near!r}?" if near else ""
    listed = ", ".join(names)
    if len(names) > MOST_NAMES:  # a wall of names hides the hint
        alike = difflib.get_close_matches(str(name), names, n=NEAREST, cutoff=0.0)
        listed = f"{', '.join(alike)} and {len(names) - NEAREST} others"
    return f"unknown {kind} {name!r}{hint} (allowed: {listed})"
