"""Driven fit: parameters of a propelled vehicle from its own runs, and their errors on other runs.

vehicle = load_vehicle("remus")
runs = load_runs("bag.zarr", vehicle)
found = identify_driven(runs[:-1], vehicle)
judge(runs[-1:], found.calibration), judge(runs[-1:], found.nominal)

Parameters are factors on numbers of a vehicle file, with the file's names: a derivative of the hull
law such as Xuu, the lift slope of a fin, the thrust of the propeller. Prior spreads are differences
between published numbers of one vehicle: Prestero's thesis has two values for the drag of REMUS 100
(table 8.2: adjusted by a factor of 2.4), and MBARI two for the fins, the cross flow and the damping
of Tethys (`assets/tethys.xml`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from twin.errors import InputError
from twin.identify.answer import DRIVEN, Identification, answer_of
from twin.identify.calibration import Array, Calibration
from twin.identify.comparison import ResidualNoise, rms
from twin.identify.driven_flights import CHANNELS, DrivenFlights
from twin.identify.driven_runs import DrivenRun
from twin.identify.fit import UNDETERMINED, free_of
from twin.identify.unknowns import UnknownParameter, choose, with_known
from twin.vehicle.laws import BodyAxes
from twin.vehicle.laws.body_axes import added_mass_coupling
from twin.vehicle.parts import Fin, Part, Propeller
from twin.vehicle.vehicle import Vehicle, parse_vehicle

DEGREE = math.pi / 180.0
DERIVATIVES = {
    "Xuu": ("drag straight ahead", 0.3),
    "Yuv": ("side force of sideslip, hull and fins at rest", 0.3),
    "Zuw": ("lift of the angle of attack, hull and fins at rest", 0.3),
    "Nuv": ("yaw moment of sideslip, Munk's and that of the fins at rest", 0.3),
    "Muw": ("pitch moment of the angle of attack, likewise", 0.3),
    "Nur": ("yaw damping that grows with the speed", 0.5),
    "Muq": ("pitch damping that grows with the speed", 0.5),
    "Yvv": ("drag of the cross flow, sideways", 0.5),
    "Zww": ("drag of the cross flow, downwards", 0.5),
    "Nrr": ("yaw damping by the cross flow", 0.5),
    "Mqq": ("pitch damping by the cross flow", 0.5),
    "Yur": ("side force of turning at speed", 0.3),
    "Zuq": ("lift of pitching at speed", 0.3),
    "Nvv": ("yaw moment of the cross flow", 0.3),
    "Mww": ("pitch moment of the cross flow", 0.3),
    "Xvv": ("drag of sideslip", 0.1),
    "Xww": ("drag of the angle of attack", 0.1),
    "Xvr": ("added mass sideways in a turn, along the hull", 0.1),
    "Xwq": ("added mass downwards while pitching, along the hull", 0.1),
}
"""Derivatives of the law in body axes: meaning, and spread of the factor's logarithm. The last
eight lower the speed in a turn, and runs hardly determine them. If they were fixed at wrong numbers
of a file, thrust and drag would be wrong, with too small standard deviations."""
ADDED_MASSES = (
    (0, "surge", "mass along the hull", 0.3),
    (1, "sway", "mass sideways", 0.1),
    (2, "heave", "mass downwards", 0.1),
    (4, "pitch", "inertia in pitch", 0.1),
    (5, "yaw", "inertia in yaw", 0.1),
)
"""Index in the matrix, name, meaning, and spread of the factor's logarithm: strip theory and an
ellipsoid of the hull's size differ by a tenth across the hull, by more along it"""
THRUST_SPREAD, LIFT_SPREAD = 0.2, 0.3
"""[1] Standard deviation of a logarithm. THRUST_SPREAD: factor on thrust. LIFT_SPREAD: factor on a
fin's lift slope"""
NEUTRAL_SPREAD = 2.0
"""[deg] Spread of the neutral position of fins"""
PLACE_SPREAD = 3.0
"""[mm] Spread of the centre of gravity along the hull after trimming"""
ARM_SPREAD = 0.3
"""[1] Spread of the righting arm's logarithm"""
UNSURE = 3.0
"""Factor on the spreads of a vehicle that was made from its dimensions alone"""


