"""Files that a Seaglider fetches when it calls: `targets`, `cmdfile` and `science`.

Lines that begin with a slash are comments. Commands, in `cmdfile`: a line for each parameter,
`$NAME,VALUE`, and at the end a directive: `$GO` goes on, `$RESUME` dives, `$QUIT` stays at the
surface. Names, types and limits of the parameters are those of the public package basestation3;
their meaning is in the Parameter Reference Manual, Applied Physics Laboratory, University of
Washington, v66.12:

    $D_TGT [m]         depth at which it turns
    $T_DIVE [min]      time of a dive with its climb: vertical speed 2 $D_TGT / $T_DIVE
    $T_MISSION [min]   time after which it gives a dive up
    $MAX_BUOY [g]      largest net mass in the dive
    $GLIDE_SLOPE [deg] steepest path through the water

Toward a distant target the vehicle glides as flat as its vertical speed and $MAX_BUOY allow.

Targets, in `targets`: a line for each place: its name, then `lat=` and `lon=` as DDMM.mmmm, north
and east positive, `radius=` [m] at which it is reached, and `goto=` the name of the next target
(Seaglider File Formats Manual, School of Oceanography and Applied Physics Laboratory, University of
Washington, v66.12).

Science, in `science`: a line for each layer of depth, from the surface down. It has the depth [m]
at which the layer ends, seconds between samples, a digit for each sensor (2: read at every second
sample; 0: off), and seconds between checks of pitch, roll and depth. Newer vehicles write the last
three as `seconds=`, `sensors=` and `gc=`; further keys of that form are kept. Both forms are those
of the public package basestation3.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from twin import Mission, Vehicle, Waypoint
from twin.bounded import read_text
from twin.errors import MissionError, unknown_name
from twin.mission import SteadyGlide, degrees, degrees_minutes, steady_glide, waypoints_of

TARGETS = "targets"
TARGET_KEYS = ("lat", "lon", "radius", "goto")
LEG_ENDS = ("escape", "depth", "finish", "timeout")
"""Keys for other ends of a leg, by depth, line or time, which a mission does not have"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SeagliderTarget:
    """Target of a Seaglider; latitude and longitude in degree."""

    name: str
    latitude: float
    longitude: float
    radius_m: float
    goto: str
    """Name of the next target; a last target names itself"""


def targets_of(mission: Mission) -> tuple[SeagliderTarget, ...]:
    """Targets T1, T2, ... of a mission to waypoints; the vehicle stays at the last.

    Raises:
      MissionError: another type of mission, or places that are relative to the start.
    """
    segment = waypoints_of(mission, "targets of a Seaglider")
    count = len(segment.targets)
    return tuple(
        SeagliderTarget(
            name=f"T{k}",
            latitude=target["latitude"],
            longitude=target["longitude"],
            radius_m=segment.arrival_radius_m,
            goto=f"T{min(k + 1, count)}",
        )
        for k, target in enumerate(segment.targets, start=1)
    )


def targets_text(targets: Sequence[SeagliderTarget]) -> str:
    """Text of the file `targets`."""
    return "".join(
        f"{one.name} lat={degrees_minutes(one.latitude)} lon={degrees_minutes(one.longitude)} "
        f"radius={one.radius_m:.0f} goto={one.goto}\n"
        for one in targets
    )


def _lines(path: str | Path, what: str) -> Iterator[tuple[str, str]]:
    """Yield location and text of each line of a file that is no comment."""
    lines = read_text(Path(path), what, MissionError).splitlines()
    for number, line in enumerate(lines, start=1):
        said = line.strip()
        if said and not said.startswith("/"):
            yield f"{Path(path).name} line {number}", said


def read_targets(path: str | Path) -> tuple[SeagliderTarget, ...]:
    """Read the places of a file, in its order.

    Raises:
      MissionError: the file cannot be read, a line lacks a key or has an unknown one, a place is no
        DDMM.mmmm, or `goto` names no target of the file.
    """
    name = Path(path).name
    found = tuple(_target(where, said) for where, said in _lines(path, TARGETS))
    if not found:
        raise MissionError(f"{name} has no target: a line is NAME lat= lon= radius= goto=")
    names = [one.name for one in found]
    for one in found:
        if one.goto not in names:
            raise MissionError(f"{name}: {one.name} goes to {one.goto}, which is not in it")
    return found


