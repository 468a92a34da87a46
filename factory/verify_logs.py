"""Verify logs: read every chunk of a store of logs and check that it says something possible."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from factory.store_check import (
    Block,
    StoreCheck,
    StoreReport,
    check_finite_range,
    check_missions,
    check_padding,
)
from twin.geodesy import offset
from twin.records.attributes import (
    DEPLOYMENT,
    DIVE,
    DIVE_DURATION,
    N_SAMPLES,
    SPLIT,
    START_TIME,
)
from twin.records.logged import LogStore
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.schema.limits import recorded_limits

Array = NDArray[np.float64]

NEEDED = (
    N_SAMPLES, SPLIT, DEPLOYMENT, DIVE, START_TIME, DIVE_DURATION, "measured_gap", TIME, MISSION,
)  # fmt: skip
"""Arrays that every import writes."""
WITH_DEPTH = ("measured_depth", "measured_pressure", "measured_phase")
"""Arrays that an import writes together, or not at all: a log whose rows are no dives may have no
depth."""
COMPLETE = frozenset({"measured_gap", *WITH_DEPTH})
"""Signals without a hole: the import bridges and marks them."""
CODES = {"measured_gap": (0.0, 1.0), "measured_phase": (0.0, 1.0, 2.0, 3.0)}
OFFSET_TOLERANCE = 0.02, 2.0
"""Of displacements against the fixes, relative and [m]: rounding, and fixes near each other"""
PRESSURE_RATIO = 0.98, 1.08
"""[dbar/m] pressure over depth anywhere in the ocean, TEOS-10 to 11 km"""
RATIO_DEPTH = 20.0
"""[m] shallower the ratio is one of small numbers"""
FASTEST_DEPTH = 5.0
"""[m/s] no glider sinks or climbs so fast"""


def verify_logs(
    logs: LogStore, watch: Callable[[int], None] | None = None, *, workers: int = 1
) -> StoreReport:
    """Read and check everything; `watch` is called with the number of dives just read, by as many
    processes as there are `workers`."""
    names = logs.signals()
    checks = {
        name: StoreCheck(name)
        for name in ("metadata", "order", "fixes", "chunks", "padding", "finite", "range", "depth")
    }
    _check_metadata(logs, names, checks["metadata"])
    if checks["metadata"].problems:
        return StoreReport(len(logs), 0, tuple(checks.values()))
    _check_order(logs, checks["order"])
    _check_fixes(logs, checks["fixes"])
    bytes_read = check_missions(logs, names, checks, _check_dive, watch, workers)
    return StoreReport(len(logs), bytes_read, tuple(checks.values()))


def _check_metadata(logs: LogStore, names: list[str], check: StoreCheck) -> None:
    data = logs.dataset
    check.problems += [f"array {n!r} is gone" for n in logs.gone_arrays()]
    deep = any(name in data.variables for name in WITH_DEPTH)
    for needed in (*NEEDED, *(WITH_DEPTH if deep else ())):
        check.expect(needed in data.variables, lambda n=needed: f"array {n!r} is missing")  # type: ignore[misc]
    if check.problems:
        return
    for name in names:
        units, wanted = data[name].attrs.get("units"), VARIABLES[name].units
        check.expect(
            units == wanted,
            lambda n=name, u=units, w=wanted: f"{n}: units {u!r}, not {w!r}",  # type: ignore[misc]
        )
    period = float(logs.declared_period or 0.0)
    time = logs.array(TIME)
    check.expect(
        bool(np.allclose(time, np.arange(len(time)) * period, rtol=0.0, atol=1e-6)),
        lambda: f"time does not run from 0 in steps of {period:g} s",
    )
    duration = logs.number(DIVE_DURATION)
    for mission, samples in enumerate(logs.samples):
        wanted_samples = max(2, round(float(duration[mission]) / period) + 1)
        check.expect(
            samples == wanted_samples <= len(time),
            lambda m=mission, s=samples, w=wanted_samples: f"dive {m}: {s} samples, not {w}",  # type: ignore[misc]
        )
    check.expect(
        int(logs.report["rows"]) == len(logs),
        lambda: f"the report of the import speaks of {logs.report['rows']} dives, not {len(logs)}",
    )


def _check_order(logs: LogStore, check: StoreCheck) -> None:
    """Dives of a deployment follow each other."""
    check.expect(
        bool(np.isfinite(logs.starts).all()), lambda: "start_time is not finite everywhere"
    )
    duration = logs.number(DIVE_DURATION)
    for deployment in dict.fromkeys(logs.deployments):
        missions = [k for k, name in enumerate(logs.deployments) if name == deployment]
        for before, after in itertools.pairwise(missions):
            end = logs.starts[before] + duration[before]
            check.expect(
                bool(logs.starts[after] >= end - logs.period),
                lambda b=before, a=after: f"dive {a} begins before dive {b} ends",  # type: ignore[misc]
            )


def _check_fixes(logs: LogStore, check: StoreCheck) -> None:
    """Positions are on Earth, and displacements are what lies between them."""
    north, east = (logs.number(f"displacement_{name}") for name in ("north", "east"))
    for mission in range(len(logs)):
        start, end = logs.fixes(mission)
        for name, fix in (("start", start), ("end", end)):
            if not np.isfinite(fix).all():
                continue
            check.expect(
                abs(fix[0]) <= 90.0 and abs(fix[1]) <= 360.0,
                lambda m=mission, n=name, f=fix: f"dive {m}: no place at its {n}: {f[0]}, {f[1]}",  # type: ignore[misc]
            )
        if np.isfinite([*start, *end]).all():
            between = offset(np.float64(end[0]), np.float64(end[1]), *start)
            error = float(np.hypot(between[0] - north[mission], between[1] - east[mission]))
            relative, least = OFFSET_TOLERANCE
            check.expect(
                error <= max(least, relative * float(np.hypot(*between))),
                lambda m=mission, e=error: (  # type: ignore[misc]
                    f"dive {m}: its displacement is {e:.3g} m off what lies between its fixes"
                ),
            )


def _check_dive(
    logs: LogStore, mission: int, rows: Block, checks: Mapping[str, StoreCheck]
) -> None:
    samples = int(logs.samples[mission])
    what = f"dive {mission}"
    for name, row in rows.items():
        check_padding(what, name, row[samples:], samples, checks["padding"])
        inside = row[:samples]
        check_finite_range(
            what,
            name,
            inside,
            name in COMPLETE,
            recorded_limits(name),
            checks["finite"],
            checks["range"],
        )
        if name in CODES:
            odd = np.setdiff1d(inside[np.isfinite(inside)], CODES[name])
            checks["range"].expect(
                not odd.size,
                lambda n=name, o=odd: f"{what}: {n} has the unknown code {o[0]:g}",  # type: ignore[misc]
            )
    if "measured_depth" not in rows:
        return
    depth = rows["measured_depth"][:samples].astype(float)
    pressure = rows["measured_pressure"][:samples].astype(float)
    rate = np.abs(np.diff(depth)) / logs.period
    checks["depth"].expect(
        not rate.size or not float(np.nanmax(rate, initial=0.0)) > FASTEST_DEPTH,
        lambda: (
            f"{what}: the depth changes by {np.nanmax(rate):.3g} m/s at sample "
            f"{int(np.nanargmax(rate))}, at most {FASTEST_DEPTH:g}"
        ),
    )
    deep = depth > RATIO_DEPTH
    ratio = pressure[deep] / depth[deep]
    low, high = PRESSURE_RATIO
    checks["depth"].expect(
        bool(((ratio > low) & (ratio < high))[np.isfinite(ratio)].all()),
        lambda: (
            f"{what}: pressure over depth runs from {np.nanmin(ratio):.3g} to "
            f"{np.nanmax(ratio):.3g} dbar/m"
        ),
    )
