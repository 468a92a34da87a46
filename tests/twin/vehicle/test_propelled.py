"""Propelled vehicles: Tethys under guidance, REMUS by its file, any by their dimensions.

The missions are those of Tethys' own simulator's tests, with their tolerances: rows of osrf/lrauv
at e7ad598 (missions moved to lrauv-application later), flown by `tethys:gazebo`; the leg of a yo-yo
is MBARI's own simulator's (issue 50 there).
"""

import math
from typing import Any

import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.mission import Hover, Mission, SawTooth, Spiral
from twin.mission.glide_balance import cruise_rate
from twin.vehicle import Dimensions
from twin.vehicle.consumption import Consumption
from twin.vehicle.dimensions import _lamb
from twin.vehicle.vehicle import load_vehicle

MBARI, GAZEBO = load_vehicle("tethys"), load_vehicle("tethys:gazebo")
THREE_HUNDRED_RPM = 1.045
"""[m/s] at 300 rpm on dives and climbs of 20 deg, in the Gazebo set"""


def fly(vehicle, segment, *, depth=0.0, duration):
    plan = Mission(segments=(segment,), start_depth_m=depth, at_end="hold", duration_s=duration)
    return twin.simulate(vehicle=vehicle, mission=plan)


def test_yo_yo_circle():
    """Rudder 9 deg, 2 to 20 m, pitch 20 deg."""
    segment = Spiral(
        max_depth_m=20, min_depth_m=2, pitch_deg=20, rotation_deg=9, speed_m_s=THREE_HUNDRED_RPM,
        duration_s=1200,
    )  # fmt: skip
    run = fly(GAZEBO, segment, duration=1200.0)
    late = run.time > 300.0
    assert run["true_propeller"].mean() == pytest.approx(10.0 * math.pi, rel=0.02)
    # its rudder turns to port when positive
    yaw_rate = -np.gradient(np.unwrap(np.radians(run["true_heading"])), run.time)
    np.testing.assert_allclose(yaw_rate[late], 0.037, atol=0.0023)
    speed = np.hypot(run["true_surge"], run["true_heave"])[late]
    np.testing.assert_allclose(speed, 1.0, atol=0.2)
    np.testing.assert_allclose(run["true_roll_rate"][late], 0.0, atol=0.1)
    # the row's bound is the pitch that is asked for, 20 deg: ours passes it by 1.4 deg on the way
    # from rest at the surface, and by 0.7 deg at each turn
    assert np.abs(run["true_pitch"]).max() < 21.5
    assert np.abs(run["true_pitch"][run.time > 100.0]).max() < 20.8
    assert run["true_depth"].max() < 24.0
    assert run["true_depth"][run.time > 180.0].min() > 0.0


def test_pitch_mass():
    """The battery pitches it to 20 deg at 10 m, without thrust."""
    run = fly(GAZEBO, Hover(depth_m=10, pitch_deg=20, duration_s=900), depth=10.0, duration=900.0)
    assert run["true_pitch"].max() > 20.0
    late = run.time > 180.0
    assert run["true_pitch"][late].min() > -5.0
    assert run["true_pitch"][late].max() < 25.0
    drift = np.hypot(np.hypot(run["true_north"], run["true_east"]), run["true_depth"] - 10.0)
    assert drift.max() <= 0.2
    np.testing.assert_allclose(np.radians(run["true_roll"]), 0.0, atol=1e-2)
    np.testing.assert_allclose(np.sin(np.radians(run["true_heading"])), 0.0, atol=1e-2)


def test_depth_vbs():
    """The buoyancy engine takes it from the surface to 10 m and holds it there."""
    run = fly(GAZEBO, Hover(depth_m=10, duration_s=3600), duration=3600.0)
    assert run["true_depth"].max() < 20.0
    late = run.time >= 1800.0
    np.testing.assert_allclose(run["true_depth"][late], 10.0, atol=0.1)
    np.testing.assert_allclose(run["true_velocity_down"][late], 0.0, atol=0.1)
    assert np.abs(run["true_pitch"][run.time >= 180.0]).max() < 10.0


def test_pitch_depth_vbs():
    """Both together: on its way to 10 m it hardly moves along or across."""
    run = fly(GAZEBO, Hover(depth_m=10, pitch_deg=0, duration_s=1800), duration=1800.0)
    assert 10.0 < run["true_depth"].max() < 20.0
    # ahead and astern 5 m, across 0.3 m
    assert np.abs(run["true_north"]).max() < 5.0
    assert np.abs(run["true_east"]).max() < 0.3
    assert np.abs(np.radians(run["true_pitch"])).max() < 0.1
    assert np.abs(np.diff(run["true_depth"])).sum() < 30.0


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_leg_of_18_m_takes_a_minute(share):
    """At 300 rpm and 20 deg, MBARI's numbers; the legs between the turns are 0.30 m/s."""
    segment = SawTooth(
        max_depth_m=40, min_depth_m=2, pitch_deg=20, speed_m_s=0.95, trim_share=share,
        duration_s=1200,
    )  # fmt: skip
    run = fly(MBARI, segment, duration=1200.0)
    depth, down = run["true_depth"], run["true_velocity_down"]
    legs = (depth > 12.0) & (depth < 30.0) & (run.time > 100.0)
    seconds = 18.0 / np.abs(down[legs]).mean()
    assert seconds == pytest.approx(60.0, abs=5.0)
    assert run["true_propeller"][legs].mean() == pytest.approx(10.0 * math.pi, rel=0.04)