def _target(where: str, line: str) -> SeagliderTarget:
    name, *words = line.replace("= ", "=").split()
    values = dict(word.partition("=")[::2] for word in words)
    if odd := [key for key in values if key not in TARGET_KEYS]:
        why = ": no mission here has such an end of a leg; leave it out" * (odd[0] in LEG_ENDS)
        raise MissionError(f"{where}: {odd[0]!r} is not one of {', '.join(TARGET_KEYS)}{why}")
    for key in TARGET_KEYS:
        if not values.get(key):
            raise MissionError(f"{where}: {name} has no {key}=")
    try:
        radius = float(values["radius"])
    except ValueError:
        raise MissionError(f"{where}: radius={values['radius']} must be metres") from None
    latitude, longitude = (degrees(where, values[key]) for key in ("lat", "lon"))
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        raise MissionError(f"{where}: latitude {latitude:g}, longitude {longitude:g} is no place")
    return SeagliderTarget(
        name=name, latitude=latitude, longitude=longitude, radius_m=radius, goto=values["goto"]
    )


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
"""Limits of a dive's parameters in their units; limits of type int mean a whole number"""
LATER, TURN = 1.5, 10.0
"""$T_MISSION is LATER times $T_DIVE plus TURN [min], so that neither vertical water motion nor
pumping at depth aborts a dive"""
STEEPEST, FLATTEST = 59.0, 8.0
"""[degree] Steepest and flattest pitch at which a glide is sought"""
GRAMS, MINUTE = 1000.0, 60.0
_HALVINGS = 40


def commands_of(mission: Mission, vehicle: Vehicle) -> dict[str, float]:
    """Parameters of the dives of a mission to waypoints.

    Raises:
      MissionError: another type of mission, a climb that differs from the dive, a glide that the
        vehicle cannot hold, or a value beyond a Seaglider's limits.
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
        "T_MISSION": round(LATER * minutes + TURN),
        "MAX_BUOY": round(mass * GRAMS, 1),
        "GLIDE_SLOPE": float(math.ceil(_slope(glide, segment.pitch_deg))),
    }
    for name, value in found.items():
        _check("commands of a Seaglider", name, value)
    return found


def commands_text(commands: Mapping[str, float], directive: str = GO) -> str:
    """Text of the file `cmdfile`."""
    return "".join(f"${name},{value:g}\n" for name, value in commands.items()) + directive + "\n"


def read_commands(path: str | Path) -> dict[str, float]:
    """Read all parameters of a file, by their names; the directive is left out.

    Raises:
      MissionError: the file cannot be read or has no directive, a line is neither a parameter nor a
        directive, or a value is no number or beyond its limits.
    """
    found: dict[str, float] = {}
    directed = False
    for where, said in _lines(path, CMDFILE):
        if said in DIRECTIVES:
            directed = True
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
    if not directed:
        raise MissionError(f"{Path(path).name} has no directive: end it with {GO}")
    return found


def commanded(
    commands: Mapping[str, float], targets: Sequence[SeagliderTarget], vehicle: Vehicle
) -> Mission:
    """Mission of commands and targets, with one dive between two surfacings.

    Raises:
      MissionError: a parameter is missing, no such glide, or targets of different radii.
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
    radius, *others = sorted({one.radius_m for one in targets})
    if others:
        said = ", ".join(f"{one:g}" for one in (radius, *others))
        raise MissionError(f"targets have the radii {said}: a mission has one")
    segment = Waypoint(
        targets=tuple({"latitude": one.latitude, "longitude": one.longitude} for one in targets),
        max_depth_m=depth,
        pitch_deg=pitch,
        net_mass_kg=mass,
        surface_after_s=commands.get("T_MISSION", LATER * commands["T_DIVE"] + TURN) * MINUTE,
        surface_after_yos=1.0,
        arrival_radius_m=radius,
    )
    return Mission(name=CMDFILE, segments=(segment,))


def _slope(glide: SteadyGlide, pitch_deg: float) -> float:
    """[degree] Glide angle below the horizontal."""
    return pitch_deg + math.degrees(glide.angle_of_attack)


