"""Flight estimators of a glider: reckoning by pitch, steady flight, and learned flight.

A glider's path is steeper than its pitch by the angle of attack a. Its speed through the water is
|z'| / sin(|pitch| + a), its horizontal speed |z'| / tan(|pitch| + a), along the measured heading.
Slocum gliders navigate by this, Spray with a = 3 deg (OceanGliders, depth-averaged current
procedure). `OnboardReckoning` is the track over ground that the vehicle itself logged.

The steady balance is `twin.identify.speed`. Its angles follow from ratios of forces, so buoyancy
hardly changes them. On a flat path the speed comes from buoyancy. On a steep path it comes from the
depth rate, which a wrong drag coefficient or ballast does not change. The learned flight corrects
drag, lift, ballast, compressibility and the accelerometers' pitch errors in each steady glide
(`twin.navigation.flight_filter`).

Flight models state the error of their speed from the vehicle's uncertainty. The horizontal speed is
the depth rate times the cotangent of the glide angle. Errors of coefficients and of pitch change
that angle.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import NamedTuple, NoReturn

import numpy as np

from twin.errors import InputError
from twin.identify.unknowns import draw_vehicles
from twin.navigation.dead_reckoning import (
    Array,
    AttitudeSeries,
    Mask,
    Signals,
    afloat,
    bridge,
    depth_rate,
    finite_channel,
    hold,
    no_glider,
    smooth,
)
from twin.navigation.estimators.base import (
    BodyVelocity,
    Estimate,
    VelocityDeviation,
    VelocityEstimator,
    WindowedEstimator,
)
from twin.navigation.flight_filter import FlightFilter, FlightSpread
from twin.navigation.flight_filter_kernels import CHANNELS
from twin.vehicle.steady_motion import balance, net_mass
from twin.vehicle.vehicle import Vehicle

REFERENCE_PITCH = math.radians(26.0)
"""[rad] Pitch for the constant angle of attack, the usual one of gliders (Slocum)."""
PATH_WINDOW_S = 20.0
"""[s] Averaging time of depth rate and pitch, as in the vehicle's own software."""
LEAST_PITCH = math.radians(10.0)
"""[rad] Pitch below which the quotient is not used and the last speed is held (inflections)."""
MAX_SPEED = 1.0
"""[m/s] Upper limit of the speed: no buoyancy glider is faster through the water for long."""
WINDOW_S = 10.0
"""[s] Averaging time of every input: shorter than a glider's settling, longer than noise."""
STEADY_PITCH = np.deg2rad(2.0)
"""[rad] Largest difference of pitch from its average in steady flight."""
FLAT_SINE = 0.07
"""Sine of the glide angle (4 deg) at which the speeds by buoyancy and depth rate weigh equally."""
LEAST_SINE = 0.12
"""Sine of the glide angle (7 deg) below which no glide is steady: the best glide ratio of
buoyancy gliders is near 8."""
DRAWS = 40
"""Vehicles sampled from an identification; their standard deviation is known to 11 %"""


class PitchPlusAlpha(WindowedEstimator):
    """Speed from depth rate, pitch and one constant angle of attack; sway is zero."""

    kind = "pitch_plus_alpha"
    title = "w / tan(pitch + alpha)"
    summary = (
        "speed from depth rate over sin(pitch + a), along the heading, with one constant a: that "
        "of the nominal vehicle at 26 deg of pitch"
    )
    colour = "orange"
    drawn = True
    channels = ("measured_depth", "measured_pitch")

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """Reason if the vehicle is no glider; empty otherwise."""
        return no_glider(vehicle)

    @functools.cached_property
    def angle_of_attack(self) -> float:
        """[rad] The nominal vehicle's angle of attack in a steady glide at `REFERENCE_PITCH`."""
        return steady_angle_of_attack(self.vehicle, REFERENCE_PITCH)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        depth = finite_channel(signals, "measured_depth")
        pitch = np.deg2rad(finite_channel(signals, "measured_pitch"))
        rate = smooth(depth_rate(depth, self.period), PATH_WINDOW_S, self.period)
        slope = smooth(pitch, PATH_WINDOW_S, self.period)
        gliding = (np.abs(slope) >= LEAST_PITCH) & (rate * slope < 0)
        alpha = self.angle_of_attack
        speed = np.abs(rate) / np.sin(np.maximum(np.abs(slope), LEAST_PITCH) + alpha)
        speed = hold(np.minimum(speed, MAX_SPEED), gliding)
        speed = np.where(afloat(depth, self.period), 0.0, speed)
        return Estimate(surge=speed * math.cos(alpha), sway=np.zeros_like(speed))


