"""Conditions of a mission are what the names and units of their parameters say, by hand."""

import datetime
import math

import numpy as np
import pytest
from stores import drawn

from factory.sampling.conditions import (
    ballast_of,
    build_current,
    build_density,
    encoder_zeros,
    origin,
    spread_vehicle,
)
from factory.sampling.fly import build_mission
from factory.sampling.parameters import parameter_table
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.axes import Origin

VEHICLE = load_vehicle()
KINDS = ("steady", "shear", "tide", "inertial", "ekman", "bottom", "wander")
SPEED, TURN = 0.2, 40.0
"""[m/s], [degree] of each current below, toward north-east"""
M2 = 12.4206 * 3600.0
"""[s] Half a mean lunar day"""
SIDEREAL = 86164.1
"""[s] Turn of the Earth"""


def alone(kind, latitude=40.0, **settings):
    """The current of one kind at `SPEED`; gives its velocity north, east at time, depth."""
    weights = {f"current__{one}": float(one == kind) for one in KINDS}
    own = {f"current__{kind}_{name}": value for name, value in settings.items()}
    parameters = drawn(
        "field", current__speed=SPEED, water__latitude=latitude, mission__max_depth_m=100.0,
        water__bottom_below_m=100.0, **weights, **own,
    )  # fmt: skip
    current, place = build_current(parameters), Origin(latitude_deg=latitude)
    assert current is not None
    return lambda time, depth: np.array(current.velocity(time, 0.0, 0.0, depth, place))[:2]


def toward(degrees, speed=SPEED):
    return speed * np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])


@pytest.mark.parametrize(("latitude", "right"), [(40.0, 1.0), (-40.0, -1.0)])
def test_the_wind_drives_a_spiral_of_the_depth_and_speed_asked_for(latitude, right):
    """Ekman: 45 degrees to the right of the wind, at the e-folding depth a radian more and 1/e."""
    flow = alone("ekman", latitude, direction_deg=TURN, depth_m=25.0)
    np.testing.assert_allclose(flow(0.0, 0.0), toward(TURN + right * 45.0), rtol=1e-6)
    turned = TURN + right * (45.0 + math.degrees(1.0))
    np.testing.assert_allclose(flow(0.0, 25.0), toward(turned, SPEED / math.e), rtol=1e-6)


@pytest.mark.parametrize(("latitude", "right"), [(30.0, 1.0), (-30.0, -1.0)])
def test_an_inertial_current_turns_once_in_a_sidereal_day_at_30_degrees(latitude, right):
    flow = alone("inertial", latitude, direction_deg=TURN, layer_m=40.0)
    for quarter in range(4):
        there = toward(TURN + right * 90.0 * quarter)
        np.testing.assert_allclose(flow(quarter * SIDEREAL / 4.0, 39.0), there, atol=2e-5)
    assert np.hypot(*flow(0.0, 60.0)) < 0.2 * SPEED


def test_a_tide_is_strongest_after_its_phase_and_turns_left_by_its_ratio():
    flow = alone("tide", direction_deg=TURN, ratio=0.5, phase_deg=90.0, constituent="M2")
    np.testing.assert_allclose(flow(M2 / 4.0, 10.0), toward(TURN), atol=1e-5)
    np.testing.assert_allclose(flow(M2 / 2.0, 90.0), toward(TURN - 90.0, SPEED / 2.0), atol=1e-5)
    words = parameter_table(VEHICLE)["current.tide_phase_deg"].long_name
    assert words == "lag of the tide's greatest flow after launch"


def test_a_bottom_layer_has_its_speed_at_its_top_and_none_at_the_floor():
    flow = alone("bottom", direction_deg=TURN, layer_m=50.0)  # the floor is at 200 m
    for depth in (0.0, 150.0):
        np.testing.assert_allclose(flow(0.0, depth), toward(TURN), rtol=1e-9)
    halfway = SPEED * math.log(25.0 / 1e-3) / math.log(50.0 / 1e-3)
    np.testing.assert_allclose(flow(0.0, 175.0), toward(TURN, halfway), rtol=1e-9)
    np.testing.assert_array_equal(flow(0.0, 200.0), 0.0)


