"""Pitch: the moments that set a glider's pitch, fitted to the steady parts of a log.

At rest about the pitch axis the moments of weight, of the pumped volume and of the water balance
(body axes forward-starboard-down about the centre of buoyancy, Fossen 2011, section 4.1):

    righting * tan(pitch) = - cos(roll) * (first - density * pumped volume * pump_position)
        + (K_M0 V^2 + (K_M + Z_A - X_A) alpha V^2) / (g cos(pitch)),

with `first` the first moment of the masses along the hull [kg m], which the battery's position
moves, `righting` that below the centre of buoyancy, which a turned battery lessens, and Z_A - X_A
the Munk moment of the added mass. Battery and pump are what was done and the pitch is what came of
it: so the pitch is compared, and its noise does not soften the arm. What the pump and the water do
part where the buoyancy changes with depth and the pump rests.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from twin.errors import VehicleError
from twin.identify.calibration import Calibration
from twin.identify.logged import Log
from twin.identify.problem import OUTLIER, robust_scale
from twin.identify.speed import motion_of, steady_parts
from twin.identify.unknowns import UnknownParameter
from twin.vehicle.parts import Pump
from twin.vehicle.parts.pump import CUBIC_CM

Array = NDArray[np.float64]

MILLI = 1e-3
LENGTH = 120.0
"""[s] of steady flight that make one observation"""
LEAST_PITCH = np.deg2rad(0.5)
"""[rad] that the pitch is off at least"""
INDEPENDENT = 600.0
"""[s] that one observation stands for: drifts of density and trim last that long"""
STEP = 1e-3
"""Spreads of the finite differences"""
PASSES = 3
"""Fits between which weights are taken again"""
LEAST_OBSERVATIONS = 4
"""of dives and of climbs each, below which nothing is said about pitch"""


def righting_arm(calibration: Calibration) -> float:
    """Depth of the centre of gravity below the centre of buoyancy [m]."""
    v = calibration.vehicle
    below = v.static_mass * v.static_cg[2] + v.battery.mass * v.battery.eccentricity
    return float(below / v.mass)


def with_righting_arm(calibration: Calibration, arm: float) -> Calibration:
    """The hull's centre of gravity moved so that the whole has this righting arm [m]."""
    v = calibration.vehicle
    cg = v.static_cg.copy()
    cg[2] = (arm * v.mass - v.battery.mass * v.battery.eccentricity) / v.static_mass
    return calibration.replace(vehicle=v.replace(static_cg=cg))


def munk_pitch(calibration: Calibration) -> float:
    """[kg] the hull's own pitch moment of angle of attack, over u w: Z_A - X_A."""
    added = calibration.vehicle.added_mass
    return float(max(added[2, 2] - added[0, 0], 1e-3 * calibration.vehicle.mass))


def pump_of(calibration: Calibration) -> Pump:
    """The pump that guidance uses; VehicleError without one."""
    pump = calibration.vehicle.steered("buoyancy")
    if not isinstance(pump, Pump):
        raise VehicleError(f"vehicle {calibration.vehicle.name!r} has no pump")
    return pump


def _with_pump(calibration: Calibration, x: float) -> Calibration:
    pump = pump_of(calibration)
    place = {pump.name: {"position": (x, *pump.position[1:])}}
    return calibration.replace(vehicle=calibration.vehicle.replace(**place))


def _with_moment(calibration: Calibration, ratio: float) -> Calibration:
    constant, _, damping = calibration.vehicle.flow_frame.pitch_moment
    moment = (constant, ratio * munk_pitch(calibration), damping)
    return calibration.replace(vehicle=calibration.vehicle.replace(pitch_moment=moment))


PITCHING = (
    UnknownParameter(
        name="shift_offset",
        unit="mm",
        meaning="battery position less the vehicle file's, at encoder zero",
        spread=100.0,  # encoders are zeroed in the workshop: in effect free
        get=lambda c: c.vehicle.battery.neutral_x / MILLI,
        set=lambda c, x: c.replace(vehicle=c.vehicle.replace(battery={"neutral_x": MILLI * x})),
    ),
    UnknownParameter(
        name="righting_arm",
        unit="mm",
        meaning="centre of gravity below the centre of buoyancy",
        spread=0.5,  # trimmed with lead: 3 to 8 mm
        logarithmic=True,
        get=lambda c: righting_arm(c) / MILLI,
        set=lambda c, x: with_righting_arm(c, MILLI * x),
    ),
    UnknownParameter(
        name="pump_position",
        unit="m",
        meaning="pumped volume forward of the centre of buoyancy",
        spread=0.5,  # nose of a Slocum 0.6 m forward, bladder of a Seaglider as far aft
        get=lambda c: pump_of(c).position[0],
        set=_with_pump,
    ),
    UnknownParameter(
        name="pitch_moment",
        unit="1",
        meaning="pitch moment of angle of attack, K_M, over the Munk moment: -1 cancels it",
        spread=0.5,
        channel="density",
        get=lambda c: c.vehicle.flow_frame.pitch_moment[1] / munk_pitch(c),
        set=_with_moment,
    ),
)
"""What a twin needs to pitch as the log does."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class PitchObservations:
    """Steady parts of the logs, each (observations,): means over `LENGTH`."""

    pitch: Array
    """[rad] true"""
    roll: Array
    """[rad]"""
    rotation: Array
    """[rad] of the battery"""
    shift: Array
    """[m]"""
    pump: Array
    """[cm3]"""
    square: Array
    """[m2/s2] speed squared"""
    alpha: Array
    """[rad]"""
    block: NDArray[np.int_]
    """Number of the dive"""


def observations(logs: Sequence[Log], calibration: Calibration) -> PitchObservations | None:
    """Steady parts in which the battery's position is known; None where there are too few."""
    rows: list[list[float]] = []
    for number, log in enumerate(logs):
        if log.shift is None:
            continue
        steady = log.use & steady_parts(log)
        motion = motion_of(log, calibration)
        pitch = calibration.true_pitch(log.pitch)
        rotation = np.zeros_like(pitch) if log.rotation is None else log.rotation
        columns = (
            pitch, np.abs(log.roll), np.abs(rotation), log.shift, log.pump,
            motion.speed**2, motion.angle_of_attack,
        )  # fmt: skip
        length = max(round(LENGTH / log.period), 2)
        for first in range(0, len(pitch) - length + 1, length):
            part = slice(first, first + length)
            if steady[part].all():
                rows.append([*(float(np.mean(column[part])) for column in columns), number])
    table = np.array(rows).reshape(-1, 8)
    if min((table[:, 0] < 0.0).sum(), (table[:, 0] > 0.0).sum()) < LEAST_OBSERVATIONS:
        return None
    return PitchObservations(
        pitch=table[:, 0],
        roll=table[:, 1],
        rotation=table[:, 2],
        shift=table[:, 3],
        pump=table[:, 4],
        square=table[:, 5],
        alpha=table[:, 6],
        block=table[:, 7].astype(int),
    )