def steady_angle_of_attack(vehicle: Vehicle, pitch: float) -> float:
    """Angle of attack [rad] of a wings-level glide at |pitch| [rad], from the coefficients.

    It is the mean of dive and climb, whose lift at zero angle differs in sign. With the tangent of
    the glide angle: K_D0 + K_D a^2 = (K_L0 + K_alpha a) tan (Graver 2005, section 4.1).
    """
    law, angles = vehicle.flow_frame, []
    for sign in (1.0, -1.0):
        alpha = 0.0
        for _ in range(100):
            drag = law.polar(alpha, vehicle.reference_density).drag
            alpha = (drag / math.tan(pitch + alpha) - sign * law.lift[0]) / law.lift[1]
        angles.append(alpha)
    return sum(angles) / 2


class OnboardReckoning(VelocityEstimator):
    """Track that the vehicle logged on board, for whole missions only.

    The vehicle resets it at every GPS fix and adds the last depth-averaged current (see
    `twin.sensors.onboard`). In a mission without fixes it is a track through the water, unless the
    vehicle is propelled: propelled vehicles use a Doppler log, which may have bottom lock. The
    estimate has no surge and sway.
    """

    kind = "onboard"
    title = "on-board track"
    summary = (
        "the track that the vehicle logged itself (w / tan(pitch + 3 deg), fixes, last dive's "
        "current; with a propeller by its Doppler log)"
    )
    colour = "purple"
    without_water = (
        "The on-board track is missing in them: it was reset at fixes or reckoned by a Doppler "
        "log, which puts the current into it."
    )
    channels = ("measured_onboard_north", "measured_onboard_east")

    @classmethod
    def open(cls, argument: str, vehicle: Vehicle, period: float) -> NoReturn:
        """Refuse, since the track gives no velocity through the water.

        Raises:
          InputError: always; `pitch_plus_alpha` uses the same equation.
        """
        raise InputError(
            "the on-board track is one over ground and gives no velocity through the water: choose "
            "pitch_plus_alpha, which reckons in the same way"
        )

    def step(self, sample: Mapping[str, float]) -> NoReturn:
        """Refuse like `open`."""
        self.open("", self.vehicle, self.period)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        track = np.stack([finite_channel(signals, name) for name in self.channels], axis=1)
        propelled = self.vehicle.steered("speed") is not None
        return Estimate(ground_track=track, uses_fixes=True, saw_bottom=propelled)


class GlideModel(VelocityEstimator):
    """Base class of methods that use a glider's balance of forces."""

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """Reason if the vehicle is no glider; empty otherwise."""
        return no_glider(vehicle)

    @property
    def deviation(self) -> VelocityDeviation:
        """See `VelocityEstimator`; for a learning method, the error at the start."""
        return glide_deviation(self.vehicle)


class SteadyFlight(GlideModel, WindowedEstimator):
    """Speed, angle of attack and sideslip from forces in balance."""

    kind = "steady_flight"
    title = "steady flight model"
    summary = (
        "forces in balance at every sample with the nominal coefficients: angle of attack, "
        "sideslip and, where the path is flat, speed; where it is steep the depth "
        "rate gives the speed"
    )
    colour = "green"
    drawn = True
    channels = (
        *("measured_depth", "measured_roll", "measured_pitch", "measured_heading"),
        *("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate", "measured_pump"),
    )

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        seen = Seen.of(self.vehicle, signals, self.period)
        velocity, gliding = seen.balanced(self.vehicle)
        surge, sway = (bridge(one, gliding, held=True) for one in velocity)
        return Estimate(
            surge=np.where(seen.still, 0.0, surge), sway=np.where(seen.still, 0.0, sway)
        )


