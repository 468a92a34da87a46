"""Stiffness: rates at which a vehicle's velocities settle at a speed, and the steps they allow.

The 6 x 6 velocity block, linearised about straight motion, has one eigenvalue for each mode in
which a small motion dies out. The fastest mode is the rotary damping of the hull's law, which grows
with the speed. If the step is long for that damping, it is solved for implicitly (see "time step"
in docs/physics/equations.md). The other terms are extrapolated and bound the step.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from twin.errors import InaccurateStep, MissionError, StepTooLong, VehicleError
from twin.mission import mission_file as g
from twin.physics.native import block as b
from twin.vehicle.mjcf import MjcfReader

if TYPE_CHECKING:
    from twin.physics.model_block import Tables
    from twin.physics.scenario import Scenario
    from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]
SMALL = 1e-5
"""[m/s] Step of the finite differences by a velocity."""
TURNING = 0.2
"""[rad/s] Step of the differences by a rate, as in quick manoeuvres, where damping is large."""
EXTRAPOLATED = 1.0
"""[1] Product of step and fastest rate above which rotary damping is solved for implicitly; below,
it can still be extrapolated."""
ACCURATE, STABLE = 0.5, 0.6
"""[1] Limits of the product of step and fastest extrapolated rate. For one mode the formula of
Adams and Bashforth is stable up to 1 (Hairer, Norsett and Wanner 1993, III.1); coupled modes in
turns and quick manoeuvres were unstable or useless from 0.66 on. At 0.5 a glider's manoeuvres are
off by about 1 mm/s (tests/twin/physics/test_convergence.py)."""
MUJOCO_STEP = 0.002
"""[s] Step of a vehicle file that gives none: MuJoCo's default."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stiffness:
    """Fastest rates [1/s] at which small motions about straight motion die out or oscillate."""

    speed: float
    """[m/s] Speed through the water."""
    whole: float
    """[1/s] Fastest rate of the whole velocity block."""
    rest: float
    """[1/s] Fastest rate of the block without the rotary damping of the hull's law."""

    def solved(self, timestep: float) -> bool:
        """Tell whether a step [s] is so long that rotary damping must be solved for implicitly."""
        return timestep * self.whole > EXTRAPOLATED

    @property
    def longest(self) -> float:
        """[s] Longest step that is accurate."""
        return ACCURATE / self.rest if self.rest > 0.0 else math.inf

    def too_long(self, timestep: float) -> str:
        """Warning that a step [s] exceeds the longest accurate one; empty if it does not."""
        if timestep <= self.longest:
            return ""
        unstable = timestep * self.rest > STABLE
        return (
            f"timestep {timestep:g} s is too long at {self.speed:.2f} m/s, where the vehicle's "
            f"velocities settle by {self.rest:.2g} 1/s: the run would be "
            f"{'unstable' if unstable else 'off by a millimetre per second or more'}; take at most "
            f"{rounded(self.longest):g} s"
        )

    def check(self, timestep: float) -> None:
        """Warn with InaccurateStep of a step [s] that is not accurate.

        Raises:
          StepTooLong: the step is unstable.
        """
        said = self.too_long(timestep)
        if said and timestep * self.rest > STABLE:
            raise StepTooLong(said)
        if said:
            warnings.warn(said, InaccurateStep, stacklevel=3)


def stiffness(vehicle: Vehicle, speed: float, angle_of_attack: float = 0.0) -> Stiffness:
    """Stiffness of straight motion at a speed [m/s] and angle of attack [rad], parts at rest."""
    from twin.mission.glide_balance import left_over, mass_matrix

    position = vehicle.rest
    velocity = speed * np.array([math.cos(angle_of_attack), 0.0, math.sin(angle_of_attack)])
    nu, down = np.concatenate([velocity, np.zeros(3)]), np.array([0.0, 0.0, 1.0])
    block, damping = np.empty((6, 6)), np.zeros((6, 6))
    for k, unit in enumerate(np.eye(6)):
        step = unit * (TURNING if k >= 3 else SMALL)
        ahead, behind = (left_over(vehicle, position, nu + s * step, down) for s in (1.0, -1.0))
        block[:, k] = (ahead - behind) / (2.0 * step[k])
        if k >= 3:
            density = vehicle.reference_density
            ahead, behind = (vehicle.law.wrench(nu + s * step, density) for s in (1.0, -1.0))
            damping[3:, k] = (ahead - behind)[3:] / (2.0 * step[k])
    damping = 0.5 * (damping + damping.T)
    inverse = np.linalg.inv(mass_matrix(vehicle, position))
    whole, rest = (
        float(np.abs(np.linalg.eigvals(inverse @ matrix)).max())
        for matrix in (block, block - damping)
    )
    return Stiffness(speed=speed, whole=whole, rest=rest)


