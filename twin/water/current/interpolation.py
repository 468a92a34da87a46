"""Interpolation: compiled, linear, on ascending axes inside a program; without allocations.

At a node the derivative of the cell that lies ahead in the axis's direction is returned; outside
the axis the edge value is held and the derivative is zero. Whatever numbers a program holds,
nothing outside a record is read: a record that cannot be one gives NaN.
"""

from __future__ import annotations

import math

from twin.compiled import borrowing

INVALID = (math.nan,) * 6
"""Velocity and derivative of a record that is damaged: an event that a simulation reports."""


@borrowing
def locate(program, start, n, x):  # type: ignore[no-untyped-def]
    """Cell of x on the ascending axis program[start:start+n]: index, fraction, 1/width.

    The guess of an evenly spaced axis is tried first, then a binary search. The width's inverse is
    zero where the edge value is held, which makes every derivative vanish there.
    """
    first = program[start]
    if n == 1 or not (x >= first):
        return 0, 0.0, 0.0
    last = program[start + n - 1]
    if x >= last:
        return n - 2, 1.0, 0.0
    guess = (x - first) / (last - first) * (n - 1)
    # Only a damaged axis guesses NaN or beyond n, which no integer holds.
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
def table(program, start, size, x, x_rate):  # type: ignore[no-untyped-def]
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
