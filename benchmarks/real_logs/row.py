"""Row: one figure of the benchmark, with its interval, number of samples and note.

python -m benchmarks.real_logs.row      # every table of what the benchmark kept

Methods are compared at equal samples, for which all of them have a value. Intervals are by
bootstrap over dives, because samples of one dive share water, trim and errors of the method. Whole
dives are sampled with replacement; each sample gives a figure (Efron and Tibshirani 1993).
`published.toml` has published figures of public methods on these deployments.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.command import markdown as markdown_table
from twin.navigation.dead_reckoning import Array

FIGURES = Path(__file__).with_name("published.toml")
MEASURED = Path(__file__).with_name("measured.json")
"""Rows that `python -m benchmarks.real_logs FOLDER --keep FILE` wrote on the public logs; a test
compares docs/results/real_logs.md with them, and `make docs` shows every table of them"""
UNITS = {
    "m s-1": ("cm/s", 100.0, 2), "m h-1": ("m/h", 1.0, 0), "1": ("ratio", 1.0, 2),
    "m s-1 mean": ("cm/s", 100.0, 2), "m s-1 sd": ("cm/s", 100.0, 2), "1 dive": ("ratio", 1.0, 2),
    "%": ("%", 1.0, 1), "degree": ("deg", 1.0, 2),
}  # fmt: skip
"""Unit on the page, factor and digits, by the unit of a row"""
DRAWS = 2000
SEED = 20221123
"""Seed of the bootstrap: intervals are the same in every run"""
CENTRAL = (2.5, 97.5)
"""[%] Percentiles of a 95 % interval"""
WIDEST = 9
"""Most columns of methods on the page; more stand in lines"""
LEAST_DIVES = 4
"""Fewest dives for an interval"""

Interval = tuple[float, float]
UNKNOWN: Interval = (float("nan"), float("nan"))
Kind = Literal["published", "public method", "twin", "network", "floor", "truth", "skipped"]
NOT_COMPARED: tuple[Kind, ...] = ("published", "floor", "skipped")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
    """Figure of one method in one task."""

    task: str
    data: str
    """Deployment, or folder without a deployment"""
    method: str
    kind: Kind
    value: float = math.nan
    """Figure in `unit`; NaN without one, see `note`"""
    low: float = math.nan
    high: float = math.nan
    """Limits of the 95 % interval of the value, by bootstrap over dives; NaN without one"""
    unit: str = "m s-1"
    samples: int = 0
    """Number of truth samples, or of dives, in the figure"""
    dives: int = 0
    note: str = ""
    """Tuning of the method, publication of the figure, or reason why it is missing"""


def rmse(errors: Array) -> float:
    """Root of the mean square; NaN without values."""
    errors = np.asarray(errors, float)
    return float(np.sqrt(np.mean(np.square(errors)))) if errors.size else math.nan


def best(rows: Sequence[Row]) -> list[Row]:
    """Select the row of least error for each task, deployment, unit and samples."""
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        # an angle is signed: its least is not its best
        if row.kind not in NOT_COMPARED and row.unit != "degree" and math.isfinite(row.value):
            groups.setdefault((row.task, row.data, row.unit, row.samples), []).append(row)
    return [min(group, key=lambda r: r.value) for group in groups.values() if len(group) > 1]


def table(rows: Sequence[Row]) -> list[dict[str, object]]:
    """Rows for a terminal; the best row at equal samples is marked."""
    winners = best(rows)
    return [
        {
            "data": row.data, "method": row.method, "": row.kind,
            row.unit: row.value if math.isfinite(row.value) else None,
            "95 %": f"{row.low:.3g} to {row.high:.3g}" if math.isfinite(row.low) else "",
            "best": "*" if any(row is one for one in winners) else "",
            "samples": row.samples or None, "dives": row.dives or None, "note": row.note,
        }
        for row in rows
    ]  # fmt: skip


def rmse_interval(dives: Sequence[Array]) -> Interval:
    """95 % interval of the RMSE over all samples; NaN for too few dives.

    Args:
      dives: errors of each dive, finite.
    """
    known = [dive for dive in dives if dive.size]
    squares = np.array([float(np.sum(dive**2)) for dive in known])
    counts = np.array([dive.size for dive in known], float)
    if len(known) < LEAST_DIVES:
        return UNKNOWN
    drawn = bootstrap(len(known))
    found = np.sqrt(squares[drawn].sum(axis=1) / counts[drawn].sum(axis=1))
    low, high = np.percentile(found, CENTRAL)
    return float(low), float(high)


def median_interval(errors: Array) -> Interval:
    """95 % interval of the median over dives, one error each; NaN for too few dives."""
    if errors.size < LEAST_DIVES:
        return UNKNOWN
    low, high = np.percentile(np.median(errors[bootstrap(errors.size)], axis=1), CENTRAL)
    return float(low), float(high)


def pooled_draws(groups: Sequence[Sequence[Array]]) -> Array:
    """RMSE of deployments with equal weights, (1 + draws,): of all dives, then of each bootstrap
    sample of dives within their deployments; NaN for too few dives.

    All methods have the same bootstrap samples, so that the ratio of two methods has an interval.

    Args:
      groups: errors of each dive of each deployment, finite.
    """
    squares = np.zeros(1 + DRAWS)
    for group, dives in enumerate(groups):
        if len(dives) < LEAST_DIVES:
            return np.full(1 + DRAWS, np.nan)
        drawn = np.vstack([np.arange(len(dives)), bootstrap(len(dives), group)])
        sums = np.array([float(np.sum(dive**2)) for dive in dives])
        counts = np.array([dive.size for dive in dives], float)
        squares += sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1) / len(groups)
    return np.sqrt(squares)


def central(draws: Array) -> Interval:
    """95 % interval of a figure from its bootstrap samples."""
    low, high = np.percentile(draws, CENTRAL)
    return float(low), float(high)


def bootstrap(dives: int, group: int = 0) -> np.ndarray:
    """Numbers of the dives in each bootstrap sample, (draws, dives)."""
    return np.random.default_rng(SEED + group).integers(0, dives, (DRAWS, dives))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Method:
    """Errors of one method."""

    name: str
    kind: Kind
    note: str
    errors: Mapping[int, Array]
    """Errors by dive, at the same samples for every method; NaN where the method has no value"""


def common(methods: Sequence[Method]) -> list[Method]:
    """Reduce methods to the samples that all have; leave out dives without any."""
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
    """Rows with the RMSE [m/s] of each method at their common samples, and its interval."""

    def figures(dives: Sequence[Array]) -> tuple[float, Interval, int, str]:
        every = np.concatenate(dives) if dives else np.zeros(0)
        bias = f"bias {1e3 * every.mean():+.1f} mm/s" if every.size else "no common sample"
        return rmse(every), rmse_interval(dives), int(every.size), bias

    return _rows(task, data, "m s-1", methods, figures)


def median_rows(task: str, data: str, unit: str, methods: Sequence[Method]) -> list[Row]:
    """Rows with the median over dives of each method, one error per dive, and its interval."""

    def figures(dives: Sequence[Array]) -> tuple[float, Interval, int, str]:
        errors = np.array([float(values[0]) for values in dives])
        spread = f"mean {errors.mean():.0f}, p90 {np.percentile(errors, 90):.0f}"
        return float(np.median(errors)), median_interval(errors), errors.size, spread

    return _rows(task, data, unit, methods, figures)


def _rows(
    task: str,
    data: str,
    unit: str,
    methods: Sequence[Method],
    figures: Callable[[Sequence[Array]], tuple[float, Interval, int, str]],
) -> list[Row]:
    """Make a row for each method; `figures` gives its value, interval, samples and note."""
    rows = []
    for one in common(methods) if methods else []:
        value, (low, high), samples, note = figures(list(one.errors.values()))
        rows.append(Row(
            task=task, data=data, method=one.name, kind=one.kind, value=value, low=low, high=high,
            unit=unit, samples=samples, dives=len(one.errors), note=f"{one.note}; {note}",
        ))  # fmt: skip
    return rows


@functools.cache
def figures() -> tuple[dict[str, Any], ...]:
    """Read every entry of `published.toml`."""
    return tuple(tomllib.loads(FIGURES.read_text(encoding="utf-8"))["figure"])


def published_rows(task: str, deployment: str) -> list[Row]:
    """Published rows of a task and a deployment, which the beginning of its name identifies."""
    return [
        Row(
            task=task, data=deployment, method=f"{entry['method']}, on other samples",
            kind="published", value=entry["value"], unit=entry["unit"], note=entry["source"],
        )
        for entry in figures()
        if entry["task"] == task and deployment.lower().startswith(entry["deployment"])
    ]  # fmt: skip


# --- rows that are kept, and their tables of Markdown ---------------------------------------------


def keep(rows: Sequence[Row], path: Path) -> None:
    """Write rows to a file; numbers have five digits."""
    lines = [
        json.dumps(
            {
                key: float(f"{value:.5g}") if isinstance(value, float) else value
                for key, value in dataclasses.asdict(row).items()
                if not (isinstance(value, float) and math.isnan(value))
            }
        )
        for row in rows
    ]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")


def kept(path: Path = MEASURED) -> list[Row]:
    """Read the rows of a file that `keep` wrote."""
    return [Row(**entry) for entry in json.loads(path.read_text(encoding="utf-8"))]


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Table in Markdown of each task that compares methods, by task."""
    tasks = dict.fromkeys(row.task for row in rows if row.kind not in NOT_COMPARED)
    return {task: markdown(rows, task) for task in tasks}