def test_a_yo_yo_at_15_degrees_is_as_fast_as_at_sea():
    """The shore logs of 2013 have medians of 0.230 m/s down and 0.245 m/s up."""
    segment = SawTooth(max_depth_m=60, min_depth_m=5, pitch_deg=15, speed_m_s=0.95, yos=6)
    run = fly(MBARI, segment, duration=2700.0)
    down = run["true_velocity_down"]
    between = (run["true_depth"] > 15.0) & (run["true_depth"] < 50.0)
    assert np.median(down[between & (down > 0)]) == pytest.approx(0.230, rel=0.1)
    assert np.median(down[between & (down < 0)]) == pytest.approx(-0.245, rel=0.1)


# --- REMUS, by its file alone ---------------------------------------------------------------------


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


# --- a vehicle from its dimensions ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("slenderness", "along", "across", "turning"),
    [(1.5, 0.305, 0.621, 0.094), (2.51, 0.156, 0.763, 0.367), (6.01, 0.045, 0.918, 0.764),
     (9.97, 0.021, 0.960, 0.883)],
)  # fmt: skip
def test_spheroids_are_those_of_lambs_table(slenderness, along, across, turning):
    """Lamb 1932, article 115, k1, k2 and k'."""
    assert _lamb(slenderness) == pytest.approx((along, across, turning), abs=2e-3)


def of(name: str, **known: float) -> tuple[Any, Any]:
    shipped = twin.load_vehicle(name)
    size = {"length": shipped.hull_length, "diameter": shipped.hull_diameter}
    return shipped, Dimensions(**size, mass=shipped.mass, **known).vehicle()


@pytest.mark.parametrize("name", ["remus", "tethys"])
def test_published_vehicles_are_near(name):
    published, made = of(name)
    assert made.mass == pytest.approx(published.mass)
    across = made.added_mass[1, 1] / published.added_mass[1, 1]
    assert 0.75 < across < 1.2
    ours, theirs = dict(made.law.derivatives), dict(published.law.derivatives)
    assert 0.5 < ours["Xuu"] / theirs["Xuu"] < 2.0
    for damping in ("Xuu", "Yvv", "Zww", "Nrr", "Mqq", "Nur", "Muq", "Kpp"):
        assert ours[damping] < 0.0, damping
    # fins turn the nose into the flow, and leave less than all of Munk's moment away from it
    munk = made.added_mass[1, 1] - made.added_mass[0, 0]
    assert 0.0 < ours["Nuv"] < munk
    assert -munk < ours["Muw"] < 0.0


def test_derivatives_grow_with_the_size_of_a_similar_vehicle():
    """Twice the length in all: forces by area, moments by volume; rates bring a length each."""
    size = {"length": 1.33, "diameter": 0.19, "mass": 30.5}
    small = Dimensions(**size).derivatives()
    large = Dimensions(length=2.66, diameter=0.38, mass=8.0 * 30.5).derivatives()
    for name, value in small.items():
        lengths = 2 + (name[0] in "KMN") + sum(motion in "pqr" for motion in name[1:])
        assert large[name] / value == pytest.approx(2.0**lengths), name
    # Hoerner's lift of a body, 0.003 a degree of its length times diameter, and that of the fins
    body = 0.5 * 1025.0 * 0.003 * math.degrees(1.0) * 1.33 * 0.19
    fins = 0.5 * 1025.0 * 3.12 * 1.33 * 0.19 / 40.0
    assert small["Yuv"] == small["Zuw"] == pytest.approx(-(body + fins))


def test_it_flies_straight_and_turns_to_port():
    _, made = of("remus", screw=0.14)

    def controller(seen: Any) -> twin.Command:
        return twin.Command(propeller=100.0, rudder=0.1 if seen.time > 30.0 else 0.0)

    scenario = twin.scenario_of(vehicle=made, duration=60.0, commanded=True)
    run = twin.simulate(scenario, controller=controller)
    assert run["true_surge"][29] > 0.5
    assert abs(run["true_yaw_rate"][29]) < 1e-6
    assert run["true_yaw_rate"][-1] < -0.01
    assert np.isfinite(run.states).all()


@pytest.mark.parametrize(
    ("numbers", "says"),
    [
        ({"length": 1.3, "diameter": 0.19}, "mass missing"),
        ({"length": 1.3, "diameter": 0.19, "mas": 30.0}, "unknown dimension 'mas'"),
        ({"length": 0.3, "diameter": 0.19, "mass": 30.0}, "length over diameter is 1.6"),
        ({"length": 1.3, "diameter": 0.19, "mass": 300.0}, r"18\.9 to 56\.7 kg, not 300"),
        ({"length": 1.3, "diameter": 0.19, "mass": 30.0, "fin_place": 0.6}, "-0.65 m and 0"),
        ({"length": 1.3, "diameter": 0.19, "mass": 30.0, "density": 1.03}, "950 to 1100"),
    ],
)
def test_what_cannot_be_is_refused(numbers, says):
    with pytest.raises(InputError, match=says):
        Dimensions.of(numbers)
