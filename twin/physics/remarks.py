"""Remarks: what a pilot must know of a run beside its figures, such as why it ended early."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twin.mission import Mission, Waypoint
from twin.numbers import Array
from twin.physics.lookup_tables import tables_of
from twin.physics.mujoco_model import with_hydrodynamics
from twin.physics.scenario import Scenario
from twin.physics.stiffness import file_timestep, stiffness
from twin.records.mission_dataset import summarise
from twin.records.trajectory import Trajectory
from twin.water.current.grid import beyond_grid
from twin.water.floor.lookup import beyond_floor

Beyond = Callable[[Array, Array, Array], NDArray[np.bool_]]


def remarks(scenario: Scenario, run: Trajectory) -> list[str]:
    """One sentence for each thing that went otherwise than the mission wanted.

    Args:
      scenario: that was flown.
      run: what came of it.
    """
    stronger, tables = _stronger_current(scenario, run), tables_of(scenario, scenario.run_time())
    found = [
        _unfinished(run, stronger),
        stronger if run.provenance.get("ended") != "time limit" else "",
        _short_of_target(scenario, run),
        _touched(run),
        _step_too_long(scenario, run),
        _left_file(run, tables.floor, beyond_floor, "bathymetry", "depth"),
        _left_file(run, tables.current, beyond_grid, "current file", "velocity"),
    ]
    return [text for text in found if text]


def _unfinished(run: Trajectory, stronger: str) -> str:
    """Why a mission was not flown to its end; empty where it was."""
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


def _stronger_current(scenario: Scenario, run: Trajectory) -> str:
    """Remark that a current exceeded the speed of a vehicle that goes to places; else empty."""
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


def _short_of_target(scenario: Scenario, run: Trajectory) -> str:
    """That a run ended on the way to a place, and how far from it; empty where it did not."""
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


def _touched(run: Trajectory) -> str:
    """When the vehicle first touched something; empty where it did not."""
    figures = summarise(run)
    if not figures.get("grounded"):
        return ""
    return (
        f"the vehicle touched the sea floor or an obstacle at {figures['first_contact_s']:.0f} s; "
        "min_altitude_m in the mission makes dives turn above the sea floor"
    )


def _step_too_long(scenario: Scenario, run: Trajectory) -> str:
    """When it first went so fast that its step was too long; empty where it did not."""
    if not scenario.centred:
        return ""
    vehicle = with_hydrodynamics(scenario.vehicle, scenario.hydrodynamics)
    step = file_timestep(vehicle) if scenario.timestep is None else scenario.timestep
    speed = np.linalg.norm(run.v_rel, axis=1)
    fastest = stiffness(vehicle, float(speed.max()))
    if not fastest.too_long(step):
        return ""
    slower = speed.max() * fastest.longest / step  # what is extrapolated grows with the speed
    return f"from {run.time[np.argmax(speed > slower)]:.0f} s on the {fastest.too_long(step)}"


def _left_file(run: Trajectory, table: Array, beyond: Beyond, file: str, held: str) -> str:
    """When the vehicle left the area of a file of the water; empty where it did not.

    Args:
      table: compiled from the file, empty without one.
      beyond: which samples of a track are outside of it.
      held: what the water keeps of the file's edge there.
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
