"""Flight models of a glider: forces in balance, and an equation of motion that learns.

The steady balance itself is `twin.identify.start_values`. Its angles follow from ratios of forces,
so the buoyancy hardly matters to them. The speed is the buoyancy's where the path is flat; where it
is steep the depth rate fixes it, which a wrong drag coefficient or ballast cannot spoil. The
learned flight corrects drag, lift, ballast, compressibility and the accelerometers' pitch errors by
each steady glide (`twin.navigation.flight_filter`).

Both state the error of their speed by what is uncertain in the vehicle. Pitch and angle of attack
make a horizontal speed of the depth rate, by the cotangent of the glide angle: coefficients and a
pitch that differ from the vehicle's file turn the path.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.identify.start_values import balance, net_mass
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
    no_glider,
    smooth,
)
from twin.navigation.estimators.base import (
    BodyVelocity,
    Estimate,
    State,
    VelocityDeviation,
    VelocityEstimator,
    WindowedEstimator,
)
from twin.navigation.flight_filter import FlightFilter, FlightSpread
from twin.navigation.flight_filter_kernels import CHANNELS
from twin.vehicle.vehicle import Vehicle

WINDOW_S = 10.0
"""[s] average of every measured input: shorter than a glider takes to settle, longer than noise."""
STEADY_PITCH = np.deg2rad(2.0)
"""[rad] by which pitch may differ from its average: more, and the vehicle is turning over."""
FLAT_SINE = 0.07
"""Sine of the path angle (4 deg) at which the buoyancy's and the depth rate's speed count alike."""
LEAST_SINE = 0.12
"""Sine of the path angle (7 deg) below which there is no steady glide: the best glide ratio of
buoyancy gliders is near 8."""
DRAWS = 40
"""Vehicles that an identification leaves possible; the deviation is known to 11 %"""


class SteadyFlight(WindowedEstimator):
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

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """It needs a glider."""
        return no_glider(vehicle)

    @property
    def deviation(self) -> VelocityDeviation:
        """See `VelocityEstimator`."""
        return glide_deviation(self.vehicle)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        seen = Seen.of(self.vehicle, signals, self.period)
        velocity, gliding = seen.balanced(self.vehicle, slice(None))
        surge, sway = (bridge(one, gliding, held=True) for one in velocity)
        return Estimate(
            surge=np.where(seen.still, 0.0, surge), sway=np.where(seen.still, 0.0, sway)
        )

    def last(self, signals: Signals) -> BodyVelocity:
        """See `WindowedEstimator`; only samples from the last glide on are balanced."""
        seen = Seen.of(self.vehicle, signals, self.period)
        end, count = (0 if seen.still[-1] else len(seen.still)), 1
        while end > 0:
            begin = max(end - count, 0)
            velocity, gliding = seen.balanced(self.vehicle, slice(begin, end))
            if gliding.any():
                surge, sway = velocity[:, np.flatnonzero(gliding)[-1]]
                return BodyVelocity(surge=float(surge), sway=float(sway))
            end, count = begin, 2 * count
        return BodyVelocity(surge=0.0, sway=0.0)


class Seen(NamedTuple):
    """Averaged measurements; angles and rates in radians."""

    rate: Array
    """[m/s] of depth, (time,)"""
    roll: Array
    pitch: Array
    rates: Array
    """[rad/s], (3, time)"""
    net: Array
    """[kg] net buoyancy mass, (time,)"""
    steady: Mask
    """Whether the pitch rests, under water"""
    still: Mask
    """Whether it lies at the surface"""

    @classmethod
    def of(cls, vehicle: Vehicle, signals: Signals, period: float) -> Seen:
        """Average one mission, or its last minutes."""
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

    def balanced(self, vehicle: Vehicle, span: slice) -> tuple[Array, Mask]:
        """Surge and sway [m/s] of some samples, (2, samples), and where forces are in balance.

        At inflections nothing is.
        """
        rate, roll, pitch = self.rate[span], self.roll[span], self.pitch[span]
        speed, alpha, beta, gliding = balance(
            vehicle, self.net[span], roll, pitch, self.rates[:, span]
        )
        direction = np.stack(
            [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)]
        )
        down = (
            -direction[0] * np.sin(pitch)
            + direction[1] * np.cos(pitch) * np.sin(roll)
            + direction[2] * np.cos(pitch) * np.cos(roll)
        )
        gliding = gliding & self.steady[span] & (rate * down > 0) & (np.abs(down) > LEAST_SINE)
        speed = (speed * FLAT_SINE**2 + rate * down) / (FLAT_SINE**2 + down**2)
        return np.maximum(speed, 0.0) * direction[:2], gliding


class LearnedFlight(VelocityEstimator):
    """Surge and sway of a flight filter that begins with the nominal vehicle."""

    kind = "flight_filter"
    title = "flight filter"
    summary = (
        "the nominal vehicle's equation of motion, with the density that a CTD measures; what the "
        "depth rate of steady glides does not agree with corrects drag, lift, ballast, "
        "compressibility and the pitch on the way (`twin/navigation/flight_filter.py`)"
    )
    channels = (*CHANNELS, "measured_heading")

    def __init__(self, vehicle: Vehicle, period: float):
        """Begin before the first sample; see `VelocityEstimator`."""
        super().__init__(vehicle, period)
        self._filter = FlightFilter(vehicle, period)

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """It needs a glider."""
        return no_glider(vehicle)

    @property
    def deviation(self) -> VelocityDeviation:
        """See `VelocityEstimator`; at first, of a hull as in its file."""
        return glide_deviation(self.vehicle)

    def batch(self, signals: Signals) -> Estimate:
        """See `VelocityEstimator`."""
        given = {name: finite_channel(signals, name) for name in CHANNELS}
        found = FlightFilter(self.vehicle, self.period).run(given)
        return Estimate(
            surge=np.ascontiguousarray(found[:, 0]), sway=np.ascontiguousarray(found[:, 1])
        )

    def reset(self) -> None:
        """See `VelocityEstimator`."""
        self._filter.reset()

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`.

        Raises:
          InputError: a channel is missing or not finite.
        """
        found = self._filter.step(sample)
        return BodyVelocity(surge=float(found[0]), sway=float(found[1]))

    def state(self) -> dict[str, NDArray[Any]]:
        """See `VelocityEstimator`."""
        return self._filter.state()

    def restore(self, state: State) -> None:
        """See `VelocityEstimator`."""
        self._filter.restore(state)