def test_a_steady_current_is_everywhere_and_a_sheared_one_decays():
    np.testing.assert_allclose(alone("steady", direction_deg=TURN)(9.0, 99.0), toward(TURN))
    sheared = alone("shear", direction_deg=TURN, scale_m=70.0)
    np.testing.assert_allclose(sheared(0.0, 0.0), toward(TURN))
    np.testing.assert_allclose(sheared(0.0, 70.0), toward(TURN, SPEED / math.e))


def test_a_wandering_current_takes_its_hours_as_seconds():
    weights = {f"current__{one}": float(one == "wander") for one in KINDS}
    current = build_current(drawn("field", current__wander_time_h=2.0, **weights))
    assert current is not None
    assert current.describe()["correlation_time"] == 7200.0


def test_errors_of_a_vehicle_go_the_way_of_their_names():
    plain = dict.fromkeys(
        ("cg_y_mm", "cg_z_mm", "compressibility", "ballast_g", "shift_offset_mm",
         "rotation_offset_deg"), 0.0,
    )  # fmt: skip
    off = {"cg_y_mm": 2.0, "cg_z_mm": 3.0, "compressibility": 4e-10, "ballast_g": 20.0,
           "shift_offset_mm": 1.0, "rotation_offset_deg": 2.0}  # fmt: skip
    sound, wrong = (
        drawn("paper", mission__max_depth_m=120.0, **{f"vehicle__{n}": v for n, v in one.items()})
        for one in (plain, off)
    )
    hulls = [spread_vehicle(VEHICLE, one) for one in (sound, wrong)]
    # forward, starboard, down
    np.testing.assert_allclose(hulls[1].static_cg - hulls[0].static_cg, [0.0, 2e-3, 3e-3])
    softer = hulls[1].hull_compressibility - hulls[0].hull_compressibility
    assert softer == pytest.approx(4e-10)
    assert encoder_zeros(VEHICLE, wrong) == pytest.approx(
        {"shift": 1e-3, "rotation": math.radians(2.0)}
    )
    ballast = ballast_of(VEHICLE, wrong)
    assert (ballast.heavy, ballast.depth) == pytest.approx((0.020, 60.0))


def test_water_is_saltier_and_colder_below():
    column = build_density(
        drawn("field", water__surface_salinity=34.0, water__salinity_increase=0.6,
              water__surface_temperature=18.0, water__deep_temperature=5.0,
              water__mixed_layer_m=20.0, water__thermocline_m=60.0, mission__max_depth_m=300.0)
    )  # fmt: skip
    assert column is not None
    salinity, temperature = column.salinity, column.temperature
    assert salinity[0] == pytest.approx(34.0)
    assert temperature[0] == pytest.approx(18.0)
    assert 34.5 < salinity[-1] < 34.6
    assert 5.0 < temperature[-1] < 6.0


def test_a_mission_begins_on_its_day_and_turns_right_by_a_positive_change():
    parameters = drawn(
        "field", mission__start_day=1.5, mission__start_heading_deg=300.0,
        mission__kind="saw-tooth",
        mission__heading_change_deg=100.0, duration=3 * 3600.0,
    )  # fmt: skip
    first, later = (
        datetime.datetime.fromisoformat(origin(one).time)
        for one in (drawn("field", mission__start_day=0.0), parameters)
    )
    assert later - first == datetime.timedelta(hours=36)
    mission = build_mission(parameters, VEHICLE)
    flown = [getattr(segment, "heading_deg", None) for segment in mission.segments]
    headings = [heading for heading in flown if heading is not None]  # none at the surface
    assert headings[:2] == pytest.approx([40.0, 140.0])
