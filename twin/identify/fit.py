"""Fit: parameters of a vehicle from its own logs, by robust least squares with what is known.

Each parameter has its nominal value and spread beside what the logs say
(`twin.identify.comparison`),
so that what a log cannot tell stays where it was.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from twin.errors import InputError
from twin.identify.answer import Identification, IdentifiedParameter
from twin.identify.calibration import Calibration
from twin.identify.comparison import (
    LEAST_DEVIATIONS,
    LEAST_DIVES,
    LEAST_GAIN,
    ResidualNoise,
    gain_of,
)
from twin.identify.depth_rates import LEAST_PAIRS, DepthRates
from twin.identify.logged_missions import Log, gliding
from twin.identify.speed import FlightModel
from twin.identify.unknowns import PARAMETERS, UnknownParameter, choose
from twin.vehicle.parts.pump import CUBIC_CM

Array = NDArray[np.float64]

LEAST_SAMPLES = 100
"""Samples under water below which nothing is fitted: a single short dive has more."""
UNDETERMINED = 0.7
"""Part of its spread that a parameter's deviation must fall below to count as determined: the log
then says as much as what was known before."""
ALWAYS = ("neutral_density", "drag")
"""Without these two nothing flies as the log does: never kept at nominal."""
PASSES = 3
"""Fits between which weights, deviation and autocorrelation time are taken again."""
COARSE: dict[str, Any] = {"max_nfev": 8, "xtol": 1e-2, "ftol": 1e-2}
FINE: dict[str, Any] = {"max_nfev": 12, "xtol": 1e-4, "ftol": 1e-5}
"""Ends of a search: offsets are in spreads, and a deviation is hardly below a hundredth of one."""
AT_BOUND = 1e-3
"""Spreads from its bound at which a parameter is called bounded."""
HULLS_DIFFER = 1.5e-10
"""[1/Pa] from one metal hull to the next: 4e-10 to 7e-10"""
DRIFT = 20.0
"""[cm3] that the displaced volume is uncertain by and that changes with depth as a hull's does: air
in the oil, pumped volume, salinity, temperature of the hull"""
USUAL_RMSE = {"slocum": 0.8, "seaglider": 1.2}
"""[cm/s] of depth rate that a fit leaves, by the kind's shipped names: medians of four and seven
public logs, off inflections (docs/results/real_logs.md)"""
OTHERS_RMSE = 1.0
"""[cm/s] likewise, of every other kind"""
BAD = 5.0
"""Times what is usual from which on a fit is refused"""
WORST = 4
"""Missions that its message names"""
MOVING = 0.05
"""[m/s] of depth rate from which a glider sinks or rises."""
START_FACTORS = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Drag over nominal at which the search starts."""
START_LOGS = 3
"""Missions that the search for a start looks at."""


