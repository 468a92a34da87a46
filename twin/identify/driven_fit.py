"""Driven fit: a propelled vehicle from its own runs, and how it flies those that it has not seen.

vehicle = load_vehicle("remus")
runs = load_runs("bag.zarr", vehicle)
found = identify_driven(runs[:-1], vehicle)
judge(runs[-1:], found.calibration), judge(runs[-1:], found.nominal)
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from twin.errors import InputError
from twin.identify.answer import DRIVEN, Identification
from twin.identify.calibration import Array, Calibration
from twin.identify.comparison import ResidualNoise, rms
from twin.identify.driven_flights import CHANNELS, DrivenFlights, ahead
from twin.identify.driven_runs import DrivenRun
from twin.identify.driven_unknowns import driven_parameters
from twin.identify.fit import UNDETERMINED, answer_of, free_of
from twin.identify.unknowns import UnknownParameter, choose, with_known
from twin.vehicle.vehicle import Vehicle

LEAST_PIECES = 6
"""Pieces of 20 s below which nothing is fitted: two minutes"""
SILENT = 0.95
"""Part of its spread that a parameter's deviation must fall below to be moved at all: above it the
runs say nothing, and the vehicle file's number stands"""
LOOKS = (5, 3, 3)
"""Evaluations of each fit; between them weights, and the currents at the starts, are taken again"""
FAR_LOOKS = (15, 15)
"""Evaluations before them, from a vehicle of which only the dimensions were known"""
ENDS: dict[str, Any] = {"xtol": 1e-2, "ftol": 1e-3}
FAR_ENDS: dict[str, Any] = {"xtol": 1e-4, "ftol": 1e-5}
TOGETHER = "with the others only: the runs do not determine it"
SLOWEST = 0.1
"""[m/s] below which a vehicle lies still"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DrivenErrors:
    """Errors of a vehicle's flight of runs that its fit has not seen."""

    speed: float
    """Mean size of the error of a flight's mean surge, over that surge"""
    turn_rate: float
    """Error of the yaw rate over the yaw rate, both root mean square"""
    depth_rate: float
    """Error of the depth rate over the depth rate, both root mean square"""
    speed_m_s: float
    """Mean size of the error [m/s]"""
    turn_rate_rad_s: float
    """[rad/s] root mean square"""
    depth_rate_m_s: float
    """[m/s] root mean square"""
    pieces: int
    """of 20 s"""
    against: str
    """"truth" of a simulated store, or "log": what the sensors measured"""

    def describe(self) -> dict[str, Any]:
        """JSON-able figures."""
        return dataclasses.asdict(self)


def identify_driven(
    runs: Sequence[DrivenRun],
    vehicle: Vehicle,
    *,
    parameters: Sequence[str] | None = None,
    known: Mapping[str, float] | None = None,
    unsure: float = 1.0,
    progress: Callable[[float], None] = lambda part: None,
) -> Identification:
    """Estimate the parameters of a propelled vehicle from its runs.

    Args:
      runs: of one vehicle, of one sample period.
      vehicle: to start from.
      parameters: names to estimate; by default all that `driven_parameters` has.
      known: values that are known and not estimated, by name.
      unsure: times the usual spreads, see `driven_parameters`.
      progress: called with the part done, 0 to 1.

    Raises:
      InputError: an unknown parameter, too few flights, or a vehicle that does not fly as the runs.
    """
    densities = [float(np.median(run.density[1])) for run in runs if run.density is not None]
    water = float(np.median(densities)) if densities else vehicle.reference_density
    everything = driven_parameters(vehicle, unsure)
    nominal = with_known(Calibration(vehicle=vehicle, water_density=water), known or {}, everything)
    wanted = everything if parameters is None else choose(parameters, everything)
    notes = {p.name: "given as known" for p in wanted if p.name in (known or {})}
    pieces = len(DrivenFlights(runs, nominal, ()).pieces)
    if pieces < LEAST_PIECES:
        raise InputError(
            f"only {pieces} pieces of 20 s under water without a gap in {len(runs)} runs; "
            f"identification needs at least {LEAST_PIECES}"
        )
    free = free_of(wanted, notes)
    problem, x = _fitted(runs, nominal, free, lambda part: progress(0.9 * part), far=unsure > 1.0)
    covariance = problem.fitted(x).covariance
    before = {p.name: float(np.sqrt(covariance[k, k])) for k, p in enumerate(free)}
    for name, off in before.items():
        if off > SILENT:
            notes[name] = f"the runs leave it to {100.0 * off:.0f} % of what was known"
    kept = tuple(p for p in free if p.name not in notes)
    if not kept:
        raise InputError(
            "the runs say nothing of any parameter: they need turns, dives and other speeds"
        )
    if kept != free:
        rows = [k for k, p in enumerate(free) if p in kept]
        covariance = covariance[np.ix_(rows, rows)]  # what is not known makes the rest less sure
        problem, x = _without(problem, x, kept)
    progress(1.0)
    covariance = covariance[: len(kept), : len(kept)]
    determined = (np.sqrt(np.diag(covariance)) <= UNDETERMINED).tolist()
    said = [(sure, "" if sure else TOGETHER) for sure in determined]
    noise = problem.reweight(x)["depth_rate"]
    found = answer_of(problem, x, runs, wanted, notes, before, covariance, said, noise, DRIVEN)
    order = sorted(found.estimates, key=lambda one: not one.determined)
    return dataclasses.replace(found, estimates=tuple(order))


