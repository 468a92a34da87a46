"""What each task rewards, when it ends, and what moving costs."""

import math
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from dm_control.utils import rewards as theirs
from hypothesis import given
from hypothesis import strategies as st
from processes import python

from twin import control
from twin.control import rewards
from twin.control.task import with_marker
from twin.control.waypoints import RADIUS
from twin.errors import InputError, VehicleError
from twin.physics.start import Start
from twin.vehicle.consumption import Consumption, cost_of_transport
from twin.vehicle.vehicle import load_vehicle
from twin.water.current import Uniform

VEHICLE = load_vehicle("glider")
NOTHING = np.zeros(3)

every_task = pytest.mark.parametrize("task", ["hold", "depth", "waypoints", "energy"])


def started(task, **task_kwargs):
    environment = control.load(task, task_kwargs={"random": 2, **task_kwargs})
    environment.reset()
    return environment


def place(environment, current=None, **start):
    """Start over somewhere else, without drawing anything."""
    physics = environment.physics
    with physics.reset_context():
        physics.set_current(current, duration=100.0)
        physics.set_start(Start(**start))


@every_task
def test_breaking_the_surface_ends_an_episode_with_discount_0(task):
    environment = started(task)
    light = (0.0, 0.0, VEHICLE.actuator_max[2])
    place(environment, depth=3.0, pitch=0.5, v_rel=(0.5, 0.0, 0.0), actuators=light)
    depths = []
    while not (time_step := environment.step([0.0, 0.0, 1.0])).last():
        depths.append(environment.physics.depth())
    assert time_step.discount == 0.0
    assert environment.physics.immersion() < 1.0
    assert min(depths) > VEHICLE.hull_diameter / 2  # and not before


@every_task
@pytest.mark.parametrize(("excess", "ends"), [(-5.0, False), (5.0, True)])
def test_going_too_deep_ends_an_episode_with_discount_0(task, excess, ends):
    environment = started(task)
    place(environment, depth=environment.task.max_depth + excess)
    time_step = environment.step(NOTHING)
    assert time_step.last() is ends
    assert time_step.discount == (0.0 if ends else 1.0)


def test_the_time_limit_ends_an_episode_with_discount_1():
    environment = started("hold", time_limit=2.0)
    kinds = [environment.step(NOTHING) for _ in range(4)]
    assert [t.last() for t in kinds] == [False, False, False, True]
    assert kinds[-1].discount == 1.0


def test_hold_rewards_the_target_and_the_way_to_it():
    environment = started("hold")
    task, physics = environment.task, environment.physics
    rewards = []
    for pitch, heading in ((0.0, 0.0), (0.2, 0.0), (0.0, 1.0), (0.2, 1.0)):
        place(
            environment,
            depth=200.0,
            pitch=task.target_pitch + pitch,
            heading=task.target_heading + heading,
            v_rel=(task.cruise.speed, 0.0, 0.0),
        )
        rewards.append(task.get_reward(physics))
    on_target, pitched, turned, both = rewards
    assert on_target == pytest.approx(1.0)
    assert 0.1 < pitched < on_target
    assert 0.1 < turned < on_target
    assert both == pytest.approx(pitched * turned, rel=1e-6)
    place(environment, depth=200.0, pitch=task.target_pitch, heading=task.target_heading)
    assert task.get_reward(physics) < 0.05  # a drifting hull holds nothing


def test_depth_rewards_being_there_at_rest():
    environment = started("depth")
    task, physics = environment.task, environment.physics

    def reward(error, sinking):
        place(environment, depth=task.target_depth - error, v_rel=(0.0, 0.0, sinking))
        return task.get_reward(physics)

    assert reward(0.0, 0.0) == pytest.approx(1.0)
    assert reward(0.0, 0.5) == pytest.approx(0.75, abs=0.01)
    assert reward(40.0, 0.0) < reward(10.0, 0.0) < 1.0


def test_waypoints_reward_progress_over_ground_so_the_current_counts():
    environment = started("waypoints")
    task, physics = environment.task, environment.physics
    bearing = math.atan2(task.target[1], task.target[0])
    speed = 0.5 * task.cruise_progress

    def reward(heading, flow):
        current = Uniform(north=flow * math.cos(bearing), east=flow * math.sin(bearing))
        place(environment, current, depth=50.0, heading=heading, v_rel=(speed, 0.0, 0.0))
        return task.get_reward(physics)

    assert reward(bearing, 0.0) == pytest.approx(0.5, abs=0.02)
    assert reward(bearing, 0.5 * speed) == pytest.approx(0.75, abs=0.02)
    assert reward(bearing, -0.5 * speed) == pytest.approx(0.25, abs=0.02)
    assert reward(bearing, 9.0) == 1.0
    assert reward(bearing + math.pi, 0.0) == 0.0


