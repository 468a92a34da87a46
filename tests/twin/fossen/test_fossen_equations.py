"""Matrices and forces of the Fossen model: identities, signs and limits."""

import math

import numpy as np
import pytest
from fossen_terms import (
    STRIPS,
    lower,
    numbers,
    quaternion_rate,
    restoring,
    rotation,
    strip_immersion,
)

from twin.fossen import FossenModel
from twin.fossen.equations import (
    actuators_after,
    derivative,
    mass_distribution,
    rigid_body_mass,
    skew,
)
from twin.fossen.forces import damping_wrench, displaced_mass, pumped
from twin.fossen.steady import down_axis
from twin.fossen.terms import added_mass_coriolis, impulse, rigid_body_coriolis, solved
from twin.frames import euler_to_quaternion, quaternion_to_matrix
from twin.vehicle.laws.flow_frame import beyond_identified
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.layers import Geostrophic
from twin.water.current.sampler import sample, sample_gradient
from twin.water.current.tide import Inertial

DEEP = 100.0


def distribution(p, *positions):
    """(CG (3,) [m], inertia about the CB (3, 3) [kg m2]) with the masses held there."""
    mass, moment, inertia = mass_distribution(p, np.array([*positions, 0.0]))
    assert mass == pytest.approx(p.mass, rel=1e-14)
    return moment / mass, inertia


@pytest.fixture(scope="module")
def model():
    return FossenModel(load_vehicle("glider"))


def random_nu(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=6) * [0.5, 0.1, 0.1, 0.1, 0.1, 0.1]


def test_solver_and_quaternion_rate():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6))
    matrix, right = root @ root.T + np.eye(6), rng.normal(size=6)
    np.testing.assert_allclose(
        solved(lower(matrix), numbers(right)), np.linalg.solve(matrix, right), rtol=1e-10
    )

    q, omega, h = euler_to_quaternion(0.3, -1.2, 2.0), rng.normal(size=3), 1e-5
    rate = quaternion_rate(q, omega)
    ahead, behind = (rotation(q + s * h * rate) for s in (1, -1))
    r = quaternion_to_matrix(q)
    np.testing.assert_allclose((ahead - behind) / (2 * h), r @ skew(omega), atol=1e-8)


def test_mass_matrix_is_that_of_two_blocks(model):
    """Kinetic energy of the blocks, each with its own velocity, equals nu^T M_RB nu / 2."""
    v, p = model.vehicle, model.parameters
    rng = np.random.default_rng(2)
    shift, rotation = 0.03, 0.9
    cg, inertia = distribution(p, shift, rotation)
    m_rb = rigid_body_mass(p.mass, cg, inertia)
    np.testing.assert_allclose(m_rb, m_rb.T, atol=1e-12)
    assert np.linalg.eigvalsh(m_rb + v.added_mass)[0] > 0
    turn = quaternion_to_matrix(euler_to_quaternion(rotation, 0.0, 0.0))
    for _ in range(5):
        nu = random_nu(rng)
        linear, omega = nu[:3], nu[3:]
        energy = 0.0
        turned = turn @ v.battery.inertia @ turn.T
        for mass, r, own in (
            (v.static_mass, v.static_cg, v.static_inertia),
            (v.battery.mass, v.battery.position(shift, rotation), turned),
        ):
            velocity = linear + np.cross(omega, r)
            energy += 0.5 * mass * velocity @ velocity + 0.5 * omega @ own @ omega
        assert 0.5 * nu @ m_rb @ nu == pytest.approx(energy, rel=1e-12)


def test_coriolis_matrices_do_no_work_and_are_newtons(model):
    rng = np.random.default_rng(3)
    p = model.parameters
    cg, inertia = distribution(p, -0.02, -0.7)
    m_rb = rigid_body_mass(p.mass, cg, inertia)
    for _ in range(10):
        nu = random_nu(rng)
        v, w = numbers(nu[:3]), numbers(nu[3:])
        body = (p.mass, numbers(p.mass * cg), lower(inertia))
        c_rb = -np.concatenate(rigid_body_coriolis(body, v, w))
        h = impulse(lower(p.added_mass), 1.0, v, w)
        c_a = -np.concatenate(added_mass_coriolis(h, v, w))
        assert nu @ c_rb == pytest.approx(0.0, abs=1e-12)
        assert nu @ c_a == pytest.approx(0.0, abs=1e-12)
        # Kirchhoff's equations with the momenta of either matrix.
        for matrix, c in ((m_rb, c_rb), (p.added_mass, c_a)):
            momentum = matrix @ nu
            force = np.cross(nu[3:], momentum[:3])
            moment = np.cross(nu[3:], momentum[3:]) + np.cross(nu[:3], momentum[:3])
            np.testing.assert_allclose(c, np.concatenate((force, moment)), atol=1e-12)


