"""Probe: check that your own type of current is complete and its derivatives match its velocity.

Added mass uses the rate and gradient of the current. A wrong sign in one of them changes the flight
without any other symptom. Shipped types pass the probe in the tests; it is not run at each of their
compilations.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from twin.compiled import Compiled
from twin.errors import CurrentError, unknown_name
from twin.seams import CURRENTS
from twin.water.current import sampler as layout
from twin.water.current.axes import Origin
from twin.water.current.sampler import Floats

FIRST_FREE_CODE = 65_536
"""First code of your own types, derived from the type's name; smaller codes are the package's."""
DAY = 86_400.0
"""[s] Duration of the missions for which examples are compiled."""
TAKEN = ("none", "sum", "table")
"""Words that descriptions and texts reserve, so that no type may have them."""
POINTS = 48
FARTHEST, DEEPEST = 30_000.0, 1000.0
"""[m] Test points. FARTHEST: largest distance from the start. DEEPEST: largest depth."""
STEPS = ((0.1, 1e-3, 10.0), (0.1, 1e-3, 10.0), (0.1, 1e-3, 10.0), (0.1, 1e-3))
"""[s, m, m, m] Steps of differences in time, north, east and depth. One step must agree: short
ones suffer from rounding and long ones from curvature."""
TOLERANCE = 1e-3
"""Largest relative error of a stated derivative."""
SMALL = 1e-6
"""Fraction of the largest derivative along an axis below which a derivative counts as zero."""
ROUNDING = 16.0 * np.finfo(float).eps
"""Rounding error of a velocity difference, as a fraction of the fastest velocity."""

AXES = ("time", "north", "east", "depth")
COMPONENTS = ("north", "east", "down")


def flaw(kind: Any, name: str) -> str:
    """Describe the fault of a type; empty when the type is sound.

    Raises:
      CurrentError: a derivative in one of the type's examples does not match its velocity.
    """
    if not re.fullmatch(r"[a-z][a-z0-9-]*", name) or name in TAKEN:
        return "its kind must be lower-case letters, digits and hyphens, and not taken"
    if "__dataclass_params__" not in vars(kind):
        return "it is not a dataclass: add @dataclass(frozen=True, kw_only=True)"
    if found := _flaw_of_functions(kind):
        return found
    own = {field.name for field in dataclasses.fields(kind)}
    for field in kind.setting_fields().values():
        if field not in own:
            return unknown_name("field in settings", field, own)
    if not kind.usage or not all(text.startswith(f"{name}:") for text in kind.usage):
        return f"it needs usage: a mapping of texts that begin with {name}: to a few words each"
    for other in () if name in CURRENTS.shipped() else layout.kinds():
        if other.number() == kind.number() and other.kind != name:
            return f"it has the code {kind.number()} of {other.kind!r}; set another `code`"
    return _flaw_of_examples(kind) if kind.number() >= FIRST_FREE_CODE else ""


def _flaw_of_functions(kind: Any) -> str:
    """Describe the fault of the type's compiled function; empty when there is none."""
    for name, count in (("kernel", 7), ("directional", 11)):
        function = getattr(kind, name)
        if function is None:
            continue
        if not isinstance(function, Compiled):
            return f"its {name} is {function!r}; decorate it with twin.compiled.jit"
        taken = len(inspect.signature(function.py_func).parameters)
        if taken != count:
            direction = ", and a direction in t, north, east, depth" if count > 7 else ""
            return (
                f"its {name} takes {taken} arguments, it must take {count}: program, start,"
                f" size, t, north, east, depth{direction}"
            )
    if (kind.kernel is None) == (kind.directional is None):
        return (
            "it needs one of kernel and directional, it has"
            f" {'neither' if kind.kernel is None else 'both'}: what flies is compiled, so give"
            " kernel, a function decorated with twin.compiled.jit that returns velocity, local"
            " rate and gradient (3 + 3 + 9 numbers)"
        )
    return ""


