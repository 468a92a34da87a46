"""The tasks as Gymnasium environments of one vehicle."""

# ruff: noqa: E402 - the packages are those of an extra
from pathlib import Path

import numpy as np
import pytest
from processes import python

gymnasium = pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")

from twin import control
from twin.control.registry import ALL_TASKS, environment_id
from twin.control.task import episode_random
from twin.errors import InputError
from twin.show.render.context import available_backend

every_task = pytest.mark.parametrize("task", ALL_TASKS)


def make(task, **settings):
    return gymnasium.make(environment_id(task), **settings)


def run(program):
    """A Python program in a process of its own."""
    return python("-c", program)


def test_gymnasium_finds_the_tasks_by_the_package_in_the_name():
    done = run(
        "import gymnasium, sys; env = gymnasium.make('twin.control:glider_twin/Depth-v0'); "
        "print(env.spec.id)"
    )
    assert done.stdout.split() == ["glider_twin/Depth-v0"], done.stderr


def test_the_page_has_the_error_of_a_bare_name_so_that_a_search_finds_it():
    done = run("import gymnasium; gymnasium.make('glider_twin/Depth-v0')")
    error = done.stderr.strip().splitlines()[-1]
    assert error.startswith("gymnasium.error.NamespaceNotFound: ")
    page = Path(__file__).parents[3] / "docs" / "howto" / "dm_control.md"
    assert error in page.read_text()


def test_registering_loads_neither_mujoco_nor_dm_control():
    done = run(
        "import twin.control, sys; "
        "sys.exit(any(n in sys.modules for n in ('mujoco', 'dm_control', 'torch')))"
    )
    assert done.returncode == 0


@every_task
@pytest.mark.parametrize("observation", ["flat", "dict"])
def test_gymnasiums_own_checker_finds_nothing(task, observation):
    from gymnasium.utils.env_checker import check_env

    env = make(task, observation=observation)
    check_env(env.unwrapped, skip_render_check=True)  # a warning would be an error here
    rate = 1.0 / env.unwrapped.task.vehicle.control_period
    assert env.metadata["render_fps"] == pytest.approx(rate)


@every_task
def test_the_checker_of_stable_baselines_finds_nothing(task):
    check = pytest.importorskip("stable_baselines3.common.env_checker")
    check.check_env(make(task), warn=True, skip_render_check=True)


@pytest.mark.parametrize("task", ["hold", "depth", "waypoints", "energy"])
def test_flat_observations_are_the_named_ones_over_their_usual_sizes(task):
    flat, named = make(task).unwrapped, make(task, observation="dict").unwrapped
    vector, _ = flat.reset(seed=4)
    found, _ = named.reset(seed=4)
    action = np.array([0.3, -0.2, -0.5], np.float32)
    for _ in range(30):
        assert vector.dtype == np.float32
        assert flat.observation_space.contains(vector)
        assert named.observation_space.contains(found)
        for name, where in flat.columns.items():
            expected = np.clip(found[name] / flat.task.scale(name), -10.0, 10.0)
            np.testing.assert_allclose(vector[where], expected, rtol=1e-6, atol=1e-7)
        assert np.abs(vector).max() < 4.0
        vector, found = flat.step(action)[0], named.step(action)[0]
    np.testing.assert_array_equal(flat.scale[flat.columns["depth"]], 100.0)


def test_episodes_are_the_suites():
    env = make("hold", observation="dict").unwrapped
    native = control.load("hold")
    observation, _ = env.reset(seed=3)
    native.task.set_generator(episode_random(3, 0))
    expected = native.reset()
    action = np.array([0.2, -0.4, -0.6])
    for _ in range(20):
        for name, value in expected.observation.items():
            np.testing.assert_array_equal(observation[name], value)
        observation, reward, terminated, truncated, _ = env.step(action)
        expected = native.step(action)
        assert reward == expected.reward
        assert (terminated, truncated) == (False, False)


def test_an_episode_depends_on_the_seed_and_its_number_alone():
    env, other = make("waypoints").unwrapped, make("waypoints").unwrapped
    env.reset(seed=11), other.reset(seed=11)
    for _ in range(5):
        env.step(env.action_space.sample())
    second, _ = env.reset()
    np.testing.assert_array_equal(second, other.reset()[0])
    again, _ = env.reset(seed=11)
    np.testing.assert_array_equal(again, other.reset(seed=11)[0])
    assert not np.array_equal(again, second)


def test_both_ends_of_an_episode():
    env = make("depth", time_limit=1.0)
    env.reset(seed=0)
    assert env.step(env.action_space.sample())[2:4] == (False, False)
    assert env.step(env.action_space.sample())[2:4] == (False, True)  # time limit: truncated
    with pytest.raises(InputError, match="call reset first"):
        env.unwrapped.step(np.zeros(3))
    env.reset()
    env.unwrapped.environment.physics.data.qpos[2] = -1e4
    assert env.step(np.zeros(3, np.float32))[2:4] == (True, False)  # too deep: terminated


