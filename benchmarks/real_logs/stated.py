"""Stated: error of the speed through the water, beside the deviation that `twin flight` states.

Methods are tuned on the depth rates and fixes of the run itself, never on its Doppler log. PD0
files have no pump: one volume is assumed in dives and one in climbs. The speed does not depend on
the volume, because the drag follows from the depth rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.real_logs import adcp, dvl
from benchmarks.real_logs.public import kinematic
from benchmarks.real_logs.row import Method, Row, rmse_rows
from benchmarks.real_logs.source import Deployment, at_times
from factory.importing import import_logs
from twin.errors import TwinError
from twin.identify import Log, identify, load_calibration, log_of, motion_of
from twin.identify.logged_missions import start_vehicle
from twin.logs.flight_estimator import FlightModel
from twin.navigation.dead_reckoning import Array

TASK = "speed, tuned on the run's depth rates"
PD0_FOLDER, PD0_VEHICLE = "slocum_pathfinder_2022", "slocum-1000"
PUMP = 200.0
"""[cm3] Assumed change of volume in each direction of a log without a pump"""
SIMPLE, TWIN = "w/sin(pitch + 3 deg)", "twin"


def rows_of(deployment: Deployment) -> list[Row]:
    """Rows of a deployment with a Doppler log or a profiler, whose surge has the depth rate added;
    none without velocities."""
    times, level = adcp.truth_of(deployment)
    doppler = dvl.read_truth(deployment)
    truth: dict[int, tuple[Array, Array]] = {}
    for log in deployment.logs():
        clock = deployment.clock(log)
        if log.index in times:
            rate = at_times(clock - clock[0], log.depth_rate, times[log.index])
            truth[log.index] = times[log.index], np.hypot(level[log.index], rate)
        elif doppler is not None:
            truth[log.index] = doppler.time - clock[0], doppler.speed
    if not truth:
        return []
    vehicle = start_vehicle(deployment.store).name
    return judged(deployment.name, vehicle, deployment.logs(list(truth)), truth)


def pd0_rows(root: Path) -> list[Row]:
    """Rows of the PD0 files of `PD0_FOLDER`, each a run of one yo."""
    rows: list[Row] = []
    for path in sorted((root / PD0_FOLDER).glob("*.pd0")):
        data, _ = import_logs("pd0", [path])
        signals = {str(n): data[n].values[0].astype(float) for n in data if data[n].ndim == 2}
        signals["measured_pump"] = PUMP * np.sign(signals["measured_pitch"])
        log = log_of(0, signals, float(data.attrs["sample_period_s"]), None, False)
        if log is None:
            raise TwinError(f"{path.name} has no dive")
        speed = np.linalg.norm(
            [signals[f"measured_dvl_{k}"] for k in ("surge", "sway", "heave")], axis=0
        )
        truth = {0: (log.period * np.arange(len(speed)), speed)}
        rows += judged(f"Pathfinder {path.stem}", PD0_VEHICLE, [log], truth)
    return rows


def judged(
    name: str, vehicle: str, logs: Sequence[Log], truth: Mapping[int, tuple[Array, Array]]
) -> list[Row]:
    """Rows of one run.

    Args:
      truth: times [s] since the row's start and speed through the water [m/s], by row.
    """
    found = identify(logs, load_calibration(vehicle)).calibration
    errors: dict[str, dict[int, Array]] = {SIMPLE: {}, TWIN: {}}
    slopes: dict[int, Array] = {}
    for log in logs:
        at, speed = truth[log.index]
        clock = log.period * np.arange(len(log.depth), dtype=float)
        values = (kinematic(log, log.pitch).speed, motion_of(log, found).speed)
        both = np.stack([at_times(clock, one, at) - speed for one in values])
        if (use := np.isfinite(both).all(axis=0)).any():
            errors[SIMPLE][log.index], errors[TWIN][log.index] = both[:, use]
            off = FlightModel().errors(log, found)[0]
            slopes[log.index] = np.array([at_times(clock, one, at)[use].sum() for one in off])
    kinds = {SIMPLE: "public method", TWIN: "twin"}
    methods = [Method(name=m, kind=kinds[m], note="", errors=e) for m, e in errors.items()]
    sums = np.array([one.sum() for one in errors[TWIN].values()])
    count = sum(len(one) for one in errors[TWIN].values())
    stated = float(np.linalg.norm(sum(slopes.values())))
    each = sums / np.linalg.norm([*slopes.values()], axis=1)
    about: dict[str, Any] = {"task": TASK, "data": name, "kind": "twin", "dives": len(sums)}
    figures = {
        "mean error": ("m s-1 mean", float(sums.sum()) / count),
        "its deviation": ("m s-1 sd", stated / count),
        "mean over deviation": ("1", float(sums.sum()) / stated),
        "farthest dive": ("1 dive", float(each[np.argmax(np.abs(each))])),
    }
    more = [Row(method=m, unit=u, value=v, samples=count, **about) for m, (u, v) in figures.items()]
    return [*rmse_rows(TASK, name, methods), *more]
