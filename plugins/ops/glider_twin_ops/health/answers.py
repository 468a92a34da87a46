"""Answers: compass, drag, pump and energy of one deployment, with standard deviations.

    said = answer_for("real.zarr", "unit334", load_vehicle("mine.xml"))
    said.drag["value"], said.compass["iron_deg"], said.pump, said.energy

    found = follow_parameters(load_logs("real.zarr"), load_calibration("mine.xml"))
    found.value("drag"), found.deviation("drag")          # after each dive, (dives,)

Drag and compass are state estimates, energy by device is that of `twin energy`, and rate and power
of the pump come from its strokes.

A state estimate is a recursion of `twin identify`. It begins at the vehicle file's values with the
parameters' standard deviations; each dive's residuals and Jacobian (`DepthRates`) update it, and
parameters walk at random from dive to dive. Without walks, the last estimate is the fit to all
dives. Residuals are linearised at the fit without walks. Smoothing adds the later dives to each
dive's estimate (Rauch, Tung and Striebel, AIAA Journal 3, 1965).
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.health.dive_channels import strokes_of
from twin import Vehicle, load_vehicle
from twin.errors import InputError, TwinError
from twin.identify import (
    Calibration,
    DepthRates,
    Log,
    UnknownParameter,
    centred,
    choose,
    gliding,
    identified,
    load_calibration,
    load_logs,
    start_vehicle,
)
from twin.logs import energy_used
from twin.numbers import Array
from twin.records import LogStore
from twin.records.attributes import DIVE
from twin.records.storage import StorePath

FOLLOWED = ("neutral_density", "drag")
"""Parameters that are followed by default, since every glide observes them"""
WALK, LEARNING = 0.01, 8
"""WALK: prior random walk from dive to dive, over the parameter's spread, by water and growth.
LEARNING: number of first dives that scale walk and noise, so that a later fault does not"""
FACTORS = np.exp(np.arange(-2.5, 2.6, 0.5))
"""Factors tried on the walks and on a dive's noise; their logarithms have unit normal priors."""
PASSES = 2
"""Fits to all dives, with new weights each; residuals are linearised at the last"""
ENDS: dict[str, Any] = {"max_nfev": 8, "xtol": 1e-3, "ftol": 1e-4}
"""Stopping rules of the fit; offsets are in spreads"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Beliefs:
    """State estimate of the parameters after each dive; the first axis of arrays is the dive."""

    parameters: tuple[UnknownParameter, ...]
    nominal: tuple[float, ...]
    """Values of the calibration, at which offsets are 0"""
    rows: tuple[int, ...]
    """Rows of the store of the dives that were used"""
    offset: Array
    """Offset from the nominal value in spreads, (dives, parameters)"""
    covariance: Array
    """Covariance of the offsets, (dives, parameters, parameters)"""
    innovation: Array
    """Difference of a dive from the estimate before it, over its standard deviation, along the
    dive's own directions, (dives, parameters); NaN where unobserved"""
    smoothed: Array
    """Offsets by all dives, (dives, parameters)"""
    smoothed_covariance: Array

    def place(self, name: str) -> int:
        """Index of a parameter; InputError where it is not followed."""
        names = [parameter.name for parameter in self.parameters]
        if name not in names:
            raise InputError(f"belief {name!r} is not followed; those are: {', '.join(names)}")
        return names.index(name)

    def value(self, name: str, *, smoothed: bool = False) -> Array:
        """Value of a parameter after each dive, in its unit, (dives,)."""
        k = self.place(name)
        offsets = (self.smoothed if smoothed else self.offset)[:, k]
        return np.array([self.parameters[k].value(self.nominal[k], float(x)) for x in offsets])

    def deviation(self, name: str, *, smoothed: bool = False) -> Array:
        """Standard deviation after each dive, in its unit, (dives,), other numbers being exact."""
        k = self.place(name)
        covariance = (self.smoothed_covariance if smoothed else self.covariance)[:, k, k]
        off, values = self.parameters[k].deviation, self.value(name, smoothed=smoothed)
        return np.array([off(v, s) for v, s in zip(values, np.sqrt(covariance), strict=True)])