def test_white_noise_has_its_deviation_and_touches_nothing_beside_what_is_made_of_it():
    noisy = make("depth", observation="dict", noise={"depth": 0.5}).unwrapped
    clean = make("depth", observation="dict").unwrapped
    errors, still = [], np.zeros(3, np.float32)
    seen, true = noisy.reset(seed=1)[0], clean.reset(seed=1)[0]
    for _ in range(400):
        errors.append(float(seen["depth"][0] - true["depth"][0]))
        for name in true.keys() - {"depth", "to_target"}:
            np.testing.assert_array_equal(seen[name], true[name])
        (seen, reward, *_), (true, expected, *_) = noisy.step(still), clean.step(still)
        assert reward == expected  # of the truth
    assert np.std(errors) == pytest.approx(0.5, rel=0.12)
    assert abs(np.mean(errors)) < 0.1
    assert abs(np.corrcoef(errors[1:], errors[:-1])[0, 1]) < 0.15


GOALS = {
    "hold": ({"attitude": 0.02, "heading": 0.1}, ["to_target"]),
    "depth": ({"depth": 1.0}, ["to_target"]),
    "waypoints": ({"heading": 0.1, "position": 5.0}, ["to_target", "current"]),
    "energy": ({"heading": 0.1, "position": 5.0}, ["to_course", "distance"]),
}


@pytest.mark.parametrize("task", GOALS)
def test_no_goal_tells_the_truth_that_noise_hides(task):
    noise, goals = GOALS[task]
    noisy = make(task, observation="dict", noise=noise).unwrapped
    clean = make(task, observation="dict").unwrapped
    seen, true = noisy.reset(seed=1)[0], clean.reset(seed=1)[0]
    action = np.array([0.2, -0.1, -0.3], np.float32)
    for _ in range(20):
        own = noisy.task
        for name in goals:
            assert np.all(seen[name] != true[name])
        if task == "depth":
            assert seen["depth"] + seen["to_target"] == pytest.approx(own.target_depth)
        elif task == "hold":
            shown = seen["to_target"][0] + seen["attitude"][1]
            assert shown == pytest.approx(own.target_pitch)
            assert np.hypot(*seen["to_target"][1:]) == pytest.approx(1.0)
        elif task == "waypoints":  # a wrong heading turns the current, and does not change it
            assert np.hypot(*seen["current"]) == pytest.approx(np.hypot(*true["current"]))
            assert abs(np.hypot(*seen["to_target"]) - np.hypot(*true["to_target"])) > 1e-3
        (seen, reward, *_), (true, expected, *_) = noisy.step(action), clean.step(action)
        assert reward == expected


def test_noise_of_a_goals_own_name_is_added_to_it():
    noisy = make("depth", observation="dict", noise={"to_target": 1.0}).unwrapped
    seen = noisy.reset(seed=1)[0]
    assert 0.0 < abs(seen["depth"][0] + seen["to_target"][0] - noisy.task.target_depth) < 5.0


def test_noise_of_what_no_goal_is_made_of_is_refused():
    with pytest.raises(InputError, match="unknown observation of this task 'heading'"):
        make("depth", noise={"heading": 0.1})
    with pytest.raises(InputError, match="did you mean 'heading'"):
        make("hold", noise={"headin": 0.1})


def test_a_goal_without_a_noisy_form_is_refused(monkeypatch):
    kind = type(control.load("depth").task)
    monkeypatch.setattr(kind, "observe_goal", lambda self, seen: {"wet": seen.immersion()})
    env = make("depth", noise={"depth": 0.1})
    with pytest.raises(InputError, match=r"physics\.immersion, which has no noisy form: .*depth"):
        env.reset()


@every_task
@pytest.mark.parametrize("disturbed", [False, True])
def test_named_observations_stay_far_inside_of_finite_limits(task, disturbed):
    settings = {"noise": {"depth": 1.0, "rates": 0.1}, "current": "uniform:0.5,0.3"}
    settings = settings | {"randomise": "field"} if disturbed else {}
    env = make(task, observation="dict", time_limit=300.0, control_timestep=5.0, **settings)
    space, rng = env.observation_space, np.random.default_rng(0)
    for box in space.values():
        assert np.isfinite([box.low, box.high]).all()
    for seed in range(4):
        seen, over = env.reset(seed=seed)[0], False
        action = rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)
        while not over:
            if rng.uniform() < 0.2:
                action = rng.uniform(-1.0, 1.0, action.shape).astype(np.float32)
            for name, value in seen.items():
                low, high = space[name].low, space[name].high
                assert space[name].contains(value), name
                if name != "spent":  # it begins with nothing
                    assert ((low < value) & (value < high)).all() or name in (
                        "actuators", "to_course", "to_heading"
                    ), name  # fmt: skip
            seen, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated


def test_without_a_time_limit_a_distance_has_no_limit():
    env = make("energy", observation="dict", time_limit=float("inf"))
    assert np.isinf(env.observation_space["distance"].high)
    assert np.isfinite(env.observation_space["depth"].high)


