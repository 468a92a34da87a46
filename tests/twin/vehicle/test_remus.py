"""REMUS: a third propelled vehicle, by its file alone."""

import math

import numpy as np
import pytest

import twin
from twin.mission.glide_balance import cruise_rate
from twin.vehicle.consumption import Consumption
from twin.vehicle.vehicle import load_vehicle

REMUS = load_vehicle("remus")
RATE = 1500.0 * math.tau / 60.0
FIN = 9.64  # [kg/m] a radian, Prestero (2001), table C.10


def test_the_screw_has_the_thrust_of_the_thesis_at_its_speed():
    screw = REMUS.part("propeller")
    ahead = np.array([1.54, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert screw.wrench(RATE, ahead, 1030.0, 10.0)[0] == pytest.approx(3.86, abs=5e-3)
    bollard = screw.wrench(RATE, np.zeros(6), 1030.0, 10.0)
    assert bollard[0] == pytest.approx(33.4, abs=0.1)  # K_T 0.136 of a B2-30 of pitch 0.4
    assert screw.wrench(0.0, ahead, 1030.0, 10.0)[0] == pytest.approx(-4.43, abs=0.02)


def test_it_reaches_its_published_speed_on_its_published_power():
    """Data sheet: 1 kWh last 22 h at 1.5 m/s and 8 h at 2.6 m/s."""
    losses = Consumption.of(REMUS)
    for speed, hours in ((1.5, 22.0), (2.5, 8.0 * (2.6 / 2.5) ** 3)):
        rate = cruise_rate(REMUS, speed)
        at = np.array([rate, 0.0, 0.0])
        still = {"depth": 10.0, "pitch": 0.0, "duration": 1.0}
        taken = losses.shares(REMUS, at, at, speed=speed, **still)
        assert sum(taken.values()) == pytest.approx(1000.0 / hours, rel=0.15)


def test_a_deflection_adds_what_the_thesis_has():
    ahead = np.array([1.54, 0.0, 0.0, 0.0, 0.0, 0.0])
    small = 1e-3
    for name, axis, moment, sense in (("rudder", 1, 5, 1.0), ("elevator", 2, 4, -1.0)):
        part = REMUS.part(name)
        wrench = part.wrench(small, ahead, 1030.0, 10.0) / (small * 1.54**2)
        assert wrench[axis] == pytest.approx(sense * FIN, rel=1e-3)
        assert wrench[moment] == pytest.approx(-6.15, rel=1e-3)
        assert np.abs(part.wrench(0.0, ahead, 1030.0, 10.0)).max() == 0.0  # the list holds it


def test_it_flies_the_shipped_survey():
    run = twin.simulate(vehicle=REMUS)
    assert run.provenance["ended"] == "flown"
    assert 29.0 < run["true_depth"].max() < 33.0
    watts = run["true_energy_propeller"][-1] / run.time[-1]
    assert 5.0 < watts < 22.0  # 18 W at 1.5 m/s; the survey is slower
