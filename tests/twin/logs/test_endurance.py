"""Days left by the dives so far: level, slope and walk of their power."""

import numpy as np
import pytest

from twin.logs import EnergyUse, endurance_of
from twin.logs.energy_timeline import DiveCharge
from twin.vehicle.consumption import Consumption
from twin.vehicle.vehicle import load_vehicle

VOLTAGE, HOURS = 14.0, 4.0


def used(power: np.ndarray, afloat: float = 0.0) -> EnergyUse:
    """Dives of four hours; `afloat` more hours at the same power in all."""
    charge = power * HOURS / VOLTAGE
    vehicle = load_vehicle("slocum-200")
    return EnergyUse(
        vehicle=vehicle, terms=(), consumption=Consumption.of(vehicle), voltage=VOLTAGE,
        dives=tuple(
            DiveCharge(mission=k, hours=HOURS, measured=float(one), modelled=np.nan)
            for k, one in enumerate(charge)
        ),
        hours=HOURS * len(power) + afloat, equations=0, resets=0,
        charge=float(charge.sum() * (1.0 + afloat / HOURS / len(power))),
    )  # fmt: skip


def test_an_even_power_is_the_energy_over_it():
    found = endurance_of(used(np.full(20, 3.0), afloat=8.0), 3.6)
    assert found is not None
    assert found.days == pytest.approx(50.0, rel=1e-3)
    low, high = found.interval()
    assert 0.9 * 50.0 < low < 50.0 < high < 1.1 * 50.0
    assert np.median(found.days_drawn(added=3.0)) == pytest.approx(25.0, rel=0.02)


def test_more_dives_promise_more():
    rng = np.random.default_rng(0)
    width: dict[int, list[float]] = {5: [], 50: []}
    for count in 20 * [5, 50]:
        found = endurance_of(used(3.0 + 0.2 * rng.standard_normal(count)), 1.0)
        assert found is not None
        low, high = found.interval()
        width[count].append((high - low) / found.days)
    assert np.mean(width[50]) < 0.6 * np.mean(width[5])


def test_a_power_that_grows_is_expected_to_grow_on():
    power = np.linspace(3.0, 4.0, 100) + 0.02 * np.random.default_rng(1).standard_normal(100)
    found = endurance_of(used(power), 1.0)
    assert found is not None
    assert found.power > 4.0 > used(power).power + 0.4


def test_a_plan_that_changed_counts_more_than_what_was_before():
    power = np.r_[np.full(30, 2.0), np.full(30, 3.0)]
    power += 0.05 * np.random.default_rng(2).standard_normal(60)
    found = endurance_of(used(power), 1.0)
    assert found is not None
    assert found.power == pytest.approx(3.0, abs=0.15)


def test_two_dives_tell_nothing_and_no_energy_no_days():
    assert endurance_of(used(np.full(2, 3.0)), 1.0) is None
    found = endurance_of(used(np.full(5, 3.0)), -0.1)
    assert found is not None
    assert found.days == 0.0
    assert found.interval() == (0.0, 0.0)
