"""DVL: speed through the water of a Slocum against its Doppler velocity log.

Every method is tuned on the depth rate only, never on the speed that is scored. All finite samples
of the truth table are scored, at their own times, in dives for which all methods have a speed. If
the author of the truth corrected the pitch, each method is scored with and without this correction.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from benchmarks.real_logs.public import fit_steady, kinematic
from benchmarks.real_logs.row import Kind, Method, Row, published_rows, rmse, rmse_rows
from benchmarks.real_logs.source import Deployment, at_times, tables_with
from benchmarks.real_logs.surge_networks import ZERO_SHOT, Pretrained, level_of
from twin.identify import Log, density_of, estimate, identify, load_calibration
from twin.identify.logged_missions import start_vehicle
from twin.navigation.dead_reckoning import Array

TASK = "speed through the water"
SPEED = "U_dvl_ms"
CORRECTED_PITCH = "pitch_rad_corrected"
MOST_PITCH_RESIDUAL = math.radians(0.5)
"""[rad] Largest RMSE of a straight line from logged to corrected pitch"""
LEAST_SAMPLES = 100
ATTACKS_DEG = (1, 2, 3, 4)
"""[deg] Constant angles of attack: OceanGliders has 3; the best in hindsight is a rival too"""


@dataclasses.dataclass(frozen=True)
class Truth:
    """Samples of the DVL in order of time."""

    time: Array
    """[s] Unix time"""
    speed: Array
    """[m/s] Speed through the water"""
    pitch_scale: float = 1.0
    pitch_offset: float = 0.0
    """[rad] The pitch by the author of the truth is scale * logged + offset"""


def read_truth(deployment: Deployment) -> Truth | None:
    """Read the DVL's speeds of a deployment; None without any."""
    tables = tables_with(deployment, SPEED)
    if not tables:
        return None
    time = np.concatenate([table.columns["time"] for table in tables])
    speed = np.concatenate([table.columns[SPEED] for table in tables])
    scale, offset = 1.0, 0.0
    if all(table.has(CORRECTED_PITCH) for table in tables):
        pitch = np.concatenate([table.columns[CORRECTED_PITCH] for table in tables])
        scale, offset = _pitch_line(deployment, time, pitch)
    known = np.isfinite(speed) & np.isfinite(time)
    order = np.argsort(time[known], kind="stable")
    return Truth(time[known][order], speed[known][order], scale, offset)


def _pitch_line(deployment: Deployment, time: Array, corrected: Array) -> tuple[float, float]:
    """Scale and offset [rad] from the logged pitch to the pitch in the truth table."""
    ours, theirs = [], []
    for log in deployment.logs():
        values = at_times(time, corrected, deployment.clock(log))
        known = np.isfinite(values) & log.use
        ours.append(log.pitch[known])
        theirs.append(values[known])
    x, y = np.concatenate(ours), np.concatenate(theirs)
    if x.size < LEAST_SAMPLES:
        return 1.0, 0.0
    for _ in range(3):  # leave out interpolated samples at inflections, which are off the line
        scale, offset = np.polyfit(x, y, 1)
        residual = np.abs(scale * x + offset - y)
        keep = residual <= max(3.0 * float(np.median(residual)), 1e-4)
        x, y = x[keep], y[keep]
    close = rmse(scale * x + offset - y) < MOST_PITCH_RESIDUAL
    return (float(scale), float(offset)) if close else (1.0, 0.0)


def rows_of(deployment: Deployment, networks: Pretrained | None) -> list[Row]:
    """Rows of one deployment; none without a DVL.

    Args:
      networks: networks trained on simulation; None: no networks are scored.
    """
    truth = read_truth(deployment)
    if truth is None or truth.time.size < LEAST_SAMPLES:
        return []
    logs, methods = deployment.logs(), []
    for corrected in (True, False) if truth.pitch_scale != 1.0 else (False,):
        methods += _methods(deployment, logs, truth, networks, corrected=corrected)
    return [*published_rows(TASK, deployment.name), *rmse_rows(TASK, deployment.name, methods)]


def _methods(
    deployment: Deployment, logs: list[Log], truth: Truth, networks: Pretrained | None, *,
    corrected: bool,
) -> list[Method]:  # fmt: skip
    """Errors of every method with the pitch by the author of the truth, or with the logged one."""
    pitch = title = "pitch as logged"
    nominal = load_calibration(start_vehicle(deployment.store))
    if corrected:
        pitch = f"pitch {truth.pitch_scale:.3f} logged {truth.pitch_offset:+.4f} rad as its author"
        title = "corrected pitch"
        nominal = nominal.replace(pitch_scale=truth.pitch_scale, pitch_offset=truth.pitch_offset)
    methods = []

    def put(name: str, kind: Kind, speeds: list[Array], note: str) -> None:
        errors = score(deployment, logs, speeds, truth)
        methods.append(Method(name=name, kind=kind, note=note, errors=errors))

    pitches = [nominal.true_pitch(log.pitch) for log in logs]
    for degree in ATTACKS_DEG:
        attack = math.radians(degree)
        simple = [kinematic(log, p, attack).speed for log, p in zip(logs, pitches, strict=True)]
        put(f"w/sin(pitch + {degree} deg), {title}", "public method", simple, pitch)
    steady = fit_steady(logs, nominal)
    speeds = [
        steady.bridged(log, p, density_of(log, nominal)).speed
        for log, p in zip(logs, pitches, strict=True)
    ]
    note = f"two parameters on depth rate; {pitch}"
    put(f"steady flight model, {title}", "public method", speeds, note)
    known = ("pitch_offset", "pitch_scale") if corrected else ()
    fit = identify(logs, nominal, fixes=False, known=known)
    found = fit.calibration
    speeds = [estimate(log, found).speed for log in logs]
    put(f"twin, {title}", "twin", speeds, f"depth rate only; {pitch}")
    if not corrected:
        named = identify(logs, nominal, fixes=False, parameters=[*fit.determined, "pitch_scale"])
        speeds = [estimate(log, named.calibration).speed for log in logs]
        scale = named["pitch_scale"]
        note = f"depth rate only; pitch scale {scale.value:.3f} +- {scale.deviation:.3f} with it"
        put("twin, pitch scale estimated too", "twin", speeds, note)
    for kind in networks or {}:
        speeds = [np.hypot(level_of(log, found, networks, kind), log.depth_rate) for log in logs]
        note = f"trained on simulation only; {pitch}"
        put(f"{ZERO_SHOT[kind]}, {title}", "network", speeds, note)
    return methods


def score(
    deployment: Deployment, logs: list[Log], speeds: list[Array], truth: Truth
) -> dict[int, Array]:
    """Estimate minus truth [m/s] at the truth samples of each dive, by row."""
    errors = {}
    for log, speed in zip(logs, speeds, strict=True):
        clock = deployment.clock(log)
        inside = (truth.time >= clock[0]) & (truth.time <= clock[-1])
        if inside.any():
            errors[log.index] = at_times(clock, speed, truth.time[inside]) - truth.speed[inside]
    return errors
