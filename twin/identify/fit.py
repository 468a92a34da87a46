"""Fit: parameters of a glider from its own logs, by robust least squares with priors.

The prior of each parameter is its nominal value and spread, so that a parameter stays near nominal
where the logs do not determine it (`twin.identify.comparison`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from twin.errors import InputError
from twin.identify.answer import Identification, answer_of
from twin.identify.calibration import Array, Calibration
from twin.identify.comparison import (
    LEAST_DEVIATIONS,
    LEAST_DIVES,
    LEAST_GAIN,
    gain_of,
    rms,
)
from twin.identify.logged_missions import Log, gliding
from twin.identify.residuals import LEAST_PAIRS, DepthRates
from twin.identify.speed import FlightModel
from twin.identify.unknowns import ALWAYS, FLIGHT, NAMES, PARAMETERS, UnknownParameter, choose
from twin.vehicle.parts.pump import CUBIC_CM

LEAST_SAMPLES = 100
"""Minimum number of samples under water for a fit: a single short dive has more."""
UNDETERMINED = 0.7
"""[1] Standard deviation over spread below which a parameter counts as determined: the log then
says as much as what was known before."""
PASSES = 3
"""Number of fits; after each, weights, noise and autocorrelation time are estimated again."""
COARSE: dict[str, Any] = {"max_nfev": 8, "xtol": 1e-2, "ftol": 1e-2}
FINE: dict[str, Any] = {"max_nfev": 12, "xtol": 1e-4, "ftol": 1e-5}
"""Ends of a search. Offsets are in spreads, of which a standard deviation is 0.01 or more."""
AT_BOUND = 1e-3
"""Distance in spreads from its bound below which a parameter is noted as at its bound."""
HULLS_DIFFER = 1.5e-10
"""[1/Pa] Half of the range of metal hulls' compressibility, 4e-10 to 7e-10"""
DRIFT = 20.0
"""[cm3] Uncertainty of the displaced volume that changes with depth as a hull's does: air in the
oil, pumped volume, salinity, temperature of the hull"""
ENOUGH_DEEP = 3
"""Dives that must be deep enough to tell one hull from another"""
USUAL_RMSE = {"slocum": 0.8, "seaglider": 1.2}
"""[cm/s] Usual RMS residual of the depth rate, by the first part of shipped names: medians of four
and seven public logs, off inflections (docs/results/real_logs.md)"""
OTHERS_RMSE = 1.0
"""[cm/s] Usual RMS residual of the depth rate for every other kind"""
BAD, WORST = 5.0, 4
"""BAD: multiple of the usual residual above which a fit is refused. WORST: number of dives named"""
STALLED, STALL, FALLING = 0.75, 600.0, 0.02
"""A stalled phase. STALLED: [1] its depth rate over the model's. STALL: [s] its duration. FALLING:
[m/s] its depth rate"""
MOVING = 0.05
"""[m/s] Smallest depth rate of a glider that sinks or rises"""
START_FACTORS, START_LOGS = (0.5, 1.0, 2.0, 4.0, 8.0), 3
"""START_FACTORS: start values of drag over nominal. START_LOGS: number of dives that choose one"""


def identify(
    logs: Sequence[Log],
    nominal: Calibration,
    *,
    parameters: Sequence[str] | None = None,
    known: Sequence[str] = (),
    model: FlightModel = "flight",
    fixes: bool = True,
    progress: Callable[[float], None] = lambda part: None,
) -> Identification:
    """Estimate a vehicle's parameters from its logs.

    Args:
      logs: dives of one vehicle, of one sample period.
      nominal: vehicle file to start from, with the sensors' known errors.
      parameters: names to estimate; by default all that the logs may determine, and a pitch offset
        where left-out dives are predicted better with it (`twin.identify.comparison`).
      known: names whose nominal value is known; not estimated.
      model: "flight", with inertia; "steady", forces in balance. Both are compared with the log
        where pump and pitch rest: an inflection says more about the pump than about the hull.
      fixes: compare the currents between fixes too. False: the depth rate is compared alone.
      progress: called with the fraction done, 0 to 1.

    Raises:
      InputError: an unknown parameter, too little data, or no fit that flies.
    """
    logs, powered = gliding(logs)
    wanted = choose(list(parameters)) if parameters is not None else PARAMETERS
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
        if parameter.name in known:
            notes[parameter.name] = "given as known"
        elif lacking := _lacking(parameter, logs, problem, asked=parameters is not None):
            notes[parameter.name] = lacking
    free = free_of(wanted, notes)
    judged = tuple(p for p in free if p.channel == "dives" and parameters is None)
    free = free_of([p for p in free if p not in judged], notes)
    progress(0.05)
    start = _start(logs, nominal, free, model)
    progress(0.15)
    first = DepthRates(logs, nominal, free, model, fixes=fixes)
    x, _ = first.fit(start, PASSES - 1, progress=lambda part: progress(0.15 + 0.5 * part), **FINE)
    # what is asked for is estimated where the log determines it beside exact values at nominal
    exact = known if parameters is None else NAMES
    deviation = np.sqrt(np.diag(_covariance(first, x, exact)))
    before = dict(zip((p.name for p in free), deviation, strict=True))
    for name, off in before.items():
        if off > UNDETERMINED and name not in ALWAYS:
            notes[name] = "the log does not determine it"
    kept = tuple(p for p in free if p.name not in notes)
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
    x, noise = final.fit(x, PASSES, progress=lambda part: progress(0.65 + 0.35 * part), **FINE)
    covariance = _covariance(final, x, known)
    said = [(True, "at its lower bound" if low else "") for low in x < final.lowest + AT_BOUND]
    found = answer_of(
        *(final, x, logs, wanted, notes, before, covariance, said, noise["depth_rate"]), model
    )
    _check_residual(final, x, found)
    calibration = found.calibration.replace(errors=_flight_errors(final, x, known))
    return dataclasses.replace(
        found, calibration=calibration, powered=powered, stalled=_stalled(final, x)
    )