def follow_parameters(
    logs: Sequence[Log],
    calibration: Calibration,
    parameters: Sequence[str] = FOLLOWED,
    *,
    walks: float | None = None,
    fixes: bool = True,
) -> Beliefs:
    """Estimate parameters dive after dive, for one vehicle.

    Args:
      logs: dives in order. calibration: first estimate, with the parameters' spreads; the
        neutral density of a file without an identification begins where the logs neither sink nor
        rise, since their sea may differ.
      parameters: names of `twin.identify.unknowns`.
      walks: random walk of each from dive to dive over its spread; default `WALK`, scaled by the
        first dives, as the noise of dives is.
      fixes: use the currents between fixes too, which observe the compass.

    Raises:
      InputError: no dive, an unknown parameter, or a calibration that does not fly.
    """
    used, _ = gliding(logs)
    chosen = choose(list(parameters))
    trimmed = any(one.name == "neutral_density" for one in chosen)
    if trimmed and not identified(calibration.vehicle):
        calibration = centred(used, calibration)
    problem = DepthRates(used, calibration, chosen, fixes=fixes)
    about, _ = problem.fit(np.zeros(len(chosen)), PASSES, **ENDS)
    said = _said(problem, about)
    steps = np.full(len(chosen), WALK if walks is None else walks)
    if walks is None:
        said, steps = _scaled(said, steps)
    offset, covariance, innovation, _ = _filtered(said, steps)
    smoothed, after = _smoothed(offset, covariance, steps)
    return Beliefs(
        parameters=chosen,
        nominal=tuple(one.get(calibration) for one in chosen),
        rows=tuple(log.index for log in used),
        offset=offset,
        covariance=covariance,
        innovation=innovation,
        smoothed=smoothed,
        smoothed_covariance=after,
    )


def _said(problem: DepthRates, about: Array) -> list[tuple[Array, Array]]:
    """J^T J and J^T (J x - r) of each dive's residuals at offsets x."""
    count = len(about)
    found = [(np.zeros((count, count)), np.zeros(count)) for _ in problem.logs]
    for one in problem.residuals(about).values():
        jacobian, values = one.jacobian / one.deviation[:, None], one.values / one.deviation
        for dive in np.unique(one.dives):
            mine = one.dives == dive
            matrix, pulled = found[dive]
            matrix += jacobian[mine].T @ jacobian[mine]
            pulled += jacobian[mine].T @ (jacobian[mine] @ about - values[mine])
    return found


def _scaled(
    said: list[tuple[Array, Array]], steps: Array
) -> tuple[list[tuple[Array, Array]], Array]:
    """Scale the dives' information and the random walk to the first innovations."""

    def louder(noise: float) -> list[tuple[Array, Array]]:
        return [(matrix / noise**2, pulled / noise**2) for matrix, pulled in said]

    def likely(factors: tuple[float, float]) -> float:
        noise, walk = factors
        found = _filtered(louder(noise)[:LEARNING], walk * steps)[3]
        return found - 0.5 * float(np.log(noise) ** 2 + np.log(walk) ** 2)

    noise, walk = max(itertools.product(FACTORS.tolist(), repeat=2), key=likely)
    return louder(noise), walk * steps


def _filtered(
    said: Sequence[tuple[Array, Array]], steps: Array
) -> tuple[Array, Array, Array, float]:
    """Offsets, covariances and innovations after each dive, and the log likelihood of the
    innovations; the first estimate is a unit normal."""
    count = len(steps)
    mean: Array = np.zeros(count)
    covariance: Array = np.eye(count)
    means, covariances, innovations, likely = [], [], [], 0.0
    for matrix, pulled in said:
        covariance = covariance + np.diag(steps**2)
        innovation, width = _innovation(matrix, pulled, mean, covariance)
        innovations.append(innovation)
        likely -= 0.5 * float(np.nansum(innovation**2)) + width
        precision = np.linalg.inv(covariance)
        before = mean
        covariance = np.asarray(np.linalg.inv(precision + matrix), np.float64)
        mean = covariance @ (precision @ before + pulled)
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances), np.array(innovations), likely


def _innovation(
    matrix: Array, pulled: Array, mean: Array, covariance: Array
) -> tuple[Array, float]:
    """Innovation of a dive, whitened, along the eigenvectors of its information.

    The best observed direction is last; unobserved ones are NaN. Returned too is half the logarithm
    of the determinant of its covariance."""
    strength, ways = np.linalg.eigh(matrix)
    told = strength > 1e-9 * max(float(strength.max()), 1e-30)
    found = np.full(len(mean), np.nan)
    ways, strength = ways[:, told], strength[told]
    off = ways.T @ (pulled - matrix @ mean) / strength
    root = np.linalg.cholesky(np.diag(1.0 / strength) + ways.T @ covariance @ ways)
    found[told] = np.linalg.solve(root, off)
    return found, float(np.log(np.diag(root)).sum())


