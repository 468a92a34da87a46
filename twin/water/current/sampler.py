"""Sampler: compiled current, its rate along the vehicle's path and its gradient.

C callbacks call `sample` once per physics step. The rate is the material derivative for the
vehicle, dV_c/dt + (v . grad) V_c with v the velocity over ground. It is the exact derivative of the
interpolated current, not an estimate. Above the mean sea surface the value at depth 0 holds.
Interpolation is linear on ascending axes. Outside an axis the edge value is held, and at a node the
derivative of the next cell counts. A damaged record gives NaN, and nothing outside it is read.

The code that dispatches to types is generated from `CURRENTS`. A newly registered type changes
that code, so all compiled functions that sample currents are compiled again.

The layout of a compiled current is flat: every type writes it, and the sampler reads it.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.compiled import Written, borrowing, generate, inline, jit
from twin.seams import CURRENTS

Floats = NDArray[np.float64]
INVALID = (math.nan,) * 6
"""Velocity and derivative of a damaged record; a simulation reports the NaN as an event."""


@borrowing
def locate(program, start, n, x):
    """Cell of x on the ascending axis program[start:start+n]: index, fraction, 1/width.

    The cell of an evenly spaced axis is tried first, then a binary search. Where the edge value
    holds, 1/width is zero, which makes every derivative vanish.
    """
    first = program[start]
    if n == 1 or not (x >= first):
        return 0, 0.0, 0.0
    last = program[start + n - 1]
    if x >= last:
        return n - 2, 1.0, 0.0
    guess = (x - first) / (last - first) * (n - 1)
    # a damaged axis may guess NaN or beyond n, which no integer holds
    low = int(guess) if guess < n else 0
    low = min(max(low, 0), n - 2)
    if not (program[start + low] <= x < program[start + low + 1]):
        low = 0
        high = n - 1
        while high - low > 1:
            middle = (low + high) >> 1
            if program[start + middle] <= x:
                low = middle
            else:
                high = middle
    inverse = 1.0 / (program[start + low + 1] - program[start + low])
    return low, (x - program[start + low]) * inverse, inverse


@borrowing
def table(program, start, size, x, x_rate):
    """Linear table: n, axis (n), velocity (n, 3). Velocity, and derivative at `x_rate` of x."""
    if size < 1 or not (program[start] >= 1.0 and 1.0 + 4.0 * program[start] == size):
        return INVALID
    n = int(program[start])
    low, fraction, inverse = locate(program, start + 1, n, x)
    here = start + 1 + n + 3 * low
    ahead = here + 3 if n > 1 else here
    rate = x_rate * inverse
    d_n = program[ahead] - program[here]
    d_e = program[ahead + 1] - program[here + 1]
    d_d = program[ahead + 2] - program[here + 2]
    return (
        program[here] + fraction * d_n,
        program[here + 1] + fraction * d_e,
        program[here + 2] + fraction * d_d,
        rate * d_n,
        rate * d_e,
        rate * d_d,
    )


RECORD_HEADER = 2
"""Length of the header before each payload: code and payload length."""


def record(code: int, *payload: ArrayLike) -> Floats:
    """Make one record: its code, the length of its payload, and the payload flattened in order."""
    body = np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in payload])
    return np.concatenate([np.array([code, body.size], dtype=np.float64), body])


def program(records: Sequence[Floats]) -> Floats:
    """Make the whole program: the number of records followed by the records."""
    return np.concatenate([np.array([len(records)], dtype=np.float64), *records])


INVALID_GRADIENT = (math.nan,) * 15
"""Velocity, local rate and gradient of a malformed program."""

_POINT = ("program", "start", "size", "t", "north", "east", "depth")
_DIRECTION = ("v_north", "v_east", "v_down")


@inline
def record_at(program, at):
    """Code, start and length of the record at `at`; the length is -1 when there is none."""
    start = at + RECORD_HEADER
    if start > program.size or not (0.0 <= program[at + 1] <= program.size - start):
        return 0.0, start, -1
    return program[at], start, int(program[at + 1])


@inline
def _along(k, v_north, v_east, v_down):
    """Velocity and rate along the path from velocity, local rate and gradient."""
    return (
        k[0],
        k[1],
        k[2],
        k[3] + (k[6] * v_north + k[7] * v_east + k[8] * v_down),
        k[4] + (k[9] * v_north + k[10] * v_east + k[11] * v_down),
        k[5] + (k[12] * v_north + k[13] * v_east + k[14] * v_down),
    )


def kinds() -> list[Any]:
    """Classes of the shipped, registered and loaded types, ordered by number."""
    shipped = (CURRENTS[name] for name in CURRENTS.shipped())
    return sorted({*shipped, *CURRENTS.loaded()}, key=lambda kind: kind.number())


def _branches(of_kind: Callable[[Any, str], Sequence[str]]) -> Written:
    """Write a branch for each type; `of_kind` makes its lines from the type and a function name.

    An unknown code returns `_invalid`.
    """
    names: dict[str, object] = {}
    lines: list[str] = []
    for kind in kinds():
        function = f"_kind_{kind.number()}"
        names[function] = kind.directional or kind.kernel
        lines.append(f"{'el' if lines else ''}if code == {kind.number()}:")
        if kind.payload_size is not None:
            lines.append(f"    if size != {kind.payload_size}: return _invalid")
        lines += [f"    {line}" for line in of_kind(kind, function)]
    return "\n".join([*lines, "else: return _invalid"]), names


def _write_rate() -> Written:
    point, direction = ", ".join(_POINT), ", ".join(_DIRECTION)

    def of_kind(kind: Any, function: str) -> list[str]:
        if kind.directional is not None:
            return [f"return {function}({point}, 1.0, {direction})"]
        return [f"return _along({function}({point}), {direction})"]

    text, names = _branches(of_kind)
    return text, {**names, "_along": _along, "_invalid": INVALID}


_AXES = {
    "time": "1.0, 0.0, 0.0, 0.0",
    "north": "0.0, 1.0, 0.0, 0.0",
    "east": "0.0, 0.0, 1.0, 0.0",
    "depth": "0.0, 0.0, 0.0, 1.0",
}
_SUMS = {axis: tuple(f"d_{axis}_{k}" for k in range(3)) for axis in _AXES}
"""Names of the sums of the derivatives of the velocity's three components, by axis."""
_VELOCITY = ("v_0", "v_1", "v_2")