def identify(
    logs: Sequence[Log],
    nominal: Calibration,
    *,
    parameters: Sequence[str] | None = None,
    known: Sequence[str] = (),
    model: FlightModel = "flight",
    fixes: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Identification:
    """Estimate a vehicle's parameters from its logs.

    Args:
      logs: missions of one vehicle, of one sample period.
      nominal: vehicle file to start from, with the sensors' known errors.
      parameters: names to estimate; by default all that the logs may determine, and a pitch offset
        where left-out dives are predicted better with it (`twin.identify.comparison`).
      known: names whose nominal value is known; not estimated.
      model: "flight", with inertia; "steady", forces in balance. Both are compared with the log
        where pump and pitch rest: an inflection says more about the pump than about the hull.
      fixes: compare the currents between fixes too. Without it nothing but the depth rate is used.
      progress: called with the part done, 0 to 1.

    Raises:
      InputError: an unknown parameter, too little data, or no fit that flies.
    """
    logs, powered = gliding(logs)
    wanted = choose(list(parameters)) if parameters is not None else PARAMETERS
    report = progress or (lambda part: None)
    if "neutral_density" not in known:
        nominal = centred(logs, nominal)
    choose(list(known))
    notes: dict[str, str] = {}
    problem = DepthRates(logs, nominal, (), model, fixes=fixes)
    samples = sum(int(mask.sum()) for mask in problem.masks)
    if samples < LEAST_SAMPLES:
        raise InputError(
            f"only {samples} samples of steady or measured flight under water in "
            f"{len(logs)} missions; identification needs at least {LEAST_SAMPLES}"
        )
    for parameter in wanted:
        lacking = "given as known"
        if parameter.name not in known:
            lacking = _lacking(parameter, logs, problem, asked=parameters is not None)
        if lacking:
            notes[parameter.name] = lacking
    judged = tuple(p for p in wanted if p.name not in notes and p.channel == "dives")
    if parameters is not None:
        judged = ()
    free = tuple(p for p in wanted if p.name not in notes and p not in judged)
    if not free:
        reasons = ", ".join(f"{name}: {why}" for name, why in notes.items())
        raise InputError(f"nothing is left to estimate ({reasons or 'no parameter asked for'})")
    report(0.05)
    start = _start(logs, nominal, free, model)
    report(0.15)
    first = DepthRates(logs, nominal, free, model, fixes=fixes)
    x, covariance, _ = _solve(first, start, PASSES - 1, lambda part: report(0.15 + 0.5 * part))
    deviation = np.sqrt(np.diag(covariance))
    loose = [
        p.name
        for p, d in zip(free, deviation, strict=True)
        if d > UNDETERMINED and p.name not in ALWAYS
    ]
    before = dict(zip((p.name for p in free), deviation, strict=True))
    for name in loose:
        notes[name] = "the log does not determine it"
    kept = tuple(p for p in free if p.name not in loose)
    offsets = dict(zip(free, x, strict=True))
    for candidate in judged:
        tight = DepthRates(logs, nominal, kept, model, fixes=fixes)
        at = np.array([offsets[p] for p in kept])
        tight.reweight(at)
        notes[candidate.name] = _unsupported(tight, at, candidate)
        if not notes[candidate.name]:
            offsets[candidate] = 0.0
            kept = tuple(p for p in PARAMETERS if p in (*kept, candidate))
    final = DepthRates(logs, nominal, kept, model, fixes=fixes)
    x = np.array([offsets[p] for p in kept])
    x, covariance, noise = _solve(final, x, PASSES, lambda part: report(0.65 + 0.35 * part))
    found = _result(final, x, covariance, wanted, notes, before, noise)
    _check_residual(final, x, found, powered)
    return dataclasses.replace(found, powered=powered)


def _check_residual(
    problem: DepthRates, x: Array, found: Identification, powered: tuple[int, ...]
) -> None:
    """Refuse a fit that says that something else than the vehicle made the depth rate."""
    name = found.nominal.vehicle.name
    usual = next((cm for kind, cm in USUAL_RMSE.items() if name.startswith(kind)), OTHERS_RMSE)
    if 100.0 * found.depth_rate_rmse <= BAD * usual:
        return
    residuals = problem.missed(x)["depth_rate"]
    way = {"dives": 1.0, "climbs": -1.0}
    sides = []
    for side, sign in way.items():
        parts = [
            r[sign * log.depth_rate[mask] > MOVING]
            for r, log, mask in zip(residuals, problem.logs, problem.masks, strict=True)
        ]
        if (rest := np.concatenate(parts)).size:
            sides.append(f"{100.0 * float(rest.mean()):+.1f} cm/s in {side}")
    sizes = [float(np.sqrt(np.mean(r**2))) if r.size else 0.0 for r in residuals]
    worst = sorted(np.argsort(sizes)[::-1][:WORST].tolist())
    listed = ", ".join(f"{problem.logs[k].index} ({100.0 * sizes[k]:.1f})" for k in worst)
    raise InputError(
        f"the fit leaves {100.0 * found.depth_rate_rmse:.1f} cm/s of depth rate, "
        f"{100.0 * found.depth_rate_rmse / usual:.0f} times what is usual ({usual:g} cm/s): model "
        f"less log is {' and '.join(sides) or 'undecided'}, worst in mission {listed}. Look at "
        "these: a propeller that the log does not tell of (opposite signs in dives and climbs), a "
        "vehicle that was re-ballasted or fouled in between (a part of --missions then fits), the "
        "unit and sign of the pump (cm3, + = lighter), the pitch sensor, and whether "
        f"{name!r} is its kind (--vehicle)"
    )


def centred(logs: Sequence[Log], nominal: Calibration) -> Calibration:
    """Start the trim where the vehicle would neither sink nor rise."""
    density = nominal.water_density
    densities = [np.median(log.density) for log in logs if log.density is not None]
    if densities:
        density = float(np.median(densities))
    vehicle = nominal.vehicle
    volume = vehicle.mass / density - CUBIC_CM * _neutral_pump(logs)
    return nominal.replace(vehicle=vehicle.replace(reference_density=vehicle.mass / volume))


def _neutral_pump(logs: Sequence[Log]) -> float:
    """Pumped volume [cm3] of no vertical force: what the log sinks and rises with, parted as the
    squares of the depth rates, which forces go with; 0 where it does not both sink and rise."""
    pump, rate = (
        np.concatenate([values[log.use] for log, values in pairs])
        for pairs in ([(g, g.pump) for g in logs], [(g, g.depth_rate) for g in logs])
    )
    sides = [(side * rate) > MOVING for side in (1.0, -1.0)]
    if not all(side.any() for side in sides):
        return 0.0
    (sink, down), (rise, up) = ((np.median(pump[s]), np.median(rate[s]) ** 2) for s in sides)
    return float((sink * up + rise * down) / (down + up))


def _lacking(
    parameter: UnknownParameter, logs: Sequence[Log], problem: DepthRates, *, asked: bool
) -> str:
    """Why the logs cannot tell anything about a parameter; empty when they may."""
    channel = parameter.channel
    if channel == "temperature" and any(log.temperature is None for log in logs):
        return "the log has no temperature"
    if channel == "pressure" and not asked:
        return _too_shallow(logs, problem.nominal)
    if parameter.name.startswith("heading") and not problem.pairs:
        return f"fewer than {LEAST_PAIRS} pairs of consecutive missions with fixes"
    if channel == "fixes" and not problem.pairs and not asked:
        return "needs fixes, or a request: depth rate alone confuses it with drag"
    if channel == "request" and not asked:
        return "estimated on request only"
    return ""


def _unsupported(problem: DepthRates, x: Array, candidate: UnknownParameter) -> str:
    """Why left-out dives do not support a parameter; empty when they do."""
    if len(problem.logs) < LEAST_DIVES:
        return f"{len(problem.logs)} dives: from {LEAST_DIVES} on, left-out dives judge it"
    gain = gain_of(problem, x, candidate)
    if gain.supported:
        return ""
    return (
        f"it takes {100.0 * max(gain.share, 0.0):.1f} % off the squared error of left-out dives; "
        f"needed are {100.0 * LEAST_GAIN:g} % and {LEAST_DEVIATIONS:g} deviations"
    )


def _too_shallow(logs: Sequence[Log], nominal: Calibration) -> str:
    """Why dives are not deep enough to tell one hull from another; empty when they are."""
    vehicle = nominal.vehicle
    deepest = float(np.median([log.depth[log.use].max(initial=0.0) for log in logs]))
    pressure = vehicle.reference_density * vehicle.gravity * deepest
    differ = HULLS_DIFFER * pressure * vehicle.neutral_volume / CUBIC_CM
    if differ >= DRIFT:
        return ""
    return (
        f"dives to {deepest:.0f} m: hulls differ there by {differ:.0f} cm3, no more than trim, "
        f"pump and density drift ({DRIFT:g} cm3)"
    )


def _start(
    logs: Sequence[Log],
    nominal: Calibration,
    free: tuple[UnknownParameter, ...],
    model: FlightModel,
) -> Array:
    """Offsets to start from: trim and drag fitted to a few missions from several drags."""
    pair = tuple(p for p in free if p.name in ALWAYS)
    if not pair:
        return np.zeros(len(free))
    longest = sorted(logs, key=lambda log: -int(log.use.sum()))[:START_LOGS]
    problem = DepthRates(longest, nominal, pair, model)
    best, cost = np.zeros(len(pair)), np.inf
    for factor in START_FACTORS:
        x = np.array([np.log(factor) if p.name == "drag" else 0.0 for p in pair])
        if not np.isfinite(problem.residual(x)).all():  # flies off: not a start
            continue
        found = least_squares(problem.residual, x, jac=problem.jacobian, loss="soft_l1", **COARSE)
        if found.cost < cost:
            best, cost = found.x, found.cost
    if not np.isfinite(cost):
        raise InputError(
            f"vehicle {nominal.vehicle.name!r} does not fly as this log does with any drag near "
            "its own; is it the right vehicle, and is the pump in cm3 with + = lighter?"
        )
    out = np.zeros(len(free))
    for parameter, value in zip(pair, best, strict=True):
        out[free.index(parameter)] = value
    return out


def _solve(
    problem: DepthRates, x: Array, passes: int, report: Callable[[float], None]
) -> tuple[Array, Array, ResidualNoise]:
    """Robust fit; offsets, their covariance and the noise of the depth rate."""
    x, noise = problem.fit(x, passes, progress=report, **FINE)
    jacobian = problem.jacobian(x)
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian), np.float64)
    return x, covariance, noise["depth_rate"]