def _pitch(vehicle: Vehicle, mass: float, rate: float) -> float:
    """Pitch [degree], positive, at which the vehicle sinks at `rate` [m/s], or nearly so."""
    low, high = FLATTEST, STEEPEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        try:
            slow = steady_glide(vehicle, -math.radians(middle), mass).vertical_speed < rate
        except MissionError:
            slow = True  # too flat to glide
        low, high = (middle, high) if slow else (low, middle)
    return round(high, 2)


def _check(where: str, name: str, value: float) -> None:
    low, high = LIMITS.get(name, (-math.inf, math.inf))
    whole = isinstance(low, int) and value != round(value)
    if not (math.isfinite(value) and low <= value <= high) or whole:
        kind = "a whole number " if isinstance(low, int) else ""
        raise MissionError(f"{where}: ${name},{value:g} must be {kind}within {low:g} to {high:g}")


SCIENCE = "science"
SCIENCE_KEYS = ("seconds", "sensors", "gc")
LEAST_PART, MOST_PART = 0.05, 4.0
"""Samples in a file, relative to those before. LEAST_PART: smallest. MOST_PART: largest"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScienceLayer:
    """Sampling within one layer of depth."""

    depth: str
    """[m] Lower end, as the file writes it; or `loiter`"""
    seconds: float
    """[s] Time between samples"""
    sensors: str
    """Digit for each sensor: 2 is read at every second sample, 0 is off"""
    gc: str
    """[s] Time between checks by guidance and control"""
    more: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Further keys of newer vehicles"""
    named: bool = False
    """True where the file writes each value with its key"""


def read_science(path: str | Path) -> tuple[ScienceLayer, ...]:
    """Read the layers of a file, from the surface down.

    Raises:
      MissionError: the file cannot be read or holds no layer, or a line is no layer.
    """
    name = Path(path).name
    found = tuple(_layer(where, said.split()) for where, said in _lines(path, SCIENCE))
    if not found:
        raise MissionError(f"{name} has no layer: a line is DEPTH SECONDS SENSORS GC")
    depths = [float(one.depth) for one in found if one.depth != "loiter"]
    if depths != sorted(depths):
        raise MissionError(f"{name}: depths must grow from line to line")
    return found


def sparser(layers: Sequence[ScienceLayer], part: float) -> tuple[ScienceLayer, ...]:
    """Thin layers to a fraction of their samples; times are rounded to the second.

    Raises:
      MissionError: the fraction is beyond its limits.
    """
    if not LEAST_PART <= part <= MOST_PART:
        raise MissionError(
            f"{part:g} of the samples: take a part from {LEAST_PART:g} to {MOST_PART:g}"
        )
    return tuple(
        dataclasses.replace(one, seconds=max(round(one.seconds / part), 1)) for one in layers
    )


def science_text(layers: Sequence[ScienceLayer]) -> str:
    """Text of the file `science`."""
    text = ""
    for one in layers:
        values = {"seconds": f"{one.seconds:g}", "sensors": one.sensors, "gc": one.gc, **one.more}
        said = (f"{name}={value}" for name, value in values.items())
        text += " ".join([one.depth, *(said if one.named else values.values())]) + "\n"
    return text


def _layer(where: str, words: Sequence[str]) -> ScienceLayer:
    named = any("=" in word for word in words)
    if named:
        values = dict(word.partition("=")[::2] for word in words[1:])
    elif len(words) == len(SCIENCE_KEYS) + 1:
        values = dict(zip(SCIENCE_KEYS, words[1:], strict=True))
    else:
        raise MissionError(f"{where}: {' '.join(words)!r} is no DEPTH SECONDS SENSORS GC")
    for key in SCIENCE_KEYS:
        if not values.get(key):
            raise MissionError(f"{where}: {key}= is missing")
    numbers = {"depth": words[0]} if words[0] != "loiter" else {}
    for name, text in {"seconds": values["seconds"], "gc": values["gc"], **numbers}.items():
        try:
            value = float(text)
        except ValueError:
            value = -1.0
        if not 0.0 <= value < 1e5:
            raise MissionError(f"{where}: {name} {text!r} must be a number, 0 or above")
    if not values["sensors"].isdigit():
        raise MissionError(f"{where}: sensors {values['sensors']!r} must be a digit for each")
    more = {key: value for key, value in values.items() if key not in SCIENCE_KEYS}
    return ScienceLayer(
        depth=words[0], seconds=float(values["seconds"]), sensors=values["sensors"],
        gc=values["gc"], more=more, named=named,
    )  # fmt: skip