def balanced_pitch(seen: PitchObservations, calibration: Calibration) -> Array:
    """Pitch [rad] at which the moments balance, (observations,)."""
    vehicle = calibration.vehicle
    pump = pump_of(calibration)
    constant, slope, _ = vehicle.flow_frame.pitch_moment
    munk = 0.0
    if vehicle.added_mass_coupling:
        munk = vehicle.added_mass[2, 2] - vehicle.added_mass[0, 0]
    water = (constant + (slope + munk) * seen.alpha) * seen.square
    battery = vehicle.battery
    first = vehicle.static_mass * vehicle.static_cg[0]
    first = first + battery.mass * (battery.neutral_x + seen.shift)
    pumped = CUBIC_CM * vehicle.reference_density * (seen.pump - pump.neutral)
    first = first - pump.position[0] * pumped
    raised = battery.mass * battery.eccentricity * (1.0 - np.cos(seen.rotation))
    righting = vehicle.mass * righting_arm(calibration) - raised
    turned = water / (vehicle.gravity * np.cos(seen.pitch)) - np.cos(seen.roll) * first
    return np.arctan(turned / righting)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Balance:
    """What the steady pitches of a log say."""

    calibration: Calibration
    parameters: tuple[UnknownParameter, ...]
    centres: Array
    offsets: Array
    """in spreads"""
    jacobian: Array
    residual: Array
    """(observations + parameters,), weighted"""
    blocks: NDArray[np.int_]
    """Dive of each residual; -1: what was known before."""
    deviation: float
    """[rad] of the pitch"""


def balanced(logs: Sequence[Log], nominal: Calibration) -> Balance | None:
    """Battery zero, righting arm, pump position and pitch moment of the steady parts.

    None where the logs have no battery positions, or too little steady flight of a phase.
    """
    seen = observations(logs, nominal)
    if seen is None:
        return None
    # without a CTD the change of buoyancy with depth is unknown, and this would take it up
    blind = any(log.density is None for log in logs)
    parameters = tuple(p for p in PITCHING if not (blind and p.channel == "density"))
    centres = np.array([p.get(nominal) for p in parameters])

    def calibrated(x: Array) -> Calibration:
        out = nominal
        for parameter, centre, offset in zip(parameters, centres, x, strict=True):
            out = parameter.at(out, float(centre), float(offset))
        return out

    def missed(x: Array) -> Array:
        return balanced_pitch(seen, calibrated(x)) - seen.pitch

    def residual(x: Array) -> Array:
        return np.concatenate([missed(x) * weights, x])

    def jacobian(x: Array) -> Array:
        steps = STEP * np.eye(len(x))
        return np.stack([(residual(x + s) - residual(x - s)) / (2 * STEP) for s in steps], axis=1)

    count = np.sqrt(LENGTH / INDEPENDENT)
    x, scale = np.zeros(len(parameters)), float(np.deg2rad(3.0))
    # the battery's zero first: from far off every pitch is near 90 deg and says nothing
    weights = np.full(len(seen.pitch), 1.0 / scale)
    for _ in range(PASSES):
        x = least_squares(residual, x, jac=jacobian, x_scale="jac", max_nfev=50).x
        off = missed(x)
        scale = max(robust_scale(off), float(LEAST_PITCH))
        weights = count / (scale * np.sqrt(1.0 + (off / (OUTLIER * scale)) ** 2))
    x = least_squares(residual, x, jac=jacobian, x_scale="jac", max_nfev=50).x
    return Balance(
        calibration=calibrated(x),
        parameters=parameters,
        centres=centres,
        offsets=x,
        jacobian=jacobian(x),
        residual=residual(x),
        blocks=np.concatenate([seen.block, np.full(len(x), -1)]),
        deviation=float(np.sqrt(np.mean(missed(x) ** 2))),
    )