def glide_deviation(vehicle: Vehicle) -> VelocityDeviation:
    """Error of the velocity that a balance of forces gives at the vehicle's usual glide.

    The coefficients of an identified vehicle are as sure as its file says; all those of another one
    as the lift slope in `FlightSpread`, which is a sound hull, without growth. The pitch is as
    there. Errors by the coefficients are the same down and up, and stay; those by the pitch change
    their sign, and go.

    Args:
      vehicle: one that glides by lift and drag coefficients.

    Raises:
      VehicleError: what the file says of its identification cannot be read.
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
    """[m/s] horizontal, through the water, at which a vehicle usually goes."""
    if vehicle.steered("speed") is not None:
        return vehicle.cruise_speed
    speed, _, angle = _glide(vehicle)
    return speed * math.cos(angle)


def _glide(vehicle: Vehicle) -> tuple[float, float, float]:
    """Speed [m/s], cotangent of the path's angle and that angle [rad], mean of down and up."""
    pitch, mass = vehicle.usual_glide
    pitches = np.array([-pitch, pitch])
    speed, attack, *_ = balance(
        vehicle, np.array([mass, -mass]), np.zeros(2), pitches, np.zeros((3, 2))
    )
    path = np.abs(pitches - attack)
    return float(speed.mean()), float((1.0 / np.tan(path)).mean()), float(path.mean())
