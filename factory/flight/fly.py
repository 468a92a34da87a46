"""Flight: one mission from its parameters to its signals. Replays run the same code."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from factory.flight.bounds import check_possible
from factory.flight.mission_water import bottom_depth, build_current, build_density, origin
from factory.flight.vehicle_errors import (
    ballast_of,
    believed_vehicle,
    encoder_zeros,
    spread_vehicle,
)
from factory.recipe.sampling import SAW_TOOTH, SURFACE, Parameters, number
from twin.mission import Mission, SawTooth, Segment, Spiral, Surface
from twin.physics.scenario import SAMPLE_PERIOD, Scenario
from twin.physics.simulation import Simulation
from twin.vehicle.vehicle import Vehicle
from twin.water.current.base import Current

if TYPE_CHECKING:
    from twin.records.trajectory import Trajectory
    from twin.sensors import SensorSuite

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Flight:
    """One mission as it was flown."""

    trajectory: Trajectory
    measured: Mapping[str, Array]
    drawn: Mapping[str, float]
    """The sensors' constants of this mission."""

    @property
    def signals(self) -> dict[str, Array]:
        """Truth, measured and commanded, each of shape (time,)."""
        return {**self.trajectory.signals, **self.measured}


PROFILE = ("max_depth_m", "min_depth_m", "pitch_deg", "climb_pitch_deg")
"""Fields of every dive and climb"""
MOTION = {"buoyancy": ("net_mass_kg", "climb_net_mass_kg"), "speed": ("speed_m_s",)}
"""Fields of those of vehicles with a pump, and of those with a propeller"""


def build_mission(parameters: Parameters, vehicle: Vehicle) -> Mission:
    """The mission that the guidance is given."""
    driven = [
        name for control, names in MOTION.items() if vehicle.steered(control) for name in names
    ]
    heading = parameters.number("mission.start_heading_deg")
    start_heading = heading
    segments: list[Segment] = []
    for drawn in parameters.segments:
        kind = drawn["mission.kind"]
        if kind == SURFACE:
            segments.append(Surface(duration_s=number(drawn, "mission.surface_duration_s")))
            continue
        profile: dict[str, Any] = {
            **{name: number(drawn, f"mission.{name}") for name in (*PROFILE, *driven)},
            "yos": _unless_nan(number(drawn, "mission.yos")),
            "duration_s": _unless_nan(number(drawn, "mission.segment_duration_s")),
        }
        if kind == SAW_TOOTH:
            if vehicle.steered("heading"):
                heading = (heading + number(drawn, "mission.heading_change_deg")) % 360.0
            segments.append(SawTooth(heading_deg=heading, **profile))
        else:
            segments.append(Spiral(rotation_deg=number(drawn, "mission.rotation_deg"), **profile))
    return Mission(
        segments=tuple(segments),
        duration_s=parameters.duration_s,
        start_depth_m=parameters.number("mission.start_depth_m"),
        start_heading_deg=start_heading,
        at_end="hold",
    )


def _unless_nan(value: float) -> float | None:
    return None if math.isnan(value) else value


def build_scenario(
    parameters: Parameters, nominal: Vehicle, current: Current | None = None
) -> Scenario:
    """Everything that the physics needs; `current` replaces the drawn one."""
    believed = believed_vehicle(nominal, parameters)
    return Scenario(
        vehicle=spread_vehicle(nominal, parameters),
        believed=believed,
        ballast=ballast_of(nominal, parameters),
        encoder_zeros=encoder_zeros(nominal, parameters),
        plan=build_mission(parameters, believed),
        duration=parameters.duration_s,
        current=build_current(parameters) if current is None else current,
        density=build_density(parameters),
        origin=origin(parameters),
        sample_period=SAMPLE_PERIOD,
    )


def fly(
    parameters: Parameters,
    nominal: Vehicle,
    suite: SensorSuite,
    sensor_seed: np.random.SeedSequence,
    *,
    current: Current | None = None,
    drawn: Mapping[str, float] | None = None,
) -> Flight:
    """Fly one mission and measure it.

    Args:
      current: instead of the drawn one.
      drawn: the sensors' constants, by default those that the seed gives.

    Raises:
      MissionError: the vehicle cannot fly it.
      SimulationUnstable: the simulation left the finite numbers.
      Impossible: it left the physically possible ones.
    """
    scenario = build_scenario(parameters, nominal, current)
    simulation = Simulation(scenario)
    trajectory = simulation.run()
    check_possible(trajectory.signals, trajectory.time)
    if drawn is None:
        drawn = suite.draw(sensor_seed)
    water = scenario.current
    measured = suite.measure(
        trajectory.signals,
        dt=SAMPLE_PERIOD,
        rng_seed=sensor_seed,
        drawn=drawn,
        bottom_depth=bottom_depth(parameters),
        latitude=parameters.number("water.latitude"),
        density=scenario.density,
        current=None if water is None else water.compile(simulation.duration, scenario.origin),
    )
    return Flight(trajectory=trajectory, measured=measured, drawn=drawn)
