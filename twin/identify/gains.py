"""Gains: the two loops of guidance, placed on the identified vehicle's own dynamics.

The glide of each phase is linearised about its trim (Fossen's equations, both planes), the
steering part follows with its lag, and the loop is closed once per control period, as guidance
does. The fastest loop is taken whose every mode dies out in dives and in climbs, at half and at
twice its gain, and does not swing at its own.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.fossen.model import FossenModel
from twin.identify.calibration import Calibration
from twin.identify.lateral import LATERAL, exponential, jacobians
from twin.mission.turning import turn_factor
from twin.mission.way import Way, way
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

LONGITUDINAL = (0, 2, 4, 7)
"""Places of (u, w, q, pitch) in the state."""
PACES = tuple(0.2 * 0.8**k for k in range(24))
"""[rad/s] of the loops that are tried, fastest first."""
MARGIN = (0.5, 1.0, 2.0)
"""Times its gain at which a loop must be stable."""
DAMPED = 0.3
"""Least damping ratio of the loop's modes at its own gain: no swinging."""
INTEGRAL = 0.15
"""Of the loop's pace at which its integral works"""
FULL_ERROR = math.radians(40.0)
"""[rad] heading error for which the whole travel may be used: larger gains only saturate"""
PITCH_PACE = 0.02
"""[rad/s] largest pace of the pitch loop's integral: pilots' loops correct pitch once a minute"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Phase:
    """A steady dive or climb of the log."""

    pitch: float
    """[rad]"""
    net_mass: float
    """[kg] at the vehicle's reference density, + = heavy"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """One plane of a trimmed glide with its steering part."""

    matrix: Array
    """(states, states)"""
    drive: Array
    """(states,) per position of the part"""
    angle: Array
    """(states,) what makes the angle that is steered: pitch, or the rate of the heading"""
    rate: Array
    """(states,) what the loop's damping sees [rad/s]"""
    heading: bool
    """the angle is an integral of `angle`"""
    gain: float
    """steady angle (of heading: rate of it) per position"""


def way_of(vehicle: Vehicle, phase: Phase) -> Way:
    """The steady way of a phase; MissionError where the vehicle has none."""
    return way(
        vehicle,
        "the climb of the log" if phase.pitch > 0.0 else "the dive of the log",
        "pitch_deg",
        math.degrees(phase.pitch),
        phase.net_mass,
        None,
    )


def trimmed(vehicle: Vehicle, phase: Phase) -> tuple[Array, Array]:
    """State (8,) and positions (parts,) of the stable glide at the phase's pitch.

    Raises:
      MissionError: too shallow, or the battery does not reach so far.
      NoSteadyState: it has no stable glide there.
    """
    positions = way_of(vehicle, phase).command
    named = dict(zip(vehicle.part_names, positions.tolist(), strict=True))
    motion = FossenModel(vehicle).steady_motion(positions=named)
    trim = motion.trim
    angles = [math.radians(trim.roll_deg), math.radians(trim.pitch_deg)]
    return np.concatenate([motion.nu_r, angles]), positions


def plane_of(vehicle: Vehicle, state: Array, positions: Array, control: str) -> Plane | None:
    """The plane that the control acts in, "pitch" or "heading"; None without such a part."""
    place = vehicle.steered_index(control)
    if place is None:
        return None
    by_state, by_part = jacobians(vehicle, state, positions)
    heading = control == "heading"
    keep = list(LATERAL if heading else LONGITUDINAL)
    matrix, drive = by_state[np.ix_(keep, keep)], by_part[keep, place]
    angle = np.zeros(4)
    rate = np.zeros(4)
    if heading:
        angle[2] = rate[2] = 1.0 / math.cos(state[7])
    else:
        angle[3], rate[2] = 1.0, 1.0
    gain = float(-angle @ np.linalg.solve(matrix, drive))
    return Plane(matrix=matrix, drive=drive, angle=angle, rate=rate, heading=heading, gain=gain)