def test_waypoints_observe_target_and_current_in_heading_axes():
    environment = started("waypoints")
    task, physics = environment.task, environment.physics
    task.target = (100.0, 0.0)
    place(environment, Uniform(east=0.2), depth=50.0, heading=math.pi / 2, v_rel=(0.3, 0.0, 0.0))
    observation = task.get_observation(physics)
    np.testing.assert_allclose(observation["to_target"], [0.0, -100.0], atol=1e-9)  # to port
    np.testing.assert_allclose(observation["current"], [0.2, 0.0], atol=1e-9)  # from behind


def test_a_reached_waypoint_is_replaced_by_the_next():
    environment = started("waypoints")
    task = environment.task
    north, east = task.target
    place(environment, north=north + 0.9 * RADIUS, east=east, depth=50.0)
    environment.step(NOTHING)
    assert task.reached == 1
    assert math.hypot(*task.to_target(environment.physics)) > RADIUS


def test_energy_counts_the_hotel_load_and_every_move():
    power = 3.0
    losses = Consumption(hotel_power=power)
    environment = started("energy", consumption=losses, normalised=False)
    task, physics = environment.task, environment.physics
    held = physics.activation()
    for _ in range(10):
        environment.step(held)
    assert task.spent == pytest.approx(power * physics.time(), rel=1e-6)
    for _ in range(10):
        environment.step([0.0, 0.0, VEHICLE.actuator_max[2]])
    pumped = (physics.part("pump") - held[2]) * 1e-6
    pressure = VEHICLE.reference_density * VEHICLE.gravity * physics.depth() + losses.hull_vacuum
    assert task.spent > power * physics.time() + 0.9 * pumped * pressure / losses.pump_efficiency


def test_energy_rewards_a_long_way_for_little():
    environment = started("energy")
    task, physics = environment.task, environment.physics

    def reward(distance, spent):
        north, east = distance * math.cos(task.course), distance * math.sin(task.course)
        place(environment, north=north, east=east, depth=50.0)
        task.spent = spent
        return task.get_reward(physics)

    assert reward(1000.0, 1000.0) == 1.0
    assert 0.1 < reward(1000.0, 8000.0) < 1.0
    assert reward(1000.0, 20000.0) < reward(1000.0, 8000.0)
    assert reward(-500.0, 1000.0) == 0.0


@pytest.mark.parametrize(("course", "north", "east"), [(0.0, 1.0, 0.0), (90.0, 0.0, 1.0)])
def test_progress_is_along_the_course_to_the_north_and_to_the_east(course, north, east):
    environment = started("energy")
    task, physics = environment.task, environment.physics
    task.course = math.radians(course)
    for metres in (700.0, -700.0):
        place(environment, north=metres * north, east=metres * east, depth=50.0)
        assert task.distance(physics) == pytest.approx(metres)
    # it heads 30 degrees to port of the course: the course is to starboard
    place(environment, depth=50.0, heading=math.radians(course - 30.0))
    assert task.heading_error(physics) == pytest.approx(math.radians(30.0))


MOVE = st.tuples(st.floats(-0.05, 0.05), st.floats(-1.5, 1.5), st.floats(-480.0, 480.0))


@given(before=MOVE, after=MOVE, depth=st.floats(0.0, 1000.0), pitch=st.floats(-1.2, 1.2))
def test_no_move_costs_less_than_the_hotel_load(before, after, depth, pitch):
    losses = Consumption()
    settings = {"depth": depth, "pitch": pitch, "duration": 0.5}
    for way in ((before, after), (after, before)):
        shares = losses.shares(VEHICLE, *map(np.array, way), **settings)
        assert sum(shares.values()) >= 0.5 * losses.hotel_power


