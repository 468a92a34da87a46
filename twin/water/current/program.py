"""Flat layout of a compiled current: what `sampler.py` reads and every component writes.

A program is one float64 vector, so that native callbacks can carry it in MuJoCo's user data:

    program[0]              number of components (0, or an empty vector, is still water)
    then per component      kind, payload length, payload

Velocities of components add up. All payloads are SI and NED about the mission's origin.
Kinds are frozen into the compiled sampler, which numba refreshes only when `sampler.py` changes:
add kinds, never renumber them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

UNIFORM = 1
PROFILE = 2
EKMAN = 3
GEOSTROPHIC = 4
TIDE = 5
INERTIAL = 6
LOG_LAYER = 7
SERIES = 8
GRID = 9

RECORD_HEADER = 2
"""Numbers in front of each payload: kind and payload length."""

GRID_HEADER = 6
"""nt, nd, nn, ne, number of velocity components (2 or 3), meridian curvature [1/m]."""


def record(kind: int, *payload: ArrayLike) -> Floats:
    """One component: its kind, the length of its payload, and the payload flattened in order."""
    body = np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in payload])
    return np.concatenate([np.array([kind, body.size], dtype=np.float64), body])


def program(records: Sequence[Floats]) -> Floats:
    """The whole program: the number of components followed by their records."""
    return np.concatenate([np.array([len(records)], dtype=np.float64), *records])


def profile_record(depth: ArrayLike, velocity: ArrayLike) -> Floats:
    """Table of velocity [m/s], shape (n, 3) NED, at ascending depths [m], shape (n,)."""
    return record(PROFILE, np.size(depth), depth, velocity)


def series_record(time: ArrayLike, velocity: ArrayLike) -> Floats:
    """Velocity [m/s], shape (n, 3) NED, at ascending times [s since mission start], shape (n,)."""
    return record(SERIES, np.size(time), time, velocity)


def grid_record(
    time: ArrayLike,
    depth: ArrayLike,
    north: ArrayLike,
    east: ArrayLike,
    velocity: ArrayLike,
    curvature: float = 0.0,
) -> Floats:
    """Velocity on a rectilinear grid.

    time [s since mission start], depth, north, east [m]: ascending vectors, length 1 allowed.
    velocity [m/s]: shape (time, depth, north, east, 2 or 3), north, east (, down).
    curvature [1/m]: tan(latitude)/N, see `Origin.curvature`; 0 for a flat grid.
    """
    values = np.asarray(velocity, dtype=np.float64)
    shape = (np.size(time), np.size(depth), np.size(north), np.size(east))
    if values.ndim != 5 or values.shape[:4] != shape or values.shape[4] not in (2, 3):
        raise ValueError(f"velocity has shape {values.shape}, axes say {shape} + (2 or 3,)")
    header = [*shape, values.shape[4], curvature]
    return record(GRID, header, time, depth, north, east, values)