class Seen(NamedTuple):
    """Averaged measurements; angles in radians, rates in rad/s."""

    rate: Array
    """[m/s] depth rate, (time,)"""
    roll: Array
    pitch: Array
    rates: Array
    """[rad/s], (3, time)"""
    net: Array
    """[kg] net buoyancy mass, (time,)"""
    steady: Mask
    """Samples under water with a steady pitch"""
    still: Mask
    """Samples at the surface"""

    @classmethod
    def of(cls, vehicle: Vehicle, signals: Signals, period: float) -> Seen:
        """Average the measurements of one mission, or of its last minutes."""
        depth = finite_channel(signals, "measured_depth")
        attitude = AttitudeSeries.of(signals)
        turning = [finite_channel(signals, f"measured_{n}_rate") for n in ("roll", "pitch", "yaw")]
        rows = np.stack([depth_rate(depth, period), attitude.roll, attitude.pitch, *turning])
        rate, roll, pitch, *rates = smooth(rows, WINDOW_S, period)
        swing = smooth(np.abs(attitude.pitch - pitch), WINDOW_S, period)
        still = afloat(depth, period)
        return cls(
            rate=rate,
            roll=roll,
            pitch=pitch,
            rates=np.stack(rates),
            net=net_mass(vehicle, finite_channel(signals, "measured_pump"), depth),
            steady=(swing < STEADY_PITCH) & ~still,
            still=still,
        )

    def balanced(self, vehicle: Vehicle) -> tuple[Array, Mask]:
        """Surge and sway [m/s], (2, time), and the samples in balance: not inflections."""
        rate, roll, pitch = self.rate, self.roll, self.pitch
        speed, alpha, beta, gliding = balance(vehicle, self.net, roll, pitch, self.rates)
        direction = np.stack(
            [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)]
        )
        down = (
            -direction[0] * np.sin(pitch)
            + direction[1] * np.cos(pitch) * np.sin(roll)
            + direction[2] * np.cos(pitch) * np.cos(roll)
        )
        gliding = gliding & self.steady & (rate * down > 0) & (np.abs(down) > LEAST_SINE)
        speed = (speed * FLAT_SINE**2 + rate * down) / (FLAT_SINE**2 + down**2)
        return np.maximum(speed, 0.0) * direction[:2], gliding


class LearnedFlight(GlideModel):
    """Surge and sway of a flight filter that starts with the nominal vehicle."""

    kind = "flight_filter"
    title = "flight filter"
    summary = (
        "the nominal vehicle's equation of motion, with the density that a CTD measures; what the "
        "depth rate of steady glides does not agree with corrects drag, lift, ballast, "
        "compressibility and the pitch on the way (`twin/navigation/flight_filter.py`)"
    )
    channels = (*CHANNELS, "measured_heading")

    def __init__(self, vehicle: Vehicle, period: float):
        """Create the estimator; see `VelocityEstimator`."""
        super().__init__(vehicle, period)
        self._filter = self._memory = FlightFilter(vehicle, period)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        given = {name: finite_channel(signals, name) for name in CHANNELS}
        found = FlightFilter(self.vehicle, self.period).run(given)
        return Estimate(
            surge=np.ascontiguousarray(found[:, 0]), sway=np.ascontiguousarray(found[:, 1])
        )

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`."""
        found = self._filter.step(sample)
        return BodyVelocity(surge=float(found[0]), sway=float(found[1]))


def glide_deviation(vehicle: Vehicle) -> VelocityDeviation:
    """Velocity error of a balance of forces at the vehicle's usual glide.

    The coefficients of an identified vehicle have the uncertainty in its file. Those of another
    vehicle have that of `FlightSpread` in lift slope (a clean hull, without growth) and in pitch.
    Errors of coefficients are equal in descent and climb: they are the constant part. Errors of
    pitch change sign between descent and climb: they are the varying part.

    Args:
      vehicle: glides by lift and drag coefficients.

    Raises:
      VehicleError: the identification in the file cannot be read.
    """
    spread, (_, slope, angle) = FlightSpread(), _glide(vehicle)
    possible, drawn = draw_vehicles(vehicle, DRAWS, np.random.default_rng(0), speed=True)
    if drawn:
        scale = float(np.std([_glide(one)[1] / slope - 1.0 for one in possible[1:]]))
    else:
        scale = math.hypot(
            *(
                _glide(vehicle.replace(law=vehicle.law.scaled({one.name: factor})))[1] / slope - 1.0
                for one in vehicle.law.uncertainties()
                if one.unit == "1" and one.certain == 1.0
                for factor in (math.exp(spread.coefficient),)
            )
        )
    turned = spread.pitch / (math.sin(angle) * math.cos(angle))
    return VelocityDeviation(scale=scale, noise=usual_speed(vehicle) * turned)


def usual_speed(vehicle: Vehicle) -> float:
    """[m/s] Usual horizontal speed of a vehicle through the water."""
    if vehicle.steered("speed") is not None or vehicle.holds_pose:
        return vehicle.cruise_speed
    speed, _, angle = _glide(vehicle)
    return speed * math.cos(angle)


def _glide(vehicle: Vehicle) -> tuple[float, float, float]:
    """Speed [m/s], cotangent of the glide angle and that angle [rad], mean of descent and climb."""
    pitch, mass = vehicle.usual_glide
    pitches = np.array([-pitch, pitch])
    speed, attack, *_ = balance(
        vehicle, np.array([mass, -mass]), np.zeros(2), pitches, np.zeros((3, 2))
    )
    path = np.abs(pitches - attack)
    return float(speed.mean()), float((1.0 / np.tan(path)).mean()), float(path.mean())
