"""Glide deviation: what an error of the vehicle makes of a speed that a balance of forces tells.

The depth rate gives the vertical speed. Pitch and angle of attack make a horizontal speed of it, by
the cotangent of the path's angle: coefficients and pitch that are not as the vehicle's file says
turn the path.
"""

from __future__ import annotations

import math

import numpy as np

from twin.identify.start_values import balance
from twin.identify.unknowns import draw_vehicles
from twin.navigation.estimators.base import VelocityDeviation
from twin.navigation.flight_filter import FlightSpread
from twin.vehicle.vehicle import Vehicle

DRAWS = 40
"""Vehicles that an identification leaves possible; the deviation is known to 11 %"""


def glide_deviation(vehicle: Vehicle) -> VelocityDeviation:
    """Of the velocity at the vehicle's usual glide.

    The coefficients of an identified vehicle are as sure as its file says; all those of another one
    as the lift slope in `FlightSpread`, which is a sound hull, without growth. The pitch is as
    there. What the coefficients do is the same down and up, and stays; what a pitch error does
    changes its sign, and goes.

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
