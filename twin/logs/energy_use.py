"""Energy use: energy taken by a deployment's electronics, pump, drives, payload and thruster.

use = energy_used("real.zarr")
use.terms, use.consumption, use.power

The counted charge times the voltage is a sum of known times and works, each with a factor:

    energy = hotel t + surface t_afloat + payload t_sampling + pump (p + vacuum) V_out
             + pump loss V_out + pump return V_in + drives W + propeller W + thruster E

Each term begins with its factor. p is the pressure outside, V_out and V_in the volumes pumped out
and in. W is the lossless work of moving masses or the propeller. E is the energy of a glider's
thruster, from its logged current.
Factors are fitted by bounded least squares over intervals of five minutes. Their standard
deviations come from whole dives, since errors of neighbouring intervals are correlated. A factor
that the log does not determine keeps the vehicle's value.

The power of a dive is a level plus noise. The level is a random walk with a slope, such as that of
a weakening pump (Durbin and Koopman 2012, Time Series Analysis by State Space Methods, chapter 3).
Results are averaged over sizes of the walk, weighted by likelihood: few dives give a wider interval
than many.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twin.errors import InputError
from twin.identify.logged_missions import start_vehicle
from twin.logs.energy_timeline import (
    CHARGE,
    COULOMBS,
    FACTORS,
    INTERVAL,
    Array,
    DiveCharge,
    EnergyTimeline,
    NotCounted,
    least_squares,
)
from twin.records.logged import LogStore
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath
from twin.vehicle.consumption import Consumption
from twin.vehicle.vehicle import Vehicle, load_vehicle

LARGEST_DUTY = 0.97
"""[1] If a payload is on, or off, for a larger fraction of the time, its power is not fitted"""
LARGEST_UNCERTAINTY = 0.5
"""[1] Largest standard deviation, as a fraction of the value, of a factor that a log determines"""
MOST_KWH = 1e4
"""[kW h] Largest energy left that is accepted"""
LEAST_EQUATIONS = 3
"""Minimum number of equations (intervals) for each fitted factor"""
WALK_VARIANCES = (0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""[1] Variances of the level's step divided by the noise variance; all are equally probable"""
SLOPE = 0.05
"""[1] Prior standard deviation of the power's relative change over a deployment: fouling, pump,
batteries"""
LEAST_DIVES = 3
"""Minimum number of dives from which the noise of a dive can be estimated"""
DRAWS = 4000
LEAST_PART = 0.1
"""[1] Lower bound of a sampled power, as a fraction of the level: the electronics always run"""
DAYS_INTERVAL = (0.05, 0.95)
DAY_HOURS = 24.0
SEED = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class EnergyTerm:
    """Factor and energy of one consumer."""

    name: str
    value: float
    """Factor, in `unit`"""
    deviation: float
    """Standard deviation; NaN if the value is the vehicle's own"""
    unit: str
    energy: float
    """[J] Energy of the deployment"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EnergyUse:
    """Consumers of a deployment, fitted to its charge counter."""

    vehicle: Vehicle
    terms: tuple[EnergyTerm, ...]
    dives: tuple[DiveCharge, ...]
    consumption: Consumption
    """The vehicle's consumption, with the values that the log determines"""
    hours: float
    """[h] Time that the counter covers, with surface intervals"""
    charge: float
    """[A h] Charge taken in `hours`"""
    voltage: float
    """[V] Mean voltage"""
    equations: int
    resets: int
    """Intervals left out because the counter ran backwards"""

    @property
    def power(self) -> float:
        """[W] Mean power."""
        return self.charge * self.voltage / self.hours

    def days_left(self, energy_left_kwh: float) -> float:
        """[d] Time that `energy_left_kwh` [kW h] lasts at the mean power.

        Raises:
          InputError: an energy beyond any vehicle's battery, or not above 0.
        """
        if not 0.0 < energy_left_kwh <= MOST_KWH:
            raise InputError(
                f"--energy-left-kwh {energy_left_kwh:g} must be above 0, at most {MOST_KWH:g}"
            )
        return energy_left_kwh * 1e3 / self.power / 24.0

    def describe(self) -> dict[str, object]:
        """Plain values, as `--json` prints them."""
        return {
            "hours": self.hours,
            "charge_a_h": self.charge,
            "voltage_v": self.voltage,
            "power_w": self.power,
            "equations": self.equations,
            "counter_resets": self.resets,
            "terms": {
                one.name: {
                    "value": one.value,
                    "deviation": None if np.isnan(one.deviation) else one.deviation,
                    "unit": one.unit,
                    "energy_kj": one.energy / 1e3,
                }
                for one in self.terms
            },
        }


