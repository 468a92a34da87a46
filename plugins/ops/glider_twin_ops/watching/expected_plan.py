"""Expected plan: the last fix, the mission expected next, its arrival at a waypoint, and its files.

`deployment.toml` names a mission file or places. Without either, the vehicle is expected to go to
the waypoint in its log, or else to keep the course of its last dive through the water. Depth, pitch
and time between surfacings are then those of its last dives.

The plan is proposed as files that a pilot may send; nothing is sent. The project's reader reads the
files back, and the twin flies the mission found in them. Files of the same names in the source,
which a dockserver or a base station keeps, are the files that the vehicle flies now.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from glider_twin_ops import files
from glider_twin_ops.forecast import Forecast, LoggedLeg, mission_to
from glider_twin_ops.forecast.logged_leg import place_at
from glider_twin_ops.watching.deployment_folder import WatchedDeployment
from glider_twin_ops.watching.dive_table import polar
from twin import Mission, Vehicle, Waypoint
from twin.errors import MissionError
from twin.geodesy import to_tangent_plane, wrap_longitude
from twin.mission import load_mission_for, read_slocum, slocum_arguments
from twin.numbers import Array
from twin.records import LogStore, unix_seconds
from twin.records.attributes import DIVE_DURATION
from twin.show.style import moment_of

LAST, STEEP = 5, 8.0
"""LAST: number of last dives whose median depth, pitch and duration the plan repeats. STEEP:
[degree] pitch above which a sample belongs to a glide"""
ON, RADIUS = 50_000.0, 500.0
"""[m] ON: distance of a guessed target, beyond any forecast. RADIUS: arrival radius of a
forecast"""
ARRIVED = 1_000.0
"""[m] Distance at which a logged waypoint counts as reached, so that the next one is unknown"""
HOUR, MINUTE, KILO = 3600.0, 60.0, 1e3
SECONDS = "%Y-%m-%dT%H:%M:%SZ"


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExpectedPlan:
    """Mission that a vehicle is expected to fly, and the reason for it."""

    mission: Mission
    words: str
    changes: tuple[Mapping[str, str], ...] = ()
    """Rows of a table: values of the last dives, and of the plan"""
    guessed: bool = False
    """True where no target is known: the ellipses hold only if the vehicle keeps its course"""


def expected_plan(
    deployment: WatchedDeployment, store: Path, vehicle: Vehicle, legs: Sequence[LoggedLeg]
) -> ExpectedPlan:
    """Make the plan from the last fix on.

    Args:
      legs: legs of the deployment, at least one.

    Raises:
      MissionError: the mission cannot be read, or the vehicle cannot fly it.
    """
    if deployment.mission:
        path = deployment.place(deployment.mission)
        mission = load_mission_for(vehicle, str(path) if path.is_file() else deployment.mission)
        return ExpectedPlan(mission=mission, words=f"mission {mission.name}")
    deep, pitch = _habits(store, legs, vehicle)
    depth = deployment.depth_m or float(round(deep))
    lasted = float(np.median([one.leg.duration for one in legs[-LAST:]]))
    seconds = HOUR * deployment.surface_every_h or MINUTE * round(lasted / MINUTE)
    goto, words, guessed = deployment.goto, "to the places of deployment.toml", False
    if not goto:
        goto, words, guessed = _onward(legs[-1])
    mission = mission_to(goto, depth=depth, pitch_deg=pitch, surface_after_s=seconds, radius=RADIUS)
    mission.check(vehicle)
    words += (
        f", dives to {depth:.0f} m at {pitch:.0f} degree, {seconds / HOUR:.1f} h between surfacings"
    )
    aims = legs[-1].targets
    aim = _place(np.array(aims[-1]), legs[-1].begin) if aims else "not in the log"
    table = (
        ("next place", aim, goto.partition(";")[0]),
        ("depth [m]", f"{deep:.0f}", f"{depth:.0f}"),
        ("pitch [degree]", f"{pitch:.0f}", f"{pitch:.0f}"),
        ("between surfacings [h]", f"{lasted / HOUR:.1f}", f"{seconds / HOUR:.1f}"),
    )
    rows = tuple(dict(zip(("what", "now", "proposed"), row, strict=True)) for row in table)
    return ExpectedPlan(mission=mission, words=words, guessed=guessed, changes=rows)


def _habits(store: Path, legs: Sequence[LoggedLeg], vehicle: Vehicle) -> tuple[float, float]:
    """Median depth [m] and pitch [degree] of the last dives; without pitch the vehicle's usual."""
    with LogStore(store) as logs:
        dives, pitches = (
            [logs.signal(f"measured_{name}", one.mission) for one in legs[-LAST:]]
            for name in ("depth", "pitch")
        )
    depths = [float(np.nanmax(one)) for one in dives if np.isfinite(one).any()]
    glides = (np.abs(one)[np.abs(one) > STEEP] for one in pitches)
    steep = [float(np.median(one)) for one in glides if len(one)]
    usual = math.degrees(vehicle.usual_glide[0])
    return float(np.median(depths)), float(round(np.median(steep))) if steep else usual


