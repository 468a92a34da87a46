"""Energy use: what electronics, pump, drives, payload and thruster of a deployment take.

use = energy_used("real.zarr")
use.terms, use.consumption, use.power

The counter of charge, times the voltage, is a line of known times and moves:

    energy = hotel t + surface t_afloat + payload t_sampling + pump (p + vacuum) V_out
             + pump loss V_out + pump return V_in + drives W + propeller W + thruster E

with the pressure p outside, the volumes V that the pump moves out and in, the work W of moving
masses and propellers without losses and the energy E that a glider's thruster draws by its own
current. Least squares over intervals of five minutes, each factor within what is possible; its
deviation is that of whole dives, since neighbouring intervals err together. A factor that the log
does not determine keeps the vehicle's figure.

The power of a dive is a level and noise; the level walks from dive to dive and has a slope, such as
that of a pump which weakens (Durbin and Koopman 2012, Time Series Analysis by State Space Methods,
chapter 3). How far it walks is averaged over by its likelihood, so that ten dives promise less than
a hundred.
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

ALWAYS = 0.97
"""of the time: what is on for longer cannot be told from the electronics"""
DOUBTFUL = 0.5
"""deviation over value from which a factor is not determined"""
MOST_KWH = 1e4
"""[kW h] of batteries"""
LEAST_EQUATIONS = 3
"""for each factor"""
WALKS = (0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Variance of a step of the level over that of the noise; each as likely before the dives speak"""
SLOPE = 0.05
"""Part by which the power changes over a whole deployment, standard deviation, before the dives
speak: fouling, pump, batteries"""
LEAST_DIVES = 3
"""Below which a dive's noise is not known"""
DRAWS = 4000
LEAST_PART = 0.1
"""Of the level that a drawn power keeps: nothing takes less than its electronics"""
DAYS_INTERVAL = (0.05, 0.95)
DAY_HOURS = 24.0
SEED = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class EnergyTerm:
    """One consumer."""

    name: str
    value: float
    """Factor, in `unit`"""
    deviation: float
    """Standard deviation; NaN where the value is the vehicle's"""
    unit: str
    energy: float
    """[J] of the deployment"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EnergyUse:
    """The consumers of a deployment."""

    vehicle: Vehicle
    terms: tuple[EnergyTerm, ...]
    dives: tuple[DiveCharge, ...]
    consumption: Consumption
    """The vehicle's with what the log determines"""
    hours: float
    """[h] that the counter covers, stays at the surface included"""
    charge: float
    """[A h] in them"""
    voltage: float
    """[V] mean"""
    equations: int
    resets: int
    """Intervals left out in which the counter ran backwards"""

    @property
    def power(self) -> float:
        """[W] mean."""
        return self.charge * self.voltage / self.hours

    def days_left(self, energy_left_kwh: float) -> float:
        """[d] that so much energy [kW h] lasts at this power.

        Raises:
          InputError: an energy that no battery of a vehicle has.
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
    """`energy_used`; None where the store has not counted its energy, or holds no logs.

    With `newest` of the deployment that began last alone.
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
    """The consumers of the dives of a store.

    Args:
      store: of logs.
      vehicle: whose pump and masses moved, and whose figures stay where the log says nothing;
        default the one of the log's kind.
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
    """The charge of later dives by what earlier ones taught."""

    dives: tuple[DiveCharge, ...]
    taught: int
    """Dives that taught"""
    per_hour: float
    """[A h/h] of the dives that taught: a simple rival"""
    each: float
    """[A h] of a dive that taught, in the mean: the other one"""

    def errors(self) -> dict[str, float]:
        """Mean absolute error of a dive and error of the sum, as parts of what was measured."""
        measured, modelled, hours = np.array(
            [(one.measured, one.modelled, one.hours) for one in self.dives]
        ).T
        rivals = {
            "model": modelled,
            "per_hour": self.per_hour * hours,
            "each": np.full(len(hours), self.each),
        }
        found = {}
        for name, said in rivals.items():
            found[f"{name}_per_dive"] = float(np.mean(np.abs(said / measured - 1.0)))
            found[f"{name}_sum"] = float(said.sum() / measured.sum() - 1.0)
        return found


def second_half(
    store: str | StorePath, vehicle: Vehicle, *, missions: Sequence[int] | None = None
) -> ChargeForecast | None:
    """The second half of the dives by the first; None where the first has too few.

    The later dives' times, depths and volumes are given: what is tested is what these cost.
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
    if not 1.0 - ALWAYS < part_on < ALWAYS:
        kept["payload"] = 0.0  # always on: in the hotel load
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
        del doubt[free[0]]  # the hotel load is in every log
        worst = max(doubt, key=lambda name: doubt[name], default="")
        many = len(span) >= LEAST_EQUATIONS * len(free)
        if not worst or (doubt[worst] <= DOUBTFUL and many):
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
    """Days that are left, where it goes on as in its last dives."""

    energy_left_kwh: float
    """[kW h]"""
    power: float
    """[W] expected"""
    powers: Array
    """[W] draws of the mean power until the energy is gone, (draw,)"""

    @property
    def days(self) -> float:
        """[d] at the expected power; 0 where nothing is left."""
        return max(self.energy_left_kwh, 0.0) * 1e3 / self.power / DAY_HOURS

    def days_drawn(self, added: float = 0.0) -> Array:
        """[d] of each draw with so much power [W] added, such as that of a change, (draw,)."""
        power = np.maximum(self.powers + added, LEAST_PART * self.power)
        return np.asarray(max(self.energy_left_kwh, 0.0) * 1e3 / power / DAY_HOURS)

    def interval(self, added: float = 0.0) -> tuple[float, float]:
        """[d] 90 % of the days left."""
        low, high = np.quantile(self.days_drawn(added), DAYS_INTERVAL)
        return float(low), float(high)

    def between(self, added: float = 0.0) -> str:
        """The interval in words; it has no upper end where the power may be next to nothing."""
        low, high = self.interval(added)
        if high > 0.99 * self.days / LEAST_PART:
            return f"{low:.1f} and more"
        return f"{low:.1f} to {high:.1f}"


