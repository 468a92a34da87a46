"""Learning dives: the next dives that would tell most of a vehicle, as files that a pilot may send.

    found = most_telling(load_calibration("mine.xml"), usual_dive(vehicle), before)
    found.chosen, found.after

A vehicle that dives alike every day tells its parameters only in the combination that this dive
needs: drag, lift and the pitch sensor's zero stand for each other at one pitch. Candidates differ
from the usual dive in pitch, pumped volume, depth and course; the twin flies each without noise,
and the slopes of its depth rates and of its way between fixes over the parameters are its Fisher
information (Kay 1993, Fundamentals of Statistical Signal Processing, 3.7), with the noise that the
vehicle's own dives have. Chosen are those after which the product of the deviations is least, one
after another and then each anew beside the others (Fedorov's exchange: Cook and Nachtsheim,
Technometrics 22, 1980).

They lie in `learn/1`, `learn/2` ... of the deployment's folder, each with `dive.txt`: what is
different in it, and the twin's flight of exactly the files beside. Nothing is sent.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from glider_twin_ops.forecast import Request, fly_nominal, legs_of
from glider_twin_ops.forecast.logged_leg import place_at
from glider_twin_ops.health import typical_dive
from glider_twin_ops.health.signatures import TypicalDive, dive_scenario, told
from glider_twin_ops.watching.deployment_folder import WatchedDeployment
from glider_twin_ops.watching.expected_plan import SEAGLIDER, UNWRITTEN, WRITTEN, proposed_files
from glider_twin_ops.watching.log_of_files import LOG
from twin import Mission, Origin, Trajectory, Vehicle, Waypoint
from twin.cli import format_table
from twin.errors import InputError, MissionError, SimulationUnstable
from twin.identify import (
    FIRST_DEVIATION,
    Calibration,
    DepthRates,
    Log,
    ResidualNoise,
    UnknownParameter,
    choose,
    gliding,
    horizontal,
    load_calibration,
    load_logs,
    log_of,
    motion_of,
)
from twin.numbers import Array
from twin.physics import Lane, flown_abreast
from twin.records import LogStore, is_store
from twin.records.storage import whole_folder

LEARNED = ("neutral_density", "drag", "lift_ratio", "compressibility", "pitch_offset")
"""Parameters that a few dives can tell; a compass takes many, for the current changes, too"""
COUNT, EXCHANGES = 3, 5
"""Dives that are proposed, and rounds in which each is chosen anew at most"""
PITCHES_DEG, DEPTHS, TURNS_DEG = (16.0, 20.0, 26.0, 35.0, 45.0), (0.6, 1.0), (0, 90, 180, 270)
"""Parts of the usual depth; courses from the usual one on, to starboard"""
REACHES = (0.4, 0.65, 0.9)
"""Parts of what the pump can make heavy in dives and light in climbs"""
NOISE = {
    "depth_rate": ResidualNoise(deviation=0.01, samples=15.0),
    "current": ResidualNoise(deviation=0.05, samples=2.0),
}
"""Of a log that has none of its own: 1 cm/s of waves that last a minute, and a current that
changes by 5 cm/s from dive to dive"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """One dive."""

    dive: TypicalDive
    turn_deg: float
    """Of its course from the usual one, to starboard"""
    seconds: float = 0.0
    """That the twin flies it for; 0: it has not been flown"""

    def words(self, usual: TypicalDive) -> str:
        """What is different from the usual dive, for a person."""
        heavy, light = (1e3 * mass for mass in (self.dive.net_mass, self.dive.climb_net_mass))
        said = f"pitch {self.dive.pitch:.0f} degree, {heavy:.0f} g heavy and {light:.0f} g light"
        if self.dive.depth != usual.depth:
            said += f", to {self.dive.depth:.0f} m"
        if self.turn_deg:
            said += f", course {self.turn_deg:.0f} degree to starboard of the usual one"
        return said


class Slopes(NamedTuple):
    """What one dive tells, near a calibration."""

    depth_rates: Array
    """Information of its depth rates, (parameters, parameters), over spreads"""
    way: Array
    """[m/s] mean velocity through the water per spread, north and east, (2, parameters)"""

    def turned(self, degrees: float) -> Slopes:
        """Slopes on a course so much farther to starboard."""
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        return self._replace(way=np.array([[c, -s], [s, c]]) @ self.way)


@dataclasses.dataclass(frozen=True, kw_only=True)
class MostTelling:
    """Proposed dives, and what is known before and after them; arrays are (parameters,)."""

    parameters: tuple[UnknownParameter, ...]
    values: tuple[float, ...]
    chosen: tuple[Manoeuvre, ...]
    before: Array
    """Deviations over spreads"""
    ordinary: Array
    """After as many dives like the usual one"""
    after: Array
    """After the proposed ones"""

    def table(self) -> list[dict[str, object]]:
        """Rows: each parameter with its deviation now, after usual dives, and after these."""
        told = {"deviation now": self.before, "after usual dives": self.ordinary,
                "after these": self.after}  # fmt: skip
        return [
            {"parameter": one.name, "unit": one.unit}
            | {n: float(f"{one.deviation(value, float(v[k])):.3g}") for n, v in told.items()}
            for k, (one, value) in enumerate(zip(self.parameters, self.values, strict=True))
        ]

    @property
    def shrinks(self) -> tuple[float, float]:
        """Geometric mean of the deviations after the usual dives, and after these, over now's."""
        usual, these = (np.log(each / self.before) for each in (self.ordinary, self.after))
        return float(np.exp(np.mean(usual))), float(np.exp(np.mean(these)))


