"""What if: plans that are changed cost what the twin says, and a way home needs energy."""

import dataclasses

import numpy as np
import pytest

from glider_twin_ops.forecast import (
    LoggedLeg,
    Request,
    forecast,
    known_without_logs,
    mission_to,
)
from glider_twin_ops.watching.energy_outlook import energy_outlook
from twin import Origin, load_vehicle
from twin.logs import Endurance, EnergyUse, endurance_of
from twin.logs.energy_timeline import DiveCharge
from twin.logs.energy_use import EnergyTerm
from twin.navigation.current import Leg
from twin.records import unix_seconds
from twin.vehicle.consumption import Consumption

TIME = "2026-03-01T00:00:00"
UNIX = unix_seconds(TIME)
HOURS, VOLTAGE, WATTS = 2.0, 14.0, 3.0


@pytest.fixture(scope="module")
def found():
    mission = mission_to("41,-50", depth=60.0, pitch_deg=24.0, surface_after_s=1500.0, radius=500.0)
    place = Origin(latitude_deg=40.0, longitude_deg=-50.0, time=TIME)
    request = Request(
        vehicle=load_vehicle("slocum-200"), mission=mission, place=place, hours=1.5, members=10
    )
    return forecast(request, known_without_logs(40.0, UNIX).at(UNIX))


def used():
    vehicle = load_vehicle("slocum-200")
    charge = WATTS * HOURS / VOLTAGE
    dive = {"hours": HOURS, "measured": charge, "modelled": charge}
    return EnergyUse(
        vehicle=vehicle, consumption=Consumption.of(vehicle), voltage=VOLTAGE, hours=20.0,
        charge=10.0 * charge, equations=0, resets=0,
        terms=tuple(
            EnergyTerm(name=name, value=value, deviation=0.1, unit=unit, energy=watts * 72e3)
            for name, value, unit, watts in (
                ("payload", 0.5, "W", 0.5), ("thruster", 1.0, "1", 0.25),
            )
        ),
        dives=tuple(DiveCharge(mission=k, **dive) for k in range(10)),
    )  # fmt: skip


def legs(north):
    """Ten legs, in a current [m/s] to the north."""
    return [
        LoggedLeg(
            mission=k, method="", begin=(40.0, -50.0), onboard=None, targets=(),
            leg=Leg(start=UNIX + 7200.0 * (k - 10), duration=7200.0,
                    over_ground=(7200.0 * north, 0.0), through_water=(0.0, 0.0)),
        )
        for k in range(10)
    ]  # fmt: skip


def outlook(found, home, *, north=0.0, kwh=1.0, guessed=True):
    use = used()
    lasts = endurance_of(use, kwh)
    return energy_outlook(found, use, lasts, legs(north), home, guessed=guessed)


def test_the_table_has_the_plan_and_each_change(found):
    told = outlook(found, None)
    assert told.home is None
    rows = {one.what: one for one in told.rows}
    assert list(rows) == [
        "as it is", "1.5 times as deep", "6 degree steeper", "half the samples", "thruster off",
    ]  # fmt: skip
    plan = rows["as it is"]
    assert plan.power == pytest.approx(WATTS, rel=1e-3)
    assert plan.days == pytest.approx(1e3 / WATTS / 24.0, rel=1e-3)
    assert rows["half the samples"].power == pytest.approx(WATTS - 0.25, rel=1e-3)
    assert rows["thruster off"].days == pytest.approx(1e3 / (WATTS - 0.25) / 24.0, rel=1e-3)
    assert rows["6 degree steeper"].power > plan.power
    assert 10.0 < plan.km_a_day < 50.0
    for one in told.rows:
        assert one.days_90[0] < one.days < one.days_90[1]


def test_a_change_that_cannot_be_flown_is_said(found):
    mission = found.request.mission
    steep = dataclasses.replace(mission.segments[0], pitch_deg=50.0)
    mission = dataclasses.replace(mission, segments=(steep,))
    request = dataclasses.replace(found.request, mission=mission)
    told = outlook(dataclasses.replace(found, request=request), None)
    assert "6 degree steeper" not in [one.what for one in told.rows]
    assert any("6 degree steeper" in said for said in told.lacking)


def test_the_last_day_to_turn_home_is_where_the_energy_meets_the_way(found):
    here = outlook(found, (40.0, -50.0))  # it goes away from home, to the north, and on
    days = here.rows[0].days
    assert here.home.away_km == pytest.approx(0.0, abs=1e-6)
    assert here.home.days == pytest.approx(0.5 * days, rel=0.1)  # as long out as back
    assert here.home.safe_days <= here.home.days
    assert (here.home.reached, here.home.safe) == (1.0, True)
    with_it = outlook(found, (40.0, -50.0), north=-0.1).home  # a current towards home
    against = outlook(found, (40.0, -50.0), north=0.1).home
    assert with_it.days > here.home.days > against.days
    far = outlook(found, (30.0, -50.0)).home
    assert (far.days, far.safe_days) == (0.0, 0.0)
    arrives = outlook(found, (40.0, -50.0), guessed=False).home  # and stays 111 km from home
    assert arrives.days > here.home.days


def test_a_current_faster_than_the_vehicle_brings_nobody_home(found):
    against = outlook(found, (39.5, -50.0), north=1.0).home
    assert against.safe_days == 0.0
    assert np.isfinite(against.days)
    assert (against.reached, against.safe) == (0.0, False)


def test_an_interval_without_an_upper_end_says_so():
    sure = Endurance(energy_left_kwh=1.0, power=2.0, powers=np.linspace(1.9, 2.1, 100))
    assert sure.between() == f"{sure.interval()[0]:.1f} to {sure.interval()[1]:.1f}"
    drawn = np.maximum(np.linspace(-1.0, 4.0, 100), 0.2)
    unsure = Endurance(energy_left_kwh=1.0, power=2.0, powers=drawn)
    assert unsure.between() == f"{unsure.interval()[0]:.1f} and more"
    assert unsure.between(-0.6).endswith("and more")  # a plan that takes less has more days
