"""Many vehicles at once: the same episodes, observations and rewards as one at a time."""

# ruff: noqa: E402 - the packages are those of an extra
import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")

from gymnasium.vector import AutoresetMode

from twin import control
from twin.control.observations import normal
from twin.control.registry import ALL_TASKS, environment_id
from twin.control.waypoints import RADIUS
from twin.errors import InputError
from twin.fossen.lane_block import AT

SEED = 5
every_task = pytest.mark.parametrize("task", ALL_TASKS)
nothing_beside = {}
everything = {"noise": {"depth": 0.2, "rates": 1e-3}, "current": "uniform:east=0.1"}


def many(task, count, **settings):
    made = gymnasium.make_vec(environment_id(task), num_envs=count, **settings)
    assert isinstance(made, control.GliderVectorEnv)
    return made


def one(task, **settings):
    return gymnasium.make(environment_id(task), **settings).unwrapped


def compare(task, *, steps, actions_of=None, **settings):
    """Fly 3 vehicles at once and one at a time over several episodes."""
    together = many(task, 3, autoreset_mode="same_step", observation="dict", **settings)
    alone = [one(task, observation="dict", **settings) for _ in range(3)]
    seen, _ = together.reset(seed=SEED)
    expected = [env.reset(seed=SEED + i)[0] for i, env in enumerate(alone)]
    rng, ends = np.random.default_rng(0), 0
    for _ in range(steps):
        for i, observation in enumerate(expected):
            for name, value in observation.items():
                np.testing.assert_allclose(seen[name][i], value, rtol=1e-12, atol=1e-12)
        actions = rng.uniform(-1.0, 1.0, together.action_space.shape).astype(np.float32)
        seen, rewards, terminated, truncated, info = together.step(actions)
        for i, env in enumerate(alone):
            observation, reward, *over = env.step(actions[i])[:4]
            assert rewards[i] == pytest.approx(reward, rel=1e-12, abs=1e-14)
            assert over == [terminated[i], truncated[i]]
            if any(over):
                ends += 1
                for name, value in observation.items():
                    np.testing.assert_allclose(
                        info["final_obs"][i][name], value, rtol=1e-12, atol=1e-12
                    )
                observation, _ = env.reset()
            expected[i] = observation
    return ends


@pytest.mark.parametrize("task", ["hold", "waypoints", "energy"])
def test_noise_behind_goals_is_the_same_for_many_and_for_one(task):
    noise = {"attitude": 0.02, "heading": 0.1} | ({} if task == "hold" else {"position": 5.0})
    assert compare(task, steps=50, time_limit=10.0, noise=noise) > 0


@every_task
@pytest.mark.parametrize("settings", [nothing_beside, everything], ids=["plain", "disturbed"])
def test_many_vehicles_fly_as_one_does(task, settings):
    settings = {"control_timestep": 0.5, **settings}  # that of gliders
    assert compare(task, steps=100, time_limit=20.0, **settings) == 6


def test_ends_at_the_surface_and_at_the_depth_limit_are_those_of_one():
    together, alone = many("depth", 2, autoreset_mode="same_step"), one("depth")
    together.reset(seed=0)
    up = np.array([[-0.4, 0.0, 1.0], [0.4, 0.0, -1.0]], np.float32)  # one light, one heavy
    ends = {}
    for step in range(1800):
        _, _, terminated, truncated, _ = together.step(up)
        for i in np.flatnonzero(terminated | truncated):
            ends.setdefault(int(i), (step, bool(terminated[i])))
        if len(ends) == 2:
            break
    for i, expected in ends.items():
        alone.reset(seed=i)
        steps, over = -1, (False, False)
        while not any(over):
            over, steps = alone.step(up[i])[2:4], steps + 1
        assert (steps, over[0]) == expected
        assert over[0]


def test_episodes_do_not_depend_on_the_others():
    few, more = many("waypoints", 2), many("waypoints", 5)
    few.reset(seed=SEED), more.reset(seed=SEED)
    mask = np.array([True, False])
    more_mask = np.array([True, False, True, True, False])
    few.step(np.zeros((2, 3), np.float32)), more.step(np.ones((5, 3), np.float32))
    a, _ = few.reset(options={"reset_mask": mask})
    b, _ = more.reset(options={"reset_mask": more_mask})
    np.testing.assert_array_equal(a[0], b[0])  # its second episode
    assert not np.array_equal(a[1], b[1])  # it went on, under another action


def test_threads_change_nothing():
    found = []
    for threads in (1, 3):
        env = many("hold", 7, threads=threads)
        env.reset(seed=1)
        for _ in range(20):
            seen = env.step(np.full((7, 3), 0.3, np.float32))[0]
        found.append(seen)
    np.testing.assert_array_equal(*found)


def test_the_next_step_begins_an_episode_where_nothing_else_is_asked():
    env = many("depth", 2, time_limit=1.0)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    first, _ = env.reset(seed=3)
    actions = np.full((2, 3), 0.5, np.float32)
    env.step(actions)
    last, rewards, _, truncated, _ = env.step(actions)
    assert truncated.all()
    assert rewards.all()
    begun, rewards, terminated, truncated, _ = env.step(actions)
    for nothing in (rewards, terminated, truncated):
        assert not nothing.any()
    assert not np.array_equal(begun, last)
    alone = one("depth", time_limit=1.0)
    alone.reset(seed=3)
    np.testing.assert_allclose(begun[0], alone.reset()[0], rtol=1e-6)
    assert not np.array_equal(first, begun)


