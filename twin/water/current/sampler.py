"""Sampler: current, its rate along the vehicle's path and its gradient, compiled.

`sample` is called once per physics step from inside C callbacks. The rate is the material
derivative for the vehicle, dV_c/dt + (v . grad) V_c with v the velocity over ground, and it is the
exact derivative of what is interpolated, not an estimate. Above the mean sea surface the value at
depth 0 holds. A program that is damaged gives NaN, and nothing outside it is read.

The chain of kinds is written from the registry: a kind that is registered later makes this module
new, and with it every compiled function that samples currents.

The layout of a compiled current is flat: every kind writes it, and the sampler reads it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.compiled import generate, inline, jit
from twin.compiled.dispatch import Written
from twin.water.current import registry
from twin.water.current.interpolation import INVALID

Floats = NDArray[np.float64]

RECORD_HEADER = 2
"""Numbers in front of each payload: code and payload length."""


def record(code: int, *payload: ArrayLike) -> Floats:
    """One record: its code, the length of its payload, and the payload flattened in order."""
    body = np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in payload])
    return np.concatenate([np.array([code, body.size], dtype=np.float64), body])


def program(records: Sequence[Floats]) -> Floats:
    """The whole program: the number of records followed by them."""
    return np.concatenate([np.array([len(records)], dtype=np.float64), *records])


INVALID_GRADIENT = (math.nan,) * 15
"""Velocity, local rate and gradient of what is not a program."""

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


@jit
def _gather(t, n, e, d):
    """Velocity, local rate and gradient from the derivatives along time, north, east and depth."""
    return (*t, n[3], e[3], d[3], n[4], e[4], d[4], n[5], e[5], d[5])


@jit
def _by_depth(d):
    """Likewise of what changes with depth alone."""
    return d[0], d[1], d[2], 0.0, 0.0, 0.0, 0.0, 0.0, d[3], 0.0, 0.0, d[4], 0.0, 0.0, d[5]


@jit
def _sum(a, b):
    """Velocity, local rate and gradient of two records together."""
    return (
        *(a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4]),
        *(a[5] + b[5], a[6] + b[6], a[7] + b[7], a[8] + b[8], a[9] + b[9]),
        *(a[10] + b[10], a[11] + b[11], a[12] + b[12], a[13] + b[13], a[14] + b[14]),
    )


@jit
def _held(k):
    """Above the surface nothing changes with depth."""
    return (
        *(k[0], k[1], k[2], k[3], k[4], k[5]),
        *(k[6], k[7], 0.0, k[9], k[10], 0.0, k[12], k[13], 0.0),
    )


def _chain(
    of_kernel: str, of_directional: Callable[[registry.Kind], str], invalid: tuple[float, ...]
) -> Written:
    """A branch for each kind; `{}` in the expressions stands for its function."""
    names = {
        "_along": _along,
        "_gather": _gather,
        "_by_depth": _by_depth,
        "_none": (0.0,) * 6,
        "_invalid": invalid,
    }
    lines = []
    for kind in registry.kinds().values():
        function = f"_kind_{kind.code}"
        expression = of_directional(kind) if kind.directional is not None else of_kernel
        names[function] = kind.directional or kind.kernel
        lines.append(f"if code == {kind.code}:")
        if kind.payload_size is not None:
            lines.append(f"    if size != {kind.payload_size}: return _invalid")
        lines.append(f"    return {expression.replace('{}', function)}")
    return "\n".join([*lines, "return _invalid"]), names


def _write_rate() -> Written:
    point, direction = ", ".join(_POINT), ", ".join(_DIRECTION)
    return _chain(
        f"_along({{}}({point}), {direction})",
        lambda kind: f"{{}}({point}, 1.0, {direction})",
        INVALID,
    )


_AXES = {
    "time": "1.0, 0.0, 0.0, 0.0",
    "north": "0.0, 1.0, 0.0, 0.0",
    "east": "0.0, 0.0, 1.0, 0.0",
    "depth": "0.0, 0.0, 0.0, 1.0",
}


def _write_gradient() -> Written:
    point = ", ".join(_POINT)

    def derivatives(kind: registry.Kind) -> str:
        if tuple(kind.cls.depends_on) == ("depth",):
            return f"_by_depth({{}}({point}, {_AXES['depth']}))"
        # the velocity comes with every derivative: here with that along time
        taken = {"time", *kind.cls.depends_on}
        four = (f"{{}}({point}, {d})" if axis in taken else "_none" for axis, d in _AXES.items())
        return f"_gather({', '.join(four)})"

    return _chain(f"{{}}({point})", derivatives, INVALID_GRADIENT)


_rate_of_kind = generate(
    "_rate_of_kind", ("code", *_POINT, *_DIRECTION), _write_rate, module=__name__, inline="always"
)
_gradient_of_kind = generate(
    "_gradient_of_kind", ("code", *_POINT), _write_gradient, module=__name__, inline="always"
)


@jit
def sample(program, t, north, east, down, v_north, v_east, v_down):
    """Current and its total time derivative along the vehicle's path.

    program: float64 vector from `Current.compile`. t [s] since mission start; north, east, down
    [m] about the mission's origin, down = depth; v_* [m/s] the vehicle's velocity over ground.
    Returns (u_north, u_east, u_down [m/s], a_north, a_east, a_down [m/s2]), positive toward
    north, east and down; NaN from what is not a program.
    """
    u_n = 0.0
    u_e = 0.0
    u_d = 0.0
    a_n = 0.0
    a_e = 0.0
    a_d = 0.0
    if program.size == 0:
        return u_n, u_e, u_d, a_n, a_e, a_d
    if not (0.0 <= program[0] <= program.size):
        return INVALID
    depth = 0.0
    depth_rate = 0.0
    if down > 0.0:
        depth = down
        depth_rate = v_down
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
def sample_gradient(program, t, north, east, down):
    """Current, its rate at a fixed place, and its gradient.

    Arguments as those of `sample`. Returns 15 numbers: velocity north, east, down [m/s]; its local
    rate dV/dt [m/s2]; its gradient [1/s] row by row, dVn/dn, dVn/de, dVn/dd, dVe/dn, ...
    """
    total = (0.0,) * 15
    if program.size == 0:
        return total
    if not (0.0 <= program[0] <= program.size):
        return INVALID_GRADIENT
    depth = down if down > 0.0 else 0.0
    at = 1
    for _ in range(int(program[0])):
        code, start, size = record_at(program, at)
        if size < 0:
            return INVALID_GRADIENT
        at = start + size
        total = _sum(total, _gradient_of_kind(code, program, start, size, t, north, east, depth))
    return total if down > 0.0 else _held(total)


@jit
def sample_track(program, t, north, east, down, v_north, v_east, v_down):
    """`sample` at each point of a track: seven vectors of shape (n,), result (n, 6)."""
    out = np.empty((t.size, 6))
    for i in range(t.size):
        part = sample(program, t[i], north[i], east[i], down[i], v_north[i], v_east[i], v_down[i])
        for j in range(6):
            out[i, j] = part[j]
    return out