def information_of(
    logs: Sequence[Log], calibration: Calibration
) -> tuple[Array, dict[str, ResidualNoise]]:
    """Information on the parameters that dives have told, over spreads, with what was known before,
    (parameters, parameters), and noise of the dives by channel.

    Raises:
      InputError: no dive glides, or the calibration does not fly.
    """
    used, _ = gliding(logs)
    chosen = choose(list(LEARNED))
    problem = DepthRates(used, calibration, chosen, fixes=True)
    about, _ = problem.fit(np.zeros(len(chosen)), 2, max_nfev=8, xtol=1e-3, ftol=1e-4)
    noise = {**NOISE, **problem.reweight(about)}
    slopes = problem.slopes(about)
    return slopes.T @ slopes + np.eye(len(chosen)), noise


def most_telling(
    calibration: Calibration,
    usual: TypicalDive,
    information: Array,
    *,
    noise: Mapping[str, ResidualNoise] = NOISE,
    course_deg: float = 0.0,
) -> MostTelling:
    """Choose the dives that shrink the deviations most.

    Args:
      calibration: of the vehicle.
      usual: the dive that it makes otherwise, and made last.
      information: what is known, as `information_of` tells it.
      noise: of the vehicle's dives, by channel.
      course_deg: true, of the usual dives.

    Raises:
      InputError: the usual dive cannot be flown.
    """
    chosen = choose(list(LEARNED))
    lightest, heaviest = calibration.vehicle.net_mass_range
    candidates = [Manoeuvre(dive=usual, turn_deg=0.0)]
    for pitch, reach, deep, turn in itertools.product(PITCHES_DEG, REACHES, DEPTHS, TURNS_DEG):
        dive = TypicalDive(
            depth=round(usual.depth * deep, 1), pitch=pitch, climb_pitch=pitch,
            net_mass=reach * heaviest, climb_net_mass=-reach * lightest, period=usual.period,
        )  # fmt: skip
        candidates.append(Manoeuvre(dive=dive, turn_deg=turn))
    dives = list(dict.fromkeys(one.dive for one in candidates))
    both = zip(dives, flown_logs(calibration, dives), strict=True)
    logs = {dive: log for dive, log in both if log is not None}
    if usual not in logs:
        raise InputError(
            f"vehicle {calibration.vehicle.name!r} cannot fly the dive that its logs show"
        )
    told_by = {
        dive: slopes_of(turned(log, course_deg), calibration, chosen, noise)
        for dive, log in logs.items()
    }
    flyable = [one for one in candidates if one.dive in logs]
    slopes = [told_by[one.dive].turned(one.turn_deg) for one in flyable]
    sigma = noise["current"].deviation ** 2 * noise["current"].samples

    def deviations(places: Sequence[int]) -> Array:
        total = information.copy()
        for before, place in itertools.pairwise((0, *places)):
            step = slopes[place].way - slopes[before].way
            total = total + slopes[place].depth_rates + step.T @ step / sigma
        return np.sqrt(np.diag(np.linalg.inv(total)))

    def size(places: Sequence[int]) -> float:
        return float(np.log(deviations(places)).sum())

    every = range(len(flyable))
    best: list[int] = []
    for _ in range(COUNT):
        best.append(min(every, key=lambda k: size([*best, k])))
    for _ in range(EXCHANGES):
        before = size(best)
        for k in range(COUNT):
            best[k] = min(every, key=lambda place: size([*best[:k], place, *best[k + 1 :]]))
        if size(best) > before - 1e-9:
            break
    return MostTelling(
        parameters=chosen,
        values=tuple(one.get(calibration) for one in chosen),
        chosen=tuple(
            dataclasses.replace(flyable[k], seconds=logs[flyable[k].dive].duration) for k in best
        ),
        before=np.sqrt(np.diag(np.linalg.inv(information))),
        ordinary=deviations([0] * COUNT),
        after=deviations(best),
    )


def flown_logs(calibration: Calibration, dives: Sequence[TypicalDive]) -> list[Log | None]:
    """Dives of the twin to the north as identification reads logs; None where one is no glide."""
    scenarios, places, lanes = [dive_scenario(calibration.vehicle, one) for one in dives], [], []
    for k, scenario in enumerate(scenarios):
        try:
            lanes.append(Lane(scenario, until_flown=True))
            places.append(k)
        except MissionError:
            continue  # a pitch or a volume that this vehicle does not reach
    found: list[Log | None] = [None] * len(dives)
    for k, flown in flown_abreast(lanes):
        if isinstance(flown, Trajectory):
            signals = told(scenarios[places[k]], flown)
            found[places[k]] = log_of(0, dict(signals.signals), signals.period, None, True)
    return found