def counted_energy(
    store: str | StorePath, vehicle: str | Path | Vehicle, *, newest: bool = False
) -> EnergyUse | None:
    """Fit the energy use of a store; None if the store has no charge counter, or holds no logs.

    With `newest`, only the deployment that began last is fitted.
    """
    with MissionStore(store) as found:
        if not found.logged:
            return None
    missions = None
    if newest:
        with LogStore(store) as logs:
            missions = logs.missions_of(logs.deployments[int(np.argmax(logs.starts))])
    try:
        return energy_used(store, vehicle, missions=missions)
    except NotCounted:
        return None


def energy_used(
    store: str | StorePath,
    vehicle: str | Path | Vehicle | None = None,
    *,
    missions: Sequence[int] | None = None,
) -> EnergyUse:
    """Fit the energy consumers to the dives of a store.

    Args:
      store: store of logs.
      vehicle: gives the work of pump and masses, and values that the log does not determine.
        Default: the shipped vehicle of the log's type.
      missions: rows to use; default all.

    Raises:
      StoreError: no store of logs.
      NotCounted: no counter of charge or no voltage in it, or too few samples of them.
    """
    if vehicle is None:
        vehicle = start_vehicle(store)
    elif not isinstance(vehicle, Vehicle):
        vehicle = load_vehicle(vehicle)
    with LogStore(store) as logs:
        rows = range(len(logs)) if missions is None else missions
        timeline = EnergyTimeline(logs, rows, vehicle)
    return _fitted(timeline, vehicle)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ChargeForecast:
    """Charge of later dives, predicted from earlier dives."""

    dives: tuple[DiveCharge, ...]
    taught: int
    """Number of dives in the fit"""
    per_hour: float
    """[A h/h] Charge per hour of the dives in the fit: a simple prediction for comparison"""
    each: float
    """[A h] Mean charge of the dives in the fit: another simple prediction for comparison"""

    def errors(self) -> dict[str, float]:
        """Mean absolute error of a dive and error of the sum, relative to the measured charge."""
        measured, modelled, hours = np.array(
            [(one.measured, one.modelled, one.hours) for one in self.dives]
        ).T
        rivals = {
            "model": modelled,
            "per_hour": self.per_hour * hours,
            "each": np.full(len(hours), self.each),
        }
        found = {}
        for name, predicted in rivals.items():
            found[f"{name}_per_dive"] = float(np.mean(np.abs(predicted / measured - 1.0)))
            found[f"{name}_sum"] = float(predicted.sum() / measured.sum() - 1.0)
        return found