def _flaw_of_examples(kind: Any) -> str:
    """Compile the examples in `usage`, which compares their derivatives with differences.

    Examples that need a file or only show a form are skipped and compared at their first flight.
    """
    for example in kind.usage:
        try:
            current = kind.parse(example.partition(":")[2])
            drawn = [layout.program(current.records(DAY, Origin())) for _ in range(2)]
        except CurrentError:
            continue
        if drawn[0].tobytes() != drawn[1].tobytes():
            return (
                f"its records() of {example!r} differ from call to call: draw what is random"
                " from a seed that is a setting, by numpy.random.default_rng(seed)"
            )
        current.compile(DAY)
    return ""


def check(kind: Any, record: Floats, duration_s: float) -> None:
    """Raise CurrentError unless the derivatives in `record` of `kind` match its velocity.

    The points lie within `FARTHEST` and `DEEPEST` at times up to `duration_s` [s]. A point with a
    velocity that is not finite lies outside the current's domain. At a kink the derivative on
    either side is accepted.
    """
    who = f"current {kind.kind!r} ({kind.__qualname__})"
    evaluate = _evaluator(kind, record, who)
    with np.errstate(all="ignore"):
        points = list(_points(duration_s))
        stated = np.array([evaluate(point) for point in points])
        again = np.array([evaluate(point) for point in points])
        inside = np.isfinite(stated[:, :3]).all(axis=1)
        if not inside.any():
            raise CurrentError(
                f"{who}: its velocity is not a finite number anywhere within {FARTHEST:g} m of the"
                f" start and {DEEPEST:g} m of depth, e.g. {_place(points[0])}: check its kernel"
            )
        if not np.array_equal(stated, again, equal_nan=True):
            raise CurrentError(
                f"{who} gives another answer when it is asked again for the same time and place:"
                " keep nothing between calls, and draw what is random in records(), from a seed"
                " that is a setting"
            )
        points = [point for point, known in zip(points, inside, strict=True) if known]
        stated = stated[inside]
        for axis in range(len(AXES)):
            _compare(who, kind, evaluate, points, stated, axis)


def _compare(
    who: str,
    kind: Any,
    evaluate: Callable[[Floats], Floats],
    points: list[Floats],
    stated: Floats,
    axis: int,
) -> None:
    """Raise CurrentError where the derivative along `axis` does not match the velocity."""
    given = stated[:, slice(3, 6) if axis == 0 else slice(5 + axis, 15, 3)]
    fastest = float(np.abs(stated[:, :3]).max())
    good = np.zeros(given.shape, dtype=bool)
    for step in STEPS[axis]:
        measured = np.full((len(points), 3, 3), np.nan)  # points, sides, components
        for row in np.flatnonzero(~good.all(axis=1)):
            measured[row] = _differences(evaluate, points[row], stated[row, :3], axis, step)
        known = np.isfinite(measured)
        largest = np.abs(measured).max(initial=np.abs(given[np.isfinite(given)]).max(initial=0.0),
                                       where=known)  # fmt: skip
        error = np.abs(measured - given[:, None])
        allowed = TOLERANCE * np.maximum(np.abs(measured), np.abs(given)[:, None])
        agree = error <= allowed + SMALL * largest + ROUNDING * fastest / step
        good |= agree.any(axis=1) | ~known.any(axis=1)  # not known: outside the current's domain
    if good.all():
        return
    wrong = np.where(good, -1.0, np.abs(np.nan_to_num(given - measured[:, 1], nan=np.inf)))
    row, part = np.unravel_index(np.argmax(wrong), wrong.shape)
    ours, theirs = given[row, part], measured[row, 1, part]
    turned = abs(ours + theirs) < 0.01 * abs(theirs)
    raise CurrentError(
        f"{who}: dV{COMPONENTS[part][0]}/d{AXES[axis][0]}, how its {COMPONENTS[part]} velocity"
        f" changes with {AXES[axis]}, is {ours:.4g} {'m/s2' if axis == 0 else '1/s'} at"
        f" {_place(points[row])}, and differences of that velocity give {theirs:.4g}:"
        f" {_remedy(kind, axis, int(part), 'turn the sign of' if turned else 'correct')}"
    )


