"""Linear motion: response of a glide to turns and moves of parts, and gains of control loops.

About a straight glide the sway, roll rate, yaw rate and roll of a vehicle with a plane of symmetry
are independent of the other motions (Fossen 2011, section 7.5). The coefficients are central
differences of the Fossen model's equations, with every part, fin, added mass and lever of the
vehicle. The coefficients give two responses:

- sway and yaw rate by the logged roll, which may have any cause;
- roll by the logged rotation of the battery.

Both are linear in the sine of the roll and in the position of the turning part, and are integrated
exactly between samples.

For guidance the glide of each phase is linearised about its trim in both planes. The steering part
follows with its lag, and the loop is closed once per control period. `with_gains` takes the fastest
loop whose modes all decay in dives and in climbs, at half and at twice its gain, and are damped at
its own gain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from twin.fossen.equations import mass_distribution, rigid_body_mass
from twin.fossen.forces import ForceParameters, parameters_of
from twin.fossen.model import FossenModel
from twin.fossen.steady import SteadyProblem
from twin.identify.calibration import Array, Calibration
from twin.mission.turning import turn_factor
from twin.mission.way import Way, way
from twin.vehicle.parts import BatteryHinge, Fin
from twin.vehicle.vehicle import Vehicle

SWAY, ROLL_RATE, YAW_RATE, ROLL = 1, 3, 5, 6
"""Indices in the state of `SteadyProblem.rate`: (u, v, w, p, q, r, roll, pitch)"""
LATERAL = (SWAY, ROLL_RATE, YAW_RATE, ROLL)
STEP = 1e-4
"""[SI units] Step of the central differences of rates, roll and a part's position"""
LONGITUDINAL = (0, 2, 4, 7)
"""Indices of (u, w, q, pitch) in the state"""
PACES = tuple(0.2 * 0.8**k for k in range(24))
"""[rad/s] Bandwidths of the loops that are tried, fastest first"""
MARGIN = (0.5, 1.0, 2.0)
"""[1] Factors on a loop's gain at which the loop must be stable"""
DAMPED = 0.3
"""[1] Smallest damping ratio of a loop's modes at its own gain"""
INTEGRAL = 0.15
"""[1] Bandwidth of the integral, as a fraction of the loop's"""
FULL_ERROR = math.radians(40.0)
"""[rad] Heading error at which the whole travel is used: larger gains would only saturate"""
PITCH_PACE = 0.02
"""[rad/s] Largest bandwidth of the pitch loop's integral: pilots' loops correct once a minute"""


class Glide(NamedTuple):
    """Straight glide of a log."""

    surge: float
    """[m/s] Forward velocity"""
    heave: float
    """[m/s] Downward velocity"""
    pitch: float
    """[rad] Pitch"""
    net_mass: float
    """[kg] Net mass, + = heavy"""


class Lateral(NamedTuple):
    """d(v, p, r, roll)/dt = matrix @ (v, p, r, roll) + drive * position + yaw * yaw moment."""

    matrix: Array
    """Matrix of the state, (4, 4)"""
    drive: Array
    """Response per unit of the turning part's position, (4,)"""
    yaw: Array
    """Response per N m of a constant yaw moment, (4,)"""
    inertia: Array
    """Mass matrix of sway, roll rate and yaw rate with added mass, (3, 3)"""
    pitch: float
    """[rad] Pitch of the glide"""

    def gains(self) -> tuple[float, float]:
        """Steady yaw rate [rad/s] and roll [rad] per unit of the turning part's position."""
        steady = -np.linalg.solve(self.matrix, self.drive)
        return float(steady[2]), float(steady[3])

    def turned_by_roll(self, period: float) -> tuple[Array, Array]:
        """Step of (sway, yaw rate) between two samples, with known roll.

        Returns the transition (2, 2) and the response (2, 4) to roll, roll's slope, the part's
        position and a yaw moment, each at its mean between two samples.
        """
        # the known roll replaces the roll equation: side force and yaw moment remain
        keep = [0, 2]
        free_inertia = np.linalg.inv(self.inertia[np.ix_(keep, keep)])

        def moved(accelerations: Array) -> Array:
            return free_inertia @ (self.inertia @ accelerations[:3])[keep]

        a, drive, yaw = moved(self.matrix), moved(self.drive), moved(self.yaw)
        # the roll's slope gives the roll rate: d(roll)/dt = p + r tan(pitch)
        free = a[:, keep].copy()
        free[:, 1] -= a[:, 1] * math.tan(self.pitch)
        return _discrete(free, np.stack([a[:, 3], a[:, 1], drive, yaw], axis=1), period)

    def rolled_by_part(self, period: float) -> tuple[Array, Array]:
        """Step of (v, p, r, roll): transition (4, 4), response (4, 2) to position, yaw moment."""
        return _discrete(self.matrix, np.stack([self.drive, self.yaw], axis=1), period)


