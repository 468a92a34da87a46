"""Learning dives: proposed dives that determine most of a vehicle's parameters, with their files.

    found = most_telling(load_calibration("mine.xml"), usual_dive(vehicle), before)
    found.chosen, found.after

Equal dives determine only one combination of the parameters: at a single pitch, drag, lift and the
pitch sensor's zero cannot be separated. Candidates differ from the usual dive in pitch, pumped
volume, depth and course; the twin flies each without noise. The derivatives of its depth rates and
of its displacement between fixes, with the noise of the vehicle's own dives, give its Fisher
information (Kay 1993, Fundamentals of Statistical Signal Processing, 3.7). Dives are chosen one
after another, so that the product of the standard deviations is smallest. Then each dive is chosen
again, given the others (Fedorov's exchange: Cook and Nachtsheim, Technometrics 22, 1980).

The dives' files lie in `learn/1`, `learn/2` ... of the deployment's folder. `dive.txt` beside them
says how the dive differs and how the twin flies exactly these files. Nothing is sent.
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
"""Parameters that a few dives can determine; a compass needs many, because the current changes"""
COUNT, EXCHANGES = 3, 5
"""COUNT: number of proposed dives. EXCHANGES: maximum number of rounds of exchange"""
PITCHES_DEG, DEPTHS, TURNS_DEG = (16.0, 20.0, 26.0, 35.0, 45.0), (0.6, 1.0), (0, 90, 180, 270)
"""DEPTHS: fractions of the usual depth. TURNS_DEG: turns from the usual course to starboard"""
REACHES = (0.4, 0.65, 0.9)
"""Fractions of the heaviest net mass in dives and of the lightest in climbs"""
NOISE = {
    "depth_rate": ResidualNoise(deviation=0.01, samples=15.0),
    "current": ResidualNoise(deviation=0.05, samples=2.0),
}
"""Noise of a log without its own estimate: waves of 1 cm/s that last a minute, and a current that
changes by 5 cm/s from dive to dive"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """Candidate for a learning dive."""

    dive: TypicalDive
    turn_deg: float
    """Course minus the usual course, to starboard"""
    seconds: float = 0.0
    """Duration of the twin's flight; 0 before it is flown"""

    def words(self, usual: TypicalDive) -> str:
        """Describe the differences from the usual dive."""
        heavy, light = (1e3 * mass for mass in (self.dive.net_mass, self.dive.climb_net_mass))
        said = f"pitch {self.dive.pitch:.0f} degree, {heavy:.0f} g heavy and {light:.0f} g light"
        if self.dive.depth != usual.depth:
            said += f", to {self.dive.depth:.0f} m"
        if self.turn_deg:
            said += f", course {self.turn_deg:.0f} degree to starboard of the usual one"
        return said


class Slopes(NamedTuple):
    """Information from one dive, linearised about a calibration."""

    depth_rates: Array
    """Fisher information of its depth rates, (parameters, parameters), per spread of each"""
    way: Array
    """[m/s] Mean velocity through the water per spread, north and east, (2, parameters)"""

    def turned(self, degrees: float) -> Slopes:
        """Slopes of the same dive on a course turned to starboard."""
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        return self._replace(way=np.array([[c, -s], [s, c]]) @ self.way)


@dataclasses.dataclass(frozen=True, kw_only=True)
class MostTelling:
    """Proposed dives, with standard deviations before and after them; arrays are (parameters,)."""

    parameters: tuple[UnknownParameter, ...]
    values: tuple[float, ...]
    chosen: tuple[Manoeuvre, ...]
    before: Array
    """Standard deviations now, in spreads"""
    ordinary: Array
    """Standard deviations after as many usual dives"""
    after: Array
    """Standard deviations after the proposed dives"""

    def table(self) -> list[dict[str, object]]:
        """Rows: each parameter's standard deviation now, after usual dives, and after these."""
        told = {"deviation now": self.before, "after usual dives": self.ordinary,
                "after these": self.after}  # fmt: skip
        return [
            {"parameter": one.name, "unit": one.unit}
            | {n: float(f"{one.deviation(value, float(v[k])):.3g}") for n, v in told.items()}
            for k, (one, value) in enumerate(zip(self.parameters, self.values, strict=True))
        ]

    @property
    def shrinks(self) -> tuple[float, float]:
        """Geometric means of the ratios of `ordinary` and of `after` to `before`."""
        usual, these = (np.log(each / self.before) for each in (self.ordinary, self.after))
        return float(np.exp(np.mean(usual))), float(np.exp(np.mean(these)))


