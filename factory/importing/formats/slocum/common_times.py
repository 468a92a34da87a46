"""Sensors of a Slocum that belong together: at the times of the first, as columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.reading.deployment_log import EMPTY, Channel

Array = NDArray[np.float64]


def at_common_times(native: Mapping[str, Channel], names: Sequence[str]) -> list[Array]:
    """Times of the first sensor, and all the sensors at them; NaN where one has no sample."""
    first = native.get(names[0], EMPTY)
    columns = [first.time, first.values]
    for name in names[1:]:
        values = np.full(len(first), np.nan)
        other = native.get(name, EMPTY)
        _, mine, its = np.intersect1d(first.time, other.time, return_indices=True)
        values[mine] = other.values[its]
        columns.append(values)
    return columns
