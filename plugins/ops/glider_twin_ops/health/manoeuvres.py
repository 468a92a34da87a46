"""Manoeuvres: the next few dives that would tell most of a vehicle's parameters.

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
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from glider_twin_ops.health.signatures import TypicalDive, dive_scenario, told
from twin import Trajectory
from twin.errors import InputError, MissionError
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
    log_of,
    motion_of,
)
from twin.numbers import Array
from twin.physics import Lane, flown_abreast

LEARNED = ("neutral_density", "drag", "lift_ratio", "compressibility", "pitch_offset")
"""Parameters that a few dives can tell; a compass takes many, for the current changes, too"""
COUNT = 3
"""Dives that are proposed"""
PITCHES_DEG = (16.0, 20.0, 26.0, 35.0, 45.0)
REACHES = (0.4, 0.65, 0.9)
"""Parts of what the pump can make heavy in dives and light in climbs"""
DEPTHS = (0.6, 1.0)
"""Parts of the usual depth"""
TURNS_DEG = (0.0, 90.0, 180.0, 270.0)
"""Courses from the usual one on, to starboard"""
NOISE = {
    "depth_rate": ResidualNoise(deviation=0.01, samples=15.0),
    "current": ResidualNoise(deviation=0.05, samples=2.0),
}
"""Of a log that has none of its own: 1 cm/s of waves that last a minute, and a current that
changes by 5 cm/s from dive to dive"""
EXCHANGES = 5


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
        said = [f"pitch {self.dive.pitch:.0f} degree, {heavy:.0f} g heavy and {light:.0f} g light"]
        if self.dive.depth != usual.depth:
            said.append(f"to {self.dive.depth:.0f} m")
        if self.turn_deg:
            said.append(f"course {self.turn_deg:.0f} degree to starboard of the usual one")
        return ", ".join(said)


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
    """Proposed dives, and what is known before and after them."""

    parameters: tuple[UnknownParameter, ...]
    values: tuple[float, ...]
    chosen: tuple[Manoeuvre, ...]
    before: Array
    """Deviations over spreads, (parameters,)"""
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
        usual, proposed = (
            float(np.exp(np.mean(np.log(each / self.before))))
            for each in (self.ordinary, self.after)
        )
        return usual, proposed


def information_of(
    logs: Sequence[Log], calibration: Calibration
) -> tuple[Array, dict[str, ResidualNoise]]:
    """Learn what dives have told of the parameters.

    Returns:
      Information over spreads, with what was known before, (parameters, parameters); noise of the
      dives by channel.

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
    candidates = [Manoeuvre(dive=usual, turn_deg=0.0), *_candidates(calibration, usual)]
    dives = list(dict.fromkeys(one.dive for one in candidates))
    logs = {
        dive: log
        for dive, log in zip(dives, flown_logs(calibration, dives), strict=True)
        if log is not None
    }
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


def _candidates(calibration: Calibration, usual: TypicalDive) -> list[Manoeuvre]:
    lightest, heaviest = calibration.vehicle.net_mass_range
    return [
        Manoeuvre(
            dive=TypicalDive(
                depth=round(usual.depth * deep, 1), pitch=pitch, climb_pitch=pitch,
                net_mass=reach * heaviest, climb_net_mass=-reach * lightest, period=usual.period,
            ),
            turn_deg=turn,
        )
        for pitch, reach, deep, turn in itertools.product(PITCHES_DEG, REACHES, DEPTHS, TURNS_DEG)
    ]  # fmt: skip


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