def driven_parameters(vehicle: Vehicle, unsure: float = 1.0) -> tuple[UnknownParameter, ...]:
    """Parameters of a vehicle that can be estimated: numbers in its file.

    Args:
      vehicle: the vehicle to start from.
      unsure: factor on all spreads except the trim's.

    Raises:
      InputError: no propeller, or another hull law than `body-axes`.
    """
    driving, law = vehicle.steered("speed"), vehicle.law
    if not isinstance(driving, Propeller):
        raise InputError(
            f"vehicle {vehicle.name!r} has no propeller (parts: {', '.join(vehicle.part_names)}): "
            "a buoyancy glider is identified by its depth rate"
        )
    if not isinstance(law, BodyAxes):
        raise InputError(
            f"vehicle {vehicle.name!r} has the hull law {law.kind!r}: under a propeller only "
            f"{BodyAxes.kind!r} is identified; start from remus or tethys (--vehicle)"
        )
    known = _derivatives(vehicle)
    factors = [
        _factor(name, what, spread, partial(_derivative, name), partial(_with_derivative, name))
        for name, (what, spread) in DERIVATIVES.items()
        if known.get(name)
    ]
    for k, name, what, spread in ADDED_MASSES:
        if vehicle.added_mass[k, k] > 0.0:
            own = partial(_added_mass, k), partial(_with_added_mass, k)
            factors.append(_factor(f"added_mass_{name}", f"added {what}", spread, *own))
    factors.append(_of_part(driving, "thrust_coefficient", "thrust at rest", THRUST_SPREAD))
    if unsure > 1.0 and driving.zero_thrust_advance > 0.0:
        what = "advance without thrust"
        factors.append(_of_part(driving, "zero_thrust_advance", what, THRUST_SPREAD))
    for control in ("heading", "pitch"):
        part = vehicle.steered(control)
        if isinstance(part, Fin):
            factors.append(_of_part(part, "lift_slope", "lift of a deflection", LIFT_SPREAD))
            factors.append(_neutral(part.name))
    factors.append(CG_X)
    if vehicle.metacentric_height > 0.0:
        factors.append(RIGHTING_ARM)
    (trim,) = choose(["neutral_density"])  # with a glider's spread
    return (trim, *(dataclasses.replace(p, spread=unsure * p.spread) for p in factors))


def _factor(
    name: str,
    what: str,
    spread: float,
    get: Callable[[Vehicle], float],
    put: Callable[[Calibration, float], Calibration],
) -> UnknownParameter:
    """Make a parameter that is a factor on a number of the vehicle file."""

    def own(calibration: Calibration) -> float:
        return get(parse_vehicle(calibration.vehicle.xml, calibration.vehicle.path))

    return UnknownParameter(
        name, "1", f"{what}, over the vehicle file's", spread,
        lambda c: get(c.vehicle) / own(c), lambda c, x: put(c, x * own(c)), logarithmic=True,
    )  # fmt: skip


def _derivatives(vehicle: Vehicle) -> dict[str, float]:
    assert isinstance(vehicle.law, BodyAxes)
    return dict(vehicle.law.derivatives)


def _derivative(name: str, vehicle: Vehicle) -> float:
    return _derivatives(vehicle)[name]


def _with_derivative(name: str, calibration: Calibration, value: float) -> Calibration:
    numbers = _derivatives(calibration.vehicle) | {name: value}
    return calibration.with_vehicle(derivatives=tuple(numbers.items()))


def _added_mass(k: int, vehicle: Vehicle) -> float:
    return float(vehicle.added_mass[k, k])


def _with_added_mass(k: int, calibration: Calibration, value: float) -> Calibration:
    matrix, law = calibration.vehicle.added_mass.copy(), calibration.vehicle.law
    matrix[k, k] = value
    assert isinstance(law, BodyAxes)
    coupled = {"coupling": added_mass_coupling(matrix)} if law.coupling else {}
    return calibration.with_vehicle(added_mass=matrix, **coupled)


def _number(part: str, field: str, vehicle: Vehicle) -> float:
    return float(getattr(vehicle.part(part), field))


def _of_part(part: Part, field: str, what: str, spread: float) -> UnknownParameter:
    name = part.name
    return _factor(
        f"{name}.{field}", f"{what} of the {name}", spread,
        partial(_number, name, field),
        lambda c, x: c.with_vehicle(**{name: {field: x}}),
    )  # fmt: skip


def _neutral(name: str) -> UnknownParameter:
    """Make a parameter for the reading of a fin that is in line with the hull."""
    return UnknownParameter(
        f"{name}.neutral", "degree", f"reading of the {name} in line with the hull", NEUTRAL_SPREAD,
        lambda c: _number(name, "neutral", c.vehicle) / DEGREE,
        lambda c, x: c.with_vehicle(**{name: {"neutral": x * DEGREE}}),
    )  # fmt: skip