def test_integrated_equation_is_fossens_in_an_unsteady_sheared_current(model):
    """M_RB dnu + C_RB(nu) nu + M_A dnu_r + C_A(nu_r) nu_r = tau - g, with nu_c spelt out."""
    rng = np.random.default_rng(4)
    p = model.parameters
    current = Geostrophic(baroclinic=0.4, direction_deg=30.0, scale_depth=40.0) + Inertial(
        speed=0.3, latitude_deg=45.0
    )
    program = current.compile(3600.0)
    for _ in range(5):
        q = euler_to_quaternion(*rng.uniform(-1, 1, 3))
        nu_r = random_nu(rng)
        position = np.array([10.0, -20.0, 30.0])
        actuators = np.array([0.02, 0.6, -200.0])
        y = np.concatenate((position, q, nu_r, [10.0]))
        dy = derivative(p, program, 500.0, y, actuators)
        r = quaternion_to_matrix(q)
        flow = np.array(sample(program, 500.0, *position, *dy[:3]))
        body_current, omega = r.T @ flow[:3], nu_r[3:]
        whole = np.array(sample_gradient(program, 500.0, *position))
        gradient = whole[6:].reshape(3, 3)
        g_body = r.T @ gradient @ r
        nu_w = nu_r - [0.0, 0.0, 0.0, g_body[2, 1], -g_body[2, 0], g_body[1, 0]]
        nu = nu_r + np.concatenate((body_current, np.zeros(3)))
        nu_c_dot = np.concatenate((-np.cross(omega, body_current) + r.T @ flow[3:], np.zeros(3)))
        nu_dot = dy[7:13] + nu_c_dot
        cg, inertia = distribution(p, *actuators[:2])
        displaced = displaced_mass(p, position[2], pumped(p, actuators)[0])
        g, _ = restoring(p, r[2].copy(), position[2], p.mass, p.mass * cg, displaced)
        body = (p.mass, numbers(p.mass * cg), lower(inertia))
        h = impulse(lower(p.added_mass), 1.0, numbers(nu_w[:3]), numbers(nu_w[3:]))
        left = (
            rigid_body_mass(p.mass, cg, inertia) @ nu_dot
            - np.concatenate(rigid_body_coriolis(body, numbers(nu[:3]), numbers(omega)))
            + p.added_mass @ dy[7:13]
            - np.concatenate(added_mass_coriolis(h, numbers(nu_r[:3]), numbers(omega)))
        )
        right = damping_wrench(p, nu_w, p.reference_density) - g
        # Froude-Krylov, and the strained impulse of the added mass
        right[:3] += displaced * r.T @ (whole[3:6] + gradient @ flow[:3])
        right[:3] -= g_body.T @ (p.added_mass @ nu_w)[:3]
        np.testing.assert_allclose(left, right, atol=1e-11)
        np.testing.assert_allclose(dy[:3], r @ nu[:3], atol=1e-14)


def test_the_weight_of_the_whole_sphere_is_exact_at_both_ends(model):
    law = model.vehicle.flow_frame
    for angle in (-0.17, 0.0, 0.1, law.linear_angle):
        assert beyond_identified(angle, law.linear_angle, law.blend_angle) == 0.0
    for angle in (0.5, -2.0, math.pi, law.blend_angle):
        assert beyond_identified(angle, law.linear_angle, law.blend_angle) == 1.0
    middle = 0.5 * (law.linear_angle + law.blend_angle)
    assert beyond_identified(-middle, law.linear_angle, law.blend_angle) == pytest.approx(0.5)


