"""Slocum mission: a Slocum mission file read as waypoints, with notes on what is left out.

Arguments of a behavior may be in argument files (.ma), which replace the mission file's own.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin.errors import MissionError
from twin.mission.plan import OVERSHOOT_MARGIN_M, Mission
from twin.mission.segments import Segment, Surface, Waypoint
from twin.mission.segments.profile import SHALLOWEST_M
from twin.mission.slocum_behavior import Behavior, Parsed, Surfacings, degrees, parse, surfacings
from twin.vehicle.vehicle import Vehicle

STEM = 6
"""Length to which a behavior's name is cut in its file names, which have eight letters."""
FOLDERS = (".", "mafiles", "../mafiles", "../Mafiles", "../MAFILES")
"""Folders in which argument files are searched, relative to the mission file's folder."""


def with_arguments(path: Path) -> Parsed:
    """Read the behaviors of a mission file; arguments of a .ma file override the mission's own.

    Raises:
      MissionError: as `parse`; or a named file is missing or belongs to another behavior.
    """
    mission = parse(path)
    for behavior in mission.behaviors:
        number = behavior.arguments.pop("args_from_file", -1.0)
        if number < 0.0:
            continue
        name = f"{behavior.name[:STEM]}{int(number):02d}.ma"
        if behavior.name.startswith("sensors_"):
            continue  # switches without effect on the motion
        found = _find(path.parent, name)
        if found is None:
            if behavior.name == "sample":
                continue  # no effect on the motion; `_limit_of_depth` adds the note
            raise MissionError(
                f"{behavior.label}: its arguments are in {name}, which is neither in {path.parent} "
                "nor in a folder mafiles there or beside it"
            )
        file = parse(found)
        _merge_arguments(behavior, file, found.name)
        mission.notes += file.notes
    return mission


def _merge_arguments(behavior: Behavior, file: Parsed, name: str) -> None:
    own = file.behaviors[0]
    if own.name != behavior.name:
        raise MissionError(
            f"{name} is for the behavior {own.name}, and {behavior.label} names it: give it "
            f"behavior_name={behavior.name}"
        )
    behavior.arguments.update(own.arguments)
    behavior.lines.update(own.lines)
    behavior.places = own.places or behavior.places
    behavior.file = name


def _find(folder: Path, name: str) -> Path | None:
    """Find a file by its name regardless of case, as DOS does."""
    for place in FOLDERS:
        try:
            candidates = sorted((folder / place).iterdir())
        except OSError:
            continue
        for candidate in candidates:
            if candidate.name.lower() == name.lower() and candidate.is_file():
                return candidate
    return None


