"""Proof: test flights of an identified vehicle before its file is written.

A glider must trim in the log's dive and in its climb, be stable there, turn when it is steered,
settle under guidance, and hold its heading through a dive and a climb flown in MuJoCo. A propelled
vehicle must hold its depth, its heading and its speed, level and through a turn with a dive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.errors import InputError, MissionError, NoSteadyState, SimulationUnstable
from twin.fossen.model import FossenModel
from twin.identify.calibration import Array, Calibration
from twin.identify.linear_motion import Phase, loop_modes, plane_of, trimmed, way_of
from twin.identify.vehicle_file import driven_step, largest_step
from twin.mission import Mission
from twin.mission.segments import SawTooth, Transect
from twin.mission.turning import turn_factor
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle
from twin.water.density import DensityProfile

STEERED, LEAST_TURN = 0.25, math.radians(0.02)
"""STEERED: fraction of the way from straight to its upper end by which the turning part moves.
LEAST_TURN: [rad/s] smallest turn rate that this must give"""
COURSE = 30.0
"""[deg] Change of heading at the start of the flight"""
MOST_SD, MOST_ERROR = 2.0, 3.0
"""[deg] Limits of settled heading and pitch. MOST_SD: largest standard deviation. MOST_ERROR:
largest mean error"""
PART = 0.5
"""[1] Fraction at the end of a dive and of a climb that is judged"""
LONGEST, SHORTEST = 1500.0, 600.0
"""[s] Longest and shortest duration of a dive and of a climb of the flight"""
START_DEPTH = 10.0
"""[m] Depth at which the flight starts"""
SLOWEST_RATE = 0.02
"""[m/s] Smallest depth rate of a flying vehicle"""
SAMPLE, DRIVEN_SAMPLE = 2.0, 0.5
"""[s] Time between samples. SAMPLE: of a glider's flight. DRIVEN_SAMPLE: a propelled vehicle's"""
DEPTHS, COURSES = (15.0, 25.0), (0.0, 90.0)
"""Two legs of a propelled vehicle. DEPTHS: [m]. COURSES: [deg] headings"""
LENGTH, JUDGED = 60.0, 0.25
"""LENGTH: of each leg, in hull lengths. JUDGED: fraction at the leg's end that is judged"""
MOST_DEPTH, MOST_HEADING, MOST_SPEED = 1.0, 3.0, 0.05
"""Largest mean errors. MOST_DEPTH: [m]. MOST_HEADING: [deg]. MOST_SPEED: [1] relative"""


def failures(calibration: Calibration, phases: Sequence[Phase]) -> tuple[str, ...]:
    """Fly a vehicle in these phases; return a sentence on each failed test."""
    vehicle = calibration.vehicle
    found: list[str] = []
    for phase in phases:
        try:
            found += _phase(vehicle, phase)
        except (MissionError, NoSteadyState, InputError) as error:
            found.append(f"it does not trim in the {_called(phase)}: {error}")
    return tuple(found) if found else tuple(_flight(vehicle, phases))


def _called(phase: Phase) -> str:
    name = "climb" if phase.pitch > 0.0 else "dive"
    return f"{name} at {abs(math.degrees(phase.pitch)):.0f} deg, {abs(phase.net_mass):.2f} kg"


def _phase(vehicle: Vehicle, phase: Phase) -> list[str]:
    state, positions = trimmed(vehicle, phase)
    found = []
    for control in ("pitch", "heading"):
        part = vehicle.steered(control)
        plane = plane_of(vehicle, state, positions, control)
        if plane is None or part is None:
            continue
        if control == "heading":
            factor = turn_factor(vehicle, way_of(vehicle, phase))
            found += _spiral(vehicle, phase, positions, plane.gain)
        else:
            factor = part.sense("pitch")
        pid = [factor * gain for gain in getattr(vehicle, f"{control}_pid")]
        modes = loop_modes(plane, pid, part.lag, vehicle.control_period)
        if np.max(modes.real) >= 0.0:
            found.append(
                f"its {control} loop does not settle in the {_called(phase)}: a mode grows by "
                f"{np.max(modes.real):.2g} 1/s"
            )
    return found


def _spiral(vehicle: Vehicle, phase: Phase, positions: Array, gain: float) -> list[str]:
    """Sentence on a turn against the sign of `gain` [rad/s / unit] or below LEAST_TURN."""
    part = vehicle.steered("heading")
    assert part is not None
    named = dict(zip(vehicle.part_names, positions.tolist(), strict=True))
    straight = named[part.name]
    moved = STEERED * (part.high - straight)
    try:
        trim = FossenModel(vehicle).trim(positions={**named, part.name: straight + moved})
    except (NoSteadyState, InputError) as error:
        return [f"it does not steer in the {_called(phase)}: {error}"]
    turn = trim.turn_rate_rad_s
    if turn * gain * moved <= 0.0 or abs(turn) < LEAST_TURN:
        return [
            f"it does not steer in the {_called(phase)}: {part.name} moved by {moved:.3g} "
            f"{part.unit} turns it by {math.degrees(turn):.3f} deg/s, small positions by "
            f"{math.degrees(gain * moved):.3f}"
        ]
    return []