def _onward(last: LoggedLeg) -> tuple[str, str, bool]:
    """Target "LAT,LON" expected after the last dive, the reason in words, and True for a guess."""
    ground = np.array(last.leg.over_ground)
    targets = [np.array(target) for target in last.targets]
    ahead = [target for target in targets if np.hypot(*(target - ground)) > ARRIVED]
    if targets and ahead and ahead[-1] is targets[-1]:
        return _place(ahead[-1], last.begin), "to the waypoint of its last dive", False
    way = np.array(last.leg.through_water)
    length = float(np.hypot(*way))
    course = math.degrees(math.atan2(way[1], way[0])) % 360.0
    there = ground + ON * way / max(length, 1.0)
    words = f"on its last dive's course through the water, {round(course) % 360:03d} degree"
    return _place(there, last.begin), words, True


def _place(metres: Array, begin: tuple[float, float]) -> str:
    latitude, longitude = place_at(metres, begin)
    return f"{latitude:.5f},{float(wrap_longitude(np.asarray(longitude))):.5f}"


class LastFix(NamedTuple):
    """Newest known position [degree] and its time [s] unix."""

    latitude: float
    longitude: float
    time: float

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        return {
            "latitude": round(self.latitude, 6),
            "longitude": round(self.longitude, 6),
            "time": f"{moment_of(self.time):{SECONDS}}",
        }


def newest_fix(logs: LogStore, rows: Sequence[int]) -> LastFix | None:
    """Find the newest fix at the end of one of these dives; None without any."""
    for row in reversed(rows):
        latitude, longitude = logs.fixes(row)[1]
        end = float(logs.starts[row] + logs.number(DIVE_DURATION)[row])
        if math.isfinite(latitude) and math.isfinite(longitude) and math.isfinite(end):
            return LastFix(latitude=float(latitude), longitude=float(longitude), time=end)
    return None


class Arrival(NamedTuple):
    """Leg from the last fix to the next waypoint, and the time of arrival there."""

    latitude: float
    """[degree]"""
    longitude: float
    km: float
    """[km] Distance to the waypoint"""
    bearing: float
    """[degree] Bearing of the waypoint"""
    speed: float
    """[m/s] Speed made good towards the waypoint, median of the members"""
    early: float
    """[s] Unix time by which 5 of 100 members have arrived"""
    time: float
    """[s] Unix time by which half of the members have arrived; infinite: never"""
    late: float
    """[s] Unix time by which 95 of 100 members have arrived; infinite: never"""
    beyond: bool
    """True if `time` is after the forecast's end and was extrapolated at the speed made good"""

    def describe(self) -> dict[str, Any]:
        """Values for JSON; None for a time that never comes."""
        times = {
            name: None if math.isinf(at := getattr(self, name)) else f"{moment_of(at):{SECONDS}}"
            for name in ("early", "time", "late")
        }
        return {**self._asdict(), **times}


def arrival(found: Forecast) -> Arrival | None:
    """Arrival of a forecast's members at their first waypoint; None for a plan without one."""
    targets, place = found.targets(), found.request.place
    segments = [one for one in found.request.mission.segments if isinstance(one, Waypoint)]
    if not len(targets) or not segments:
        return None
    longitude, latitude = (float(value) for value in targets[0])
    start = place.latitude_deg, place.longitude_deg
    there = np.array(to_tangent_plane(latitude, longitude, *start))
    times, speeds = [], []
    for time, way in found.ways:
        off = np.hypot(*(there - way).T)
        left = np.maximum(off - segments[0].arrival_radius_m, 0.0)
        near = np.flatnonzero(left == 0.0)
        last = int(near[0]) if near.size else len(time) - 1
        speed = float(off[0] - off[last]) / max(float(time[last]), 1.0)
        speeds.append(speed)
        rest = float(left[last])
        further = rest / speed if speed > 0.0 else math.inf
        times.append(float(time[last]) + (further if rest else 0.0))
    metres, bearing = polar(*there.tolist())
    begin = unix_seconds(str(place.time))
    early, middle, late = np.quantile(times, (0.05, 0.5, 0.95), method="nearest").tolist()
    return Arrival(
        latitude=latitude,
        longitude=float(wrap_longitude(np.asarray(longitude))),
        km=metres / KILO,
        bearing=bearing,
        speed=float(np.median(speeds)),
        early=begin + early,
        time=begin + middle,
        late=begin + late,
        beyond=middle > found.request.horizon,
    )


