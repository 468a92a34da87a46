"""Registry: the kinds of current, by name and by the code in compiled programs.

The shipped kinds register themselves when `twin.water.current` is imported. A kind of another
distribution is found through its entry point in the group `glider_twin.currents`, named as the
kind and naming its class; it is loaded when its name is first asked for. A file named by
`GLIDER_TWIN_PLUGINS` registers its kinds itself.

They are no row of `twin.seams` because a kind here is a class together with the number that
stands for it in compiled programs: no two kinds may share one, and a new kind makes samplers
compile again.

Checks of settings stand here too, worded the same for every kind, and what takes the text of a
current apart, `NAME=VALUE` between commas.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from twin.compiled import Compiled, changed
from twin.errors import CurrentError, unknown_name
from twin.plugins import run_plugins

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints


ENTRY_POINTS = "glider_twin.currents"
"""Group of entry points of distributions that bring kinds of current."""


FIRST_FREE_CODE = 65_536
"""Codes below are the package's own; others follow from the kind's name, the same everywhere."""


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What the sampler, the command line and descriptions know of a kind."""

    cls: Any
    """The subclass of `twin.water.current.base.Current`."""
    code: int
    """Number in compiled programs; never changed once programs with it exist."""
    payload_size: int | None
    """Numbers in a record; None: it varies, and the kernel checks its `size` itself."""
    kernel: Compiled | None
    """(program, start, size, t, north, east, depth) to velocity, local rate and gradient (15)."""
    directional: Compiled | None
    """The same arguments and a direction (t, north, east, depth) to velocity and derivative (6)."""


_kinds: dict[str, Kind] = {}


def add(name: str, kind: Kind) -> None:
    """Take a kind in; compiled functions that sample currents are then made again.

    Raises CurrentError when the name or the code is another kind's. The same class again, as when
    a notebook's cell is run twice, replaces itself.
    """
    for other, known in _kinds.items():
        same = _place(known.cls) == _place(kind.cls)
        if other == name and not same:
            raise CurrentError(
                f"current {name!r} is registered already by {_place(known.cls)}; choose another"
                " `kind`"
            )
        if other != name and known.code == kind.code:
            raise CurrentError(
                f"current {name!r} has the code {kind.code} of {other!r}; set another `code`"
            )
    _kinds[name] = kind
    changed()


def remove(name: str) -> None:
    """Take a kind out again; programs with its records then give NaN."""
    del _kinds[name]
    changed()


def find(name: str) -> Kind | None:
    """The kind of that name, from an entry point if need be; None when there is none."""
    run_plugins()
    if name not in _kinds:
        _load(name)
    return _kinds.get(name)


def kinds() -> dict[str, Kind]:
    """Every kind registered so far, in the order of their codes."""
    return dict(sorted(_kinds.items(), key=lambda item: item[1].code))


def of_code(code: float) -> Kind | None:
    """The registered kind whose records begin with `code`; None when there is none."""
    return next((kind for kind in _kinds.values() if kind.code == code), None)


def names() -> list[str]:
    """Names of every kind, those of entry points that are not loaded yet included."""
    run_plugins()
    return [*kinds(), *(point.name for point in _points() if point.name not in _kinds)]


def unknown(name: str, *also: str) -> CurrentError:
    """The error for a name that no kind has; `also` are other words allowed in its place."""
    hint = ""
    if name[:1].isdigit() or name[:1] in "+-.":  # velocities alone
        hint = f"; write uniform:{name} for a velocity north, east in m/s"
    return CurrentError(unknown_name("current", name, [*names(), *also]) + hint)


def _points() -> EntryPoints:
    from importlib.metadata import entry_points  # 15 ms that most commands do not need

    return entry_points(group=ENTRY_POINTS)


def _load(name: str) -> None:
    """Import the module of the entry point of that name; importing it registers its kind."""
    for point in _points():
        if point.name == name:
            try:
                point.load()
            except Exception as error:
                raise CurrentError(
                    f"current {name!r}: its entry point {point.value} cannot be loaded:"
                    f" {type(error).__name__}: {error}"
                ) from error
            if name not in _kinds:
                raise CurrentError(
                    f"current {name!r}: its entry point {point.value} registers no kind of that"
                    " name; decorate the class with twin.water.current.register"
                )


def _place(cls: type) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"


FASTEST_CURRENT = 10.0
"""[m/s] No ocean current is faster (tidal races reach about 8); above it the units are wrong."""


def finite(kind: str, name: str, value: float, unit: str) -> float:
    """`value` as a float; raises CurrentError unless it is a finite number."""
    try:
        number = float(value)
    except OverflowError:  # a whole number with hundreds of digits
        number = math.inf
    except (TypeError, ValueError):
        raise CurrentError(f"{kind}: {name} must be a number in {unit}, not {value!r}") from None
    if not math.isfinite(number):
        raise CurrentError(f"{kind}: {name} must be a finite number in {unit}, not {number}")
    return number


def speed(kind: str, name: str, value: float) -> float:
    """`value` as a plausible velocity component [m/s] of either sign."""
    number = finite(kind, name, value, "m/s")
    if abs(number) > FASTEST_CURRENT:
        raise CurrentError(
            f"{kind}: {name} is {number} m/s, beyond {FASTEST_CURRENT:g} m/s: give it in m/s"
        )
    return number


def positive(kind: str, name: str, value: float, unit: str) -> float:
    """`value` as a float greater than zero."""
    number = finite(kind, name, value, unit)
    if number <= 0.0:
        raise CurrentError(f"{kind}: {name} must be greater than 0 {unit}, not {number:g}")
    return number


def not_negative(kind: str, name: str, value: float, unit: str) -> float:
    """`value` as a float of at least zero."""
    number = finite(kind, name, value, unit)
    if number < 0.0:
        raise CurrentError(f"{kind}: {name} must be at least 0 {unit}, not {number:g}")
    return number


def split_settings(kind: str, rest: str) -> tuple[list[str], dict[str, str]]:
    """Split comma-separated values into positional ones and NAME=VALUE."""
    positional: list[str] = []
    given: dict[str, str] = {}
    for item in rest.split(","):
        name, equals, value = item.partition("=")
        name, value = name.strip(), value.strip()
        if not equals:
            positional.append(name)
            continue
        name = name.lower()
        if name in given:
            raise CurrentError(f"{kind}: {name}= is given twice")
        given[name] = value
    return positional, given


def number(kind: str, name: str, text: str) -> float:
    """A finite number; raises CurrentError."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CurrentError(f"{kind}: {name} must be a number, not {text!r}")
    return value


def whole_number(kind: str, name: str, text: str) -> int:
    """A whole number; raises CurrentError."""
    value = number(kind, name, text)
    if value != int(value):
        raise CurrentError(f"{kind}: {name} must be a whole number, not {value:g}")
    return int(value)


def allowed(names: Iterable[str]) -> str:
    """The end of a message: which settings there are."""
    return f"settings: {', '.join(names)}"