def loop_modes(plane: Plane, pid: tuple[float, float, float], lag: float, period: float) -> Array:
    """Eigenvalues [1/s] of the closed loop, complex, by its discrete form.

    `pid` acts on the part's position, with the sign that steers the right way.
    """
    n = 4
    # states: plane, heading (or none), part; held command as the last column
    size = n + 2
    whole = np.zeros((size + 1, size + 1))
    whole[:n, :n], whole[:n, n + 1] = plane.matrix, plane.drive
    if plane.heading:
        whole[n, :n] = plane.angle
    whole[n + 1, n + 1], whole[n + 1, size] = -1.0 / lag, 1.0 / lag
    step = exponential(whole * period)
    transition, command = step[:size, :size], step[:size, size]
    sees = np.zeros(size)
    if plane.heading:
        sees[n] = 1.0
    else:
        sees[:n] = plane.angle
    damps = np.zeros(size)
    damps[:n] = plane.rate
    kp, ki, kd = pid
    # command = -kp angle - kd rate + ki integral; integral' = integral - period angle
    closed = np.zeros((size + 1, size + 1))
    feedback = -kp * sees - kd * damps
    closed[:size, :size] = transition + np.outer(command, feedback)
    closed[:size, size] = command * ki
    closed[size, :size] = -period * sees
    closed[size, size] = 1.0
    if not plane.heading:
        keep = [k for k in range(size + 1) if k != n]
        closed = closed[np.ix_(keep, keep)]
    values = np.linalg.eigvals(closed).astype(complex)
    values = values[np.abs(values) > 1e-9]
    return np.asarray(np.log(values) / period)


def _settles(
    planes: Sequence[Plane], pids: Sequence[tuple[float, float, float]], lag: float, period: float
) -> bool:
    for plane, pid in zip(planes, pids, strict=True):
        for factor in MARGIN:
            scaled = (factor * pid[0], factor * pid[1], factor * pid[2])
            modes = loop_modes(plane, scaled, lag, period)
            if np.max(modes.real) >= 0.0:
                return False
            if factor == 1.0 and np.any(-modes.real < DAMPED * np.abs(modes)):
                return False
    return True


def _placed(
    planes: Sequence[Plane], factors: Sequence[float], lag: float, period: float, travel: float
) -> tuple[float, float, float] | None:
    """Gains of the fastest loop that settles in every plane; None: no pace settles.

    Args:
      factors: what guidance multiplies the gains by in each plane, with the sign that steers.
    """
    largest = max(abs(plane.gain * factor) for plane, factor in zip(planes, factors, strict=True))
    most = travel / FULL_ERROR / max(map(abs, factors))
    for pace in PACES:
        if planes[0].heading:
            kp = min(pace / largest, most)
            ki = INTEGRAL * kp * kp * largest
        else:
            ki = min(pace, PITCH_PACE) / largest
            kp = ki / (2.0 * pace)
        pids = [(factor * kp, factor * ki, 0.0) for factor in factors]
        if _settles(planes, pids, lag, period):
            return kp, ki, 0.0
    return None


def with_gains(calibration: Calibration, phases: Sequence[Phase]) -> Calibration:
    """The vehicle with `pitch_pid` and `heading_pid` placed on its dynamics in these phases.

    A loop that settles at no pace, or that the vehicle has no part for, keeps its gains.

    Raises:
      MissionError, NoSteadyState: it does not trim in one of the phases.
    """
    vehicle = calibration.vehicle
    trims = [trimmed(vehicle, phase) for phase in phases]
    changes: dict[str, tuple[float, float, float]] = {}
    for control in ("pitch", "heading"):
        part = vehicle.steered(control)
        if part is None:
            continue
        planes = [plane_of(vehicle, state, there, control) for state, there in trims]
        if control == "heading":
            factors = [turn_factor(vehicle, way_of(vehicle, phase)) for phase in phases]
        else:
            factors = [part.sense("pitch")] * len(phases)
        travel = 0.5 * (part.high - part.low)
        known = [plane for plane in planes if plane is not None]
        found = _placed(known, factors, part.lag, vehicle.control_period, travel)
        if found is not None:
            changes[f"{control}_pid"] = found
    return calibration.replace(vehicle=vehicle.replace(**changes))