NAMES = ("goto_l10.ma", "yo10.ma", "surfac10.ma", files.TARGETS, files.CMDFILE, files.SCIENCE)
"""Every name that a proposed file can have"""
SLOCUM, SEAGLIDER = "slocum", "seaglider"
WRITTEN = (SLOCUM, SEAGLIDER)
"""Types of logs for which files are proposed"""
UNWRITTEN = {
    "seaexplorer": "files of a SeaExplorer are not written: no public text says what its sea.msn "
    "holds, and its plans are made with its maker's program; set there what is said above",
    "": "files of {} vehicles are not written: set it as it is said above",
}
READS_BACK = "".join(
    f"behavior: {name}\n    b_arg: args_from_file(enum) 10\n"
    for name in ("surface", "goto_list", "yo")
)
"""Mission file that reads argument files of number 10"""
MOST_BYTES = 100_000
"""[byte] A larger file in the source is not compared with a proposed file"""


class ProposedFiles(NamedTuple):
    """Proposed files, and the mission that a reader finds in them."""

    files: Mapping[str, str]
    """Text of each file, by its name"""
    mission: Mission
    """Mission read back from the files, as the twin flies it"""
    changes: Mapping[str, str]
    """`diff -u` of each file that the source also has; empty if both are equal"""


def flown_files(folder: Path) -> dict[str, str]:
    """Read the files in a source that the vehicle flies now: texts by their names."""
    found = {}
    for name in NAMES:
        path = folder / name
        if path.is_file() and path.stat().st_size <= MOST_BYTES:
            found[name] = path.read_text(encoding="utf-8", errors="replace")
    return found


def proposed_files(
    kind: str,
    mission: Mission,
    vehicle: Vehicle,
    flown: Mapping[str, str],
    samples: float = 1.0,
) -> ProposedFiles:
    """Write a plan as files for the vehicle.

    Args:
      kind: type of the logs, such as slocum.
      flown: texts of files that are flown now, by their names.
      samples: fraction of the samples that a new science file keeps; 1: no new science file.

    Raises:
      MissionError: no files are written for this type, or they cannot express the mission.
    """
    if kind not in WRITTEN:
        raise MissionError(UNWRITTEN.get(kind, UNWRITTEN[""].format(kind)))
    if kind == SLOCUM:
        texts = slocum_arguments(mission)
    else:
        targets, commands = files.targets_of(mission), files.commands_of(mission, vehicle)
        texts = {
            files.TARGETS: files.targets_text(targets),
            files.CMDFILE: files.commands_text(commands),
        }
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        if samples != 1.0:
            texts[files.SCIENCE] = _science(kind, flown, samples, place)
        for file, text in texts.items():
            (place / file).write_text(text, encoding="utf-8")
        read = _read_back(kind, vehicle, place)
    changes = {}
    for name in (one for one in texts if one in flown):
        now, proposed = flown[name].splitlines(), texts[name].splitlines()
        told = f"{name}, flown now", f"{name}, proposed"
        lines = difflib.unified_diff(now, proposed, *told, lineterm="")
        changes[name] = "".join(f"{line}\n" for line in lines)
    return ProposedFiles(files=texts, mission=read, changes=changes)


def _science(kind: str, flown: Mapping[str, str], samples: float, place: Path) -> str:
    """Reduce the samples in the present science file to the fraction `samples`."""
    if kind != SEAGLIDER:
        raise MissionError(
            f"samples = {samples:g} in deployment.toml: a Seaglider alone has a science file that "
            f"is written, not a {kind}; set samples = 1"
        )
    if files.SCIENCE not in flown:
        raise MissionError(
            f"samples = {samples:g} in deployment.toml: the source has no file {files.SCIENCE} "
            "that says how it samples now; copy it there from the base station"
        )
    (place / files.SCIENCE).write_text(flown[files.SCIENCE], encoding="utf-8")
    return files.science_text(files.sparser(files.read_science(place / files.SCIENCE), samples))


def _read_back(kind: str, vehicle: Vehicle, place: Path) -> Mission:
    """Read the mission from the files of a folder with the project's own reader."""
    if kind == SEAGLIDER:
        if (place / files.SCIENCE).exists():
            files.read_science(place / files.SCIENCE)
        return files.commanded(
            files.read_commands(place / files.CMDFILE),
            files.read_targets(place / files.TARGETS),
            vehicle,
        )
    (place / "plan.mi").write_text(READS_BACK, encoding="utf-8")
    mission = read_slocum(place / "plan.mi", above_floor=True).mission
    segments = tuple(  # the twin's water is deeper than the dive
        dataclasses.replace(one, min_altitude_m=None) if isinstance(one, Waypoint) else one
        for one in mission.segments
    )
    return dataclasses.replace(mission, segments=segments)
