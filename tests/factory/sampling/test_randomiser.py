"""Vehicles and water of control tasks, drawn from the table of parameters."""

import mujoco
import numpy as np
import pytest

from factory.sampling.randomiser import field, table
from twin import control
from twin.control.conditions import Conditions
from twin.errors import InputError, VehicleError
from twin.physics.model_block import header
from twin.physics.mujoco_model import compile_model, refit
from twin.physics.native import block as b
from twin.physics.start import Ballast
from twin.vehicle.vehicle import load_vehicle

GLIDER = load_vehicle("glider")
PLACE = {"vehicle": GLIDER, "depth": 200.0, "duration": 900.0}


def test_only_what_is_named_is_drawn():
    drawn = table({"vehicle.cg_z_mm": "uniform(0.1, 0.3)"}, **PLACE)
    one, other = drawn.draw(np.random.RandomState(0)), drawn.draw(np.random.RandomState(1))
    assert one.current is None
    assert one.density is None
    assert set(one.encoder_zeros.values()) == {0.0}
    shift = [1e3 * (c.vehicle.static_cg - GLIDER.static_cg)[2] for c in (one, other)]
    assert 0.1 <= min(shift) < max(shift) <= 0.3
    np.testing.assert_array_equal(one.vehicle.law.values(), GLIDER.law.values())


def test_preset_field_draws_vehicle_and_water_and_takes_changes():
    drawn = field({"current.speed": 0.0}, **PLACE).draw(np.random.RandomState(0))
    assert drawn.current is None
    assert drawn.density is not None
    assert not np.array_equal(drawn.vehicle.law.values(), GLIDER.law.values())
    assert any(drawn.encoder_zeros.values())
    assert field({}, **PLACE).draw(np.random.RandomState(0)).current is not None


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("vehicle.balast_g", "did you mean 'vehicle.ballast_g'"),
        ("mission.pitch_deg", "belongs to a mission"),
    ],
)
def test_other_parameters_are_refused(name, message):
    with pytest.raises(InputError, match=message):
        table({name: "uniform(0, 1)"}, **PLACE)


@pytest.mark.parametrize("name", ["glider", "tethys"])
def test_a_refitted_model_is_the_compiled_one(name):
    """The drawn vehicle's own model and a refitted one fly to the same bits."""
    nominal = load_vehicle(name)
    place = {**PLACE, "vehicle": nominal}
    real = field({}, **place).draw(np.random.RandomState(3)).vehicle
    own = compile_model(real, lean=True, centred=True)
    refitted = compile_model(nominal, lean=True, centred=True)
    refit(refitted, mujoco.MjData(refitted), nominal, real)
    np.testing.assert_array_equal(
        refitted.numeric_data[-b.HEADER_WORDS :], own.numeric_data[-b.HEADER_WORDS :]
    )
    states = []
    for model in (own, refitted):
        assert header(model)["centred"] == 1.0
        data = mujoco.MjData(model)
        data.qpos[2] = -50.0
        data.ctrl[:] = 0.5 * np.array([part.high for part in nominal.parts])
        mujoco.mj_step(model, data, nstep=500)
        states.append(np.concatenate([data.qpos, data.qvel, data.act]))
    np.testing.assert_array_equal(*states)


def test_what_needs_a_model_of_its_own_is_refused():
    model = compile_model(GLIDER, lean=True)
    heavier = GLIDER.replace(static_mass=GLIDER.static_mass + 1.0)
    with pytest.raises(VehicleError, match="its mass is not that of 'glider'"):
        refit(model, mujoco.MjData(model), GLIDER, heavier)


class Heavier:
    """Draws ballast alone."""

    def draw(self, random):
        return Conditions(ballast=Ballast(depth=50.0, heavy=random.uniform(0.01, 0.02)))


def test_conditions_belong_to_one_episode():
    environment = control.load("depth", {"random": 0}, {"randomise": Heavier()})
    found = []
    for _ in range(3):
        environment.reset()
        found.append(environment.physics.net_buoyancy())
    assert len(set(found)) == 3
    # what compressed hull and depth make of it is small beside the error
    assert all(0.0 < net < 0.03 for net in found)
    environment.task.conditions = None
    plain = control.load("depth", {"random": 0})
    plain.reset()
    assert abs(plain.physics.net_buoyancy()) < 0.01


@pytest.mark.parametrize(
    "randomise",
    ["field", {"vehicle.cg_y_mm": "normal(0, 0.05)", "current.speed": "uniform(0.1, 0.2)"}],
    ids=["field", "named"],
)
def test_many_vehicles_have_the_conditions_of_one(randomise):
    pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")
    settings = {"randomise": randomise, "observation": "dict", "time_limit": 10.0}
    together = control.GliderVectorEnv("waypoints", 2, autoreset_mode="same_step", **settings)
    alone = [control.GliderEnv("waypoints", **settings) for _ in range(2)]
    seen, _ = together.reset(seed=5)
    expected = [env.reset(seed=5 + i)[0] for i, env in enumerate(alone)]
    currents = []
    for _ in range(45):
        for i, observation in enumerate(expected):
            for name, value in observation.items():
                np.testing.assert_allclose(seen[name][i], value, rtol=1e-11, atol=1e-11)
        currents.append(seen["current"][0])
        seen, *_ = together.step(np.full((2, 3), 0.4, np.float32))
        for i, env in enumerate(alone):
            observation, _, terminated, truncated, _ = env.step(np.full(3, 0.4, np.float32))
            expected[i] = env.reset()[0] if terminated or truncated else observation
    assert np.ptp(np.linalg.norm(currents, axis=1)) > 0.01  # another current in each episode


def test_unknown_randomisers_are_refused():
    with pytest.raises(InputError, match="did you mean 'field'"):
        control.load("depth", environment_kwargs={"randomise": "feld"})
