"""Energy timeline: actuator work, time and the charge counter's readings along a deployment.

Moves of resting parts are encoder noise and are removed: a part at rest takes no energy.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.records.logged import LogStore
from twin.vehicle.consumption import Consumption
from twin.vehicle.parts import Move
from twin.vehicle.parts.propeller import Propeller
from twin.vehicle.parts.pump import CUBIC_CM, Pump
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

CHARGE, VOLTAGE, VACUUM = "measured_charge", "measured_voltage", "measured_vacuum"
COULOMBS = 3600.0
"""[C] Charge of 1 A h"""
INTERVAL = 300.0
"""[s] Shortest time between the two counter readings of one equation"""
LONGEST_STAY = 3600.0
"""[s] Longest gap between dives that counts as a surface interval; a longer gap is unknown"""
LEAST_MOVE = 0.005
"""[1] Fraction of a part's travel; a smaller move is encoder noise"""


class NotCounted(InputError):
    """Error: a store has no charge counter, no voltage, or too few readings of them."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveCharge:
    """Charge of one dive, from the counter's first sample in the dive to its last."""

    mission: int
    hours: float
    """[h] Time between the two samples"""
    measured: float
    """[A h] Charge by the counter"""
    modelled: float
    """[A h] Charge by the fitted factors"""


class EnergyFactor(NamedTuple):
    """Factor of one consumer in the energy equation."""

    name: str
    unit: str
    least: float
    field: str
    """Field of `Consumption`; empty for a factor without a field"""
    inverse: bool = False
    """True if the field is 1 / factor"""
    most: float = np.inf


FACTORS = (
    EnergyFactor("hotel", "W", 0.0, "hotel_power"),
    EnergyFactor("surface", "W", 0.0, "surface_power"),
    EnergyFactor("payload", "W", 0.0, "payload_power"),
    EnergyFactor("pump", "1", 1.0, "pump_efficiency", inverse=True),
    EnergyFactor("pump loss", "Pa", 0.0, "pump_loss"),
    EnergyFactor("pump return", "Pa", 0.0, "pump_return"),
    # efficiency above 1/100: drives move with the pump, and a fit could give them its energy
    EnergyFactor("drives", "1", 1.0, "screw_efficiency", inverse=True, most=100.0),
    EnergyFactor("propeller", "1", 1.0, "propeller_efficiency", inverse=True),
    EnergyFactor("thruster", "1", 0.0, ""),
)
"""Factors of the energy equation; every log determines the first factor, `hotel`"""