def _remedy(kind: Any, axis: int, part: int, what: str) -> str:
    if kind.directional is None:
        number = 4 + part if axis == 0 else 6 + 3 * part + axis
        return f"{what} number {number} of the 15 that its kernel returns"
    if axis and AXES[axis] not in kind.depends_on:
        return f"name {AXES[axis]!r} in its depends_on"
    return f"{what} number {4 + part} of the 6 that its directional function returns"


def _evaluator(kind: Any, record: Floats, who: str) -> Callable[[Floats], Floats]:
    """Velocity (3), local rate (3) and gradient (9) at (t, north, east, depth), by plain Python."""
    program = layout.program([record])
    at = (program, 1 + layout.RECORD_HEADER, record.size - layout.RECORD_HEADER)
    compiled = kind.kernel or kind.directional
    assert compiled is not None
    function = compiled.py_func

    def call(count: int, *numbers: float) -> Floats:
        try:
            found = function(*at, *numbers)
        except (ArithmeticError, ValueError):  # compiled code returns inf or NaN here
            return np.full(count, np.nan)
        except Exception as error:
            raise CurrentError(
                f"{who}: its compiled function fails at {_place(np.array(numbers))}:"
                f" {type(error).__name__}: {error}"
            ) from error
        values = np.ravel(np.asarray(found, dtype=np.float64))
        if values.size != count:
            raise CurrentError(
                f"{who}: its compiled function returns {values.size} numbers, it must return"
                f" {count}: velocity (3), "
                + ("local rate (3) and gradient (9)" if count == 15 else "derivative (3)")
            )
        return values

    if kind.directional is None:
        return lambda point: call(15, *point)
    taken = [axis in ("time", *kind.depends_on) for axis in AXES]

    def gathered(point: Floats) -> Floats:
        rows = [call(6, *point, *np.eye(4)[axis]) for axis in range(4)]
        slopes = [row[3:] if used else np.zeros(3) for row, used in zip(rows, taken, strict=True)]
        return np.concatenate([rows[0][:3], slopes[0], np.ravel(np.transpose(slopes[1:]))])

    return gathered


def _points(duration_s: float) -> Iterator[Floats]:
    """Test points (t, north, east, depth) [s, m]: all directions, distances by powers of ten."""
    for i in range(1, POINTS + 1):
        a, b, c, d = (i * root % 1.0 for root in (0.6180339887, 2**0.5, 3**0.5, 7**0.5))
        distance = FARTHEST ** (1.1 * a - 0.1)
        yield np.array(
            [
                b * duration_s,
                distance * np.cos(2.0 * np.pi * c),
                distance * np.sin(2.0 * np.pi * c),
                0.5 * (2.0 * DEEPEST) ** d,
            ]
        )


def _differences(
    evaluate: Callable[[Floats], Floats], point: Floats, here: Floats, axis: int, step: float
) -> Floats:
    """Differences of the velocity along `axis` [m/s2, 1/s]: behind, across, ahead, (3, 3)."""
    before, after = point.copy(), point.copy()
    before[axis], after[axis] = point[axis] - step, point[axis] + step
    if axis in (0, 3):  # neither before the start nor above the water
        before[axis] = max(before[axis], 0.0)
    low, high = evaluate(before)[:3], evaluate(after)[:3]
    behind, ahead = point[axis] - before[axis], after[axis] - point[axis]
    return np.array([(here - low) / behind, (high - low) / (behind + ahead), (high - here) / ahead])


def _place(point: Floats) -> str:
    t, north, east, depth = point[:4]
    return f"t {t:.4g} s, {north:.4g} m north, {east:.4g} m east, {depth:.4g} m deep"
