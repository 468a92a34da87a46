"""Added mass: exact in the mass matrix, at any ratio, under every integrator."""

import dataclasses

import mujoco
import numpy as np
import pytest
from physics import (
    added_mass_in_joint_space,
    fossen_state,
    full_mass,
    glider,
    held,
    hydrodynamic_wrench,
    set_motion,
    without_water_forces,
    zero_servos,
)

from twin.fossen import FossenModel
from twin.fossen.equations import mass_distribution, rigid_body_mass
from twin.physics.mujoco_model import INTEGRATORS
from twin.physics.native.install import install, uninstall
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle

RATIOS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)


def scaled(ratio: float):
    """The Sea-Wing with its heave added mass at `ratio` times its rigid mass."""
    vehicle = load_vehicle("glider")
    return vehicle.replace(added_mass=vehicle.added_mass * ratio * vehicle.mass / 65.92)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_acceleration_is_the_force_over_rigid_plus_added_mass(ratio, integrator):
    vehicle = scaled(ratio)
    model, data = glider(vehicle=vehicle, integrator=integrator, timestep=1e-3)
    zero_servos(model)
    moving = {"velocity": (0.3, -0.1, 0.2), "rates": (0.02, -0.03, 0.05)}
    set_motion(data, roll=0.3, pitch=-0.5, heading=2.0, **moving)
    mujoco.mj_forward(model, data)
    with_added = full_mass(model, data)
    force = data.qfrc_smooth.copy()
    qacc = data.qacc.copy()

    uninstall()
    try:
        mujoco.mj_makeM(model, data)
    finally:
        install()
    rigid = full_mass(model, data)
    exact = rigid + added_mass_in_joint_space(model, data, vehicle.added_mass)
    np.testing.assert_allclose(with_added, exact, rtol=1e-12, atol=1e-11)
    np.testing.assert_allclose(qacc, np.linalg.solve(exact, force), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("ratio", RATIOS[1:])
def test_stiff_servos_approach_the_locked_composite(ratio):
    """Released at rest, the hull moves as if the battery were bolted to it, as dt shrinks."""
    vehicle = scaled(ratio)
    actuators = (0.02, 0.4, -290.0)
    start = Start(depth=1000.0, actuators=actuators)
    given = held(vehicle, actuators, 4.0, start=start, sample_period=1.0)
    locked = FossenModel(vehicle).simulate(
        fossen_state(start), given.mission, 4.0, dt=0.01, sample_period=1.0
    )
    errors = []
    for timestep in (0.1, 0.05, 0.025):
        flown = simulate(dataclasses.replace(given, timestep=timestep))
        errors.append(np.abs(flown.v_rel - locked.v_rel).max())
    moved = np.abs(locked.v_rel).max()
    assert errors[0] < 2e-3 * moved
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


def test_mass_matrix_is_symmetric_positive_definite():
    model, data = glider()
    rng = np.random.default_rng(1)
    for _ in range(20):
        set_motion(
            data, roll=rng.uniform(-1, 1), pitch=rng.uniform(-1, 1), heading=rng.uniform(0, 6)
        )
        mujoco.mj_forward(model, data)
        mass = full_mass(model, data)
        np.testing.assert_array_equal(mass, mass.T)
        assert np.linalg.eigvalsh(mass)[0] > 0


def test_repeated_evaluation_adds_the_mass_once():
    model, data = glider()
    set_motion(data, roll=0.2, pitch=0.3, velocity=(0.4, 0, 0.1), rates=(0.01, 0.02, 0.03))
    mujoco.mj_forward(model, data)
    mass, qacc = full_mass(model, data), data.qacc.copy()
    for _ in range(3):  # skipping the position stage leaves the previous matrix in place
        mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, True)
    np.testing.assert_allclose(full_mass(model, data), mass, rtol=1e-14)
    np.testing.assert_allclose(data.qacc, qacc, rtol=1e-10, atol=1e-13)


def test_finite_difference_linearisation_leaves_the_state_alone():
    model, data = glider()
    set_motion(data, pitch=-0.5, velocity=(0.35, 0, 0.2))
    mujoco.mj_forward(model, data)
    before = full_mass(model, data)
    n = 2 * model.nv + model.na
    a = np.zeros((n, n))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, a, None, None, None)
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(full_mass(model, data), before)
    assert np.isfinite(a).all()
    assert np.abs(a).max() > 0.5


def test_added_mass_does_no_net_work():
    """Drag-free and neutral, the energy of body plus entrained water stays constant."""
    vehicle = without_water_forces()
    start = Start(depth=1000.0, pitch=-0.2, v_rel=(0.5, 0.02, 0.05), rates=(0.02, 0.05, -0.04))
    energies = {}
    for timestep in (0.02, 0.01):
        scenario = held(vehicle, (0.0, 0.0, 0.0), 10.0, start=start, timestep=timestep)
        energies[timestep] = kinetic_and_potential(vehicle, simulate(scenario))
    coarse, fine = (np.abs(e / e[0] - 1).max() for e in energies.values())
    # a tumbling hull: the drift is the integrator's, and vanishes with the step
    assert coarse < 0.02
    assert fine < 0.6 * coarse


def kinetic_and_potential(vehicle, trajectory):
    """Energy [J] of the locked composite with added mass, from the logged signals."""
    total, moment, inertia = mass_distribution(FossenModel(vehicle).parameters, np.zeros(3))
    mass = rigid_body_mass(total, moment / total, inertia) + vehicle.added_mass
    rates = np.stack([trajectory[f"true_{n}_rate"] for n in ("roll", "pitch", "yaw")], -1)
    twist = np.concatenate([trajectory.v_rel, rates], axis=1)
    kinetic = 0.5 * np.einsum("ti,ij,tj->t", twist, mass, twist)
    roll, pitch = (np.deg2rad(trajectory[f"true_{n}"]) for n in ("roll", "pitch"))
    down = np.stack(
        [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)], -1
    )
    return kinetic - vehicle.gravity * down @ moment


def test_munk_moment_has_the_right_sign_and_size():
    """At an angle of attack the added mass pitches the hull further: (Z - X) u w."""
    vehicle = without_water_forces()
    model, data = glider(vehicle=vehicle)
    u, w = 0.5, 0.05
    set_motion(data, velocity=(u, 0, w))
    wrench = hydrodynamic_wrench(model, data)
    expected = (vehicle.added_mass[2, 2] - vehicle.added_mass[0, 0]) * u * w
    assert wrench[4] == pytest.approx(expected, rel=1e-12)