def _first_moment(vehicle: Vehicle) -> float:
    """First moment [kg m] of all masses along the hull, with parts at position 0."""
    moved = sum(m.mass * m.neutral_x for m in vehicle.masses)
    return vehicle.static_mass * float(vehicle.static_cg[0]) + moved


def _moved(calibration: Calibration, axis: int, moment: float) -> Calibration:
    """Move the hull's centre of gravity along an axis by a moment [kg m]."""
    place = calibration.vehicle.static_cg.copy()
    place[axis] += moment / calibration.vehicle.static_mass
    return calibration.with_vehicle(static_cg=place)


# fmt: off
CG_X = UnknownParameter(
    "cg_x", "mm", "centre of gravity ahead of the centre of buoyancy, parts at rest", PLACE_SPREAD,
    lambda c: 1e3 * _first_moment(c.vehicle) / c.vehicle.mass,
    lambda c, x: _moved(c, 0, 1e-3 * x * c.vehicle.mass - _first_moment(c.vehicle)))
RIGHTING_ARM = UnknownParameter(
    "righting_arm", "mm", "centre of gravity below the centre of buoyancy", ARM_SPREAD,
    lambda c: 1e3 * c.vehicle.metacentric_height,
    lambda c, x: _moved(c, 2, (1e-3 * x - c.vehicle.metacentric_height) * c.vehicle.mass),
    logarithmic=True)
# fmt: on


LEAST_PIECES = 6
"""Minimum number of windows of 20 s for a fit: two minutes"""
LARGEST_UNCERTAINTY = 0.95
"""[1] Largest standard deviation, as a fraction of the spread, of a parameter that the runs
determine; beyond, the parameter stays the vehicle file's"""
LOOKS = (5, 3, 3)
"""Evaluations in each fit; weights and the runs' initial currents are set again after each fit"""
FAR_LOOKS = (15, 15)
"""Evaluations in each fit before these, for a vehicle made from its dimensions alone"""
ENDS: dict[str, Any] = {"xtol": 1e-2, "ftol": 1e-3}
FAR_ENDS: dict[str, Any] = {"xtol": 1e-4, "ftol": 1e-5}
TOGETHER = "with the others only: the runs do not determine it"
SLOWEST = 0.1
"""[m/s] Speed below which a vehicle counts as still"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DrivenErrors:
    """Errors of simulated runs that the vehicle's fit has not used."""

    speed: float
    """[1] Mean magnitude of the relative error of a window's mean surge"""
    turn_rate: float
    """[1] RMS error of the yaw rate, divided by the RMS yaw rate"""
    depth_rate: float
    """[1] RMS error of the depth rate, divided by the RMS depth rate"""
    speed_m_s: float
    """[m/s] Mean magnitude of the error of a window's mean surge"""
    turn_rate_rad_s: float
    """[rad/s] RMS error of the yaw rate"""
    depth_rate_m_s: float
    """[m/s] RMS error of the depth rate"""
    pieces: int
    """Number of compared windows of 20 s"""
    against: str
    """Source of the compared values: "truth" of a simulated store, or "log", measured"""

    def describe(self) -> dict[str, Any]:
        """Figures as plain values for JSON."""
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
      runs: runs of one vehicle, of one sample period.
      vehicle: the vehicle to start from.
      parameters: names to estimate; by default all of `driven_parameters`.
      known: values that are known and not estimated, by name.
      unsure: factor on the spreads, see `driven_parameters`.
      progress: called with the fraction done, 0 to 1.

    Raises:
      InputError: an unknown parameter, too few runs, or a vehicle that cannot fly the runs.
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
    held = [p for p in everything if p not in wanted and p.name not in (known or {})]  # not listed
    covariance = problem.fitted(x).covariance
    before = {p.name: float(np.sqrt(covariance[k, k])) for k, p in enumerate(free)}
    moved = problem.considered(x, held)[1]
    covariance = covariance + moved @ moved.T
    for name, off in before.items():
        if off > LARGEST_UNCERTAINTY:
            notes[name] = f"the runs leave it to {100.0 * off:.0f} % of what was known"
    kept = tuple(p for p in free if p.name not in notes)
    if not kept:
        raise InputError(
            "the runs say nothing of any parameter: they need turns, dives and other speeds"
        )
    if kept != free:
        rows = [k for k, p in enumerate(free) if p in kept]
        covariance = covariance[np.ix_(rows, rows)]  # with undetermined parameters fitted too
        x, started = x[[*rows, *range(len(free), len(x))]], problem.started
        problem = DrivenFlights(runs, nominal, kept)
        problem.started = started
        x, _ = problem.fit(x, 1, max_nfev=LOOKS[-1], **ENDS)
    progress(1.0)
    covariance = covariance[: len(kept), : len(kept)]
    determined = (np.sqrt(np.diag(covariance)) <= UNDETERMINED).tolist()
    answers = [(sure, "" if sure else TOGETHER) for sure in determined]
    noise = problem.reweight(x)["depth_rate"]
    found = answer_of(problem, x, runs, wanted, notes, before, covariance, answers, noise, DRIVEN)
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
    """Fit the parameters; return the problem with its weights, and the offsets.

    From a `far` start, every manoeuvre would look like an outlier without weight. So in the first
    fits all residuals of a channel have equal weights.
    """
    problem = DrivenFlights(runs, nominal, parameters)
    x = np.zeros(problem.size)
    stages = [(looks, True) for looks in FAR_LOOKS if far] + [(looks, False) for looks in LOOKS]
    for k, (looks, plain) in enumerate(stages):
        first = _equal_weights(problem, x) if plain else None
        x, _ = problem.fit(x, 1, first=first, max_nfev=looks, **(FAR_ENDS if plain else ENDS))
        problem.started = problem.currents(x)
        progress((k + 1) / len(stages))
    problem.reweight(x)
    return problem, x