def _flight(vehicle: Vehicle, phases: Sequence[Phase]) -> list[str]:
    dive, climb = sorted(phases, key=lambda phase: phase.pitch)
    rates = [abs(way_of(vehicle, phase).vertical_speed) for phase in (dive, climb)]
    if min(rates) < SLOWEST_RATE:
        return [f"it moves by {100 * min(rates):.1f} cm/s only"]
    deepest = float(np.clip(LONGEST * min(rates), SHORTEST * max(rates), 1000.0))
    plan = Mission(
        name="proof",
        start_heading_deg=0.0,
        ascent_pitch_deg=abs(math.degrees(climb.pitch)),
        segments=(
            SawTooth(
                max_depth_m=START_DEPTH + deepest,
                min_depth_m=5.0,
                pitch_deg=abs(math.degrees(dive.pitch)),
                climb_pitch_deg=abs(math.degrees(climb.pitch)),
                net_mass_kg=abs(dive.net_mass),
                climb_net_mass_kg=abs(climb.net_mass),
                heading_deg=COURSE,
                yos=1,
            ),
        ),
    )
    # the density grows with depth as fast as the hull shrinks: the buoyancy of the trim is constant
    depth = np.array([0.0, 2000.0])
    pressure = vehicle.reference_density * vehicle.gravity * depth
    density = vehicle.reference_density / (1.0 - vehicle.hull_compressibility * pressure)
    state, positions = trimmed(vehicle, dive)
    scenario = Scenario(
        vehicle=vehicle,
        mission=plan,
        density=DensityProfile(depth=depth, values=density),
        sample_period=SAMPLE,
        timestep=largest_step(vehicle),
        start=Start(  # in a glide: the surface is not judged
            depth=START_DEPTH,
            pitch=float(state[7]),
            v_rel=(float(state[0]), float(state[1]), float(state[2])),
            actuators=tuple(map(float, positions)),
        ),
    )
    try:
        flown = simulate(scenario)
    except SimulationUnstable as error:
        return [f"it does not fly a dive and a climb: {error}"]
    return _held(flown, START_DEPTH + deepest, phases, vehicle)


def _held(
    flown: Trajectory, deepest: float, phases: Sequence[Phase], vehicle: Vehicle
) -> list[str]:
    depth, heading, pitch = (flown[f"true_{name}"] for name in ("depth", "heading", "pitch"))
    bottom = int(np.argmax(depth))
    turned = int(np.argmax(depth >= deepest))  # the pump starts; the vehicle sinks on for minutes
    end = bottom + int(np.argmax(depth[bottom:] < 6.0)) if (depth[bottom:] < 6.0).any() else 0
    if end <= bottom:
        return ["it does not come up from its dive"]
    found = []
    for phase in phases:
        first, last = (bottom, end) if phase.pitch > 0.0 else (0, turned)
        judged = slice(int(last - PART * (last - first)), last - round(30.0 / SAMPLE))
        wanted = [("pitch", math.degrees(phase.pitch), pitch[judged])]
        if vehicle.steered("heading") is not None:
            error = (heading[judged] - COURSE + 180.0) % 360.0 - 180.0 + COURSE
            wanted.append(("heading", COURSE, error))
        for name, target, values in wanted:
            off, sd = float(np.mean(values) - target), float(np.std(values))
            if abs(off) > MOST_ERROR or sd > MOST_SD:
                found.append(
                    f"its {name} does not settle in the {_called(phase)}: off by {off:.1f} deg on "
                    f"average, standard deviation {sd:.1f} deg"
                )
    return found


def driven_failures(calibration: Calibration, speed: float) -> tuple[str, ...]:
    """Fly a propelled vehicle at a speed [m/s]; return a sentence on each failed test."""
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
        sample_period=DRIVEN_SAMPLE,
        timestep=driven_step(vehicle),
        duration=2.0 * duration,
    )
    try:
        flown = simulate(scenario)
    except (SimulationUnstable, MissionError) as error:
        return (f"it does not fly level: {error}",)
    found = []
    for k, (depth, course) in enumerate(zip(DEPTHS, COURSES, strict=True)):
        last = round((k + 1) * duration / DRIVEN_SAMPLE)
        part = slice(last - round(JUDGED * duration / DRIVEN_SAMPLE), last)
        sunk, turned, surge = (flown[f"true_{n}"][part] for n in ("depth", "heading", "surge"))
        turned = (turned - course + 180.0) % 360.0 - 180.0
        for what, off, most, unit in (
            ("depth", float((sunk - depth).mean()), MOST_DEPTH, "m"),
            ("heading", float(turned.mean()), MOST_HEADING, "deg"),
            ("speed", float(surge.mean()) / speed - 1.0, MOST_SPEED, "of it"),
        ):
            if not abs(off) <= most:
                found.append(
                    f"it does not hold its {what} on the way at {depth:g} m: off by {off:.2g} "
                    f"{unit} on average"
                )
    return tuple(found)
