"""Equal samples: methods side by side, each scored where all of them say something."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.real_logs.intervals import median_interval, rmse_interval
from benchmarks.real_logs.row import Kind, Row, rmse
from twin.navigation.dead_reckoning import Array


@dataclasses.dataclass(frozen=True, kw_only=True)
class Method:
    """Errors of one method."""

    name: str
    kind: Kind
    note: str
    errors: Mapping[int, Array]
    """By dive, at the same samples for every method; NaN where it says nothing"""


def common(methods: Sequence[Method]) -> list[Method]:
    """The same methods at the samples that all of them have, dives without any left out."""
    dives = sorted(set.intersection(*(set(one.errors) for one in methods)))
    known = {
        dive: np.logical_and.reduce([np.isfinite(one.errors[dive]) for one in methods])
        for dive in dives
    }
    return [
        dataclasses.replace(
            one, errors={d: one.errors[d][known[d]] for d in dives if known[d].any()}
        )
        for one in methods
    ]


def rmse_rows(task: str, data: str, methods: Sequence[Method]) -> list[Row]:
    """RMSE of each method at their common samples [m/s], with an interval over dives."""
    rows = []
    for one in common(methods) if methods else []:
        dives = list(one.errors.values())
        every = np.concatenate(dives) if dives else np.zeros(0)
        low, high = rmse_interval(dives)
        bias = f"bias {1e3 * every.mean():+.1f} mm/s" if every.size else "no common sample"
        rows.append(
            Row(
                task=task,
                data=data,
                method=one.name,
                kind=one.kind,
                value=rmse(every),
                low=low,
                high=high,
                samples=int(every.size),
                dives=len(dives),
                note=f"{one.note}; {bias}",
            )
        )
    return rows


def median_rows(task: str, data: str, unit: str, methods: Sequence[Method]) -> list[Row]:
    """Median over dives of each method, one error a dive, with an interval."""
    rows = []
    for one in common(methods) if methods else []:
        errors = np.array([float(values[0]) for values in one.errors.values()])
        low, high = median_interval(errors)
        spread = f"mean {errors.mean():.0f}, p90 {np.percentile(errors, 90):.0f}"
        rows.append(
            Row(
                task=task,
                data=data,
                method=one.name,
                kind=one.kind,
                value=float(np.median(errors)),
                low=low,
                high=high,
                unit=unit,
                samples=errors.size,
                dives=errors.size,
                note=f"{one.note}; {spread}",
            )
        )
    return rows