def test_wrench_at_the_edge_of_the_identified_range_by_hand(model):
    """Zhang et al. (2013) spelt out with rotations about y and z instead of R_BC's entries."""
    p = model.parameters
    alpha, beta, speed = math.radians(9.9), math.radians(-9.9), 0.5
    ahead = np.array([math.cos(alpha) * math.cos(beta), math.sin(beta), math.sin(alpha)])
    nu = np.array([*(speed * ahead * [1.0, 1.0, math.cos(beta)]), 0.01, -0.02, 0.03])
    force = -np.array([7.19 + 386.29 * alpha**2, 115.65 * beta, -0.36 + 440.99 * alpha])
    moment = np.array([-58.27 * beta, 0.28 - 65.84 * alpha, 34.10 * beta])
    moment -= np.array([19.83, 205.64, 389.30]) * nu[3:]
    about_y = quaternion_to_matrix(euler_to_quaternion(0.0, -alpha, 0.0))
    about_z = quaternion_to_matrix(euler_to_quaternion(0.0, 0.0, beta))
    to_body = about_y @ about_z
    np.testing.assert_allclose(to_body @ [speed, 0.0, 0.0], nu[:3], atol=1e-15)
    expected = speed**2 * np.concatenate((to_body @ force, to_body @ moment))
    np.testing.assert_allclose(damping_wrench(p, nu, p.reference_density), expected, rtol=1e-12)


def test_immersion_runs_from_air_to_full_depth(model):
    p = model.parameters
    for depth, expected in ((-0.5 * p.hull_diameter, 0.0), (0.0, 0.5), (0.5 * p.hull_diameter, 1)):
        _, immersion = restoring(p, down_axis(0.0, 0.0), depth, p.mass, np.zeros(3), p.mass)
        assert immersion == pytest.approx(expected, abs=1e-12)
    xs = [strip_immersion(p, 0.0, 0.0, i)[0] for i in range(STRIPS)]
    assert sum(xs) == pytest.approx(0.0, abs=1e-12)
    assert max(xs) == pytest.approx(p.hull_length * 4 / 9)


def test_waterplane_rights_the_hull_in_pitch(model):
    """At the surface a nose-up hull sinks its stern: buoyancy pushes the nose down."""
    p = model.parameters
    for pitch in (-0.1, 0.05, 0.3):
        g, _ = restoring(p, down_axis(0.0, pitch), 0.0, p.mass, np.zeros(3), p.mass)
        assert np.sign(-g[4]) == -np.sign(pitch)
    # Fully immersed the strips have no moment about the CB.
    g, immersion = restoring(p, down_axis(0.2, 0.4), DEEP, p.mass, np.zeros(3), p.mass)
    assert immersion == 1.0
    np.testing.assert_allclose(g, 0.0, atol=1e-9)


def test_restoring_signs(model):
    p = model.parameters
    level = down_axis(0.0, 0.0)
    heavy, _ = restoring(p, level, DEEP, p.mass, np.zeros(3), p.mass - 0.3)
    assert -heavy[2] == pytest.approx(0.3 * p.gravity)
    nose_heavy, _ = restoring(p, level, DEEP, p.mass, np.array([1.0, 0.0, 0.0]), p.mass)
    assert -nose_heavy[4] == pytest.approx(-p.gravity)
    port_heavy, _ = restoring(p, level, DEEP, p.mass, np.array([0.0, -1.0, 0.0]), p.mass)
    assert -port_heavy[3] == pytest.approx(-p.gravity)


def test_static_equilibrium(model):
    """Neutral and at rest the hull hangs with its CG below the CB and stays there."""
    p = model.parameters
    cg, _ = distribution(p, 0.001, 0.5)
    pitch = math.atan2(-cg[0], math.hypot(cg[1], cg[2]))
    q = euler_to_quaternion(math.atan2(cg[1], cg[2]), pitch, 1.0)
    y = np.concatenate(([0.0, 0.0, DEEP], q, np.zeros(6), [10.0]))
    rate = derivative(p, np.zeros(0), 0.0, y, np.array([0.001, 0.5, 0.0]))
    np.testing.assert_allclose(rate, 0.0, atol=1e-13)