def markdown(rows: Sequence[Row], task: str) -> str:
    """Table of one task in Markdown: a line for each method if there is one deployment, else a line
    for each deployment, or for each of many methods. The best figure at equal samples is bold."""
    hidden = ("published", "skipped") if task.endswith("beside bounds") else NOT_COMPARED
    mine = [row for row in rows if row.task == task and row.kind not in hidden]
    data = list(dict.fromkeys(row.data for row in mine))
    methods = list(dict.fromkeys(row.method for row in mine))
    cells = {(row.data, row.method): cell(row, best(mine)) for row in mine}
    unit = UNITS[mine[0].unit][0]
    if len(methods) > WIDEST and len(data) > 1:
        sizes = [_samples(next(row for row in mine if row.data == name)) for name in data]
        head = [f"{unit} (95 %)", *data]
        body = [
            *([method, *(cells.get((n, method), "") for n in data)] for method in methods),
            ["samples", *sizes],
        ]
    elif len(data) == 1:
        head = [f"{data[0]}, {_samples(mine[0])}", f"{unit} (95 %)"]
        body = [[method, cells[data[0], method]] for method in methods]
    else:
        head = [f"{unit} (95 %)", *methods, "samples"]
        body = [
            [
                name,
                *(cells.get((name, method), "") for method in methods),
                _samples(next(row for row in mine if row.data == name)),
            ]
            for name in data
        ]
    return markdown_table(head, body)


def cell(row: Row, winners: Sequence[Row]) -> str:
    _, factor, digits = UNITS[row.unit]
    text = f"{factor * row.value:.{digits}f}"
    if any(row is one for one in winners):
        text = f"**{text}**"
    if math.isfinite(row.low):
        text += f" ({factor * row.low:.{digits}f} to {factor * row.high:.{digits}f})"
    return text


def _samples(row: Row) -> str:
    words = {"propelled": "run", "angle of": "minute"}
    one = next((word for start, word in words.items() if row.task.startswith(start)), "dive")
    if row.samples == row.dives:
        return f"{row.dives} {one}s"
    return f"{row.samples} in {row.dives} {one}{'s' if row.dives > 1 else ''}"


if __name__ == "__main__":
    print("\n".join(f"## {task}\n\n{one}" for task, one in tables(kept()).items()))