def _write_gradient() -> Written:
    """Write `sample_gradient`; each type adds only its own axes, so depth-only types are fast."""
    point = ", ".join(_POINT)

    def add(sums: Sequence[str], first: int) -> str:
        return "; ".join(f"{name} += k[{first + i}]" for i, name in enumerate(sums))

    def of_kind(kind: Any, function: str) -> list[str]:
        if kind.directional is None:
            by_place = [(_SUMS["north"][i], _SUMS["east"][i], _SUMS["depth"][i]) for i in range(3)]
            sums = (*_VELOCITY, *_SUMS["time"], *(name for row in by_place for name in row))
            return [f"k = {function}({point})", add(sums, 0)]
        taken = tuple(kind.depends_on)
        if taken != ("depth",):
            taken = ("time", *(axis for axis in taken if axis != "time"))
        lines = []
        for axis in taken:
            lines += [f"k = {function}({point}, {_AXES[axis]})", add(_SUMS[axis], 3)]
        return [*lines, add(_VELOCITY, 0)]  # each call returns the velocity too

    branches, names = _branches(of_kind)
    sums = (*_VELOCITY, *(name for axis in _SUMS.values() for name in axis))
    body = f"""
{" = ".join(sums)} = 0.0
if program.size > 0:
    if not (0.0 <= program[0] <= program.size): return _invalid
    depth = down if down > 0.0 else 0.0
    at = 1
    for _ in range(int(program[0])):
        code, start, size = _record_at(program, at)
        if size < 0: return _invalid
        at = start + size
{textwrap.indent(branches, "        ")}
if not down > 0.0:  # above the surface nothing changes with depth
    {" = ".join(_SUMS["depth"])} = 0.0
return ({", ".join(_VELOCITY)}, {", ".join(_SUMS["time"])}, {
        ", ".join(_SUMS[axis][k] for k in range(3) for axis in ("north", "east", "depth"))
    })
"""
    return body, {**names, "_record_at": record_at, "_invalid": INVALID_GRADIENT}


_rate_of_kind = generate(
    "_rate_of_kind", ("code", *_POINT, *_DIRECTION), _write_rate, module=__name__, forceinline=True
)
sample_gradient = generate(
    "sample_gradient", ("program", "t", "north", "east", "down"), _write_gradient, module=__name__,
    _nrt=False,
)  # fmt: skip
"""Current, its rate at a fixed place, and its gradient.

Takes the arguments of `sample`. Returns 15 numbers: velocity north, east, down [m/s]; its local
rate dV/dt [m/s2]; its gradient [1/s] row by row, dVn/dn, dVn/de, dVn/dd, dVe/dn, ...
"""


@borrowing
def sample(program, t, north, east, down, v_north, v_east, v_down):
    """Current and its total time derivative along the vehicle's path.

    program: float64 vector from `Current.compile`. t [s] since mission start; north, east, down
    [m] about the mission's origin, down = depth; v_* [m/s] the vehicle's velocity over ground.
    Returns (u_north, u_east, u_down [m/s], a_north, a_east, a_down [m/s2]), positive toward
    north, east and down; NaN for a malformed program.
    """
    u_n = u_e = u_d = a_n = a_e = a_d = 0.0
    if program.size == 0:
        return u_n, u_e, u_d, a_n, a_e, a_d
    if not (0.0 <= program[0] <= program.size):
        return INVALID
    depth, depth_rate = (down, v_down) if down > 0.0 else (0.0, 0.0)
    at = 1
    for _ in range(int(program[0])):
        code, start, size = record_at(program, at)
        if size < 0:
            return INVALID
        at = start + size
        part = _rate_of_kind(
            code, program, start, size, t, north, east, depth, v_north, v_east, depth_rate
        )
        u_n += part[0]
        u_e += part[1]
        u_d += part[2]
        a_n += part[3]
        a_e += part[4]
        a_d += part[5]
    return u_n, u_e, u_d, a_n, a_e, a_d


@jit
def sample_track(program, t, north, east, down, v_north, v_east, v_down):
    """Current at each point of a track (`sample`): seven vectors of shape (n,), result (n, 6)."""
    out = np.empty((t.size, 6))
    for i in range(t.size):
        part = sample(program, t[i], north[i], east[i], down[i], v_north[i], v_east[i], v_down[i])
        for j in range(6):
            out[i, j] = part[j]
    return out
