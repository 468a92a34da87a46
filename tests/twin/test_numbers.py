"""Where a number belongs, a text or anything else is one line that names the field."""

import os

import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.mission.plan import Mission
from twin.numbers import number, numbers, processors, product, solved_system
from twin.physics.scenario import Scenario
from twin.physics.start import Start
from twin.sensors.base import SENSORS
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.profile import Profile
from twin.water.density import DensityProfile
from twin.water.floor.bathymetry import KINDS

NONE = ["x", "3", None, [], {}, True, b"x", object(), (1.0, 2.0)]
PLAN = Mission.from_dict({"segments": [{"kind": "surface"}]})


@pytest.mark.parametrize("value", NONE, ids=lambda value: type(value).__name__)
def test_what_is_no_number(value):
    with pytest.raises(InputError, match=r"^depth \[m\] is .*: give a number$"):
        number(value, "depth [m]")


def test_what_is_a_number():
    assert [number(value, "x") for value in (3, np.float32(0.5), np.int64(2), np.array(1.5))] == [
        3.0, 0.5, 2.0, 1.5,
    ]  # fmt: skip
    assert number(10**400, "x") == np.inf
    assert numbers([1, 2], "x").tolist() == [1.0, 2.0]
    with pytest.raises(InputError, match="x is 'ab': give numbers"):
        numbers("ab", "x")


@pytest.mark.parametrize("field", ["duration", "sample_period", "timestep", "encoder_zeros"])
def test_a_scenario_names_the_field(field):
    with pytest.raises(InputError, match=f"scenario: {field}"):
        Scenario(mission=PLAN, **{field: "x"})


@pytest.mark.parametrize("field", ["north", "heading", "v_rel", "rates", "actuators"])
def test_a_start_names_the_field(field):
    with pytest.raises(InputError, match=f"start: {field}"):
        Start(**{field: "x"})


def test_simulate_names_the_argument():
    with pytest.raises(InputError, match="scenario: duration is 'x': give a number"):
        twin.simulate(mission=PLAN, duration="x")


@pytest.mark.parametrize("name", list(SENSORS))
def test_a_sensor_names_the_setting(name):
    kind = SENSORS[name]
    fields = [f for f, v in vars(kind()).items() if isinstance(v, float) and v is not True]
    assert fields or name == "encoders"
    for field in fields:
        with pytest.raises(InputError, match=rf"{kind.__name__}\.{field}"):
            kind(**{field: "x"})


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_sea_floor_names_the_setting(kind):
    needed = {"flat": {}, "rough": {"depth_m": 60.0}, "bathymetry": {"path": "x.nc"}}
    if kind == "grid":
        with pytest.raises(InputError, match="north_m"):
            KINDS[kind](north_m="x", east_m=[0.0, 9.0], depth_m=[[1.0, 1.0], [1.0, 1.0]])
        return
    field = "depth_m" if kind == "flat" else "reach_m"
    with pytest.raises(InputError, match=field):
        KINDS[kind](**{**needed[kind], field: "x"})


def test_tables_name_their_column():
    with pytest.raises(InputError, match="profile: north is 'x'"):
        Profile(depth=(0.0,), north="x", east=(0.0,))
    with pytest.raises(InputError, match="density profile: values is 'x'"):
        DensityProfile(depth=[0.0], values="x")
    with pytest.raises(InputError, match="no sea is deeper"):
        DensityProfile(depth=[0.0, 1e12], values=[1025.0, 1030.0])
    assert DensityProfile(depth=[0.0, 11_000.0], values=[1025.0, 1070.0])
    with pytest.raises(InputError, match="max_depth is 1e"):
        DensityProfile.thermocline(max_depth=1e12)


def test_a_vehicle_that_turns_over_says_so_once(tmp_path):
    xml = load_vehicle("remus").xml
    path = tmp_path / "mine.xml"
    body = xml.index('<body name="hull"')
    place = xml.index('pos="', xml.index("<inertial", body)) + 5
    end = xml.index('"', place)
    path.write_text(f"{xml[:place]}0 0 0.01{xml[end:]}")
    with pytest.warns(RuntimeWarning, match="gravity is 10 mm above its centre of buoyancy"):
        vehicle = load_vehicle(path)
    assert vehicle.metacentric_height == pytest.approx(-0.01)
    load_vehicle(path)  # a warning would be an error here


def test_shipped_vehicles_hang_upright():
    assert load_vehicle("remus").metacentric_height == pytest.approx(0.0196)
    assert load_vehicle("glider").metacentric_height == pytest.approx(0.00502, abs=1e-5)


def test_small_systems_are_solved_as_by_a_library():
    rng = np.random.default_rng(6)
    for size in (1, 2, 3, 4, 6):
        matrix, right = rng.normal(size=(size, size)), rng.normal(size=size)
        matrix[0, 0] = 0.0 if size > 1 else 2.0  # a pivot has to be looked for
        found = solved_system(matrix, right)
        assert found is not None
        np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-9)
        np.testing.assert_allclose(product(matrix, found), right, atol=1e-12)
    assert solved_system(np.zeros((2, 2)), np.ones(2)) is None


def test_processors_where_the_system_has_no_affinity(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5}, raising=False)
    assert processors() == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    assert processors() == 6
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert processors() == 1