def _smoothed(means: Array, covariances: Array, steps: Array) -> tuple[Array, Array]:
    """Smooth each dive's estimate by the later dives."""
    found, after = means.copy(), covariances.copy()
    walk = np.diag(steps**2)
    for d in range(len(means) - 2, -1, -1):
        ahead = covariances[d] + walk
        gain = covariances[d] @ np.linalg.inv(ahead)
        found[d] = means[d] + gain @ (found[d + 1] - means[d])
        after[d] = covariances[d] + gain @ (after[d + 1] - ahead) @ gain.T
    return found, after


COMPASS = ("heading_offset", "heading_cos", "heading_sin", "heading_cos2", "heading_sin2")
"""Parameters of the compass' deviation, as `Calibration.true_heading` adds them"""
TOLD = 0.7
"""Largest standard deviation of a parameter, over its spread, for an answer"""
HEADINGS = np.arange(0.0, 360.0, 45.0)
"""[degree] Headings at which the compass' deviation is stated"""
DEPTHS = (0.0, 10.0, 30.0, 100.0, 200.0, 400.0, 700.0, 1000.0, 6000.0)
"""[m] Edges of the depths at which a pump's strokes are averaged"""
LEAST_SAMPLES = 3
"""Minimum number of samples of pumping in a range of depths"""
DAY = 86400.0
"""[s] Seconds of a day"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Answers:
    """Answers of a deployment's log beside faults; None where the log lacks them."""

    beliefs: Beliefs | None
    dives: tuple[int, ...]
    """Numbers of the dives of `beliefs`"""
    time: Array
    """[s] Unix time of the begin of each of these dives, (dives,)"""
    compass: dict[str, Any] | None
    """True less compass heading [degree], by heading; and the one-cycle amplitude (iron)"""
    drag: dict[str, Any] | None
    """K_D0 [kg/m] over the dives, and its smoothed change from the first to the last"""
    pump: list[dict[str, float]] | None
    """Rate [cm3/s] and power [W] by depth, with standard deviations of the means"""
    energy: dict[str, Any] | None
    """Energy [kW h] and value of each device"""
    lacking: dict[str, str]
    """Reason for each missing answer"""

    def describe(self) -> dict[str, object]:
        """Return plain values, as `--json` prints them."""
        kept = ("compass", "drag", "pump", "energy")
        return {name: getattr(self, name) for name in kept} | {"unanswered": self.lacking}


def answer_for(
    store: str | StorePath, deployment: str, vehicle: str | Path | Vehicle | None = None
) -> Answers:
    """Compute the answers for one deployment of a store of logs.

    Args:
      vehicle: vehicle that made it, as `glider_twin_ops.health.assess` takes it.

    Raises:
      StoreError: no store of logs.
    """
    lacking: dict[str, str] = {}
    made = start_vehicle(store) if vehicle is None else vehicle
    flown = made if isinstance(made, Vehicle) else load_vehicle(made)

    def tried(name: str, answer: Callable[[], Any]) -> Any:
        try:
            return answer()
        except TwinError as error:
            lacking[name] = str(error)
            return None

    with LogStore(store) as logs:
        rows = logs.missions_of(deployment)
        pump = _pump(logs, rows)
        numbers = np.asarray(logs.array(DIVE) if DIVE in logs else np.arange(len(logs)), float)
        starts = np.asarray(logs.starts)
    if pump is None:
        lacking["pump"] = "the log has no strokes of a pump"
    beliefs = tried(
        "drag",
        lambda: follow_parameters(
            load_logs(store, rows, task="following a vehicle's drag"),
            load_calibration(flown),
            (*FOLLOWED, *COMPASS),
        ),
    )
    used = [] if beliefs is None else list(beliefs.rows)
    dives, time = tuple(int(number) for number in numbers[used]), starts[used]
    compass = None if beliefs is None else _compass(beliefs)
    if compass is None:
        lacking["compass"] = lacking.get("drag", "too few fixes of dives on different headings")
    drag = None
    if beliefs is not None:
        back, off = beliefs.value("drag", smoothed=True), beliefs.deviation("drag", smoothed=True)
        drag = {
            "unit": "kg m-1",
            "dives": list(dives),
            "days": ((time - time[0]) / DAY).tolist(),
            "value": beliefs.value("drag").tolist(),
            "deviation": beliefs.deviation("drag").tolist(),
            "change": float(back[-1] / back[0] - 1.0),
            "change_deviation": float(math.hypot(off[-1] / back[-1], off[0] / back[0])),
        }
    return Answers(
        beliefs=beliefs,
        dives=dives,
        time=time,
        compass=compass,
        drag=drag,
        pump=pump,
        energy=tried("energy", lambda: _energy(store, rows, flown)),
        lacking=lacking,
    )


