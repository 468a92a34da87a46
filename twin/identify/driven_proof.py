"""Driven proof: an identified propelled vehicle flies, before its file is written.

It must hold its depth, its heading and its speed under its own guidance, level and through a turn
with a dive, flown in MuJoCo.
"""

from __future__ import annotations

from twin.errors import MissionError, SimulationUnstable
from twin.identify.calibration import Calibration
from twin.identify.vehicle_file import driven_step
from twin.mission import Mission
from twin.mission.segments import Transect
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.water.density import DensityProfile

DEPTHS, COURSES = (15.0, 25.0), (0.0, 90.0)
"""[m], [deg] of the two ways"""
LENGTH = 60.0
"""hull lengths of each way"""
JUDGED = 0.25
"""Last part of a way that is judged"""
MOST_DEPTH, MOST_HEADING, MOST_SPEED = 1.0, 3.0, 0.05
"""[m], [deg] and part of the speed by which it may be off there, on average"""
SAMPLE = 0.5
"""[s]"""


def driven_failures(calibration: Calibration, speed: float) -> tuple[str, ...]:
    """What a vehicle cannot do at a speed [m/s]; empty when it flies."""
    vehicle = calibration.vehicle
    duration = max(LENGTH * vehicle.hull_length / speed, 60.0)
    plan = Mission(
        name="proof",
        start_heading_deg=COURSES[0],
        start_depth_m=DEPTHS[0],
        segments=tuple(
            Transect(depth_m=depth, heading_deg=course, speed_m_s=speed, duration_s=duration)
            for depth, course in zip(DEPTHS, COURSES, strict=True)
        ),
    )
    scenario = Scenario(
        vehicle=vehicle,
        mission=plan,
        density=DensityProfile.constant(calibration.water_density),
        sample_period=SAMPLE,
        timestep=driven_step(vehicle),
        duration=2.0 * duration,
    )
    try:
        flown = simulate(scenario)
    except (SimulationUnstable, MissionError) as error:
        return (f"it does not fly level: {error}",)
    found = []
    for k, (depth, course) in enumerate(zip(DEPTHS, COURSES, strict=True)):
        last = round((k + 1) * duration / SAMPLE)
        part = slice(last - round(JUDGED * duration / SAMPLE), last)
        turned = (flown["true_heading"][part] - course + 180.0) % 360.0 - 180.0
        for what, off, most, unit in (
            ("depth", float((flown["true_depth"][part] - depth).mean()), MOST_DEPTH, "m"),
            ("heading", float(turned.mean()), MOST_HEADING, "deg"),
            (
                "speed",
                float(flown["true_surge"][part].mean()) / speed - 1.0,
                MOST_SPEED,
                "of it",
            ),
        ):
            if not abs(off) <= most:
                found.append(
                    f"it does not hold its {what} on the way at {depth:g} m: off by {off:.2g} "
                    f"{unit} on average"
                )
    return tuple(found)