def endurance_of(used: EnergyUse, energy_left_kwh: float) -> Endurance | None:
    """Days left by the dives of a deployment; None of fewer than three.

    Args:
      used: of one deployment. energy_left_kwh: [kW h].
    """
    if len(used.dives) < LEAST_DIVES:
        return None
    hours = np.array([one.hours for one in used.dives])
    taken = np.array([one.measured for one in used.dives])
    whole = used.charge / used.hours / (taken.sum() / hours.sum())  # stays at the surface, too
    power = taken / hours * used.voltage * whole
    left = max(energy_left_kwh, 0.0) * 1e3 / power.mean() / float(np.median(hours))  # dives
    slope = SLOPE * power.mean() / (len(power) + left)
    found = [_followed(power, ratio, slope, left) for ratio in WALKS]
    likely = np.array([one[2] for one in found])
    weights = np.exp(likely - likely.max())
    weights /= weights.sum()
    rng = np.random.default_rng(SEED)
    which = rng.choice(len(WALKS), DRAWS, p=weights)
    expected, spread = np.array([one[:2] for one in found]).T
    drawn = expected[which] + spread[which] * rng.standard_t(len(hours) - 1, DRAWS)
    mean = float(weights @ expected)
    return Endurance(
        energy_left_kwh=energy_left_kwh,
        power=mean,
        powers=np.maximum(drawn, LEAST_PART * mean),
    )


def _followed(power: Array, walk: float, slope: float, left: float) -> tuple[float, float, float]:
    """Mean of the dives to come, its deviation, and the logarithm of the likelihood.

    A Kalman filter of level and slope, begun with the first dive; its variances are over that of
    the noise, which the innovations tell.

    Args:
      power: [W] of each dive. walk: variance of a step. slope: [W] a dive, its deviation before.
      left: dives to come.
    """
    least = (1e-6 * abs(float(power.mean()))) ** 2  # a counter that is even without end
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
    middle = np.array([1.0, 0.5 * left])  # the slope's part of the mean of what is to come
    ahead = middle @ cover @ middle + walk * left / 3.0 + 1.0 / max(left, 1.0)
    likelihood = -0.5 * float(np.log(variances).sum() + len(squares) * np.log(noise))
    return float(middle @ state), float(np.sqrt(noise * ahead)), likelihood
