"""Lookup: depth of the sea floor in a compiled table, for native code and for numpy.

A table holds: number of nodes along north and east, the meridians' convergence [1/m], the axes
north and east [m] about the mission's start, and the depths [m] row by row. Depth is bilinear
between the nodes, and the edge depth holds beyond the table's sides.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import borrowing, jit
from twin.numbers import Array
from twin.water.current.sampler import locate

HEADER = 3
"""Length of the header: nodes along north, nodes along east, meridian convergence [1/m]."""

EXACT = 1e-4
"""[m] Largest error of a beam's length."""


@borrowing
def floor_depth(table, north, east):  # type: ignore[no-untyped-def]
    """Depth [m] of the sea floor at a point [m] of the mission's tangent plane.

    NaN for a malformed table.
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
    """Depths [m] of the sea floor along a track: `floor_depth` of vectors of equal length [m]."""
    out = np.empty(north.shape[0])
    for k in range(out.shape[0]):
        out[k] = floor_depth(table, north[k], east[k])
    return out


@borrowing
def shallowest_depth(table):  # type: ignore[no-untyped-def]
    """Smallest depth [m] of a table's nodes, hence of the whole floor."""
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

    The search begins at the depth `shallowest` [m] of the whole floor. Steps of `step` [m] find
    the first crossing, and false position refines it to 0.1 mm. The distance is 0 for a point at
    or below the floor.
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
    """Distance to the floor between `low`, `short` [m] above it, and `high`, `beyond` [m] below it.

    False position, Illinois form: an end that stays counts half in the next step.
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
    """Distances [m] of many beams: `beam_length` at places (n,) [m] along unit vectors (n, 3)."""
    out = np.empty(north.shape[0])
    least = shallowest_depth(table)
    for k in range(out.shape[0]):
        out[k] = beam_length(table, least, north[k], east[k], depth[k], toward[k], farthest, step)
    return out


def pack(north: Array, east: Array, depth: Array, curvature: float = 0.0) -> Array:
    """Pack a grid into a table: axes [m] ascending, (n,) and (m,), and depths [m] (n, m)."""
    header = np.array([north.size, east.size, curvature], dtype=np.float64)
    return np.concatenate([header, north, east, np.asarray(depth, dtype=np.float64).ravel()])


def beyond_floor(table: Array, north: Array, east: Array) -> NDArray[np.bool_]:
    """Mark points of a track [m], shape (n,), outside a table, where edge depths are used."""
    nn, ne, curvature = int(table[0]), int(table[1]), table[2]
    outside = np.zeros(np.shape(north), bool)
    for count, first, along in (
        (nn, HEADER, north - 0.5 * curvature * east**2),
        (ne, HEADER + nn, east * (1.0 + curvature * north)),
    ):
        if count > 1:  # a single node holds everywhere
            outside |= (along < table[first]) | (along > table[first + count - 1])
    return outside
