"""Slocum writer: a mission of waypoints as the argument files (.ma) that a Slocum reads at sea.

`goto_l10.ma` holds the targets, `yo10.ma` depths and pitches, `surfac10.ma` the surfacings. The
vehicle's mission file names them by number. `twin.mission.slocum_mission` reads them back. The
files do not set the surfacing at each target, nor pump volumes that the mission does not give: the
vehicle keeps its own settings of these.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from twin.errors import MissionError
from twin.mission.plan import Mission
from twin.mission.segments import Waypoint
from twin.mission.slocum_behavior import EVERY_SECS, IMMEDIATELY, PITCH_IDLE
from twin.mission.slocum_mission import ABSOLUTE, KG_PER_CM3, ONCE, SERVO, WPT_DIST

NUMBER = 10
"""Number of the files that the vehicle's own mission files refer to."""
MOST_NUMBER = 99
RESUMES, WAITS = 2, 1
"""end_action: go on (RESUMES), or wait for control-C and then go on (WAITS)."""
ENDLESS, OFF = -1, -1
"""ENDLESS: yos without end. OFF: altitude that turns no climb."""
ALTITUDE = 20.0
"""[m] Default height above the sea floor at which dives turn; without it, a glider would dive into
the floor where the chart is wrong."""
DECIMALS = 4
"""Number of decimals of a minute; the last one is 0.2 m."""


def slocum_arguments(mission: Mission, *, number: int = NUMBER) -> dict[str, str]:
    """Texts of the argument files, by file name.

    Args:
      mission: one segment of waypoints with geographic targets.
      number: number of the files, 0 to 99.

    Raises:
      MissionError: another type of mission, or targets in metres from the start.
    """
    if not 0 <= number <= MOST_NUMBER:
        raise MissionError(f"argument files have numbers from 0 to {MOST_NUMBER}, not {number}")
    segment = waypoints_of(mission, "argument files of a Slocum")
    return {
        f"goto_l{number:02d}.ma": _goto_text(segment),
        f"yo{number:02d}.ma": _yo_text(segment),
        f"surfac{number:02d}.ma": _surface_text(segment),
    }


def waypoints_of(mission: Mission, what: str) -> Waypoint:
    """Return the only segment of a mission, which must be waypoints with geographic targets.

    Raises:
      MissionError: the segment is of another type, or its targets are in metres from the start.
    """
    segment = mission.segments[0]
    if len(mission.segments) != 1 or not isinstance(segment, Waypoint):
        kinds = ", ".join(one.kind for one in mission.segments)
        raise MissionError(f"{what} have one segment of waypoints; this mission has: {kinds}")
    if any("latitude" not in target for target in segment.targets):
        raise MissionError(f"{what} need latitude and longitude of each place, not north and east")
    return segment


def degrees_minutes(degrees: float, *, decimals: int = DECIMALS) -> str:
    """Format a coordinate as DDMM.mmmm, such as -7032.0640: 70 degree 32.064 minutes west."""
    scale = 10**decimals
    count = round(abs(degrees) * 60 * scale)
    whole, part = divmod(count, 60 * scale)
    sign = "-" if degrees < 0.0 and count else ""
    return f"{sign}{whole * 100 + part / scale:.{decimals}f}"


def _goto_text(segment: Waypoint) -> str:
    places = [
        f"{degrees_minutes(target['longitude'])} {degrees_minutes(target['latitude'])}"
        for target in segment.targets
    ]
    return _file_text(
        "goto_list",
        {
            "num_legs_to_run(nodim)": ONCE,
            "start_when(enum)": IMMEDIATELY,
            "list_stop_when(enum)": WPT_DIST,
            "list_when_wpt_dist(m)": segment.arrival_radius_m,
            "initial_wpt(enum)": 0,
            "num_waypoints(nodim)": len(places),
        },
        places,
    )


def _yo_text(segment: Waypoint) -> str:
    climb = segment.pitch_deg if segment.climb_pitch_deg is None else segment.climb_pitch_deg
    arguments: dict[str, float] = {
        "start_when(enum)": PITCH_IDLE,
        "num_half_cycles_to_do(nodim)": ENDLESS,
        "end_action(enum)": RESUMES,
        "d_target_depth(m)": segment.max_depth_m,
        "d_target_altitude(m)": segment.min_altitude_m or ALTITUDE,
        "d_use_pitch(enum)": SERVO,
        "d_pitch_value(X)": -math.radians(segment.pitch_deg),
        "c_target_depth(m)": segment.min_depth_m,
        "c_target_altitude(m)": OFF,
        "c_use_pitch(enum)": SERVO,
        "c_pitch_value(X)": math.radians(climb),
    }
    light = segment.net_mass_kg if segment.climb_net_mass_kg is None else segment.climb_net_mass_kg
    for way, kilograms, sign in (("d", segment.net_mass_kg, -1.0), ("c", light, 1.0)):
        if kilograms is not None:
            arguments[f"{way}_use_bpump(enum)"] = ABSOLUTE
            arguments[f"{way}_bpump_value(X)"] = sign * kilograms / KG_PER_CM3
    return _file_text("yo", arguments)


def _surface_text(segment: Waypoint) -> str:
    if segment.surface_after_s is None or segment.surface_after_yos is not None:
        raise MissionError(
            "argument files of a Slocum have the time between surfacings: give surface_after_s, "
            "and leave surface_after_yos out"
        )
    climb = segment.pitch_deg if segment.climb_pitch_deg is None else segment.climb_pitch_deg
    return _file_text(
        "surface",
        {
            "start_when(enum)": EVERY_SECS,
            "when_secs(sec)": segment.surface_after_s,
            "end_action(enum)": WAITS,
            "keystroke_wait_time(sec)": segment.stay_s,
            "c_use_pitch(enum)": SERVO,
            "c_pitch_value(X)": math.radians(climb),
        },
    )


def _file_text(behavior: str, arguments: Mapping[str, float], places: Sequence[str] = ()) -> str:
    lines = [f"behavior_name={behavior}", "<start:b_arg>"]
    lines += [f"    b_arg: {name} {_number_text(value)}" for name, value in arguments.items()]
    lines.append("<end:b_arg>")
    if places:
        lines += ["<start:waypoints>", "# longitude latitude", *places, "<end:waypoints>"]
    return "\n".join(lines) + "\n"


def _number_text(value: float) -> str:
    return f"{value:.4f}".rstrip("0").rstrip(".")