def usual_way(vehicle: Vehicle) -> tuple[float, float]:
    """Speed [m/s] and angle of attack [rad] of the usual glide, or of the propelled cruise."""
    from twin.mission.way import level_way, way

    label = f"vehicle {vehicle.name!r}"
    if vehicle.steered("speed") is not None:
        flown = level_way(vehicle, label, None)
    else:
        pitch, net_mass = vehicle.usual_glide
        flown = way(
            vehicle, label, "usual_glide", -math.degrees(pitch), net_mass, None, within_travel=True
        )
    return flown.speed, flown.angle_of_attack


def planned_way(plan: Array) -> tuple[float, float] | None:
    """Speed [m/s] and angle of attack [rad] of the fastest leg of a mission's table; None: no leg.

    plan: shape (rows, SEGMENT_COLUMNS + 3 parts), see `Mission.compile`.
    """
    found = []
    for ahead, pitch, attack in (
        (g.DIVE_SPEED, g.DIVE_PITCH, g.DIVE_ATTACK),
        (g.CLIMB_SPEED, g.CLIMB_PITCH, g.CLIMB_ATTACK),
    ):
        angle = np.nan_to_num(plan[:, attack])
        path = np.cos(np.nan_to_num(plan[:, pitch]) - angle)
        speed = np.nan_to_num(plan[:, ahead]) / np.maximum(path, 0.1)
        found += list(zip(speed.tolist(), angle.tolist(), strict=True))
    fastest = max(found)
    return fastest if fastest[0] > 0.0 else None


def stiffness_of(
    vehicle: Vehicle, plan: Array | None = None, *, start: float = 0.0
) -> Stiffness | None:
    """Stiffness at the largest known speed of a vehicle; None if no speed is known.

    Args:
      plan: table of its mission, see `Mission.compile`; without legs there, the usual glide counts.
      start: [m/s] initial speed through the water.
    """
    try:
        found = None if plan is None or not plan.size else planned_way(plan)
        speed, angle = found or usual_way(vehicle)
    except (MissionError, VehicleError):
        if start <= 0.0:
            return None
        speed, angle = 0.0, 0.0
    return stiffness(vehicle, max(speed, start), angle)


def stiffness_in(scenario: Scenario, vehicle: Vehicle, tables: Tables) -> Stiffness | None:
    """Stiffness of a scenario's vehicle at its largest known speed in that scenario."""
    from twin.mission import Mission

    plan = tables.plan if tables.control == b.CONTROL_MISSION else None
    if scenario.navigate is not None and isinstance(scenario.mission, Mission):
        plan, _ = scenario.mission_in_metres().compile(scenario.believed_vehicle)
    return stiffness_of(vehicle, plan, start=math.hypot(*scenario.begin.v_rel))


def file_timestep(vehicle: Vehicle) -> float:
    """Physics step [s] that a vehicle's file gives."""
    return _file_timestep(vehicle.xml, vehicle.path)


@functools.lru_cache(maxsize=16)
def _file_timestep(xml: str, path: Path) -> float:
    return float(MjcfReader(xml, path).one("option").get("timestep", MUJOCO_STEP))


def rounded(step: float) -> float:
    """Largest step [s] that is not above `step` and is 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return max(k * power for k in (1.0, 2.0, 5.0) if k * power <= step * (1.0 + 1e-9))
