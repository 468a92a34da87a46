"""Outcome: how a simulation ended, its log as a trajectory, and remarks for the pilot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import SimulationUnstable
from twin.mission import Mission, Waypoint
from twin.mission.mission_file import ABORTED, DONE
from twin.numbers import Array
from twin.physics.model_block import tables_of
from twin.physics.mujoco_model import with_hydrodynamics
from twin.physics.scenario import Scenario
from twin.physics.stiffness import file_timestep, stiffness
from twin.physics.true_signals import from_log
from twin.records.coordinates import NOMINAL, START_LATITUDE, START_LONGITUDE, START_TIME
from twin.records.mission_dataset import UNDER_WATER_M, summarise
from twin.records.trajectory import Trajectory
from twin.vehicle.laws.flow_frame import is_flow_frame
from twin.water.current.axes import DEFAULT_TIME
from twin.water.current.grid import beyond_grid
from twin.water.floor.lookup import beyond_floor

HYDROGRAPHY = ("true_temperature", "true_salinity")
"""Signals of missions in water of known temperature and salinity."""
MAY_BE_NAN = ("pitch_setpoint", "heading_setpoint", "segment")
"""Fields of a log row that are NaN in a sound run while a segment has no setpoint."""
LONG_STALL = 600.0
"""[s] A longer stall is a glide; at an inflection a glider stalls for a minute."""
Beyond = Callable[[Array, Array, Array], NDArray[np.bool_]]
SMALLER = 5
"""[1] Factor by which an error message shortens the step of an unstable run."""


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
    """Turn the log of a run into a trajectory.

    Args:
      scenario: the flown scenario.
      rows: records of `block.log_row`.
      ours: a record of `block.STATE` with guidance's memory; tells whether and when the run failed.
      timestep: [s]. half_step, floor, contacts, lean: see `true_signals.from_log`.
      mission: index that errors give next to the mission's name.

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
        rows, scenario.vehicle, half_step=half_step, sample_period=scenario.sample_period,
        floor=floor, contacts=contacts, lean=lean, complete=not failed,
        provenance={"ended": _ending(scenario, ours, failed), **_place(scenario, duration)},
    )  # fmt: skip
    if not lean:
        found.signals.update(_hydrography(scenario, found))
    if failed:
        time = float(ours["fail_time"])
        raise SimulationUnstable(
            f"{_label(scenario, mission)} went unstable at {time:.1f} s{_last_speed(found)} "
            f"(vehicle {scenario.vehicle.name!r}, hydrodynamics {scenario.hydrodynamics}, timestep "
            f"{timestep:g} s); try a smaller timestep, such as {timestep / SMALLER:g}, or check "
            "the parameters",
            mission=mission or 0,
            time_s=time,
            partial=found,
        )
    return found


def _last_speed(trajectory: Trajectory) -> str:
    """Speed through the water at the last finite sample, as words; empty without a sample."""
    if not len(trajectory.time):
        return ""
    parts = [trajectory[f"true_{name}"][-1] for name in ("surge", "sway", "heave")]
    return f", {math.hypot(*map(float, parts)):.2f} m/s through the water"


def _hydrography(scenario: Scenario, trajectory: Trajectory) -> dict[str, NDArray[Any]]:
    """Temperature [degree_Celsius] and salinity [1] at the vehicle; empty if unknown.

    Source is the density profile, else the file of the current.
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
    """Place and time at which the run began, with a note of those that are defaults.

    A gridded current that knows the place and time of its file sets them for the run.
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
    """Ending of a run in a word: unstable, aborted, flown, duration or time limit."""
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
    """Name of a run in errors: its mission's name, its index among others, or both."""
    plan = scenario.mission
    name = repr(plan.name) if isinstance(plan, Mission) else ""
    if mission is None:
        return f"mission {name}" if name else "the run"
    return f"mission {mission} ({name})" if name else f"mission {mission}"


def remarks(scenario: Scenario, run: Trajectory) -> list[str]:
    """Remarks, one sentence for each departure of the run from the mission.

    Args:
      scenario: the flown scenario.
      run: its trajectory.
    """
    stronger, tables = _current_remark(scenario, run), tables_of(scenario, scenario.run_time())
    found = [
        _ending_remark(run, stronger),
        stronger if run.provenance.get("ended") != "time limit" else "",
        _target_remark(scenario, run),
        _contact_remark(run),
        _stall_remark(scenario, run),
        _step_remark(scenario, run),
        _area_remark(run, tables.floor, beyond_floor, "bathymetry", "depth"),
        _area_remark(run, tables.current, beyond_grid, "current file", "velocity"),
    ]
    return [text for text in found if text]