def free_of(
    wanted: Sequence[UnknownParameter], notes: Mapping[str, str]
) -> tuple[UnknownParameter, ...]:
    """Return the parameters without a note; InputError with all notes where none is left."""
    free = tuple(p for p in wanted if p.name not in notes)
    if not free:
        reasons = ", ".join(f"{name}: {why}" for name, why in notes.items())
        raise InputError(f"nothing is left to estimate ({reasons or 'no parameter asked for'})")
    return free


def _covariance(problem: DepthRates, x: Array, known: Sequence[str]) -> Array:
    """Covariance of the offsets, in spreads, with errors of what is neither fitted nor known."""
    noise, moved = problem.considered(x, _held(problem, known))
    return np.asarray(noise + moved @ moved.T)


def _held(problem: DepthRates, known: Sequence[str]) -> list[UnknownParameter]:
    held = [p for p in PARAMETERS if p not in problem.parameters and p.name not in known]
    return [p for p in held if problem.pairs or not p.name.startswith("heading")]


def _flight_errors(problem: DepthRates, x: Array, known: Sequence[str]) -> dict[str, list[float]]:
    """Independent errors of the fit and of what it held at nominal, as in `Calibration.errors`.

    A held value that is off moves the fit until depth rates agree again. Here it is off by its
    whole spread and not by its usual error: the depth rate does not show an angle that is wrong.
    """
    held, found = _held(problem, known), problem.calibration(x)
    noise, moved = problem.considered(x, held)
    fitted = np.hstack([np.linalg.cholesky(noise), moved / [p.held / p.spread for p in held]])
    rows = [*fitted, *np.eye(len(held), fitted.shape[1], len(x)) * -1.0]
    every = zip([*problem.parameters, *held], rows, strict=True)
    return {
        p.name: [p.deviation(p.get(found), off) for off in row.tolist()]
        for p, row in every
        if p.name in FLIGHT
    }


def _stalled(problem: DepthRates, x: Array) -> tuple[int, ...]:
    """Rows of the dives that sink or rise far slower than the model, as stalled wings do."""
    found: dict[int, bool] = {}
    for k, missed in enumerate(problem.missed(x)["depth_rate"]):
        log, rate = problem.logs[k], problem.logs[k].depth_rate[problem.masks[k]]
        for side in (rate > FALLING, rate < -FALLING):
            if side.sum() * log.period > STALL:
                part = np.median(rate[side]) / np.median((rate + missed)[side])
                found[log.index] = found.get(log.index, False) or bool(part < STALLED)
    return tuple(row for row, slow in found.items() if slow)


def _check_residual(problem: DepthRates, x: Array, found: Identification) -> None:
    """Refuse a fit whose residual is too large for the hull alone to have made the depth rate."""
    name = found.nominal.vehicle.name
    usual = next((cm for kind, cm in USUAL_RMSE.items() if name.startswith(kind)), OTHERS_RMSE)
    if 100.0 * found.depth_rate_rmse <= BAD * usual:
        return
    residuals = problem.missed(x)["depth_rate"]
    sides = []
    for side, sign in (("dives", 1.0), ("climbs", -1.0)):
        parts = [
            r[sign * log.depth_rate[mask] > MOVING]
            for r, log, mask in zip(residuals, problem.logs, problem.masks, strict=True)
        ]
        if (rest := np.concatenate(parts)).size:
            sides.append(f"{100.0 * float(rest.mean()):+.1f} cm/s in {side}")
    sizes = [rms(r) if r.size else 0.0 for r in residuals]
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
    """Return the calibration with the trim at which the logs' vehicle neither sinks nor rises."""
    densities = [np.median(log.density) for log in logs if log.density is not None]
    density = float(np.median(densities)) if densities else nominal.water_density
    mass = nominal.vehicle.mass
    volume = mass / density - CUBIC_CM * _neutral_pump(logs)
    return nominal.with_vehicle(reference_density=mass / volume)


def _neutral_pump(logs: Sequence[Log]) -> float:
    """Pumped volume [cm3] without vertical force, between the medians of sinking and rising. Forces
    grow with the squared depth rates, which weight them; 0 where the logs lack either."""
    pump, rate = (
        np.concatenate([getattr(log, name)[log.use] for log in logs])
        for name in ("pump", "depth_rate")
    )
    sides = [(side * rate) > MOVING for side in (1.0, -1.0)]
    if not all(side.any() for side in sides):
        return 0.0
    (sink, down), (rise, up) = ((np.median(pump[s]), np.median(rate[s]) ** 2) for s in sides)
    return float((sink * up + rise * down) / (down + up))


def _lacking(
    parameter: UnknownParameter, logs: Sequence[Log], problem: DepthRates, *, asked: bool
) -> str:
    """Reason why the logs say nothing about a parameter; empty where they may."""
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
    """Reason why left-out dives do not support a parameter; empty where they do."""
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
    """Reason why dives are too shallow to tell one hull from another; empty where they are not."""
    vehicle = nominal.vehicle
    deepest = sorted(float(log.depth[log.use].max(initial=0.0)) for log in logs)[-ENOUGH_DEEP:][0]
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
    """Offsets to start from: trim and drag fitted to the longest dives from several drags."""
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
    offsets = dict(zip(pair, best, strict=True))
    return np.array([offsets.get(parameter, 0.0) for parameter in free])
