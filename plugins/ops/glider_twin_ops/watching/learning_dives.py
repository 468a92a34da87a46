"""Learning dives: the next dives that would tell most of a vehicle, as files that a pilot may send.

They lie in `learn/1`, `learn/2` ... of the deployment's folder, each with `dive.txt`: what is
different in it, and the twin's flight of exactly the files beside. Nothing is sent.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.forecast import Request, fly_nominal, legs_of
from glider_twin_ops.forecast.logged_leg import place_at
from glider_twin_ops.health import MostTelling, information_of, most_telling, typical_dive
from glider_twin_ops.health.manoeuvres import Manoeuvre
from glider_twin_ops.watching.deployment_folder import WatchedDeployment
from glider_twin_ops.watching.expected_plan import SEAGLIDER, UNWRITTEN, WRITTEN, proposed_files
from glider_twin_ops.watching.log_of_files import LOG
from glider_twin_ops.watching.morning import vehicle_of_log
from twin import Mission, Origin, Vehicle, Waypoint
from twin.cli import format_table
from twin.errors import InputError, SimulationUnstable
from twin.identify import load_calibration, load_logs
from twin.records import LogStore, is_store
from twin.records.storage import whole_folder

LEARN, DIVE, SAID = "learn", "dive.txt", "proposed.json"
LAST = 20
"""Dives by which is told what is known now: 0.4 s each"""
AHEAD = 30_000.0
"""[m] to the place that a dive's course is given by: farther than a dive goes"""
RADIUS, SHALLOW = 500.0, 8.0
"""[m] of arrival, and of the upper turn"""
LONGER = 1.5
"""Times a dive's own time, within which the twin's flight of its files surfaces"""
MINUTE, HOUR = 60.0, 3600.0
BY_HAND = "its files have no climb: here it climbs as steep and as light as it dives heavy"


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearningDive:
    """One proposed dive."""

    words: str
    files: Mapping[str, str]
    """Texts by the names of the files; empty for vehicles whose files are not known"""
    by_hand: str
    """What the files cannot say; empty where they say all"""
    flight: dict[str, float]
    """Of exactly these files by the twin in still water: minutes, km and Wh to the surfacing"""

    def text(self) -> str:
        """Words as `dive.txt` has them."""
        flown = ", ".join(f"{value:g} {unit}" for unit, value in self.flight.items())
        said = f"{self.words}\nthe twin flies it in still water that is deeper: {flown}\n"
        return said + f"{self.by_hand}\n" * bool(self.by_hand)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearningDives:
    """What is proposed, and what it would tell."""

    folder: Path
    dives: tuple[LearningDive, ...]
    telling: MostTelling

    def text(self) -> str:
        """For a terminal."""
        usual, proposed = self.telling.shrinks
        lines = [f"{k + 1}: {one.words}" for k, one in enumerate(self.dives)]
        lines += ["", format_table(self.telling.table())]
        lines.append(
            f"deviations shrink to {proposed:.2f} of what they are now in the mean, with as many "
            f"usual dives to {usual:.2f}"
        )
        return "\n".join(lines)

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        usual, proposed = self.telling.shrinks
        return {
            "dives": [dataclasses.asdict(one) for one in self.dives],
            "deviations": self.telling.table(),
            "after_usual": usual,
            "after_proposed": proposed,
        }


def propose_learning(deployment: WatchedDeployment) -> LearningDives:
    """Write the dives that would tell most into `learn`, in the place of earlier ones.

    Raises:
      InputError: no pass has made a log yet, or it tells no glide between two fixes.
      WriteError: something else is in the way, or the disk refuses.
    """
    store = deployment.folder / LOG
    if not is_store(store):
        raise InputError(
            f"{deployment.folder} has no {LOG} yet: `twin watch` it first, with --once"
        )
    vehicle = vehicle_of_log(deployment, store)
    with LogStore(store) as logs:
        name = logs.deployments[int(np.argmax(np.nan_to_num(logs.starts, nan=-np.inf)))]
        rows, kind = logs.missions_of(name), logs.source
        legs = legs_of(logs, name)
    if not legs:
        raise InputError(f"{LOG} has no dive between two fixes: nothing tells its course")
    calibration = load_calibration(vehicle)
    information, noise = information_of(load_logs(store, rows[-LAST:]), calibration)
    north, east = legs[-1].velocity.tolist()
    course = math.degrees(math.atan2(east, north)) % 360.0
    usual = typical_dive(store, name, vehicle)
    telling = most_telling(calibration, usual, information, noise=noise, course_deg=course)
    dives = tuple(
        _dive(one, one.words(usual), kind, vehicle, legs[-1].end, course) for one in telling.chosen
    )
    found = LearningDives(folder=deployment.folder / LEARN, dives=dives, telling=telling)
    with whole_folder(
        found.folder, overwrite=True, ours=lambda one: (one / SAID).is_file()
    ) as place:
        for k, one in enumerate(dives):
            (place / f"{k + 1}").mkdir()
            for file, text in {**one.files, DIVE: one.text()}.items():
                (place / f"{k + 1}" / file).write_text(text, encoding="utf-8")
        (place / SAID).write_text(json.dumps(found.describe(), indent=1) + "\n", encoding="utf-8")
    return found


def _dive(
    one: Manoeuvre,
    words: str,
    kind: str,
    vehicle: Vehicle,
    start: tuple[float, float],
    course: float,
) -> LearningDive:
    turn = math.radians(course + one.turn_deg)
    latitude, longitude = place_at((AHEAD * math.cos(turn), AHEAD * math.sin(turn)), start)
    by_hand = "" if kind in WRITTEN else UNWRITTEN.get(kind, UNWRITTEN[""].format(kind))
    climbs: dict[str, Any] = {
        "climb_pitch_deg": one.dive.climb_pitch,
        "climb_net_mass_kg": one.dive.climb_net_mass,
    }
    if kind == SEAGLIDER:
        by_hand, climbs = BY_HAND, {}
    segment = Waypoint(
        targets=({"latitude": latitude, "longitude": longitude},),
        max_depth_m=one.dive.depth,
        min_depth_m=SHALLOW,
        pitch_deg=one.dive.pitch,
        net_mass_kg=one.dive.net_mass,
        surface_after_s=MINUTE * round(one.seconds / MINUTE),
        arrival_radius_m=RADIUS,
        **climbs,
    )
    read, files = Mission(name="learn", segments=(segment,)), {}
    if kind in WRITTEN:
        proposed = proposed_files(kind, read, vehicle, {})
        files, read = dict(proposed.files), proposed.mission
    request = Request(
        vehicle=vehicle,
        mission=read,
        place=Origin(latitude_deg=start[0], longitude_deg=start[1], time="2000-01-01T00:00:00"),
        hours=LONGER * one.seconds / HOUR,
    )
    flown = fly_nominal(request, [read])[0]
    if isinstance(flown, SimulationUnstable):
        raise InputError(f"proposed dive ({words}): {flown}")
    seconds, there, energy = flown.duration, flown.end[:2], flown.taken
    if len(flown.time):
        seconds, there, energy = float(flown.time[0]), flown.place[0], float(flown.energy[0])
    flight = {
        "min": round(seconds / MINUTE, 1),
        "km": round(float(np.hypot(*there)) / 1e3, 2),
        "Wh": round(energy / HOUR, 2),
    }
    return LearningDive(words=words, files=files, by_hand=by_hand, flight=flight)