def test_navigation_shows_what_is_known_on_board():
    env = make("depth", observation="dict", navigate="ekf", time_limit=20.0).unwrapped
    true = make("depth", observation="dict", time_limit=20.0).unwrapped
    seen, known = env.reset(seed=2)[0], true.reset(seed=2)[0]
    assert 0.0 < abs(seen["depth"][0] - known["depth"][0]) < 5.0
    assert not np.array_equal(env.reset(seed=3)[0]["depth"], seen["depth"])
    np.testing.assert_array_equal(env.reset(seed=2)[0]["depth"], seen["depth"])


def test_a_current_carries_the_vehicle():
    env = make("depth", current="uniform:north=0.2", time_limit=60.0).unwrapped
    env.reset(seed=0)
    for _ in range(40):
        env.step(np.zeros(3, np.float32))
    physics = env.environment.physics
    assert physics.north() == pytest.approx(0.2 * physics.time(), rel=1e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"observation": "flaat"}, "did you mean 'flat'"),
        ({"noise": {"dept": 0.1}}, "did you mean 'depth'"),
        ({"noise": {"depth": -0.1}}, "give 0 or more"),
        ({"render_mode": "human"}, "unknown render_mode 'human'"),
        ({"random": 3}, r"reset\(seed=\.\.\.\)"),
        ({"vehicl": "glider"}, "did you mean 'vehicle'"),
        ({"nois": {"depth": 0.1}}, r"did you mean 'noise'.*\(allowed: control_timestep, current, "),
        ({"curent": "uniform:0.1"}, "did you mean 'current'.*hydrodynamics, .*noise, .*vehicle"),
        ({"current": "uniform:north=0.1", "time_limit": float("inf")}, "time limit"),
        ({"randomise": 3}, "a name, a mapping of distributions or an object"),
    ],
)
def test_settings_that_cannot_be_used_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        control.GliderEnv("depth", **settings)


def test_actions_in_the_parts_units():
    env = make("depth", normalised=False)
    low, high = env.unwrapped.environment.physics.actuator_range()
    np.testing.assert_allclose(env.action_space.low, low, rtol=1e-6)
    np.testing.assert_allclose(env.action_space.high, high, rtol=1e-6)


@pytest.mark.skipif(available_backend() is None, reason="nothing here can draw")
def test_pictures():
    kwargs = {"camera_id": "side", "height": 64, "width": 80}
    env = make("energy", render_mode="rgb_array", render_kwargs=kwargs)
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (64, 80, 3)
    assert picture.std() > 5.0
    env.close()


HIDDEN = """
import importlib.util, sys
found = importlib.util.find_spec
def find(name, package=None):
    return None if name in hidden else found(name, package)
importlib.util.find_spec = find
sys.modules.update(dict.fromkeys(hidden))
"""
"""Packages of an extra that is not installed"""


def without(packages, program):
    """What a process of its own prints that does not find these packages."""
    done = run(f"hidden = {packages!r}{HIDDEN}{program}")
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", ["GliderEnv", "GliderVectorEnv", "StableBaselinesVec"])
def test_a_missing_extra_is_named(name):
    told = without(
        ["gymnasium"],
        "from twin import control\n"
        "from twin.errors import InputError\n"
        f"try:\n    control.{name}\nexcept InputError as error:\n    print(error)",
    )
    assert told.startswith(f"twin.control.{name} needs the package gymnasium")
    assert told.endswith('pip install "glider-twin[gym]"\n')


def test_without_gymnasium_the_tasks_are_there_for_dm_control():
    told = without(
        ["gymnasium"],
        "from twin import control\n"
        "environment = control.load('hold', task_kwargs={'random': 1})\n"
        "print(environment.reset().first(), sorted(control.TASKS))",
    )
    assert told == "True ['depth', 'energy', 'hold', 'path', 'reach', 'station', 'waypoints']\n"


def test_nothing_of_dm_control_is_needed():
    told = without(
        ["dm_control", "dm_env"],
        """
import numpy as np
from twin import control
from twin.control.environment import load_environment
from twin.control.policies import POLICIES
for task in control.ALL_TASKS:
    one, many = control.GliderEnv(task), control.GliderVectorEnv(task, 2)
    one.reset(seed=1), many.reset(seed=1)
    for _ in range(3):
        action = one.action_space.sample()
        _, alone, *_ = one.step(action)
        _, together, *_ = many.step(np.stack([action, action]))
        assert abs(alone - together[0]) < 1e-9
    environment = load_environment(task, {"random": 2})
    environment.reset()
    for make in POLICIES.values():
        assert environment.step(make(environment, 0)(None)).reward >= 0.0
print("flown")
try:
    control.load("hold")
except Exception as error:
    print(type(error).__name__, error)
""",
    )
    flown, refused = told.splitlines()
    assert flown == "flown"
    assert refused.startswith("InputError a task of dm_control needs the package dm_control")
    assert 'pip install "glider-twin[suite]"' in refused