def _discrete(a: Array, b: Array, period: float) -> tuple[Array, Array]:
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a * period, b * period
    whole = expm(block)
    return whole[:n, :n], whole[:n, n:]


def turning_part(vehicle: Vehicle) -> BatteryHinge | Fin | None:
    """Hinge or rudder by which guidance turns the vehicle; None without either."""
    part = vehicle.steered("heading")
    return part if isinstance(part, BatteryHinge | Fin) else None


def jacobians(vehicle: Vehicle, state: Array, positions: Array) -> tuple[Array, Array]:
    """Rates of `SteadyProblem.rate` per state, (8, 8), and per position of a part, (8, parts).

    Args:
      state: (u, v, w, p, q, r, roll, pitch), (8,). positions: of the parts, (parts,).
    """
    parameters = _parameters(vehicle)
    place = vehicle.steered_index("heading")

    def problem(positions: Array) -> SteadyProblem:
        return SteadyProblem(parameters, positions, place, driven=False)

    here = problem(positions)
    by_state = [
        (here.rate(state + step) - here.rate(state - step)) / (2.0 * STEP)
        for step in STEP * np.eye(8)
    ]
    by_part = []
    for k, part in enumerate(vehicle.parts):
        step = np.zeros(len(positions))
        step[k] = STEP * min(part.high - part.low, 1.0)
        ahead, behind = (problem(positions + s * step).rate(state) for s in (1.0, -1.0))
        by_part.append((ahead - behind) / (2.0 * step[k]))
    return np.stack(by_state, axis=1), np.stack(by_part, axis=1)


def linearised(vehicle: Vehicle, glide: Glide) -> Lateral:
    """Lateral motion about a glide, with the turning part at rest."""
    positions = vehicle.rest.copy()
    pump = vehicle.steered_index("buoyancy")
    assert pump is not None
    positions[pump] = vehicle.pump_for_net_mass(glide.net_mass)
    state = np.array([glide.surge, 0.0, glide.heave, 0.0, 0.0, 0.0, 0.0, glide.pitch])
    slide = vehicle.steered_index("pitch")
    if slide is not None:
        positions[slide] += _balancing(vehicle, state, positions, slide)
    by_state, by_part = jacobians(vehicle, state, positions)
    keep = list(LATERAL)
    place = vehicle.steered_index("heading")
    inertia = _inertia(vehicle, positions)
    return Lateral(
        matrix=by_state[np.ix_(keep, keep)],
        drive=by_part[keep, place] if place is not None else np.zeros(4),
        yaw=np.append(np.linalg.solve(inertia, [0.0, 0.0, 1.0]), 0.0),
        inertia=inertia,
        pitch=glide.pitch,
    )


def _balancing(vehicle: Vehicle, state: Array, positions: Array, slide: int) -> float:
    """Change of the pitching part's position at which the pitch moments balance. The weight's
    position along the hull matters because it also turns a rolled glider."""
    parameters = _parameters(vehicle)
    place = vehicle.steered_index("heading")
    step = np.zeros(len(positions))
    step[slide] = STEP
    here, there = (
        SteadyProblem(parameters, x, place, driven=False).rate(state)[4]
        for x in (positions, positions + step)
    )
    return float(-here * STEP / (there - here)) if there != here else 0.0


def _parameters(vehicle: Vehicle) -> ForceParameters:
    """Force parameters of a vehicle in water of its reference density."""
    return parameters_of(vehicle, np.array([0.0, 1e4]), np.full(2, vehicle.reference_density))


def _inertia(vehicle: Vehicle, positions: Array) -> Array:
    """Mass matrix of sway, roll rate and yaw rate, with added mass, (3, 3)."""
    mass, moment, inertia = mass_distribution(_parameters(vehicle), positions)
    whole = np.asarray(rigid_body_mass(mass, moment / mass, inertia)) + vehicle.added_mass
    keep = [SWAY, ROLL_RATE, YAW_RATE]
    return np.asarray(whole[np.ix_(keep, keep)])


class Phase(NamedTuple):
    """Steady dive or climb of the log."""

    pitch: float
    """[rad] Pitch"""
    net_mass: float
    """[kg] Net mass at the vehicle's reference density, + = heavy"""


class Plane(NamedTuple):
    """Linear motion of a trimmed glide in one plane, with the part that steers it."""

    matrix: Array
    """Matrix of the state, (states, states)"""
    drive: Array
    """Response per unit of the part's position, (states,)"""
    angle: Array
    """Row that gives the steered angle, pitch, or the rate of the heading, (states,)"""
    rate: Array
    """Row that gives the rate [rad/s] for the loop's damping, (states,)"""
    heading: bool
    """True: the steered angle is the integral of `angle` times the state."""
    gain: float
    """Steady pitch, or rate of the heading, per unit of the part's position"""