class EnergyTimeline:
    """Cumulative work, time and charge over the dives and surface intervals, in order of time."""

    def __init__(self, logs: LogStore, rows: Sequence[int], vehicle: Vehicle):
        missing = [name for name in (CHARGE, VOLTAGE) if name not in logs]
        if missing:
            raise NotCounted(
                f"store {logs.path} lacks {' and '.join(missing)}: the energy needs the vehicle's "
                "counter of charge and its voltage (a Slocum's m_coulomb_amphr_total and "
                "m_battery); import logs that have them"
            )
        ordered = sorted(rows, key=lambda k: (logs.deployments[k], logs.starts[k]))
        owner = np.concatenate(
            [np.full(int(logs.samples[k]), logs.deployments[k], object) for k in ordered]
        )
        self.time = np.concatenate([logs.time(k) for k in ordered])
        self.mission = np.concatenate([np.full(int(logs.samples[k]), k) for k in ordered])
        step = np.diff(self.time, prepend=self.time[0])
        parted = (step < 0.0) | (step > LONGEST_STAY)
        parted[1:] &= self.mission[1:] != self.mission[:-1]
        parted[1:] |= owner[1:] != owner[:-1]
        self.chain = np.cumsum(parted)
        known = np.concatenate([[False], np.diff(self.chain) == 0])
        self.step = np.where(known, step, 0.0)

        def signal(name: str) -> Array:
            return np.concatenate([logs.signal(name, k) for k in ordered])

        self.charge = signal(CHARGE)
        self.voltage = _joined(signal(VOLTAGE))
        vacuum = signal(VACUUM)
        vacuum = vacuum[np.isfinite(vacuum)]
        self.vacuum = float(np.median(vacuum)) if vacuum.size else np.nan
        names = {name for name in logs.signals() if name.startswith("measured_")}
        self.done = self._done(signal, names, vehicle)

    def _done(
        self, signal: Callable[[str], Array], names: set[str], vehicle: Vehicle
    ) -> dict[str, Array]:
        """Cumulative quantity that each factor multiplies, by the factor's name, (time,)."""
        losses = Consumption.of(vehicle)
        depth = np.maximum(_joined(signal("measured_depth")), 0.0)
        pitch = np.deg2rad(_joined(signal("measured_pitch")))
        middle = [0.5 * (v + np.concatenate([v[:1], v[:-1]])) for v in (depth, pitch)]
        afloat = (signal("measured_phase") == 0.0) | np.concatenate(
            [[False], np.diff(self.mission) != 0]
        )
        parts = {
            "hotel": self.step,
            "surface": self.step * afloat,
            "payload": self.step * np.isfinite(signal("measured_temperature")),
            "thruster": self.step * np.nan_to_num(signal("measured_thruster_power")),
        }
        lossless = dataclasses.replace(losses, screw_efficiency=1.0, propeller_efficiency=1.0)
        for part in vehicle.parts:
            name = f"measured_{part.name}"
            if name not in names:
                continue
            place = _joined(signal(name)) / part.quantity.scale
            place = place if isinstance(part, Propeller) else settled(place)
            before = np.concatenate([place[:1], place[:-1]])
            if isinstance(part, Pump):
                vacuum = losses.hull_vacuum if np.isnan(self.vacuum) else self.vacuum
                pressure = vehicle.reference_density * vehicle.gravity * middle[0] + vacuum
                moved = (place - before) * CUBIC_CM * (self.step > 0.0)
                parts["pump"] = np.maximum(moved, 0.0) * pressure
                parts["pump loss"] = np.maximum(moved, 0.0)
                parts["pump return"] = np.maximum(-moved, 0.0)
                continue
            move = Move(before, place, middle[0], middle[1], self.step)
            of = part.energy(vehicle, move, lossless)
            which = "propeller" if isinstance(part, Propeller) else "drives"
            parts[which] = parts.get(which, 0.0) + np.asarray(of)
        return {name: np.cumsum(values) for name, values in parts.items()}

    def intervals(self) -> NDArray[np.intp]:
        """First and last sample of each interval between counter readings, (interval, 2)."""
        found, start = [], -1
        for k in np.flatnonzero(np.isfinite(self.charge)).tolist():
            if start >= 0 and self.chain[k] == self.chain[start]:
                if self.time[k] - self.time[start] < INTERVAL:
                    continue
                found.append((start, k))
            start = k
        return np.array(found, np.intp).reshape(-1, 2)

    def energy(self, span: NDArray[np.intp]) -> Array:
        """[J] Energy taken in each interval, (interval,)."""
        first, last = span.T
        volts = 0.5 * (self.voltage[first] + self.voltage[last])
        return np.asarray((self.charge[last] - self.charge[first]) * COULOMBS * volts)

    def table(self, span: NDArray[np.intp], names: Sequence[str]) -> Array:
        """Quantity of each factor in each interval, (interval, factor)."""
        first, last = span.T
        columns = [self.done[name][last] - self.done[name][first] for name in names]
        return np.stack(columns, axis=1)

    def dives(self, factors: Mapping[str, float]) -> tuple[DiveCharge, ...]:
        """Measured and modelled charge of each dive with two counter readings."""
        found = []
        for mission in dict.fromkeys(self.mission[np.isfinite(self.charge)].tolist()):
            at = np.flatnonzero((self.mission == mission) & np.isfinite(self.charge))
            span = np.array([[at[0], at[-1]]])
            taken = self.charge[at[-1]] - self.charge[at[0]]
            if len(at) < 2 or taken <= 0.0:
                continue
            energy = float(self.table(span, list(factors))[0] @ list(factors.values()))
            volts = 0.5 * (self.voltage[at[0]] + self.voltage[at[-1]])
            found.append(
                DiveCharge(
                    mission=mission,
                    hours=float(self.time[at[-1]] - self.time[at[0]]) / 3600.0,
                    measured=float(taken),
                    modelled=energy / volts / COULOMBS,
                )
            )
        return tuple(found)


def least_squares(
    table: Array, taken: Array, dive: Array, names: Sequence[str]
) -> tuple[Array, Array]:
    """Fit factors within bounds; standard deviations from sums over dives, infinite at a bound."""
    from scipy.optimize import lsq_linear

    scale = np.maximum(np.abs(table).max(axis=0), 1e-300)
    bounds = [(f.least, f.most) for name in names for f in FACTORS if f.name == name]
    least, most = np.array(bounds).T * scale
    with np.errstate(invalid="ignore"):  # scipy multiplies its infinite step along a zero gradient
        found = lsq_linear(table / scale, taken, bounds=(least, most))
    error = taken - table / scale @ found.x
    inner = found.active_mask == 0
    deviations = np.full(len(names), np.inf)
    if inner.any():
        design = table[:, inner] / scale[inner]
        inverse = np.linalg.pinv(design.T @ design)
        groups = np.unique(dive, return_inverse=True)[1]
        sums = np.stack([np.bincount(groups, column * error) for column in design.T], axis=1)
        count = len(sums)
        cover = inverse @ (sums.T @ sums) @ inverse * (count / max(count - 1, 1))
        deviations[inner] = np.sqrt(np.diag(cover))
    return found.x / scale, deviations / scale


def settled(values: Array) -> Array:
    """Position of a part without encoder noise, (time,).

    The value stays, as with backlash, until the reading moves by `LEAST_MOVE` of the travel.
    """
    play = LEAST_MOVE * float(np.ptp(np.percentile(values, [1.0, 99.0])))
    place, found = float(values[0]), np.empty(len(values))
    for k, value in enumerate(values.tolist()):
        place = min(max(place, value - play), value + play)
        found[k] = place
    return found


def _joined(values: Array) -> Array:
    """Values with NaN interpolated linearly; zeros if no value is finite."""
    known = np.flatnonzero(np.isfinite(values))
    if not known.size:
        return np.zeros(len(values))
    return np.interp(np.arange(len(values)), known, values[known])
