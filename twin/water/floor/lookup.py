"""Lookup: the depth of the sea floor in a compiled table, for native code and for numpy.

A table holds: nodes along north and along east, the meridians' convergence [1/m], the axes north
and east [m] about the mission's start, and the depths [m] row by row. Between the nodes the depth
is bilinear; beyond the table's sides the depth at its edge is held.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import borrowing, jit
from twin.numbers import Array
from twin.water.current.sampler import locate

HEADER = 3
"""nodes along north, nodes along east, meridian convergence [1/m]"""

EXACT = 1e-4
"""[m] of the length of a beam"""


@borrowing
def floor_depth(table, north, east):  # type: ignore[no-untyped-def]
    """Depth [m] of the sea floor at a point [m] of the mission's tangent plane.

    NaN for a table that cannot be one.
    """
    if table.size < HEADER:
        return math.nan
    rows, columns, curvature = table[0], table[1], table[2]
    if not (rows >= 1.0 and columns >= 1.0):
        return math.nan
    if HEADER + rows + columns + rows * columns != table.size:
        return math.nan
    nn, ne = int(rows), int(columns)
    # tangent-plane metres to metres along the meridian and the start's parallel, second order
    y = north - 0.5 * curvature * east * east
    x = east * (1.0 + curvature * north)
    i, f, _ = locate(table, HEADER, nn, y)
    j, g, _ = locate(table, HEADER + nn, ne, x)
    up = ne if nn > 1 else 0
    right = 1 if ne > 1 else 0
    at = HEADER + nn + ne + i * ne + j
    south = table[at] + g * (table[at + right] - table[at])
    far = table[at + up] + g * (table[at + up + right] - table[at + up])
    return south + f * (far - south)


@jit
def floor_depths(table, north, east):  # type: ignore[no-untyped-def]
    """`floor_depth` along a track: vectors of equal length, [m]."""
    out = np.empty(north.shape[0])
    for k in range(out.shape[0]):
        out[k] = floor_depth(table, north[k], east[k])
    return out


@borrowing
def shallowest_depth(table):  # type: ignore[no-untyped-def]
    """Least depth [m] of a table's nodes, which the depths between them keep to."""
    least = math.inf
    if table.size < HEADER:
        return least
    first = HEADER + int(table[0]) + int(table[1])
    for k in range(first, table.size):
        least = min(least, table[k])
    return least


@borrowing
def beam_length(  # type: ignore[no-untyped-def]
    table, shallowest, north, east, depth, toward, farthest, step
):
    """Distance [m] from a point to the sea floor along a unit vector NED; inf beyond `farthest`.

    Steps of `step` [m], from the depth `shallowest` [m] of the whole floor on, find the first
    crossing, and false position where it is, to 0.1 mm. A point at or below the floor is at
    distance 0.
    """
    low, short = 0.0, 0.0
    if depth < shallowest:
        if toward[2] > 0.0:
            low = (shallowest - depth) / toward[2]
    elif depth >= floor_depth(table, north, east):
        return 0.0
    if low >= farthest:
        return math.inf
    x, y, z = north + low * toward[0], east + low * toward[1], depth + low * toward[2]
    short = floor_depth(table, x, y) - z
    if short <= 0.0:
        return low
    while low < farthest:
        high = min(low + step, farthest)
        x, y, z = north + high * toward[0], east + high * toward[1], depth + high * toward[2]
        beyond = z - floor_depth(table, x, y)
        if beyond >= 0.0:
            return _crossing(table, north, east, depth, toward, low, short, high, beyond)
        low, short = high, -beyond
    return math.inf


@borrowing
def _crossing(  # type: ignore[no-untyped-def]
    table, north, east, depth, toward, low, short, high, beyond
):
    """Where a beam that is `short` [m] above the floor at `low` and `beyond` it at `high` meets it.

    False position in the form called Illinois: an end that stays counts half the next time.
    """
    kept = 0
    while high - low > EXACT:
        middle = low + (high - low) * short / (short + beyond)
        x, y, z = north + middle * toward[0], east + middle * toward[1], depth + middle * toward[2]
        found = z - floor_depth(table, x, y)
        if abs(found) < 0.1 * EXACT or not (low < middle < high):
            return middle
        if found > 0.0:
            high, beyond = middle, found
            if kept == 1:
                short *= 0.5
            kept = 1
        else:
            low, short = middle, -found
            if kept == -1:
                beyond *= 0.5
            kept = -1
    return high


@jit
def beam_lengths(table, north, east, depth, toward, farthest, step):  # type: ignore[no-untyped-def]
    """`beam_length` of many beams: places (n,) [m], unit vectors (n, 3)."""
    out = np.empty(north.shape[0])
    least = shallowest_depth(table)
    for k in range(out.shape[0]):
        out[k] = beam_length(table, least, north[k], east[k], depth[k], toward[k], farthest, step)
    return out


def pack(north: Array, east: Array, depth: Array, curvature: float = 0.0) -> Array:
    """The table of a grid: axes [m] ascending, (n,) and (m,), and depths [m] (n, m)."""
    header = np.array([north.size, east.size, curvature], dtype=np.float64)
    return np.concatenate([header, north, east, np.asarray(depth, dtype=np.float64).ravel()])


def beyond_floor(table: Array, north: Array, east: Array) -> NDArray[np.bool_]:
    """Where a track [m], shape (n,), is outside a table's sides, so that edge depths were used."""
    nn, ne, curvature = int(table[0]), int(table[1]), table[2]
    outside = np.zeros(np.shape(north), bool)
    for count, first, along in (
        (nn, HEADER, north - 0.5 * curvature * east**2),
        (ne, HEADER + nn, east * (1.0 + curvature * north)),
    ):
        if count > 1:  # one node holds for all the sea
            outside |= (along < table[first]) | (along > table[first + count - 1])
    return outside
