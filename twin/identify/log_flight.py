"""Log flight: simulated flights of a vehicle file with the targets of logged dives, leg by leg.

`fly_turns` repeats the logged positions of the turning part, so that log and twin have the same
input. Under guidance, the twin's rudder would hardly move in calm water, while the log's rudder
works against waves and compass noise. Pitch and pump stay under guidance; the heading is free.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.errors import InputError, SimulationUnstable
from twin.identify.calibration import Array
from twin.identify.logged_missions import layers
from twin.identify.replayed_dive import DivePiece, ReplayedDive, Target, Turning
from twin.mission import Mission
from twin.mission.controller import (
    MEMORY,
    Command,
    FollowedPositions,
    MissionController,
    Observation,
    followed,
)
from twin.mission.glide_balance import steady_glide
from twin.mission.mission_file import DONE
from twin.mission.segments import SawTooth
from twin.physics.lanes import fly_in_lanes
from twin.physics.model_block import state
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.physics.start import Start
from twin.physics.stiffness import file_timestep
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle
from twin.water.density import DensityProfile

SHALLOWEST = 2.0
"""[m] Depth at which a simulated dive starts and ends; above, the hull would break the surface"""
BIN = 2.0
"""[m] Thickness of the layers of the log's density profile"""
SAMPLE_PERIOD = 1.0
"""[s] Time between the twin's samples: short against the roll's period of about ten seconds"""
PATIENCE = 2.0
"""Longest duration of the twin's dive, as a multiple of the log's"""
CHECK_PERIOD = 10.0
"""[s] Time between checks for the end of a dive"""
PUMP_MARGIN = 0.05
"""[1] Largest distance of the log's pump beyond the vehicle file's travel, in travels"""


def fly_dives(
    vehicle: Vehicle, dives: Sequence[ReplayedDive], engine: str = "mujoco"
) -> list[Trajectory | SimulationUnstable]:
    """Fly the targets of each dive; an unstable flight gives the error that ended it.

    Args:
      engine: engine of `Scenario`; with "lanes" the dives are simulated as a batch.

    Raises:
      InputError: a logged pump position is beyond the vehicle's pump.
      MissionError: the vehicle cannot fly the log's pitch at its buoyancy.
    """
    legs = [(dive.targets[0].leg, dive.targets[-1].leg) for dive in dives]
    scenarios = [
        scenario_of(vehicle, dive, PATIENCE * dive.period * (last.last - first.first), engine)
        for dive, (first, last) in zip(dives, legs, strict=True)
    ]
    if engine == "lanes":
        return fly_in_lanes(scenarios, until_flown=True)
    flights: list[Trajectory | SimulationUnstable] = []
    with quiet_mujoco():
        for dive, scenario in zip(dives, scenarios, strict=True):
            try:
                flights.append(_fly(Simulation(scenario), dive.row))
            except SimulationUnstable as error:
                flights.append(error)
    return flights