def _fitted(
    runs: Sequence[DrivenRun],
    nominal: Calibration,
    parameters: tuple[UnknownParameter, ...],
    progress: Callable[[float], None],
    *,
    far: bool,
) -> tuple[DrivenFlights, Array]:
    """The problem with its weights, and where its fit ends.

    From `far`, every manoeuvre is an outlier, and what is left of it says nothing: there all
    residuals of a channel count alike first.
    """
    problem = DrivenFlights(runs, nominal, parameters)
    x = np.zeros(problem.size)
    stages = [(looks, True) for looks in FAR_LOOKS if far] + [(looks, False) for looks in LOOKS]
    for k, (looks, plain) in enumerate(stages):
        first = _alike(problem, x) if plain else None
        x, _ = problem.fit(x, 1, first=first, max_nfev=looks, **(FAR_ENDS if plain else ENDS))
        problem.started = problem.currents(x)
        progress((k + 1) / len(stages))
    problem.reweight(x)
    return problem, x


def _alike(problem: DrivenFlights, x: Array) -> dict[str, ResidualNoise]:
    """Noise of each channel by which no residual is an outlier."""
    return {
        name: ResidualNoise(
            deviation=max(rms(np.concatenate(series)), CHANNELS[name][1]), samples=1.0
        )
        for name, series in problem.missed(x).items()
        if sum(map(len, series))
    }


def _without(
    problem: DrivenFlights, x: Array, kept: tuple[UnknownParameter, ...]
) -> tuple[DrivenFlights, Array]:
    """The fit gone on from `x` with fewer parameters, the others at the vehicle file's."""
    stays = [k for k, p in enumerate(problem.parameters) if p in kept]
    fewer = DrivenFlights(problem.runs, problem.nominal, kept)
    fewer.started = problem.started
    x = x[[*stays, *range(len(problem.parameters), len(x))]]
    x, _ = fewer.fit(x, 1, max_nfev=LOOKS[-1], **ENDS)
    return fewer, x


def cruise_of(runs: Sequence[DrivenRun], vehicle: Vehicle) -> float:
    """Median surge [m/s] of runs by their Doppler logs; the vehicle file's without any."""
    known = [run.velocity[0][run.use & np.isfinite(run.velocity[0])] for run in runs]
    surge = np.concatenate(known)
    return float(np.median(surge)) if surge.size else vehicle.cruise_speed


def judge(runs: Sequence[DrivenRun], calibration: Calibration) -> DrivenErrors:
    """Fly runs with their attitude and compare speed, depth rate, and yaw rate of a second ahead.

    Of a run that has no truth the speed is compared with its Doppler log, less the one current that
    fits it best.

    Raises:
      InputError: no Doppler log, nothing without a gap, or the vehicle does not fly.
    """
    true = all(run.true_velocity is not None for run in runs)
    problem = DrivenFlights(runs, calibration, ())
    x = np.zeros(problem.size)
    for looks in LOOKS:
        x, _ = problem.fit(x, 1, max_nfev=looks, **ENDS)
        problem.started = problem.currents(x)
    speeds, turns, depths = [], [], []
    motions = problem.flown(x)
    for number, rows in problem.pieces:
        run, motion = runs[number], motions[number]
        surge = (
            run.velocity[0] - problem.turned[number][:, 0] @ problem.started[number] * run.ground
        )
        if true and run.true_velocity is not None:
            surge = run.true_velocity[0]
        part = rows["depth_rate"]
        seen = part[np.isfinite(surge[part])]
        if seen.size:
            speeds.append((motion.velocity.surge[seen].mean(), surge[seen].mean()))
        lead = rows["yaw_rate"]
        turns.append((ahead(run, motion, 2)[lead], run.rates[2, lead]))
        depths.append((motion.depth_rate[part] - run.depth_rate[part], run.depth_rate[part]))
    if not speeds:
        raise InputError("these runs have no velocity by a Doppler log to judge a vehicle by")
    model, real = np.array(speeds).T
    known = np.abs(real) > SLOWEST
    (turn_off, turn), (depth_off, depth) = (
        [rms(np.concatenate(part)) for part in zip(*pairs, strict=True)]
        for pairs in (turns, depths)
    )
    off = np.abs(model - real)[known]
    return DrivenErrors(
        speed=float(np.mean(off / np.abs(real[known]))),
        turn_rate=turn_off / turn,
        depth_rate=depth_off / depth,
        speed_m_s=float(np.mean(off)),
        turn_rate_rad_s=turn_off,
        depth_rate_m_s=depth_off,
        pieces=len(problem.pieces),
        against="truth" if true else "log",
    )