def turned(log: Log, course_deg: float) -> Log:
    """The same dive on another course [degree], its mean heading."""
    mean = float(np.mean(log.heading[log.use])) if log.use.any() else 0.0
    return dataclasses.replace(log, heading=log.heading - mean + math.radians(course_deg))


def slopes_of(
    log: Log,
    calibration: Calibration,
    parameters: tuple[UnknownParameter, ...],
    noise: Mapping[str, ResidualNoise],
) -> Slopes:
    """What one dive tells of parameters."""
    problem = DepthRates([log], calibration, parameters)
    zero = np.zeros(len(parameters))
    slopes = problem.slopes(zero)
    off = noise["depth_rate"]
    scale = FIRST_DEVIATION**2 / (off.deviation**2 * off.samples)

    def way(x: Array) -> Array:
        here = problem.calibration(x)
        both = horizontal(log, here, motion_of(log, here))
        return log.period * np.sum(np.stack(both), axis=1) / log.duration

    base = way(zero)
    moved = [(way(problem.step * unit) - base) / problem.step for unit in np.eye(len(zero))]
    return Slopes(depth_rates=scale * slopes.T @ slopes, way=np.stack(moved, axis=1))


LEARN, DIVE, SAID = "learn", "dive.txt", "proposed.json"
LAST, LONGER = 20, 1.5
"""Dives by which is told what is known now: 0.4 s each; and times a dive's own time, within which
the twin's flight of its files surfaces"""
AHEAD, RADIUS, SHALLOW = 30_000.0, 500.0, 8.0
"""[m] to the place that a dive's course is given by, farther than a dive goes, of arrival there,
and of the upper turn"""
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
        said = [self.words, f"the twin flies it in still water that is deeper: {flown}"]
        return "".join(f"{one}\n" for one in (*said, self.by_hand) if one)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearningDives:
    """What is proposed, and what it would tell."""

    folder: Path
    dives: tuple[LearningDive, ...]
    telling: MostTelling

    def text(self) -> str:
        """For a terminal."""
        usual, proposed = self.telling.shrinks
        lines = [f"{k}: {one.words}" for k, one in enumerate(self.dives, 1)]
        return "\n".join(lines) + (
            f"\n\n{format_table(self.telling.table())}\ndeviations shrink to {proposed:.2f} of "
            f"what they are now in the mean, with as many usual dives to {usual:.2f}"
        )

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        said = dict(zip(("after_usual", "after_proposed"), self.telling.shrinks, strict=True))
        dives = [dataclasses.asdict(one) for one in self.dives]
        return {"dives": dives, "deviations": self.telling.table(), **said}


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
    vehicle = deployment.vehicle_of(store)
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
    told_of = kind, vehicle, legs[-1].end, course
    dives = tuple(_dive(one, one.words(usual), *told_of) for one in telling.chosen)
    found = LearningDives(folder=deployment.folder / LEARN, dives=dives, telling=telling)
    with whole_folder(
        found.folder, overwrite=True, ours=lambda one: (one / SAID).is_file()
    ) as place:
        for k, one in enumerate(dives, 1):
            (place / f"{k}").mkdir()
            for file, text in {**one.files, DIVE: one.text()}.items():
                (place / f"{k}" / file).write_text(text, encoding="utf-8")
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
    climb: tuple[float | None, float | None] = one.dive.climb_pitch, one.dive.climb_net_mass
    if kind == SEAGLIDER:
        by_hand, climb = BY_HAND, (None, None)
    segment = Waypoint(
        targets=({"latitude": latitude, "longitude": longitude},),
        max_depth_m=one.dive.depth,
        min_depth_m=SHALLOW,
        pitch_deg=one.dive.pitch,
        net_mass_kg=one.dive.net_mass,
        surface_after_s=MINUTE * round(one.seconds / MINUTE),
        arrival_radius_m=RADIUS,
        climb_pitch_deg=climb[0],
        climb_net_mass_kg=climb[1],
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
    (flown,) = fly_nominal(request, [read])
    if isinstance(flown, SimulationUnstable):
        raise InputError(f"proposed dive ({words}): {flown}")
    seconds, there, energy = flown.duration, flown.end[:2], flown.taken
    if len(flown.time):
        seconds, there, energy = float(flown.time[0]), flown.place[0], float(flown.energy[0])
    km = round(float(np.hypot(*there)) / 1e3, 2)
    flight = {"min": round(seconds / MINUTE, 1), "km": km, "Wh": round(energy / HOUR, 2)}
    return LearningDive(words=words, files=files, by_hand=by_hand, flight=flight)