def _ending_remark(run: Trajectory, stronger: str) -> str:
    """Remark why a mission was not flown to its end; empty if it was."""
    ended = run.provenance.get("ended")
    if ended == "aborted":
        depth = run["true_depth"]
        reason = "it went deeper than max_depth_m" + (
            " and climbed to the surface"
            if depth[-1] < 0.5 * depth.max()
            else ", and its climb to the surface failed: it is too heavy"
        )
    elif ended == "time limit":
        reason = stronger or (
            "its segments took more than a generous estimate of their time "
            "(too light or too heavy for this water, or a depth it cannot reach?)"
        )
    else:
        return ""
    return f"the mission was not flown to its end: {reason}"


def _current_remark(scenario: Scenario, run: Trajectory) -> str:
    """Remark that the current exceeded the speed of a vehicle with waypoints; else empty."""
    plan = scenario.mission
    if not any(isinstance(one, Waypoint) for one in getattr(plan, "segments", ())):
        return ""
    figures = summarise(run)
    flow = math.hypot(figures["mean_current_north_m_s"], figures["mean_current_east_m_s"])
    speed = figures["mean_speed_m_s"]
    if flow <= speed:
        return ""
    return (
        f"the current of {flow:.2f} m/s is stronger than the vehicle, which makes {speed:.2f} m/s "
        "through the water: it reaches places downstream only"
    )


def _target_remark(scenario: Scenario, run: Trajectory) -> str:
    """Remark that a run ended short of a waypoint, with the distance left; else empty."""
    if not isinstance(scenario.mission, Mission):
        return ""
    flown = [one for part in scenario.mission_in_metres().segments for one in part.flown_as()]
    at = int(run["commanded_segment"][-1])
    if at >= len(flown) or not isinstance(one := flown[at], Waypoint):
        return ""
    target = one.targets[0]
    north, east = (target[f"{n}_m"] - float(run[f"true_{n}"][-1]) for n in ("north", "east"))
    many = sum(isinstance(part, Waypoint) for part in flown)
    number = 1 + sum(isinstance(part, Waypoint) for part in flown[:at])
    return (
        f"the run ended {math.hypot(north, east) / 1e3:.2f} km short of target {number} of {many}, "
        f"at {run.time[-1]:.0f} s"
    )


def _contact_remark(run: Trajectory) -> str:
    """Remark when the vehicle first touched floor or obstacle; empty if never."""
    figures = summarise(run)
    if not figures.get("grounded"):
        return ""
    return (
        f"the vehicle touched the sea floor or an obstacle at {figures['first_contact_s']:.0f} s; "
        "min_altitude_m in the mission makes dives turn above the sea floor"
    )


def _stall_remark(scenario: Scenario, run: Trajectory) -> str:
    """Remark that a glider fell with stalled wings; empty if never, or if it touched ground."""
    law, (surge, _, heave) = scenario.vehicle.law, run.v_rel.T
    if not is_flow_frame(law) or summarise(run).get("grounded"):
        return ""
    attack = np.abs(np.arctan2(heave, surge))
    stalled = (attack > law.blend_angle) & (run["true_depth"] > UNDER_WATER_M)
    width = round(LONG_STALL / scenario.sample_period) | 1
    if 2 * np.count_nonzero(stalled) < width:  # the filters mirror a run's ends
        return ""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    if not (stalled := maximum_filter1d(minimum_filter1d(stalled, width), width)).any():
        return ""
    return (
        f"the vehicle fell with stalled wings, an angle of attack of "
        f"{np.degrees(np.median(attack[stalled])):.0f} deg, for {stalled.mean():.0%} of the run, "
        f"first at {run.time[stalled][0]:.0f} s: a steeper pitch or a larger net mass glides"
    )


def _step_remark(scenario: Scenario, run: Trajectory) -> str:
    """Remark when the speed first made the time step too long; empty if never."""
    if not scenario.centred:
        return ""
    vehicle = with_hydrodynamics(scenario.vehicle, scenario.hydrodynamics)
    step = file_timestep(vehicle) if scenario.timestep is None else scenario.timestep
    speed = np.linalg.norm(run.v_rel, axis=1)
    fastest = stiffness(vehicle, float(speed.max()))
    if not fastest.too_long(step):
        return ""
    slower = speed.max() * fastest.longest / step  # the extrapolated terms grow with speed
    return f"from {run.time[np.argmax(speed > slower)]:.0f} s on the {fastest.too_long(step)}"


def _area_remark(run: Trajectory, table: Array, beyond: Beyond, file: str, held: str) -> str:
    """Remark when the vehicle left the area of a water file; empty if never.

    Args:
      table: compiled from the file; empty without a file.
      beyond: tells the samples of a track outside the table.
      held: name of the quantity that keeps its value at the edge.
    """
    if not table.size:
        return ""
    outside = beyond(table, run["true_north"], run["true_east"])
    if not outside.any():
        return ""
    return (
        f"the vehicle left the {file}'s area at {run.time[outside][0]:.0f} s; "
        f"from there on the {held} at its edge was used"
    )