def way_of(vehicle: Vehicle, phase: Phase) -> Way:
    """Steady glide of a phase; MissionError if the vehicle has none."""
    where = "the climb of the log" if phase.pitch > 0.0 else "the dive of the log"
    return way(vehicle, where, "pitch_deg", math.degrees(phase.pitch), phase.net_mass, None)


def trimmed(vehicle: Vehicle, phase: Phase) -> tuple[Array, Array]:
    """State (8,) and positions (parts,) of the stable glide at the phase's pitch.

    Raises:
      MissionError: the pitch is too flat to glide, or beyond the battery's travel.
      NoSteadyState: the vehicle has no stable glide there.
    """
    positions = way_of(vehicle, phase).command
    named = dict(zip(vehicle.part_names, positions.tolist(), strict=True))
    motion = FossenModel(vehicle).steady_motion(positions=named)
    trim = motion.trim
    angles = [math.radians(trim.roll_deg), math.radians(trim.pitch_deg)]
    return np.concatenate([motion.nu_r, angles]), positions


def plane_of(vehicle: Vehicle, state: Array, positions: Array, control: str) -> Plane | None:
    """Plane in which the control "pitch" or "heading" acts; None without such a part."""
    place = vehicle.steered_index(control)
    if place is None:
        return None
    by_state, by_part = jacobians(vehicle, state, positions)
    heading = control == "heading"
    keep = list(LATERAL if heading else LONGITUDINAL)
    matrix, drive = by_state[np.ix_(keep, keep)], by_part[keep, place]
    angle, rate = np.zeros(4), np.zeros(4)
    if heading:
        angle[2] = rate[2] = 1.0 / math.cos(state[7])
    else:
        angle[3], rate[2] = 1.0, 1.0
    gain = float(-angle @ np.linalg.solve(matrix, drive))
    return Plane(matrix=matrix, drive=drive, angle=angle, rate=rate, heading=heading, gain=gain)


def loop_modes(plane: Plane, pid: Sequence[float], lag: float, period: float) -> Array:
    """Eigenvalues [1/s] of the closed loop, complex, by its discrete form.

    `pid` acts on the part's position; its sign must make the feedback negative.
    """
    n = 4
    # states: plane, heading (or none), part; held command as the last column
    size = n + 2
    whole = np.zeros((size + 1, size + 1))
    whole[:n, :n], whole[:n, n + 1] = plane.matrix, plane.drive
    if plane.heading:
        whole[n, :n] = plane.angle
    whole[n + 1, n + 1], whole[n + 1, size] = -1.0 / lag, 1.0 / lag
    step = expm(whole * period)
    transition, command = step[:size, :size], step[:size, size]
    sees, damps = np.zeros(size), np.append(plane.rate, np.zeros(size - n))
    if plane.heading:
        sees[n] = 1.0
    else:
        sees[:n] = plane.angle
    kp, ki, kd = pid
    # command = -kp angle - kd rate + ki integral; integral' = integral - period angle
    closed = np.zeros((size + 1, size + 1))
    feedback = -kp * sees - kd * damps
    closed[:size, :size] = transition + np.outer(command, feedback)
    closed[:size, size] = command * ki
    closed[size, :size] = -period * sees
    closed[size, size] = 1.0
    if not plane.heading:
        closed = np.delete(np.delete(closed, n, axis=0), n, axis=1)
    values = np.linalg.eigvals(closed).astype(complex)
    values = values[np.abs(values) > 1e-9]
    return np.asarray(np.log(values) / period)


def _settles(plane: Plane, pid: Sequence[float], lag: float, period: float) -> bool:
    """True if a loop's modes decay at all gains of MARGIN, and are damped at its own gain."""
    for factor in MARGIN:
        modes = loop_modes(plane, [factor * gain for gain in pid], lag, period)
        if np.max(modes.real) >= 0.0:
            return False
        if factor == 1.0 and np.any(-modes.real < DAMPED * np.abs(modes)):
            return False
    return True


def _placed(
    planes: Sequence[Plane], factors: Sequence[float], lag: float, period: float, travel: float
) -> tuple[float, float, float] | None:
    """Gains of the fastest loop that settles in every plane; None: no bandwidth settles.

    Args:
      factors: guidance's factor on the gains in each plane, with its sign.
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
        pairs = zip(planes, factors, strict=True)
        if all(_settles(one, (f * kp, f * ki, 0.0), lag, period) for one, f in pairs):
            return kp, ki, 0.0
    return None


def with_gains(calibration: Calibration, phases: Sequence[Phase]) -> Calibration:
    """Set `pitch_pid` and `heading_pid` from the vehicle's dynamics in these phases.

    A loop keeps its gains if no bandwidth settles or the vehicle has no part for it.

    Raises:
      MissionError, NoSteadyState: the vehicle does not trim in one of the phases.
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
    return calibration.with_vehicle(**changes)