def _equal_weights(problem: DrivenFlights, x: Array) -> dict[str, ResidualNoise]:
    """Noise of each channel that gives all its residuals equal weights."""
    return {
        name: ResidualNoise(
            deviation=max(rms(np.concatenate(series)), CHANNELS[name][1]), samples=1.0
        )
        for name, series in problem.missed(x).items()
        if sum(map(len, series))
    }


def cruise_of(runs: Sequence[DrivenRun], vehicle: Vehicle) -> float:
    """Median surge [m/s] of runs by their Doppler logs; without logs, the vehicle file's speed."""
    known = [run.velocity[0][run.use & np.isfinite(run.velocity[0])] for run in runs]
    surge = np.concatenate(known)
    return float(np.median(surge)) if surge.size else vehicle.cruise_speed


def judge(runs: Sequence[DrivenRun], calibration: Calibration) -> DrivenErrors:
    """Simulate runs with the measured attitude; compare speed, depth rate and yaw rate 1 s ahead.

    The speed of a run without truth is compared with its Doppler log minus the constant current
    that fits the run best.

    Raises:
      InputError: no Doppler log, no window without a gap, or the vehicle cannot fly the runs.
    """
    true = all(run.true_velocity is not None for run in runs)
    problem = DrivenFlights(runs, calibration, ())
    x = np.zeros(problem.size)
    for looks in LOOKS:
        x, _ = problem.fit(x, 1, max_nfev=looks, **ENDS)
        problem.started = problem.currents(x)
    speeds, motions, missed = [], problem.flown(x), problem.missed(x)
    for number, rows in problem.pieces:
        run, part = runs[number], rows["depth_rate"]
        surge = (
            run.velocity[0] - problem.turned[number][:, 0] @ problem.started[number] * run.ground
        )
        if true and run.true_velocity is not None:
            surge = run.true_velocity[0]
        seen = part[np.isfinite(surge[part])]
        if seen.size:
            speeds.append((motions[number].velocity.surge[seen].mean(), surge[seen].mean()))
    if not speeds:
        raise InputError("these runs have no velocity by a Doppler log to judge a vehicle by")
    model, real = np.array(speeds).T
    known = np.abs(real) > SLOWEST
    off = np.abs(model - real)[known]
    turn_off, depth_off = (rms(np.concatenate(missed[n])) for n in ("yaw_rate", "depth_rate"))
    turns = [runs[k].rates[2, rows["yaw_rate"]] for k, rows in problem.pieces]
    depths = [runs[k].depth_rate[rows["depth_rate"]] for k, rows in problem.pieces]
    return DrivenErrors(
        speed=float(np.mean(off / np.abs(real[known]))),
        turn_rate=turn_off / rms(np.concatenate(turns)),
        depth_rate=depth_off / rms(np.concatenate(depths)),
        speed_m_s=float(np.mean(off)),
        turn_rate_rad_s=turn_off,
        depth_rate_m_s=depth_off,
        pieces=len(problem.pieces),
        against="truth" if true else "log",
    )
