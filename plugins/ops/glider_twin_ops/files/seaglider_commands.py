"""Seaglider commands: the file `cmdfile` that a Seaglider fetches when it calls.

A line for each parameter, `$NAME,VALUE`, and at the end a directive: `$GO` goes on, `$RESUME`
dives, `$QUIT` stays at the surface; lines that begin with a slash are comments. Names, kinds and
limits of the parameters are those of the public package basestation3; what they ask is in the
Parameter Reference Manual, Applied Physics Laboratory, University of Washington, v66.12:

    $D_TGT [m]         depth at which it turns
    $T_DIVE [min]      time of a dive with its climb: vertical speed 2 $D_TGT / $T_DIVE
    $T_MISSION [min]   time after which it gives a dive up
    $MAX_BUOY [g]      heaviest that it may be in the dive
    $GLIDE_SLOPE [deg] steepest way through the water

To a place that is far it goes as flat as $MAX_BUOY lets it keep its vertical speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from glider_twin_ops.files.seaglider_targets import SeagliderTarget, radius_of
from twin import Vehicle
from twin.bounded import read_text
from twin.errors import MissionError, unknown_name
from twin.mission import Mission, SteadyGlide, steady_glide, waypoints_of
from twin.mission.segments import Waypoint

CMDFILE = "cmdfile"
GO = "$GO"
DIRECTIVES = (GO, "$RESUME", "$QUIT", "$EXIT_TO_MENU")
LIMITS: Mapping[str, tuple[float, float]] = {
    "D_TGT": (0.0, 1100.0),
    "T_DIVE": (5, 2880),
    "T_MISSION": (10, 43200),
    "MAX_BUOY": (-600.0, 600.0),
    "GLIDE_SLOPE": (-90.0, 90.0),
}
"""Of the parameters that say a dive, in their units; whole ones have whole limits"""
LATER, TURN = 1.5, 10.0
"""$T_MISSION over $T_DIVE, and [min] on top: neither water that rises or sinks nor the pump's time
below must end a dive"""
STEEPEST, FLATTEST = 59.0, 8.0
"""[degree] of pitch within which a glide is looked for"""
GRAMS, MINUTE = 1000.0, 60.0
_HALVINGS = 40


def commands_of(mission: Mission, vehicle: Vehicle) -> dict[str, float]:
    """The parameters of the dives of a mission to waypoints.

    Raises:
      MissionError: another kind of mission, a climb that differs from the dive, a glide that the
        vehicle has not, or a value that no Seaglider takes.
    """
    segment = waypoints_of(mission, "commands of a Seaglider")
    for name in ("pitch_deg", "net_mass_kg"):
        if getattr(segment, f"climb_{name}") not in (None, getattr(segment, name)):
            raise MissionError(
                f"commands of a Seaglider have no climb of their own: leave climb_{name} out"
            )
    mass = vehicle.usual_glide[1] if segment.net_mass_kg is None else segment.net_mass_kg
    glide = steady_glide(vehicle, -math.radians(segment.pitch_deg), mass)
    minutes = round(2.0 * segment.max_depth_m / glide.vertical_speed / MINUTE)
    found = {
        "D_TGT": round(segment.max_depth_m, 1),
        "T_DIVE": minutes,
        "T_MISSION": round(_given_up(minutes)),
        "MAX_BUOY": round(mass * GRAMS, 1),
        "GLIDE_SLOPE": float(math.ceil(_slope(glide, segment.pitch_deg))),
    }
    for name, value in found.items():
        _check("commands of a Seaglider", name, value)
    return found


def commands_text(commands: Mapping[str, float], directive: str = GO) -> str:
    """The text of the file."""
    return "".join(f"${name},{value:g}\n" for name, value in commands.items()) + directive + "\n"


def read_commands(path: str | Path) -> dict[str, float]:
    """The parameters of a file by their names, of every name; the directive is read, and left out.

    Raises:
      MissionError: it cannot be read, a line is neither a parameter nor a directive, a value is no
        number or beyond its limits, or there is no directive.
    """
    path = Path(path)
    found: dict[str, float] = {}
    directive = ""
    for number, line in enumerate(read_text(path, CMDFILE, MissionError).splitlines(), start=1):
        said, where = line.strip(), f"{path.name} line {number}"
        if not said or said.startswith("/"):
            continue
        if said in DIRECTIVES:
            directive = said
            continue
        name, comma, text = said.partition(",")
        if not (name.startswith("$") and comma):
            raise MissionError(f"{where}: {said!r} is no $NAME,VALUE and none of {DIRECTIVES}")
        try:
            value = float(text)
        except ValueError:
            raise MissionError(f"{where}: {name},{text} must be a number") from None
        _check(where, name[1:], value)
        found[name[1:]] = value
    if not directive:
        raise MissionError(f"{path.name} has no directive: end it with {GO}")
    return found


def commanded(
    commands: Mapping[str, float], targets: Sequence[SeagliderTarget], vehicle: Vehicle
) -> Mission:
    """The mission that commands and targets say: a dive from surfacing to surfacing.

    Raises:
      MissionError: a parameter of the dive is missing, or the vehicle has no such glide.
    """
    for name in ("D_TGT", "T_DIVE", "MAX_BUOY", "GLIDE_SLOPE"):
        if name not in commands:
            near = unknown_name("parameter", name, list(commands))
            raise MissionError(f"{CMDFILE} has no ${name}, which a dive needs: {near}")
    depth, mass = commands["D_TGT"], commands["MAX_BUOY"] / GRAMS
    pitch = _pitch(vehicle, mass, 2.0 * depth / (commands["T_DIVE"] * MINUTE))
    glide = steady_glide(vehicle, -math.radians(pitch), mass)
    if _slope(glide, pitch) > commands["GLIDE_SLOPE"] + 0.5:
        raise MissionError(
            f"{CMDFILE}: {depth:g} m in {commands['T_DIVE']:g} min at {commands['MAX_BUOY']:g} g "
            f"need a glide of {_slope(glide, pitch):.0f} degree, steeper than $GLIDE_SLOPE"
        )
    segment = Waypoint(
        targets=tuple({"latitude": one.latitude, "longitude": one.longitude} for one in targets),
        max_depth_m=depth,
        pitch_deg=pitch,
        net_mass_kg=mass,
        surface_after_s=commands.get("T_MISSION", _given_up(commands["T_DIVE"])) * MINUTE,
        surface_after_yos=1.0,
        arrival_radius_m=radius_of(targets),
    )
    return Mission(name=CMDFILE, segments=(segment,))


def _given_up(minutes: float) -> float:
    """[min] after which a dive of a $T_DIVE is given up."""
    return LATER * minutes + TURN


def _slope(glide: SteadyGlide, pitch_deg: float) -> float:
    """[degree] of the way through the water below the horizontal."""
    return pitch_deg + math.degrees(glide.angle_of_attack)


def _pitch(vehicle: Vehicle, mass: float, rate: float) -> float:
    """Pitch [degree], positive, at which the vehicle sinks so fast [m/s]; the nearest it has."""
    low, high = FLATTEST, STEEPEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        try:
            slow = steady_glide(vehicle, -math.radians(middle), mass).vertical_speed < rate
        except MissionError:
            slow = True  # flatter than it glides
        low, high = (middle, high) if slow else (low, middle)
    return round(high, 2)


def _check(where: str, name: str, value: float) -> None:
    low, high = LIMITS.get(name, (-math.inf, math.inf))
    whole = isinstance(low, int) and value != round(value)
    if not (math.isfinite(value) and low <= value <= high) or whole:
        kind = "a whole number " if isinstance(low, int) else ""
        raise MissionError(f"{where}: ${name},{value:g} must be {kind}within {low:g} to {high:g}")