def test_moves_against_pressure_and_gravity_cost_their_work():
    ideal = Consumption(
        hotel_power=0.0,
        pump_efficiency=1.0,
        hull_vacuum=0.0,
        screw_efficiency=1.0,
        rail_friction=0.0,
        bearing_torque=0.0,
    )

    def cost(shift=0.0, rotation=0.0, pump=0.0, pitch=0.0):
        move = np.array([shift, rotation, pump])
        found = ideal.shares(VEHICLE, NOTHING, move, depth=100.0, pitch=pitch, duration=1.0)
        return sum(found.values())

    pressure = VEHICLE.reference_density * VEHICLE.gravity * 100.0
    weight = VEHICLE.battery.mass * VEHICLE.gravity
    assert cost(pump=10.0) == pytest.approx(1e-5 * pressure)
    assert cost(pump=-10.0) == 0.0
    assert cost(shift=0.01, pitch=0.5) == pytest.approx(weight * 0.01 * math.sin(0.5))
    assert cost(shift=0.01, pitch=-0.5) == 0.0
    lifted = VEHICLE.battery.eccentricity * (1.0 - math.cos(0.8))
    assert cost(rotation=-0.8) == pytest.approx(weight * lifted)


def test_cost_of_transport():
    weight = VEHICLE.mass * VEHICLE.gravity
    assert cost_of_transport(VEHICLE, 10.0 * weight, 1000.0) == pytest.approx(0.01)
    assert cost_of_transport(VEHICLE, 1.0, 0.0) == math.inf


@pytest.mark.parametrize(
    ("field", "value"), [("pump_efficiency", 0.0), ("screw_efficiency", 1.5), ("hotel_power", -1.0)]
)
def test_impossible_losses_are_refused(field, value):
    with pytest.raises(InputError, match=field):
        Consumption(**{field: value})


def test_a_second_marker_is_refused():
    marked = with_marker(VEHICLE, type="sphere", size="1")
    with pytest.raises(VehicleError, match="'target'"):
        with_marker(marked, type="sphere", size="1")


DOCS = Path(__file__).parents[3] / "docs" / "howto" / "dm_control.md"
BLOCKS = re.findall(r"```python( gym)?\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize(("extra", "program"), BLOCKS)
def test_the_documentations_programs_run(extra, program):
    if extra:
        pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")
    left = {}
    exec(compile(program, str(DOCS), "exec"), left)
    assert {"environment", "physics", "env", "envs"} & set(left)
    for name in {"observation", "observations", "rewards"} & set(left):
        assert np.isfinite(left[name]).all()


def test_the_documentation_names_every_task():
    assert all(f"| `{task}` |" in DOCS.read_text(encoding="utf-8") for task in control.ALL_TASKS)


def headless(*words):
    """`python -m twin.control` where there is no screen."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL")
    }
    return python("-m", "twin.control", *words, env=environment)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have a screen")
def test_the_viewer_says_that_it_needs_a_screen():
    done = headless("--task", "hold")
    assert done.returncode == 1
    assert "error: the viewer needs a screen" in done.stderr.splitlines()[-1]
    assert "Warning" not in done.stderr


def test_the_viewer_names_unknown_policies():
    from twin.cli.console import Console
    from twin.control.__main__ import ViewTask

    with pytest.raises(InputError, match="did you mean 'autopilot'"):
        ViewTask(policy="autopilt").run(Console("test"))


SETTINGS = [
    {"bounds": (-0.1, 0.3), "margin": 0.7},
    {"bounds": (0.0, 0.2), "margin": 1.3, "sigmoid": "long_tail"},
    {"bounds": (0.5, np.inf), "margin": 0.5, "sigmoid": "linear", "value_at_margin": 0.0},
    {"bounds": (-1.0, -1.0), "margin": 2.0, "sigmoid": "linear", "value_at_margin": 0.3},
    {"bounds": (-0.2, 0.2)},
]


@pytest.mark.parametrize("settings", SETTINGS)
def test_values_are_dm_controls(settings):
    x = np.concatenate([np.random.default_rng(0).normal(0.0, 1.5, 400), [-0.1, 0.2, 0.3, 0.5]])
    expected = theirs.tolerance(x, **settings)
    np.testing.assert_array_equal(rewards.tolerance(x, **settings), expected)
    assert 0.0 < expected.mean() < 1.0
    for value in x[:5].tolist():
        found = rewards.tolerance(value, **settings)
        assert isinstance(found, float)
        assert found == theirs.tolerance(value, **settings)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"bounds": (1.0, 0.0)}, "bounds 1.0 to 0.0"),
        ({"margin": -1.0}, "margin -1.0"),
        ({"margin": 1.0, "sigmoid": "gausian"}, "did you mean 'gaussian'"),
        ({"margin": 1.0, "value_at_margin": 0.0}, "value_at_margin 0.0"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(settings, told):
    with pytest.raises(InputError, match=told):
        rewards.tolerance(0.5, **settings)
