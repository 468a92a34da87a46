"""Outcome: why a simulation ended, and its log as a trajectory."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.errors import SimulationUnstable
from twin.mission import Mission
from twin.mission.mission_file import ABORTED, DONE
from twin.numbers import Array
from twin.physics.model_block import header, table
from twin.physics.obstacles import has_contacts
from twin.physics.scenario import Scenario
from twin.physics.true_signals import from_log
from twin.records.coordinates import NOMINAL, START_LATITUDE, START_LONGITUDE, START_TIME
from twin.records.trajectory import Trajectory
from twin.water.current.axes import DEFAULT_TIME

HYDROGRAPHY = ("true_temperature", "true_salinity")
"""Signals of missions in water whose temperature and salinity are known"""
MAY_BE_NAN = ("pitch_setpoint", "heading_setpoint", "segment")
"""Fields of a log row that are NaN in a sound run, where a segment has no setpoint."""

SMALLER = 5
"""Times shorter is the step that an unstable run is advised to try"""


def trajectory_of(
    scenario: Scenario,
    model: mujoco.MjModel,
    rows: NDArray[Any],
    ours: Any,
    mission: int | None = None,
) -> Trajectory:
    """`trajectory` of a simulation in MuJoCo: `ours` is its record of `block.STATE`."""
    return trajectory(
        scenario,
        rows,
        ours,
        mission,
        timestep=model.opt.timestep,
        half_step=0.5 * float(header(model)["centred"]) * model.opt.timestep,
        floor=table(model, "floor"),
        contacts=has_contacts(model),
    )


def trajectory(
    scenario: Scenario,
    rows: NDArray[Any],
    ours: Any,
    mission: int | None = None,
    *,
    timestep: float,
    half_step: float,
    floor: Array,
    contacts: bool,
    lean: bool = False,
) -> Trajectory:
    """The log of a run as a trajectory.

    Args:
      scenario: what was flown.
      rows: records of `block.log_row`.
      ours: a record of `block.STATE`: whether and when it failed, and guidance's memory.
      timestep: [s]. half_step, floor, contacts, lean: see `true_signals.from_log`.
      mission: index that an error names beside the mission's name.

    Raises:
      SimulationUnstable: the run went unstable; `partial` holds the finite samples.
    """
    finite = np.ones(len(rows), bool)
    for name in rows.dtype.names or ():
        if name not in MAY_BE_NAN:
            values = np.isfinite(rows[name])
            finite &= values.all(axis=tuple(range(1, values.ndim)))
    failed = bool(ours["failed"]) or not finite.all()
    if failed:
        rows = rows[: int(np.argmin(finite))] if not finite.all() else rows
    duration = max(len(rows) - 1, 0) * scenario.sample_period
    found = from_log(
        rows,
        scenario.vehicle,
        half_step=half_step,
        sample_period=scenario.sample_period,
        floor=floor,
        contacts=contacts,
        lean=lean,
        complete=not failed,
        provenance={"ended": _ending(scenario, ours, failed), **_place(scenario, duration)},
    )
    if not lean:
        found.signals.update(_hydrography(scenario, found))
    if failed:
        time = float(ours["fail_time"])
        raise SimulationUnstable(
            f"{_label(scenario, mission)} went unstable at {time:.1f} s{_speed(found)} "
            f"(vehicle {scenario.vehicle.name!r}, hydrodynamics {scenario.hydrodynamics}, timestep "
            f"{timestep:g} s); try a smaller timestep, such as {timestep / SMALLER:g}, or check "
            "the parameters",
            mission=mission or 0,
            time_s=time,
            partial=found,
        )
    return found


def _speed(trajectory: Trajectory) -> str:
    """How fast it was at its last sound sample; empty without one."""
    if not len(trajectory.time):
        return ""
    parts = [trajectory[f"true_{name}"][-1] for name in ("surge", "sway", "heave")]
    return f", {math.hypot(*map(float, parts)):.2f} m/s through the water"


def _hydrography(scenario: Scenario, trajectory: Trajectory) -> dict[str, NDArray[Any]]:
    """Temperature [degree_Celsius] and salinity [1] at the vehicle, where something knows them.

    Those of the density profile, in which the vehicle flies, or else of the current's file.
    """
    depth = trajectory["true_depth"]
    water = None if scenario.density is None else scenario.density.temperature_salinity(depth)
    if water is None and scenario.current is not None:
        from twin.water.current.hydrography import along_track

        north, east = trajectory["true_north"], trajectory["true_east"]
        place = scenario.place
        water = along_track(scenario.current, trajectory.time, north, east, depth, place)
    return {} if water is None else dict(zip(HYDROGRAPHY, water, strict=True))


def _place(scenario: Scenario, duration: float) -> dict[str, float | str]:
    """Where and when the run began, and which of the two are defaults.

    A gridded current that says where its file is read says it for the run too.
    """
    place = usual = scenario.place
    if scenario.current is not None:
        place = scenario.current.begins(duration, usual)
    somewhere = scenario.has_place or replace(place, time=usual.time) != usual
    unsaid = [*(() if somewhere else ("place",)), *(("date",) if place.time is None else ())]
    return {
        START_LATITUDE: place.latitude_deg,
        START_LONGITUDE: place.longitude_deg,
        START_TIME: place.time or DEFAULT_TIME,
        **({NOMINAL: " and ".join(unsaid)} if unsaid else {}),
    }


def _ending(scenario: Scenario, ours: Any, failed: bool) -> str:
    """How a run ended: unstable, aborted, flown, or at its duration or time limit."""
    if failed:
        return "unstable"
    if not isinstance(scenario.mission, Mission):
        return "duration"
    if ours["guidance"][ABORTED]:
        return "aborted"
    if ours["guidance"][DONE]:
        return "flown"
    return "time limit" if scenario.open_ended else "duration"


def _label(scenario: Scenario, mission: int | None) -> str:
    """What an error calls a run: its mission's name, its index among others, or both."""
    plan = scenario.mission
    name = repr(plan.name) if isinstance(plan, Mission) else ""
    if mission is None:
        return f"mission {name}" if name else "the run"
    return f"mission {mission} ({name})" if name else f"mission {mission}"