MOVES_NOTHING = ("sample", "prepare_to_dive", "sensors_in", "sensors_out", "nop_cmds")
"""Behaviors without an effect on the motion."""
SERVO, BATTERY_POSITION = 3.0, 1.0
"""use_pitch: hold a pitch (SERVO), or a position of the battery (BATTERY_POSITION)."""
AUTOBALLAST, ABSOLUTE = 0.0, 2.0
"""use_bpump: dive and climb take half of the volume each (AUTOBALLAST), or all of it (ABSOLUTE)."""
USUAL_PITCH_DEG = 26.0
"""[degree] Pitch of a dive or climb whose file gives no pitch."""
KG_PER_CM3 = 1.025e-3
"""[kg/cm3] Density of sea water."""
WPT_DIST = 7.0
"""Value of list_stop_when: the waypoint is reached within list_when_wpt_dist."""
USUAL_RADIUS_M = 10.0
FOREVER, ONCE = -1.0, -2.0
"""num_legs_to_run: legs without end (FOREVER), or once through the list (ONCE)."""
MOST_LEGS = 1000
LAST_ACHIEVED, CLOSEST = -1.0, -2.0
"""initial_wpt: the waypoint after the last achieved one, or the closest one (CLOSEST)."""
LAT_LONG = 2.0
"""Value of wpt_units: longitude and latitude."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SlocumReading:
    """A mission, and a note for everything in its files that is left out or flown differently."""

    mission: Mission
    notes: tuple[str, ...]


def read_slocum(
    path: str | Path, vehicle: Vehicle | None = None, *, above_floor: bool = False
) -> SlocumReading:
    """Read the mission of a Slocum mission file (.mi) and of the .ma files that it names.

    Args:
      path: path of the .mi; .ma files are beside it, or in a folder mafiles there or one level up.
      vehicle: vehicle whose pump limits the volumes, as on a glider; None: volumes are not limited.
      above_floor: use the altitudes at which dives turn; a run then needs a sea floor.

    Raises:
      MissionError: a file is unreadable, a value is not a number, or goto_list or yo is missing.
    """
    path = Path(path)
    if path.suffix.lower() == ".ma":
        raise MissionError(
            f"{path.name} has the arguments of one behavior: give the mission file (.mi) that "
            "names it, beside it or in the folder above"
        )
    parsed = with_arguments(path)
    notes = parsed.notes
    goto, yo = (_first(path.name, parsed.behaviors, name, notes) for name in ("goto_list", "yo"))
    surface = surfacings([b for b in parsed.behaviors if b.name == "surface"], notes)
    settings = _yo_settings(yo, notes, vehicle, above_floor)
    half_cycles = yo.arguments.get("num_half_cycles_to_do", -1.0)
    if half_cycles > 0.0 and surface.when_yo_ends:
        settings["surface_after_yos"] = max(1.0, math.ceil(half_cycles / 2.0))
        if half_cycles % 2.0:
            notes.append(f"{yo.label}: num_half_cycles_to_do {half_cycles:g} is flown as even")
    elif half_cycles > 0.0:
        notes.append(f"{yo.label}: no surface behavior starts when it ends: it is flown on")
    settings |= _surface_settings(surface, settings, notes)
    settings["current"] = _current_setting(parsed.sensors, notes)
    segments: list[Segment] = [Waypoint(**_targets(goto, notes), **settings)]
    if surface.first:
        segments.insert(0, Surface(duration_s=surface.stay_s))
    mission: dict[str, Any] = {"name": path.stem, "segments": tuple(segments)}
    if surface.pitch_deg is not None:
        mission["ascent_pitch_deg"] = surface.pitch_deg
    mission |= _limit_of_depth(parsed.behaviors, settings["max_depth_m"], notes)
    try:
        return SlocumReading(mission=Mission(**mission), notes=tuple(notes))
    except MissionError as error:
        raise MissionError(f"{path.name}: {error}") from None


def _first(file: str, behaviors: list[Behavior], name: str, notes: list[str]) -> Behavior:
    """Find the first behavior of that name, and note the others as left out."""
    found = [behavior for behavior in behaviors if behavior.name == name]
    if not found:
        names = ", ".join(sorted({behavior.name for behavior in behaviors}))
        raise MissionError(f"{file} has no behavior {name}: it goes nowhere (it has {names})")
    for other in found[1:]:
        notes.append(f"{other.label}: a second {name} is left out")
    return found[0]


def _yo_settings(
    yo: Behavior, notes: list[str], vehicle: Vehicle | None, above_floor: bool
) -> dict[str, Any]:
    """Settings of depths, pitches and buoyancy from a yo behavior."""
    arguments = dict(yo.arguments)
    for name in ("start_when", "end_action", "num_half_cycles_to_do"):
        arguments.pop(name, None)
    depth = arguments.pop("d_target_depth", None)
    if depth is None:
        raise MissionError(f"{yo.label}: d_target_depth is missing: how deep do dives go?")
    top = arguments.pop("c_target_depth", None)
    settings: dict[str, Any] = {"max_depth_m": depth}
    if top is not None:
        settings["min_depth_m"] = max(top, SHALLOWEST_M)
        if top < SHALLOWEST_M:
            notes.append(f"{yo.label}: c_target_depth {top:g} m is flown as {SHALLOWEST_M:g} m")
    altitude = arguments.pop("d_target_altitude", -1.0)
    if altitude > 0.0 and above_floor:
        settings["min_altitude_m"] = altitude
    elif altitude > 0.0:
        notes.append(
            f"{yo.label}: d_target_altitude {altitude:g} m needs a sea floor (`twin simulate "
            "--floor`): dives turn at their depth only"
        )
    if arguments.pop("c_target_altitude", -1.0) > 0.0:
        notes.append(f"{yo.label}: c_target_altitude is left out: climbs turn at their depth")
    for way, prefix, sign in (("d", "", 1.0), ("c", "climb_", -1.0)):
        use, value = (
            arguments.pop(f"{way}_use_pitch", SERVO),
            arguments.pop(f"{way}_pitch_value", None),
        )
        pitch = USUAL_PITCH_DEG
        if value is not None and use != BATTERY_POSITION:
            pitch = yo.pitch_deg(f"{way}_pitch_value")
        elif value is not None:
            notes.append(
                f"{yo.label}: {way}_use_pitch 1 gives a place of the battery: "
                f"{USUAL_PITCH_DEG:g} degree are flown"
            )
        settings[f"{prefix}pitch_deg"] = round(pitch, 6)
        settings |= _buoyancy(yo, way, prefix, sign, arguments, notes, vehicle)
    for name in sorted(arguments):
        notes.append(f"{yo.label}: {name} = {arguments[name]:g} is left out")
    return settings


def _buoyancy(
    yo: Behavior,
    way: str,
    prefix: str,
    sign: float,
    arguments: dict[str, float],
    notes: list[str],
    vehicle: Vehicle | None,
) -> dict[str, float]:
    """Net mass of a dive or climb from its pump volume; empty for the vehicle's usual one."""
    mode = arguments.pop(f"{way}_bpump_mode", ABSOLUTE)  # name of use_bpump in some versions
    use = arguments.pop(f"{way}_use_bpump", mode)
    value = arguments.pop(f"{way}_bpump_value", None)
    if value is None:
        return {}
    if use not in (AUTOBALLAST, ABSOLUTE):
        notes.append(
            f"{yo.label}: {way}_use_bpump {use:g} is left out: the usual net mass is flown"
        )
        return {}
    kilograms = abs(value) * KG_PER_CM3 * (0.5 if use == AUTOBALLAST else 1.0)
    pump = None if vehicle is None else vehicle.steered("buoyancy")
    if vehicle is not None and pump is not None:
        end = float(pump.low if sign > 0.0 else pump.high)
        most = abs(vehicle.net_mass_for_pump(end))
        if kilograms > most:
            notes.append(
                f"{yo.label}: {way}_bpump_value {value:g} cm3 is clipped to the "
                f"{most / KG_PER_CM3:.0f} of vehicle {vehicle.name!r}"
            )
        kilograms = min(kilograms, most)
    return {f"{prefix}net_mass_kg": kilograms} if kilograms > 0.0 else {}


