"""Pitch: the moments that set a glider's pitch, fitted to the steady parts of a log.

At rest about the pitch axis the moments of weight, of the pumped volume and of the water balance
(body axes forward-starboard-down about the centre of buoyancy, Fossen 2011, section 4.1):

    righting * tan(pitch) = - cos(roll) * (first - density * pumped volume * pump_position)
        + (K_M0 V^2 + (K_M + Z_A - X_A) alpha V^2) / (g cos(pitch)),

`first` is the first moment of the masses along the hull [kg m], which the battery's position
changes. `righting` is their moment below the centre of buoyancy, which a turned battery reduces.
Z_A - X_A is the Munk moment of the added mass. Battery and pump are inputs and the pitch is the
output: its noise then does not bias the righting arm. Effects of pump and water can be separated if
the buoyancy changes with depth while the pump rests.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twin.errors import VehicleError
from twin.identify.calibration import Array, Calibration
from twin.identify.comparison import ComparedQuantity, Comparison, Fitted, ResidualNoise
from twin.identify.logged_missions import Log
from twin.identify.speed import motion_of, steady_parts
from twin.identify.unknowns import UnknownParameter, of_law
from twin.vehicle.parts import Pump
from twin.vehicle.parts.pump import CUBIC_CM

MILLI = 1e-3
LENGTH = 120.0
"""[s] Duration of steady flight for one observation"""
LEAST_PITCH = np.deg2rad(0.5)
"""[rad] Lower bound of the standard deviation of the pitch"""
INDEPENDENT = 600.0
"""[s] Time between independent observations: drifts of density and trim last that long"""
PASSES = 4
"""Number of fits; weights are set again after each fit"""
FIRST_DEVIATION = np.deg2rad(3.0)
"""[rad] Standard deviation of the pitch in the first fit"""
LEAST_OBSERVATIONS = 4
"""Minimum number of observations of dives, and of climbs, for a fit of the pitch"""


def righting_arm(calibration: Calibration) -> float:
    """Depth of the centre of gravity below the centre of buoyancy [m]."""
    v = calibration.vehicle
    return float((v.static_mass * v.static_cg[2] + battery_moment(calibration)) / v.mass)


def battery_moment(calibration: Calibration) -> float:
    """First moment [kg m] of the battery below its axis of rotation."""
    battery = calibration.vehicle.battery
    return battery.mass * battery.eccentricity


def with_righting_arm(calibration: Calibration, arm: float) -> Calibration:
    """Move the hull's centre of gravity so that the whole vehicle has this righting arm [m]."""
    v = calibration.vehicle
    cg = v.static_cg.copy()
    cg[2] = (arm * v.mass - battery_moment(calibration)) / v.static_mass
    return calibration.with_vehicle(static_cg=cg)


def munk_moment(calibration: Calibration, axis: int = 1) -> float:
    """Munk moment of the hull divided by the product of both speeds [kg].

    Axis 1: yaw moment / (u v) is Y_A - X_A. Axis 2: pitch moment / (u w) is Z_A - X_A.
    """
    added = calibration.vehicle.added_mass
    return float(max(added[axis, axis] - added[0, 0], 1e-3 * calibration.vehicle.mass))


def pump_of(calibration: Calibration) -> Pump:
    """Pump that guidance uses; VehicleError without one."""
    pump = calibration.vehicle.steered("buoyancy")
    if not isinstance(pump, Pump):
        raise VehicleError(f"vehicle {calibration.vehicle.name!r} has no pump")
    return pump


def _with_pump(calibration: Calibration, x: float) -> Calibration:
    pump = pump_of(calibration)
    return calibration.with_vehicle(**{pump.name: {"position": (x, *pump.position[1:])}})


# fmt: off
PITCHING = (
    # a wide spread: encoders have any zero from the workshop
    UnknownParameter(
        "shift_offset", "mm", "battery position less the vehicle file's, at encoder zero",
        100.0, lambda c: c.vehicle.battery.neutral_x / MILLI,
        lambda c, x: c.with_vehicle(battery={"neutral_x": MILLI * x})),
    # spread: vehicles are trimmed with lead to 3 to 8 mm
    UnknownParameter(
        "righting_arm", "mm", "centre of gravity below the centre of buoyancy",
        0.5, lambda c: righting_arm(c) / MILLI,
        lambda c, x: with_righting_arm(c, MILLI * x), logarithmic=True),
    # spread: a Slocum's pump is 0.6 m forward, a Seaglider's bladder as far aft
    UnknownParameter(
        "pump_position", "m", "pumped volume forward of the centre of buoyancy",
        0.5, lambda c: pump_of(c).position[0], _with_pump),
    of_law(
        "pitch_moment", "1",
        "pitch moment of angle of attack, K_M, over the Munk moment: -1 cancels it",
        0.5, "pitch_moment", 1, lambda c: munk_moment(c, 2), channel="density"),
)
# fmt: on
"""Parameters that can be fitted to the pitch of a log"""
NAMES = tuple(p.name for p in PITCHING)