def _fly(simulation: Simulation, row: int) -> Trajectory:
    """Fly one dive until its mission is done or the scenario's duration is over."""
    steps = max(1, round(CHECK_PERIOD / simulation.model.opt.timestep))
    for _ in range(-(-simulation.steps // steps)):
        if simulation.failed or state(simulation.data)["guidance"][DONE]:
            break
        simulation.step(steps)
    return simulation.trajectory(row)


def scenario_of(
    vehicle: Vehicle, dive: ReplayedDive, duration: float, engine: str, *, plan: bool = True
) -> Scenario:
    """Scenario of a dive for `duration` [s]: its targets as a mission, its water and its start.

    Without `plan` the scenario has no mission, for a controller that brings its own.
    """
    first = dive.targets[0]
    leg = first.leg
    begin = max(leg.top, SHALLOWEST) if leg.phase == "dive" else leg.bottom
    heading = 0.0 if dive.heading is None else math.radians(dive.heading[leg.first] % 360.0)
    pump = vehicle.steered("buoyancy")
    assert pump is not None
    actuators = {pump.name: _limited_pump(vehicle, first.pieces[0].pump, dive.row)}
    slide = vehicle.steered("pitch")
    if slide is not None:
        # start in trim for the first target: the encoder's zero can be far from trim
        net = vehicle.net_mass_for_pump(actuators[pump.name])
        place = steady_glide(vehicle, math.radians(first.pitch), net).shift
        actuators[slide.name] = min(max(place, slide.low), slide.high)
    timestep = file_timestep(vehicle)
    return Scenario(
        vehicle=vehicle,
        mission=mission_of(vehicle, dive) if plan else None,
        engine=engine,
        duration=duration,
        density=water_of(dive),
        start=Start(
            depth=begin,
            heading=heading,
            pitch=math.radians(first.pitch),
            actuators=actuators,
        ),
        sample_period=max(round(SAMPLE_PERIOD / timestep), 1) * timestep,
    )


def mission_of(vehicle: Vehicle, dive: ReplayedDive) -> Mission:
    """Mission of a dive: a saw-tooth for each section of a leg; depths end the sections."""
    segments: list[SawTooth] = []
    top, bottom = SHALLOWEST, 0.0
    for index, target in enumerate(dive.targets):
        diving = target.leg.phase == "dive"
        if diving:
            top, bottom = max(target.leg.top, SHALLOWEST), target.turn_depth
            if index:
                top = max(dive.targets[index - 1].turn_depth, SHALLOWEST)
        else:
            top = max(target.turn_depth, SHALLOWEST)
            bottom = max(bottom, top + 1.0) if index else target.leg.bottom
        for piece in target.pieces:
            until = float(dive.depth[piece.last])
            if piece is target.pieces[-1]:
                until = bottom if diving else top
            segments.append(
                SawTooth(
                    min_depth_m=top,
                    max_depth_m=bottom,
                    until_depth_m=min(max(until, top), bottom),
                    heading_deg=piece.heading,
                    **_glides(vehicle, dive, index, piece),
                )
            )
    last = segments[-1]
    return Mission(
        name=f"logged dive {dive.row}",
        segments=tuple(segments),
        at_end="hold",
        ascent_pitch_deg=last.climb_pitch_deg or last.pitch_deg,
    )


def segment_legs(dive: ReplayedDive) -> list[int]:
    """Index of the leg of each segment of a dive's mission."""
    return [k for k, target in enumerate(dive.targets) for _ in target.pieces]


def legs_flown(dive: ReplayedDive, trajectory: Trajectory) -> Array:
    """Index of the log's leg that the twin was flying at each of its samples, (time,).

    The index is -1 after the last leg, when the mission holds its last segment.
    """
    legs = segment_legs(dive)
    segment = np.nan_to_num(trajectory["commanded_segment"], nan=0.0).astype(int)
    number = np.array(legs)[np.clip(segment, 0, len(legs) - 1)]
    last = dive.targets[-1]
    down = last.leg.phase == "dive"
    end = last.turn_depth if down else max(last.turn_depth, SHALLOWEST)
    depth = trajectory["true_depth"]
    there = (number == len(dive.targets) - 1) & ((depth >= end) if down else (depth <= end))
    if there.any():
        number[int(np.argmax(there)) + 1 :] = -1
    return number


def water_of(dive: ReplayedDive) -> DensityProfile:
    """Density profile: medians of the log's densities in layers of `BIN`."""
    depths, density = layers(dive.depth, dive.water[0], BIN)
    columns = [density, *(layers(dive.depth, one, BIN)[1] for one in dive.water[1:])]
    if dive.measured.any():
        there = np.isin(
            depths, layers(dive.depth[dive.measured], dive.depth[dive.measured], BIN)[0]
        )
        depths, columns = depths[there], [one[there] for one in columns]
    names = ("values", "temperature", "salinity")
    return DensityProfile(depth=depths, **dict(zip(names, columns, strict=False)))


FlownTurn = tuple[ReplayedDive, Trajectory, Array]
"""A dive, its flight with the log's turns, and the index of the leg at each sample, (time,)"""


class _Turned:
    """Controller with guidance that repeats the log's turning positions from each leg's start."""

    def __init__(self, vehicle: Vehicle, dive: ReplayedDive, follow: FollowedPositions):
        self._guidance = MissionController(mission_of(vehicle, dive), vehicle)
        self._legs = segment_legs(dive)
        self._part = vehicle.part_names[follow.part]
        self._table, self._memory = follow.table(), np.zeros(MEMORY)
        self.begun: list[tuple[float, int]] = []
        """Start [s] and index of each leg; index -1 after the last"""

    def __call__(self, observation: Observation) -> Command:
        command = self._guidance(observation)
        segment = self._guidance.segment
        leg = -1
        if not self._guidance.done:
            leg = self._legs[min(segment, len(self._legs) - 1)]
        if not self.begun or leg != self.begun[-1][1]:
            self.begun.append((observation.time, leg))
        if leg < 0:
            return command
        position = followed(self._table, self._memory, observation.time, segment)
        return Command(**{**command, self._part: float(position)})

    def legs(self, time: Array) -> Array:
        """Index of the leg at each time [s], (time,); -1 after the last."""
        times, numbers = zip(*self.begun, strict=True)
        return np.array(numbers)[np.searchsorted(times, time, side="right") - 1]


def fly_turns(
    vehicle: Vehicle,
    flown: Sequence[tuple[ReplayedDive, Trajectory]],
    turning: Turning,
    engine: str = "mujoco",
) -> tuple[list[FlownTurn], list[SimulationUnstable]]:
    """Fly with the log's turning positions; return flights, and errors of unstable flights.

    Args:
      flown: dives with positions of the turning part, each with the twin's flight under guidance,
        which sets the duration.
      turning: turning part of the same type as the log's.
      engine: engine of `Scenario`; with "lanes" the dives are simulated as a batch.
    """
    follow = [_followed(vehicle, dive, turning) for dive, _ in flown]
    lanes = engine == "lanes"
    scenarios = [scenario_of(vehicle, d, float(f.time[-1]), engine, plan=lanes) for d, f in flown]
    if lanes:
        runs = fly_in_lanes(scenarios, follow=follow)
        return (
            [
                (dive, run, legs_flown(dive, run))
                for (dive, _), run in zip(flown, runs, strict=True)
                if isinstance(run, Trajectory)
            ],
            [run for run in runs if isinstance(run, SimulationUnstable)],
        )
    found: list[FlownTurn] = []
    failed: list[SimulationUnstable] = []
    for (dive, _), positions, scenario in zip(flown, follow, scenarios, strict=True):
        controller = _Turned(vehicle, dive, positions)
        try:
            with quiet_mujoco():
                run = Simulation(scenario).run(controller, mission=dive.row)
        except SimulationUnstable as error:
            failed.append(error)
        else:
            found.append((dive, run, controller.legs(run.time)))
    return found, failed


def _followed(vehicle: Vehicle, dive: ReplayedDive, turning: Turning) -> FollowedPositions:
    """Positions of the log that the turning part follows in place of guidance."""
    assert dive.turning is not None
    part = vehicle.part(turning.part)
    legs = [dive.targets[k].leg for k in segment_legs(dive)]
    return FollowedPositions(
        part=vehicle.part_names.index(part.name),
        period=dive.period,
        positions=np.clip(turning.sense * dive.turning / part.quantity.scale, part.low, part.high),
        legs=tuple((leg.first, leg.last) for leg in legs),
    )


def _glides(vehicle: Vehicle, dive: ReplayedDive, index: int, piece: DivePiece) -> dict[str, float]:
    """Pitch and net mass of a section in its phase; the other phase has its neighbour's."""
    mine = dive.targets[index]
    beside = dive.targets[index + 1 : index + 2] or dive.targets[max(index - 1, 0) : index]
    found: dict[str, float] = {}
    for target in (*beside, mine):
        way = "" if target.leg.phase == "dive" else "climb_"
        found[f"{way}pitch_deg"] = _pitch(target, dive.row)
        pump = piece.pump if target is mine else target.pump
        found[f"{way}net_mass_kg"] = _net_mass(vehicle, target, pump, dive.row)
    if "pitch_deg" not in found:
        found["pitch_deg"] = found["climb_pitch_deg"]
        found["net_mass_kg"] = found["climb_net_mass_kg"]
    return found


def _pitch(target: Target, row: int) -> float:
    """Magnitude [deg] of a leg's pitch."""
    signed = -target.pitch if target.leg.phase == "dive" else target.pitch
    if signed <= 0.0:
        raise InputError(
            f"dive {row}: the log {_verb(target)} at a pitch of {target.pitch:.1f} deg, nose the "
            "wrong way: its pitch is not that of a glide; leave the dive out with --missions"
        )
    return signed


def _net_mass(vehicle: Vehicle, target: Target, pump: float, row: int) -> float:
    """Magnitude [kg] of a leg's net mass at reference density with its pump at `pump` [cm3]."""
    net = vehicle.net_mass_for_pump(_limited_pump(vehicle, pump, row))
    signed = net if target.leg.phase == "dive" else -net
    if signed <= 0.0:
        raise InputError(
            f"dive {row}: the log {_verb(target)} with its pump at {pump:.0f} cm3, where "
            f"vehicle {vehicle.name!r} is {'light' if net < 0.0 else 'heavy'}: it is another "
            "vehicle, or not trimmed as the log's; identify it first (`twin identify`)"
        )
    return signed


def _verb(target: Target) -> str:
    return "dives" if target.leg.phase == "dive" else "climbs"


def _limited_pump(vehicle: Vehicle, position: float, row: int) -> float:
    """Logged pump position [cm3], limited to the travel of the vehicle's pump."""
    pump = vehicle.steered("buoyancy")
    assert pump is not None
    slack = PUMP_MARGIN * (pump.high - pump.low)
    if not pump.low - slack <= position <= pump.high + slack:
        raise InputError(
            f"dive {row}: the log's pump is at {position:.0f} cm3, that of vehicle "
            f"{vehicle.name!r} moves from {pump.low:g} to {pump.high:g}: give a vehicle file with "
            "the logged vehicle's pump"
        )
    return min(max(position, float(pump.low)), float(pump.high))