def _result(
    problem: DepthRates,
    x: Array,
    covariance: Array,
    wanted: tuple[UnknownParameter, ...],
    notes: Mapping[str, str],
    before: Mapping[str, float],
    noise: ResidualNoise,
) -> Identification:
    calibration, nominal = problem.calibration(x), problem.nominal
    deviation = np.sqrt(np.diag(covariance))
    estimates = []
    names = [p.name for p in problem.parameters]
    for parameter in wanted:
        centre = parameter.get(nominal)
        if parameter.name in names:
            k = names.index(parameter.name)
            estimate = IdentifiedParameter.of(
                parameter,
                nominal=centre,
                value=parameter.get(calibration),
                deviation=float(deviation[k]),
                determined=True,
                note="at its lower bound" if x[k] < problem.lowest[k] + AT_BOUND else "",
            )
        else:
            estimate = IdentifiedParameter.of(
                parameter,
                nominal=centre,
                value=centre,
                deviation=float(before.get(parameter.name, np.nan)),
                determined=False,
                note=notes[parameter.name],
            )
        estimates.append(estimate)
    rates, changes = _unweighted(problem, x)
    rates0, changes0 = _unweighted(problem, np.zeros_like(x))
    samples = len(rates)
    return Identification(
        calibration=calibration,
        nominal=nominal,
        model=problem.model,
        estimates=tuple(estimates),
        correlation=covariance / np.outer(deviation, deviation),
        depth_rate_rmse=float(np.sqrt(np.mean(rates**2))),
        nominal_depth_rate_rmse=float(np.sqrt(np.mean(rates0**2))),
        robust_deviation=noise.deviation,
        correlation_time=noise.samples * problem.logs[0].period,
        samples=samples,
        hours=samples * problem.logs[0].period / 3600.0,
        missions=len(problem.logs),
        current_change=changes,
        nominal_current_change=changes0,
    )


def _unweighted(problem: DepthRates, x: Array) -> tuple[Array, float | None]:
    missed = problem.missed(x)
    changes = np.reshape(missed["current"], (-1, 2))
    median = float(np.median(np.hypot(*changes.T))) if len(changes) else None
    return np.concatenate(missed["depth_rate"]), median
