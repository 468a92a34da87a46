"""A user's force on the hull: `xfrc_applied` adds to the water's forces, as on any MuJoCo body."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch
from scipy.integrate import solve_ivp

from twin.physics.model_block import Tables
from twin.physics.mujoco_model import INTEGRATORS, compile_model
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.base import parse_current

FORCE, MOMENT = 10.0, 0.5
"""[N] ahead, [N m] about the vertical, to port"""
SECONDS, STEP = 4.0, 0.005
FLOW = 0.15
"""[m/s] Current to the north."""


def neutral():
    """An ROV with its CG a micrometre below the CB and no tether: level forces leave it level."""
    vehicle = load_vehicle("bluerov2")
    cg = np.array([0.0, 0.0, 1e-6])  # at 0 MuJoCo simplifies the body, which native code refuses
    return vehicle.replace(static_cg=cg, tether={"drag_coefficient": 0.0})


def ready(*, current=None, **options):
    """A model and its data at rest over ground, heading north, deep, and the index of its hull."""
    program = None if current is None else parse_current(current).compile(60.0)
    tables = None if program is None else Tables(current=program)
    model = compile_model(neutral(), lean=True, timestep=STEP, tables=tables, **options)
    data = mujoco.MjData(model)
    data.qpos[2] = -50.0
    return model, data, model.body("hull").id


def pushed(model, data, hull, seconds=SECONDS):
    """State after a force that is assigned once."""
    data.xfrc_applied[hull, 0] = FORCE
    mujoco.mj_step(model, data, nstep=round(seconds / STEP))
    return np.concatenate([data.qpos, data.qvel])


def response(inertia, linear, quadratic, push, start=0.0):
    """Speed after SECONDS of (m + m_A) du/dt = push - linear u - quadratic u|u|, by DOP853."""
    found = solve_ivp(
        lambda t, u: (push - linear * u - quadratic * u * np.abs(u)) / inertia,
        (0.0, SECONDS), [start], method="DOP853", rtol=1e-11, atol=1e-13,
    )  # fmt: skip
    return float(found.y[0, -1])


@pytest.mark.parametrize("flow", [0.0, FLOW])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_force_moves_a_neutral_hull_as_its_equation_says(integrator, flow):
    """An explicit Euler step of a contracting equation errs by at most half a step of its start."""
    model, data, hull = ready(integrator=integrator, current=f"uniform:{FLOW},0" if flow else None)
    vehicle = neutral()
    inertia = vehicle.mass + vehicle.added_mass[0, 0]
    drag = (13.7, 141.0)  # von Benzon et al. 2022
    expected = flow + response(inertia, *drag, FORCE, start=-flow)
    pushed(model, data, hull)
    largest = (FORCE + drag[0] * flow + drag[1] * flow**2) / inertia
    bound = 1e-8 if integrator == "rk4" else 0.5 * STEP * largest
    assert data.qvel[0] == pytest.approx(expected, abs=bound)
    assert np.abs(data.qvel[1:]).max() < 1e-4
    assert expected > 0.2  # far from still water


def test_a_moment_turns_it_and_a_later_one_leaves_the_force():
    model, data, hull = ready()
    vehicle = neutral()
    inertia = vehicle.static_inertia[2, 2] + vehicle.added_mass[5, 5]
    data.xfrc_applied[hull, 5] = MOMENT
    mujoco.mj_step(model, data, nstep=round(SECONDS / STEP))
    expected = response(inertia, 0.0, 1.5, MOMENT)
    assert data.qvel[5] == pytest.approx(expected, abs=0.5 * STEP * MOMENT / inertia)
    data.xfrc_applied[hull, 2] = -FORCE  # down; the moment, which nobody touched, stays
    mujoco.mj_step(model, data, nstep=round(SECONDS / STEP))
    assert data.qvel[2] < -0.1
    assert data.qvel[5] == pytest.approx(np.sqrt(MOMENT / 1.5), rel=1e-3)


def test_evaluations_at_the_same_state_do_not_add_up():
    model, data, hull = ready()
    data.xfrc_applied[hull, :3] = FORCE, -2.0, 3.0
    mujoco.mj_forward(model, data)
    first = data.qacc.copy()
    for _ in range(3):
        mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.qacc, first)


@pytest.mark.parametrize("whole", [True, False])
def test_zero_takes_the_force_away(whole):
    """The viewer clears the whole array before each step; a user may clear the hull's row alone."""
    model, data, hull = ready()
    mujoco.mj_forward(model, data)
    rest = data.qacc.copy()
    data.xfrc_applied[hull, :] = FORCE
    mujoco.mj_forward(model, data)
    assert np.abs(data.qacc - rest).max() > 0.1
    if whole:
        data.xfrc_applied[:] = 0.0
    else:
        data.xfrc_applied[hull] = 0.0
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.qacc, rest)