def _compass(beliefs: Beliefs) -> dict[str, Any] | None:
    """Deviation by heading after the last dive; None where unobserved."""
    places = [beliefs.place(name) for name in COMPASS]
    spread = np.array([beliefs.parameters[k].spread for k in places])
    value = np.array([beliefs.value(name)[-1] for name in COMPASS])
    covariance = beliefs.covariance[-1][np.ix_(places, places)] * np.outer(spread, spread)
    one_cycle = np.sqrt(np.diag(covariance))[1:3]
    if (one_cycle > TOLD * spread[1:3]).any():
        return None
    turn = np.deg2rad(HEADINGS)
    waves = (np.ones_like(turn), np.cos(turn), np.sin(turn), np.cos(2 * turn), np.sin(2 * turn))
    basis = np.stack(waves, axis=1)
    off = np.sqrt(np.einsum("hi,ij,hj->h", basis, covariance, basis))
    cosine, sine = value[1:3]
    iron = math.hypot(cosine, sine)
    along = np.array([cosine, sine]) / max(iron, 1e-12)
    return {
        "iron_deg": iron,
        "iron_deviation_deg": float(np.sqrt(along @ covariance[1:3, 1:3] @ along)),
        "largest_at_deg": math.degrees(math.atan2(sine, cosine)) % 360.0,
        "by_heading": [
            {"heading_deg": float(h), "deviation_deg": float(d), "standard_deviation_deg": float(s)}
            for h, d, s in zip(HEADINGS, basis @ value, off, strict=True)
        ],
    }


def _pump(logs: LogStore, rows: list[int]) -> list[dict[str, float]] | None:
    """Rate and power of pumping out, by depth."""
    signals = ("depth", "pump", "pump_power", "voltage", "battery_current")
    names = [f"measured_{name}" for name in signals]
    if any(name not in logs for name in names[:2]):
        return None
    blocks = {name: logs.rows(name, rows) for name in names if name in logs}
    depths, rates, powers = [], [], []
    for k, row in enumerate(rows):
        told = {name: block[k, : logs.samples[row]].astype(float) for name, block in blocks.items()}
        rate, _, pumping = strokes_of(told["measured_pump"], logs.period)
        power = told.get("measured_pump_power")
        if power is None and {"measured_voltage", "measured_battery_current"} <= told.keys():
            taken = told["measured_voltage"] * told["measured_battery_current"]
            power = taken - np.nanmedian(taken) if np.isfinite(taken).any() else None
        depths.append(told["measured_depth"][pumping])
        rates.append(rate[pumping])
        powers.append(np.full(int(pumping.sum()), math.nan) if power is None else power[pumping])
    depth, rate, power = (np.concatenate(parts) for parts in (depths, rates, powers))
    found = []
    for above, below in itertools.pairwise(DEPTHS):
        inside = (depth >= above) & (depth < below) & np.isfinite(rate)
        if inside.sum() < LEAST_SAMPLES:
            continue
        one = {"from_m": above, "to_m": below, "samples": int(inside.sum())}
        for name, values in (("rate_cm3_s", rate[inside]), ("power_w", power[inside])):
            values = values[np.isfinite(values)]
            if len(values) >= LEAST_SAMPLES:
                one[name] = float(np.mean(values))
                one[f"{name}_deviation"] = float(np.std(values, ddof=1) / math.sqrt(len(values)))
        found.append(one)
    return found or None


def _energy(store: str | StorePath, rows: list[int], vehicle: Vehicle) -> dict[str, Any]:
    """Energy of the dives by device, as `twin energy`."""
    used = energy_used(store, vehicle, missions=rows)
    devices = {
        one.name: {
            "energy_kwh": one.energy / 3.6e6,
            "value": one.value,
            "deviation": one.deviation if math.isfinite(one.deviation) else None,
            "unit": one.unit,
        }
        for one in used.terms
    }
    return {"power_w": used.power, "devices": devices}
