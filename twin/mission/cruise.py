"""Cruise: the rate of a propeller that holds a speed, level and straight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.errors import MissionError

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle

_BISECTIONS = 60
"""Halvings that take any interval of rates below double precision."""
_DEEP = 1e3
"""[m] where every part is under water"""


def cruise_rate(vehicle: Vehicle, speed: float) -> float:
    """Rate [rad/s] at which thrust equals the drag of hull and parts at `speed` [m/s].

    Raises:
      MissionError: the propeller cannot; the largest speed that it can hold is named.
    """
    driving = vehicle.steered("speed")
    assert driving is not None
    if not surplus(vehicle, driving.high, speed) >= 0.0:
        slow, fast = 0.0, speed
        for _ in range(_BISECTIONS):
            middle = 0.5 * (slow + fast)
            if surplus(vehicle, driving.high, middle) >= 0.0:
                slow = middle
            else:
                fast = middle
        raise MissionError(
            f"speed_m_s = {speed:g}: propeller {driving.name!r} of vehicle {vehicle.name!r} drives "
            f"it at up to {slow:.2f} m/s ({driving.high:g} rad/s); give less"
        )
    low, high = 0.0, float(driving.high)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if surplus(vehicle, middle, speed) >= 0.0:
            high = middle
        else:
            low = middle
    return high


def surplus(vehicle: Vehicle, rate: float, speed: float) -> float:
    """Thrust less drag [N] at a propeller's `rate` [rad/s] and `speed` [m/s] straight ahead."""
    nu_r = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    density = vehicle.reference_density
    force = float(vehicle.law.wrench(nu_r, density)[0])
    for part in vehicle.parts:
        position = rate if part.name == vehicle.steering.get("speed") else part.rest
        force += float(part.wrench(position, nu_r, density, _DEEP)[0])
    return force