def test_a_force_that_cancels_the_water_is_kept():
    model, data, hull = ready()
    mujoco.mj_forward(model, data)
    data.xfrc_applied[hull] *= -1.0
    mujoco.mj_forward(model, data)
    for _ in range(2):
        sinking = data.qacc.copy()
        mujoco.mj_forward(model, data)
        assert sinking[2] < -1.0  # the weight alone is left
        np.testing.assert_array_equal(data.qacc, sinking)


@pytest.mark.parametrize("centred", [True, False])
def test_a_reset_takes_the_force_away(centred):
    model, data, hull = ready(centred=centred)
    mujoco.mj_forward(model, data)
    rest = data.qacc.copy()
    first = pushed(model, data, hull)
    mujoco.mj_resetData(model, data)
    data.qpos[2] = -50.0
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.qacc, rest)
    mujoco.mj_resetData(model, data)
    data.qpos[2] = -50.0
    np.testing.assert_array_equal(pushed(model, data, hull), first)


def test_a_saved_state_goes_on_with_its_force():
    model, data, hull = ready()
    whole = mujoco.mjtState.mjSTATE_INTEGRATION
    pushed(model, data, hull, 1.0)
    saved = np.empty(mujoco.mj_stateSize(model, whole))
    mujoco.mj_getState(model, data, saved, whole)
    mujoco.mj_step(model, data, nstep=100)
    expected = data.qvel.copy()
    data.xfrc_applied[hull, :3] = 1.0, 2.0, 3.0
    mujoco.mj_step(model, data, nstep=10)
    mujoco.mj_setState(model, data, saved, whole)
    mujoco.mj_step(model, data, nstep=100)
    np.testing.assert_array_equal(data.qvel, expected)


@pytest.mark.parametrize("cleared", [0.0, None])
def test_userdata_that_is_cleared_or_restored_alone_makes_no_force_of_the_water(cleared):
    """dm_control restores userdata without `xfrc_applied`, and a start clears it."""
    model, data, _ = ready()
    before = data.userdata.copy()
    data.qvel[0] = 0.3
    mujoco.mj_step(model, data, nstep=50)
    other = mujoco.MjData(model)
    other.qpos[:], other.qvel[:], other.act[:] = data.qpos, data.qvel, data.act
    data.userdata[:] = before if cleared is None else cleared
    mujoco.mj_forward(model, data)
    mujoco.mj_forward(model, other)
    np.testing.assert_array_equal(data.qacc, other.qacc)


def test_each_simulation_of_a_batch_has_its_own_force():
    model, data, hull = ready()
    batch = Batch(model, 2, 1)
    batch.bind("qpos")[:] = data.qpos
    batch.bind("xfrc_applied")[1].reshape(-1, 6)[hull, 0] = FORCE
    batch.step(nstep=200)
    speeds = batch.bind("qvel")[:, 0]
    pushed(model, data, hull, 200 * STEP)
    assert speeds[0] == 0.0
    assert speeds[1] == data.qvel[0] > 0.1