def test_pump_density_and_compressibility_change_the_displaced_mass():
    vehicle = load_vehicle("glider")
    plain = FossenModel(vehicle).parameters
    assert displaced_mass(plain, DEEP, 0.0) == pytest.approx(vehicle.mass)
    pump = vehicle.pump_for_net_mass(0.3)
    assert vehicle.mass - displaced_mass(plain, DEEP, pump) == pytest.approx(0.3)

    stiff_pressure = vehicle.reference_density * vehicle.gravity * 1000.0
    squeezed = FossenModel(vehicle.replace(hull_compressibility=5e-10)).parameters
    lost = vehicle.mass - displaced_mass(squeezed, 1000.0, 0.0)
    assert lost == pytest.approx(vehicle.mass * 5e-10 * stiff_pressure)

    table = FossenModel(vehicle, density=([0.0, 100.0], [1020.0, 1030.0]))
    function = FossenModel(vehicle, density=lambda z: 1020.0 + 0.1 * np.minimum(z, 100.0))
    for depth, density in ((-1.0, 1020.0), (25.0, 1022.5), (100.0, 1030.0), (500.0, 1030.0)):
        for other in (table, function):
            expected = density * vehicle.neutral_volume
            assert displaced_mass(other.parameters, depth, 0.0) == pytest.approx(expected)


def test_actuators_follow_their_law():
    """The closed form against small explicit steps of clip((command - x) / lag, -rate, rate)

    with the command at most at the end of the travel.
    """
    law = np.array(
        [[-0.05, -1.5, -400.0], [0.05, 1.5, 400.0], [2.0, 2.0, 4.0], [0.02, 0.35, 50.0], [0, 0, 0]]
    )
    command = np.array([0.04, -2.0, 30.0])
    x = np.array([-0.05, 1.0, 0.0])
    start, h, wanted = x.copy(), 1e-4, np.clip(command, law[0], law[1])
    for step in range(1, 100_001):
        x = x + h * np.clip((wanted - x) / law[2], -law[3], law[3])
        if step % 10_000 == 0:
            exact = actuators_after(start, command, law, step * h)
            np.testing.assert_allclose(exact, x, rtol=1e-3, atol=1e-6)
    assert exact[1] == pytest.approx(-1.5, abs=0.1)


# --- at the surface: vertical forces, and an energy ----------------------------------------------


ATTITUDES = [(0.5, 0.2), (-0.5, 0.2), (1.2, -0.3), (math.pi / 2, 0.1), (2.5, -0.6)]
"""[rad] roll, pitch"""


@pytest.fixture(scope="module")
def parameters(model):
    return model.parameters


@pytest.mark.parametrize(("roll", "pitch"), ATTITUDES)
@pytest.mark.parametrize("depth", [-0.05, 0.0, 0.1])
def test_weight_and_buoyancy_have_no_moment_about_the_vertical(parameters, roll, pitch, depth):
    p = parameters
    moment = p.mass * np.array([0.01, -0.004, 0.003])
    down = down_axis(roll, pitch)
    for first_moment in (np.zeros(3), moment):
        g, immersion = restoring(p, down, depth, p.mass, first_moment, p.mass)
        assert 0.0 < immersion < 1.0
        assert g[3:] @ down == pytest.approx(0.0, abs=1e-10)
        assert np.abs(g[3:]).max() > 1.0  # there is a moment, about the horizontal


@pytest.mark.parametrize(("roll", "pitch"), ATTITUDES)
def test_the_buoyancy_acts_on_the_strips(parameters, roll, pitch):
    """Moment and force are the sums over the strips, each pushed up at its own place."""
    p = parameters
    down, depth = down_axis(roll, pitch), 0.05
    force, moment = np.zeros(3), np.zeros(3)
    for strip in range(STRIPS):
        x, fraction = strip_immersion(p, depth, down[0], strip)
        push = -fraction / STRIPS * p.mass * p.gravity * down
        force += push
        moment += np.cross([x, 0.0, 0.0], push)
    g, _ = restoring(p, down, depth, p.mass, np.zeros(3), p.mass)
    np.testing.assert_allclose(-g[:3], force + p.mass * p.gravity * down, atol=1e-9)
    np.testing.assert_allclose(-g[3:], moment, atol=1e-9)


@pytest.mark.parametrize(("roll", "pitch"), ATTITUDES)
def test_a_strip_is_immersed_by_its_own_depth(parameters, roll, pitch):
    """Nose down (sine of pitch below 0) the bow is the deeper end."""
    p = parameters
    slope = down_axis(roll, pitch)[0]
    assert slope == pytest.approx(-math.sin(pitch))
    bow = strip_immersion(p, 0.0, slope, STRIPS - 1)[1]
    stern = strip_immersion(p, 0.0, slope, 0)[1]
    assert np.sign(bow - stern) == -np.sign(pitch)
