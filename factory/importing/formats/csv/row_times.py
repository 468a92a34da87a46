"""Row times: where rows begin and end in a log that is not cut into dives."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.formats.csv.mapping import Mapping

Array = NDArray[np.float64]


def row_times(
    mapping: Mapping, time: Array, files: Sequence[Array]
) -> tuple[tuple[float, float], ...] | None:
    """Start and end [s] of each row of a deployment; None where its rows are dives.

    A hole in the times that is longer than the mapping's gap ends a row, whatever rows are. Rows of
    minutes divide what is between holes into equal parts of about that length.

    Args:
      time: [s] of the deployment, increasing.
      files: [s] times of each of its files.
    """
    if mapping.rows == "dives":
        return None
    spans: list[tuple[float, float]] = []
    for part in files if mapping.rows == "file" else [time]:
        inside = time[(time >= np.nanmin(part)) & (time <= np.nanmax(part))]
        for run in np.split(inside, np.flatnonzero(np.diff(inside) > mapping.gap_s) + 1):
            spans += _divided(run, 60.0 * mapping.minutes)
    return tuple(sorted(spans))


def _divided(run: Array, length: float) -> list[tuple[float, float]]:
    """A run without holes as one row, or as rows of about `length` [s]."""
    first, last = float(run[0]), float(run[-1])
    count = max(1, round((last - first) / length)) if length else 1
    edges = np.linspace(first, last, count + 1)
    return [(float(a), float(b)) for a, b in itertools.pairwise(edges)]
