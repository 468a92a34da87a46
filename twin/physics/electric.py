"""Electric: what a vehicle's counter of charge, voltmeter and vacuum gauge read in a flight."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.faults.base import Condition
from twin.physics.condition import conditions_of, healthy
from twin.physics.scenario import Scenario
from twin.records.trajectory import Trajectory
from twin.vehicle.consumption import ENERGY, needed_signals
from twin.vehicle.parts.pump import Pump

Array = NDArray[np.float64]

REST_VOLTAGE, EMPTY_VOLTAGE = 15.0, 12.5
"""[V] of a fresh and of an empty lithium pack, as gliders log it"""
RESISTANCE = 0.35
"""[ohm] of all packs together and their wires"""
ENDURANCE_DAYS = 60.0
"""[d] that the batteries last at the vehicle's own power; they are drawn about it"""
VOLTAGE_NOISE, CURRENT_NOISE = 0.02, 0.005
"""[V], [A] of a sample"""
HULL_AIR = 0.35
"""Part of the hull that is air"""
VACUUM_NOISE = 40.0
"""[Pa]"""
AIR_LAG = 1800.0
"""[s] in which the air takes the water's temperature"""
ZERO_C = 273.15
"""[K]"""
SEA_LEVEL = 101_325.0
"""[Pa]"""


def electric_signals(
    scenario: Scenario, flown: Trajectory, rng: np.random.Generator | None = None
) -> dict[str, Array]:
    """Charge [A h], voltage [V], current [A], power of the pump [W] and vacuum [Pa], each (n,).

    They have the names of signals.

    Args:
      scenario: that was flown, with its faults.
      rng: of the batteries and the noise; None: batteries as usual, no noise.
    """
    time = flown.time
    period = scenario.sample_period
    table = conditions_of(scenario, float(time[-1]) + period) or ((0.0, healthy(scenario)),)
    taken, pump = np.zeros(len(time)), np.zeros(len(time))
    packs, water = np.ones(len(time)), np.zeros(len(time))
    pumps = [part.name for part in scenario.vehicle.parts if isinstance(part, Pump)]
    needed = needed_signals(scenario.vehicle)
    for first, last, condition in _stretches(table, time):
        signals = {name: flown[name][max(first - 1, 0) : last] for name in needed}
        span = time[max(first - 1, 0) : last]
        energy = condition.consumption.signals(condition.vehicle, signals, span)
        own = np.sum([np.diff(values, prepend=0.0) for values in energy.values()], axis=0)
        moved = sum(np.diff(energy[f"{ENERGY}{name}"], prepend=0.0) for name in pumps)
        keep = slice(1 if first else 0, None)
        taken[first:last] = own[keep]
        if pumps:
            pump[first:last] = np.asarray(moved)[keep]
        packs[first:last], water[first:last] = condition.packs, condition.taken
    power = taken / period
    power[0] = power[1] if len(power) > 1 else 0.0
    capacity = ENDURANCE_DAYS * 24.0 * float(np.mean(power)) / REST_VOLTAGE
    more, share = (1.0, 0.2) if rng is None else (rng.uniform(0.8, 1.5), rng.uniform(0.05, 0.4))
    capacity *= float(more)
    used = float(share) * capacity
    current = power / REST_VOLTAGE
    charge = np.cumsum(current) * period / 3600.0
    spent = used / capacity + np.cumsum(current / packs) * period / 3600.0 / capacity
    rest = REST_VOLTAGE + (EMPTY_VOLTAGE - REST_VOLTAGE) * np.minimum(spent, 1.0)
    voltage = rest - RESISTANCE / packs * current
    noise = np.zeros((3, len(time))) if rng is None else rng.standard_normal((3, len(time)))
    # the air of the hull has the water's temperature, late
    warmth = flown.signals.get("true_temperature")
    air = np.full(len(time), ZERO_C + 10.0)
    if warmth is not None:
        air = ZERO_C + _late(np.asarray(warmth, float), AIR_LAG / period)
    room = HULL_AIR * scenario.vehicle.neutral_volume
    inside = (SEA_LEVEL - healthy(scenario).consumption.hull_vacuum) * (air / (ZERO_C + 10.0))
    inside = inside * room / (room - np.minimum(water, 0.9 * room))
    return {
        "measured_charge": used + charge,
        "measured_voltage": voltage + VOLTAGE_NOISE * noise[0],
        "measured_battery_current": np.maximum(current + CURRENT_NOISE * noise[1], 0.0),
        "measured_pump_power": pump / period,
        "measured_vacuum": SEA_LEVEL - inside + VACUUM_NOISE * noise[2],
    }


def _late(values: Array, lag: float) -> Array:
    """Values that follow with a lag of so many samples."""
    from scipy.signal import lfilter

    share = 1.0 - math.exp(-1.0 / lag)
    found, _ = lfilter([share], [1.0, share - 1.0], values, zi=[values[0] * (1.0 - share)])
    return np.asarray(found)


def _stretches(
    table: Sequence[tuple[float, Condition]], time: Array
) -> Iterator[tuple[int, int, Condition]]:
    """First and last sample of each row of a table of conditions."""
    begins = np.searchsorted(time, [row[0] for row in table])
    ends = [*begins[1:].tolist(), len(time)]
    for first, last, (_, condition) in zip(begins.tolist(), ends, table, strict=True):
        if last > first:
            yield first, last, condition