def _surface_settings(
    surface: Surfacings, settings: Mapping[str, Any], notes: list[str]
) -> dict[str, Any]:
    climb = settings["climb_pitch_deg"]
    if surface.pitch_deg is not None and abs(surface.pitch_deg - climb) > 0.05:
        notes.append(
            f"surface: between targets it comes up at the yo's {climb:.1f} degree, not at its own "
            f"{surface.pitch_deg:.1f}"
        )
    return {
        "surface_after_s": surface.after_s,
        "surface_at_target": surface.at_target,
        "stay_s": surface.stay_s,
    }


def _current_setting(sensors: Mapping[str, float], notes: list[str]) -> str:
    used = sensors.get("u_use_current_correction", 1.0)
    for name in sorted(set(sensors) - {"u_use_current_correction"}):
        notes.append(f"sensor {name} = {sensors[name]:g} is left out")
    return "estimated" if used > 0.0 else "none"


def _targets(goto: Behavior, notes: list[str]) -> dict[str, Any]:
    """Targets of a goto_list in order, and their arrival radius."""
    arguments = dict(goto.arguments)
    arguments.pop("start_when", None)
    places = list(goto.places)
    declared = arguments.pop("num_waypoints", None)
    index = 0
    while f"wpt_x_{index}" in arguments or f"wpt_y_{index}" in arguments:
        x, y = (arguments.pop(f"wpt_{axis}_{index}", 0.0) for axis in "xy")
        if arguments.pop(f"wpt_units_{index}", LAT_LONG) != LAT_LONG:
            raise MissionError(f"{goto.label}: wpt_units_{index} must be 2, longitude and latitude")
        places.append((degrees(goto.label, y), degrees(goto.label, x)))
        index += 1
    if not places:
        raise MissionError(f"{goto.label}: it has no waypoints (<start:waypoints>)")
    if declared is not None and declared != len(places):
        notes.append(
            f"{goto.label}: num_waypoints is {declared:g}, and {len(places)} are given: all are "
            "flown"
        )
    first = arguments.pop("initial_wpt", 0.0)
    if first in (LAST_ACHIEVED, CLOSEST):
        which = "the one after the last achieved" if first == LAST_ACHIEVED else "the closest"
        notes.append(f"{goto.label}: initial_wpt {first:g}, {which}: the list begins at its first")
        first = 0.0
    if not 0.0 <= first < len(places):
        raise MissionError(f"{goto.label}: initial_wpt {first:g} of {len(places)} waypoints")
    legs = arguments.pop("num_legs_to_run", ONCE)
    round_trip = [*places[int(first) :], *places[: int(first)]]
    if legs == FOREVER:
        notes.append(f"{goto.label}: num_legs_to_run -1 is for ever: the list is flown once")
    elif legs == ONCE:
        round_trip = places[int(first) :]
    elif 0.0 < legs <= MOST_LEGS:
        turns = math.ceil(legs / len(round_trip))
        round_trip = (round_trip * turns)[: int(legs)]
    else:
        raise MissionError(
            f"{goto.label}: num_legs_to_run {legs:g}: give -2, -1 or a number up to {MOST_LEGS}"
        )
    stop, radius = arguments.pop("list_stop_when", WPT_DIST), USUAL_RADIUS_M
    if stop != WPT_DIST:
        notes.append(f"{goto.label}: list_stop_when {stop:g} is flown as 7, by distance")
    radius = arguments.pop("list_when_wpt_dist", radius)
    for name in sorted(arguments):
        notes.append(f"{goto.label}: {name} = {arguments[name]:g} is left out")
    targets = tuple({"latitude": lat, "longitude": lon} for lat, lon in round_trip)
    return {"targets": targets, "arrival_radius_m": radius}


def _limit_of_depth(behaviors: list[Behavior], deepest: float, notes: list[str]) -> dict[str, Any]:
    """Depth limit from abend behaviors; adds notes on the behaviors that are not flown."""
    fields: dict[str, Any] = {}
    for behavior in behaviors:
        if behavior.name == "abend":
            arguments = dict(behavior.arguments)
            over = arguments.pop("overdepth", -1.0)
            if over >= deepest + OVERSHOOT_MARGIN_M:
                fields["max_depth_m"] = over
            elif over >= 0.0:
                notes.append(
                    f"{behavior.label}: overdepth {over:g} m is left out: the yo's {deepest:g} m "
                    f"and an overshoot of {OVERSHOOT_MARGIN_M:g} m would abort"
                )
            for name, value in sorted(arguments.items()):
                if value >= 0.0:
                    notes.append(f"{behavior.label}: {name} = {value:g} never aborts here")
        elif behavior.name in MOVES_NOTHING:
            notes.append(f"{behavior.label}: no effect on the motion")
        elif behavior.name not in ("goto_list", "yo", "surface"):
            notes.append(f"{behavior.label}: this behavior is not flown")
    return fields
