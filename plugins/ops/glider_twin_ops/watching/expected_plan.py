"""Expected plan: where a vehicle was last, and what it is taken to do next.

It goes by `deployment.toml`: a mission file, or places. Else to the waypoint that its log has, and
without one on along its last dive's way through the water. Depth, pitch and time between surfacings
are those of its last dives.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.forecast import LoggedLeg, mission_to, place_at
from glider_twin_ops.watching.deployment_folder import WatchedDeployment
from twin import Vehicle
from twin.geodesy import wrap_longitude
from twin.mission import Mission, load_mission_for
from twin.numbers import Array
from twin.records import LogStore
from twin.records.attributes import DIVE_DURATION
from twin.show.style import moment_of

LAST = 5
"""Dives whose median depth, pitch and time it goes on with"""
ON = 50_000.0
"""[m] ahead: farther than a glider goes within a forecast"""
ARRIVED = 1_000.0
"""[m] within which a waypoint of the log counts as reached, so that the next one is not known"""
RADIUS = 500.0
"""[m] of arrival, as `twin forecast --goto` has it"""
STEEP = 8.0
"""[degree] of pitch from which it dives or climbs"""
HOUR, MINUTE = 3600.0, 60.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExpectedPlan:
    """A mission and why it is this one."""

    mission: Mission
    words: str
    changes: tuple[Mapping[str, str], ...] = ()
    """Rows of a table: what it does now, by its last dives, and in the plan"""
    guessed: bool = False
    """Whether nobody says where it goes: the ellipses then hold if it goes there"""


def expected_plan(
    deployment: WatchedDeployment, store: Path, vehicle: Vehicle, legs: Sequence[LoggedLeg]
) -> ExpectedPlan:
    """The plan from the last fix on.

    Args:
      legs: of the deployment, one at least.

    Raises:
      MissionError: it cannot be read, or the vehicle cannot fly it.
    """
    if deployment.mission:
        path = deployment.place(deployment.mission)
        name = str(path) if path.is_file() else deployment.mission
        mission = load_mission_for(vehicle, name)
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
    places = (_place(np.array(aims[-1]), legs[-1].begin) if aims else "not in the log"), goto
    table = {
        "next place": (places[0], places[1].partition(";")[0]),
        "depth [m]": (f"{deep:.0f}", f"{depth:.0f}"),
        "pitch [degree]": (f"{pitch:.0f}", f"{pitch:.0f}"),
        "between surfacings [h]": (f"{lasted / HOUR:.1f}", f"{seconds / HOUR:.1f}"),
    }
    changes = tuple({"what": k, "now": now, "proposed": new} for k, (now, new) in table.items())
    return ExpectedPlan(mission=mission, words=words, guessed=guessed, changes=changes)


def _habits(store: Path, legs: Sequence[LoggedLeg], vehicle: Vehicle) -> tuple[float, float]:
    """Depth [m] and pitch [degree] of the last dives; the vehicle's usual pitch without any."""
    depths, steep = [], []
    with LogStore(store) as logs:
        for one in legs[-LAST:]:
            depth = logs.signal("measured_depth", one.mission)
            pitch = np.abs(logs.signal("measured_pitch", one.mission))
            if np.isfinite(depth).any():
                depths.append(float(np.nanmax(depth)))
            if (pitch > STEEP).any():
                steep.append(float(np.median(pitch[pitch > STEEP])))
    usual = math.degrees(vehicle.usual_glide[0])
    return float(np.median(depths)), float(round(np.median(steep))) if steep else usual


def _onward(last: LoggedLeg) -> tuple[str, str, bool]:
    """A place "LAT,LON" that it is taken to go to from the end of its last dive, why, and whether
    that is a guess."""
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class LastFix:
    """Where it was known to be last."""

    latitude: float
    """[degree]"""
    longitude: float
    """[degree]"""
    time: float
    """[s] unix"""

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        return {
            "latitude": round(self.latitude, 6),
            "longitude": round(self.longitude, 6),
            "time": f"{moment_of(self.time):%Y-%m-%dT%H:%M:%SZ}",
        }


def newest_fix(logs: LogStore, rows: Sequence[int]) -> LastFix | None:
    """The newest fix after one of these dives."""
    for row in reversed(rows):
        latitude, longitude = logs.fixes(row)[1]
        end = float(logs.starts[row] + logs.number(DIVE_DURATION)[row])
        if math.isfinite(latitude) and math.isfinite(longitude) and math.isfinite(end):
            return LastFix(latitude=float(latitude), longitude=float(longitude), time=end)
    return None