class PitchObservations(NamedTuple):
    """Means over steady parts of LENGTH seconds of a log, each (observations,)."""

    pitch: Array
    """[rad] Pitch by the sensor"""
    roll: Array
    """[rad] Magnitude of the roll"""
    rotation: Array
    """[rad] Magnitude of the battery's rotation"""
    shift: Array
    """[m] Battery's position"""
    pump: Array
    """[cm3] Pumped volume"""
    square: Array
    """[m2/s2] Squared speed"""
    alpha: Array
    """[rad] Angle of attack"""


def observations(log: Log, calibration: Calibration) -> PitchObservations:
    """Observations of a log's steady parts; none if the battery's position is unknown."""
    columns = [np.zeros(0)] * 7
    length = max(round(LENGTH / log.period), 2)
    steady = log.use & steady_parts(log)
    whole = len(steady) // length * length
    chosen = steady[:whole].reshape(-1, length).all(axis=1)
    if log.shift is not None and chosen.any():
        motion = motion_of(log, calibration)
        rotation = np.zeros_like(log.pitch) if log.rotation is None else log.rotation
        every = (
            log.pitch, np.abs(log.roll), np.abs(rotation), log.shift, log.pump,
            motion.speed**2, motion.angle_of_attack,
        )  # fmt: skip
        columns = [one[:whole].reshape(-1, length).mean(axis=1)[chosen] for one in every]
    return PitchObservations(*columns)


def balanced_pitch(seen: PitchObservations, calibration: Calibration) -> Array:
    """Pitch [rad] at which the moments balance, (observations,)."""
    vehicle, pitch = calibration.vehicle, calibration.true_pitch(seen.pitch)
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
    raised = battery_moment(calibration) * (1.0 - np.cos(seen.rotation))
    righting = vehicle.mass * righting_arm(calibration) - raised
    turned = water / (vehicle.gravity * np.cos(pitch)) - np.cos(seen.roll) * first
    return np.arctan(turned / righting)


class Pitches(Comparison):
    """Residuals "pitch" [rad] of steady parts: balanced pitch minus measured pitch."""

    def __init__(
        self,
        logs: Sequence[Log],
        nominal: Calibration,
        parameters: tuple[UnknownParameter, ...],
    ):
        self.logs = logs
        self.seen = [observations(log, nominal) for log in logs]
        # other parameters than PITCHING change the flight model's speeds: compute them again
        self.flies = any(p.name not in NAMES for p in parameters)
        channel = ComparedQuantity(
            unit="rad", least=float(LEAST_PITCH), samples=INDEPENDENT / LENGTH
        )
        super().__init__(nominal, parameters, {"pitch": channel}, {"pitch": range(len(logs))})

    @property
    def enough(self) -> bool:
        """True if dives and climbs have enough observations for a fit."""
        pitch = np.concatenate([self.nominal.true_pitch(one.pitch) for one in self.seen])
        return min((pitch < 0.0).sum(), (pitch > 0.0).sum()) >= LEAST_OBSERVATIONS

    def missed(self, x: Array) -> dict[str, list[Array]]:
        """Residuals, model minus log (see `Comparison`)."""
        calibration, seen = self.calibration(x), self.seen
        if self.flies:
            seen = [observations(log, calibration) for log in self.logs]
        return {
            "pitch": [
                balanced_pitch(one, calibration) - calibration.true_pitch(one.pitch) for one in seen
            ]
        }


def balanced(logs: Sequence[Log], nominal: Calibration) -> Fitted | None:
    """Fit battery zero, righting arm, pump position and pitch moment to the steady parts.

    The result is None without battery positions, or with too little steady flight in a phase.
    """
    # without a CTD the change of buoyancy with depth is unknown, and would bias the pitch moment
    blind = any(log.density is None for log in logs)
    parameters = tuple(p for p in PITCHING if not (blind and p.channel == "density"))
    pitches = Pitches(logs, nominal, parameters)
    if not pitches.enough:
        return None
    # far from the battery's zero every balanced pitch is near 90 deg: start with small weights
    x = np.zeros(pitches.size)
    first = {"pitch": ResidualNoise(deviation=float(FIRST_DEVIATION), samples=1.0)}
    x, _ = pitches.fit(x, PASSES, first=first, max_nfev=50)
    return pitches.fitted(x)