def information_of(
    logs: Sequence[Log], calibration: Calibration
) -> tuple[Array, dict[str, ResidualNoise]]:
    """Fisher information of dives and prior on the parameters, per spread of each, (parameters,
    parameters), and noise of the dives by channel.

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
    """Choose the dives that reduce the standard deviations most.

    Args:
      calibration: calibration of the vehicle.
      usual: the vehicle's usual dive, as flown last.
      information: information so far, as `information_of` returns it.
      noise: noise of the vehicle's dives, by channel.
      course_deg: true course of the usual dives.

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
    """Fly dives to the north and return them as logs for identification; None for a failed one."""
    scenarios, places, lanes = [dive_scenario(calibration.vehicle, one) for one in dives], [], []
    for k, scenario in enumerate(scenarios):
        try:
            lanes.append(Lane(scenario, until_flown=True))
            places.append(k)
        except MissionError:
            continue  # the vehicle does not reach this pitch or volume
    found: list[Log | None] = [None] * len(dives)
    for k, flown in flown_abreast(lanes):
        if isinstance(flown, Trajectory):
            signals = told(scenarios[places[k]], flown)
            found[places[k]] = log_of(0, dict(signals.signals), signals.period, None, True)
    return found


def turned(log: Log, course_deg: float) -> Log:
    """Log with its headings turned until their mean is a course [degree]."""
    mean = float(np.mean(log.heading[log.use])) if log.use.any() else 0.0
    return dataclasses.replace(log, heading=log.heading - mean + math.radians(course_deg))


def slopes_of(
    log: Log,
    calibration: Calibration,
    parameters: tuple[UnknownParameter, ...],
    noise: Mapping[str, ResidualNoise],
) -> Slopes:
    """Compute the information of one dive on parameters."""
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
"""LAST: number of last dives that give the information so far, 0.4 s each. LONGER: longest flight
of the files over the dive's duration"""
AHEAD, RADIUS, SHALLOW = 30_000.0, 500.0, 8.0
"""[m] AHEAD: distance of the target that sets a dive's course, beyond a dive's reach. RADIUS: of
arrival. SHALLOW: depth of the upper turn"""
MINUTE, HOUR = 60.0, 3600.0
BY_HAND = "its files have no climb: here it climbs as steep and as light as it dives heavy"


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearningDive:
    """Proposed dive with its files."""

    words: str
    files: Mapping[str, str]
    """Text of each file, by its name; empty for vehicles whose files are not known"""
    by_hand: str
    """Settings that the files cannot express; empty where they express all"""
    flight: dict[str, float]
    """Twin's flight of exactly these files in still water: minutes, km and Wh to the surfacing"""

    def text(self) -> str:
        """Text of `dive.txt`."""
        flown = ", ".join(f"{value:g} {unit}" for unit, value in self.flight.items())
        said = [self.words, f"the twin flies it in still water that is deeper: {flown}"]
        return "".join(f"{one}\n" for one in (*said, self.by_hand) if one)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearningDives:
    """Proposed dives, and the information expected from them."""

    folder: Path
    dives: tuple[LearningDive, ...]
    telling: MostTelling

    def text(self) -> str:
        """Text for a terminal."""
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
    """Write the most informative dives into `learn`, in place of earlier ones.

    Raises:
      InputError: no pass has made a log yet, or the log has no glide between two fixes.
      WriteError: something else lies in `learn`, or the disk refuses.
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