def test_without_autoreset_the_caller_resets():
    env = many("depth", 2, time_limit=1.0, autoreset_mode="disabled")
    env.reset(seed=3)
    actions = np.zeros((2, 3), np.float32)
    env.step(actions), env.step(actions)
    with pytest.raises(InputError, match=r"episodes of \[0, 1\] are over"):
        env.step(actions)
    env.reset(options={"reset_mask": np.array([True, True])})
    assert not env.step(actions)[3].any()


def test_a_reached_waypoint_is_replaced_for_that_vehicle_alone():
    env = many("waypoints", 3)
    env.reset(seed=0)
    before = env.task.target.copy()
    env.task.target[1] = [0.5 * RADIUS, 0.0]  # beside the start
    env.step(np.zeros((3, 3), np.float32))
    assert env.task.reached.tolist() == [0, 1, 0]
    np.testing.assert_array_equal(env.task.target[[0, 2]], before[[0, 2]])
    assert np.hypot(*env.task.target[1]) > RADIUS


def test_an_action_that_is_not_finite_is_named_with_its_vehicle():
    many = control.GliderVectorEnv(num_envs=3)
    many.reset(seed=0)
    actions = np.zeros((3, 3), np.float32)
    actions[2, 1] = np.nan
    with pytest.raises(InputError, match="action of vehicle 2: rotation is nan"):
        many.step(actions)
    with pytest.raises(InputError, match=r"shape \(3,\) must be of shape \(3, 3\): shift, rot"):
        many.step(actions[0])


@pytest.mark.parametrize("engine", ["mujoco", "lanes"])
def test_an_unstable_vehicle_ends_alone_and_no_nan_is_shown(engine):
    env = many("depth", 3, engine=engine)
    seen, _ = env.reset(seed=0)
    if engine == "lanes":
        env.physics._rows[0, AT["state"] + 10, 1] = 1e9
    else:
        env.physics.batch.bind("qvel")[1, 3] = 1e9
    after, rewards, terminated, truncated, _ = env.step(np.zeros((3, 3), np.float32))
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert rewards[1] == 0.0
    np.testing.assert_array_equal(after[1], seen[1])
    again, *_ = env.step(np.zeros((3, 3), np.float32))
    assert np.isfinite(again).all()
    assert not env.step(np.zeros((3, 3), np.float32))[2].any()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"navigate": "ekf"}, "only the single environment"),
        ({"render_mode": "rgb_array"}, "draws no pictures"),
        ({"autoreset_mode": "same"}, "did you mean 'same_step'"),
        ({"thread": 2}, r"did you mean 'threads'.*\(allowed: autoreset_mode, .*noise, .*num_envs"),
        ({"num_envs": 0}, "give at least 1"),
    ],
)
def test_what_it_does_not_serve_is_refused(settings, message):
    with pytest.raises(InputError, match=message):
        control.GliderVectorEnv("depth", **{"num_envs": 2, **settings})


def test_wrong_calls_are_refused():
    env = many("depth", 2)
    with pytest.raises(InputError, match="call reset first"):
        env.step(np.zeros((2, 3)))
    with pytest.raises(InputError, match="3 seeds for 2 vehicles"):
        env.reset(seed=[1, 2, 3])
    with pytest.raises(InputError, match="first reset begins every episode"):
        env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(InputError, match="option of reset"):
        env.reset(options={"mask": 1})
    env.reset(seed=0)
    with pytest.raises(InputError, match="for each of 2 vehicles"):
        env.step(np.zeros((3, 3)))


def test_a_task_that_draws_for_one_vehicle_only_is_refused():
    class Old(type(control.load("depth").task)):
        def initialize_episode(self, physics):
            super().initialize_episode(physics)

    old = Old(control.load("depth").task.vehicle, max_depth=200.0)
    with pytest.raises(InputError, match="draw its episodes in draw_episode"):
        old.serve([np.random.RandomState(0)])


def test_noise_is_normal_and_every_place_has_its_own():
    count = 40
    seeds, steps = np.arange(count), np.zeros(count, int)
    drawn = np.stack([normal(seeds, steps, steps + k, 25) for k in range(50)])
    flat = drawn.reshape(-1)
    assert len(np.unique(flat)) == flat.size
    assert abs(flat.mean()) < 0.02
    assert flat.std() == pytest.approx(1.0, abs=0.02)
    assert np.mean(np.abs(flat) < 1.0) == pytest.approx(0.6827, abs=0.01)
    for one, other in ((drawn[1:], drawn[:-1]), (drawn[:, 1:], drawn[:, :-1])):
        assert abs(np.mean(one * other)) < 0.02


def test_gymnasiums_statistics_wrapper_takes_it():
    env = gymnasium.wrappers.vector.RecordEpisodeStatistics(many("depth", 2, time_limit=1.0))
    env.reset(seed=0)
    env.step(np.zeros((2, 3), np.float32))
    info = env.step(np.zeros((2, 3), np.float32))[4]
    assert info["episode"]["l"].tolist() == [2, 2]