def second_half(
    store: str | StorePath, vehicle: Vehicle, *, missions: Sequence[int] | None = None
) -> ChargeForecast | None:
    """Predict the charge of the second half of the dives; None if the first half is too short.

    Times, depths and volumes of the second half are given; only its energy is predicted.
    """
    with LogStore(store) as logs:
        rows = range(len(logs)) if missions is None else missions
        order = sorted(rows, key=lambda k: logs.starts[k])
        known = [k for k in order if np.isfinite(logs.signal(CHARGE, k)).sum() > 1]
        taught, tested = known[: len(known) // 2], known[len(known) // 2 :]
        if len(taught) < 2:
            return None
        timelines = [EnergyTimeline(logs, rows, vehicle) for rows in (taught, tested)]
    try:
        fit = _fitted(timelines[0], vehicle)
    except NotCounted:
        return None
    factors = {one.name: one.value for one in fit.terms}
    before, dives = (timeline.dives(factors) for timeline in timelines)
    hours = sum(one.hours for one in before)
    charge = sum(one.measured for one in before)
    return ChargeForecast(
        dives=dives, taught=len(before), per_hour=charge / hours, each=charge / len(before)
    )


def _fitted(line: EnergyTimeline, vehicle: Vehicle) -> EnergyUse:
    span = line.intervals()
    taken = line.energy(span)
    forward = taken > 0.0
    resets = int((~forward).sum())
    span, taken = span[forward], taken[forward]
    usual = Consumption.of(vehicle)
    kept: dict[str, float] = {}
    for factor in FACTORS:
        value = getattr(usual, factor.field) if factor.field else 1.0
        kept[factor.name] = 1.0 / value if factor.inverse else value
    free = [f.name for f in FACTORS if f.name in line.done]
    if len(span) < LEAST_EQUATIONS:
        raise NotCounted(
            f"{len(span)} intervals of {INTERVAL / 60:.0f} min with a reading of the counter of "
            f"charge at both ends; the energy needs {LEAST_EQUATIONS} at least: import more dives"
        )
    table = line.table(span, free)
    part_on = table[:, free.index("payload")].sum() / table[:, free.index("hotel")].sum()
    if not 1.0 - LARGEST_DUTY < part_on < LARGEST_DUTY:
        kept["payload"] = 0.0  # always on: part of the hotel load
        free.remove("payload")
    free = [name for name in free if line.table(span, [name]).any()]
    dive = line.mission[span[:, 0]]
    while True:
        known = [name for name in kept if name not in free and name in line.done]
        rest = taken - line.table(span, known) @ [kept[name] for name in known] if known else taken
        values, deviations = least_squares(line.table(span, free), rest, dive, free)
        doubt = {
            name: deviation / value if value > 0.0 else np.inf
            for name, value, deviation in zip(free, values, deviations, strict=True)
        }
        del doubt[free[0]]  # every log determines the hotel load
        worst = max(doubt, key=lambda name: doubt[name], default="")
        many = len(span) >= LEAST_EQUATIONS * len(free)
        if not worst or (doubt[worst] <= LARGEST_UNCERTAINTY and many):
            break
        free.remove(worst)
    found = {**kept, **dict(zip(free, values.tolist(), strict=True))}
    spread = dict(zip(free, deviations.tolist(), strict=True))
    names = [name for name in found if name in line.done]
    by_field = {
        f.field: 1.0 / found[f.name] if f.inverse else found[f.name]
        for f in FACTORS
        if f.field and f.name in found
    }
    if np.isfinite(line.vacuum):
        by_field["hull_vacuum"] = line.vacuum
    hours = float(line.done["hotel"][span[:, 1]].sum() - line.done["hotel"][span[:, 0]].sum())
    volts = 0.5 * (line.voltage[span[:, 0]] + line.voltage[span[:, 1]])
    charge = float((taken / volts).sum() / COULOMBS)
    return EnergyUse(
        vehicle=vehicle,
        terms=tuple(
            EnergyTerm(
                name=f.name,
                value=found[f.name],
                deviation=spread.get(f.name, np.nan),
                unit=f.unit,
                energy=float(found[f.name] * line.table(span, [f.name]).sum()),
            )
            for f in FACTORS
            if f.name in names
        ),
        dives=line.dives({name: found[name] for name in names}),
        consumption=dataclasses.replace(usual, **by_field),
        hours=hours / 3600.0,
        charge=charge,
        voltage=float(taken.sum() / COULOMBS / charge),
        equations=len(span),
        resets=resets,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Endurance:
    """Days left if the vehicle continues as in its last dives."""

    energy_left_kwh: float
    """[kW h]"""
    power: float
    """[W] Expected mean power"""
    powers: Array
    """[W] Samples of the mean power until the energy is gone, (draw,)"""

    @property
    def days(self) -> float:
        """[d] Days left at the expected power; 0 if no energy is left."""
        return max(self.energy_left_kwh, 0.0) * 1e3 / self.power / DAY_HOURS

    def days_drawn(self, added: float = 0.0) -> Array:
        """[d] Days left for each sample of the power plus `added` [W], (draw,)."""
        power = np.maximum(self.powers + added, LEAST_PART * self.power)
        return np.asarray(max(self.energy_left_kwh, 0.0) * 1e3 / power / DAY_HOURS)

    def interval(self, added: float = 0.0) -> tuple[float, float]:
        """[d] Interval that holds the days left with a probability of 90 %."""
        low, high = np.quantile(self.days_drawn(added), DAYS_INTERVAL)
        return float(low), float(high)

    def between(self, added: float = 0.0) -> str:
        """`interval` as text; without an upper end if a sampled power is at its lower bound."""
        low, high = self.interval(added)
        if high > 0.99 * self.days / LEAST_PART:
            return f"{low:.1f} and more"
        return f"{low:.1f} to {high:.1f}"


def endurance_of(used: EnergyUse, energy_left_kwh: float) -> Endurance | None:
    """Days left, estimated from the dives of a deployment; None for fewer than three dives.

    Args:
      used: energy use of one deployment. energy_left_kwh: [kW h] energy that is left.
    """
    if len(used.dives) < LEAST_DIVES:
        return None
    hours = np.array([one.hours for one in used.dives])
    taken = np.array([one.measured for one in used.dives])
    whole = used.charge / used.hours / (taken.sum() / hours.sum())  # adds the surface intervals
    power = taken / hours * used.voltage * whole
    left = max(energy_left_kwh, 0.0) * 1e3 / power.mean() / float(np.median(hours))  # dives
    slope = SLOPE * power.mean() / (len(power) + left)
    found = [_forecast(power, ratio, slope, left) for ratio in WALK_VARIANCES]
    likely = np.array([one[2] for one in found])
    weights = np.exp(likely - likely.max())
    weights /= weights.sum()
    rng = np.random.default_rng(SEED)
    which = rng.choice(len(WALK_VARIANCES), DRAWS, p=weights)
    expected, spread = np.array([one[:2] for one in found]).T
    drawn = expected[which] + spread[which] * rng.standard_t(len(hours) - 1, DRAWS)
    mean = float(weights @ expected)
    return Endurance(
        energy_left_kwh=energy_left_kwh,
        power=mean,
        powers=np.maximum(drawn, LEAST_PART * mean),
    )


def _forecast(power: Array, walk: float, slope: float, left: float) -> tuple[float, float, float]:
    """Mean power of the dives to come, its standard deviation, and the log-likelihood.

    A Kalman filter of level and slope, started at the first dive. Its variances are divided by the
    noise variance, which the innovations determine.

    Args:
      power: [W] of each dive. walk: variance of a step. slope: [W] prior standard deviation of the
        slope per dive. left: number of dives to come.
    """
    least = (1e-6 * abs(float(power.mean()))) ** 2  # keeps the noise above 0 for equal dives
    noise = max(0.5 * float(np.mean(np.diff(power) ** 2)), least)
    state, cover = np.array([power[0], 0.0]), np.diag([1.0, slope**2 / noise])
    step = np.array([[1.0, 1.0], [0.0, 1.0]])
    squares, variances = [], []
    for value in power[1:]:
        state, cover = step @ state, step @ cover @ step.T
        cover[0, 0] += walk
        variance = cover[0, 0] + 1.0
        innovation = value - state[0]
        gain = cover[:, 0] / variance
        state, cover = state + gain * innovation, cover - np.outer(gain, cover[0])
        squares.append(innovation**2 / variance)
        variances.append(variance)
    noise = max(float(np.mean(squares)), least)
    middle = np.array([1.0, 0.5 * left])  # the mean of a line is its value halfway
    ahead = middle @ cover @ middle + walk * left / 3.0 + 1.0 / max(left, 1.0)
    likelihood = -0.5 * float(np.log(variances).sum() + len(squares) * np.log(noise))
    return float(middle @ state), float(np.sqrt(noise * ahead)), likelihood
