"""What the impulse of the added mass takes in water with a gradient, and what it leaves out.

docs/physics/equations.md says why. Here one glide is flown with the right-hand side of the Fossen
model and another account of the added mass, in plain NumPy.
"""

import functools
from typing import Any

import numpy as np
import pytest
from fossen_terms import quaternion_rate, rotation
from scipy.integrate import solve_ivp

from twin.fossen.equations import (
    acceleration,
    mass_distribution,
    rigid_body_mass,
    turned_water,
)
from twin.fossen.forces import parameters_of
from twin.frames import euler_to_quaternion
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.base import parse_current
from twin.water.current.sampler import sample_gradient

VEHICLE = load_vehicle("glider")
PARAMETERS = parameters_of(VEHICLE, np.zeros(1), np.array([VEHICLE.reference_density]))
PARTS = np.array([0.02, 0.5, VEHICLE.pump_for_net_mass(0.3)])
MASS, MOMENT, INERTIA = mass_distribution(PARAMETERS, PARTS)
DISPLACED = MASS - 0.3
ADDED = np.array(VEHICLE.added_mass)
BOTH = np.linalg.inv(rigid_body_mass(MASS, MOMENT / MASS, INERTIA) + ADDED)
DURATION, STEP = 300.0, 0.2
CURRENTS = (
    "geostrophic:surface=0.4,direction=90,scale=200",
    "ekman:stress=0.2,lat=40,direction=20",
)


def skew(a: Any) -> Any:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def turning(g: Any) -> Any:
    """Rotation (3,) of the water that the gradient `g` in body axes is to a hull with wings."""
    return np.array([g[2, 1], -g[2, 0], g[1, 0]])


def of_impulse(velocity: Any, omega: Any, rates: Any, g: Any) -> Any:
    """What the impulse h = M_A (velocity, rates) presses with, less what any account has."""
    h = ADDED @ np.concatenate([velocity, rates])
    force = np.concatenate(
        [np.cross(omega, h[:3]) + g.T @ h[:3], np.cross(omega, h[3:]) + np.cross(velocity, h[:3])]
    )
    return -force


def left_out(nu: Any, g: Any, change: Any) -> Any:
    """Rate of the gradient, derivative of the energy by the attitude, strain of what is displaced.

    `change` is the gradient's local rate and change along the path, in body axes.
    """
    omega = skew(nu[3:])
    h = ADDED @ np.concatenate([nu[:3], nu[3:] - turning(g)])
    tau = ADDED[:, 3:] @ turning(g @ omega - omega @ g + change)
    tau[3:] -= [h[3:] @ turning(g @ skew(e) - skew(e) @ g) for e in np.eye(3)]
    half = 0.5 * np.array([VEHICLE.hull_length, VEHICLE.hull_diameter, VEHICLE.hull_diameter])
    q = (g @ g + change) * (0.2 * DISPLACED * half**2)  # an ellipsoid's second moments
    tau[3:] += [q[2, 1] - q[1, 2], q[0, 2] - q[2, 0], q[1, 0] - q[0, 1]]
    return tau


def rate(program: Any, account: str, t: float, y: Any) -> Any:
    """dy/dt of (position, quaternion, nu_r)."""
    to_ned, nu = rotation(y[3:7]), y[7:]
    flow = np.array(sample_gradient(program, t, *y[:3]))
    a = flow[6:].reshape(3, 3)
    velocity = to_ned @ nu[:3] + flow[:3]
    g = to_ned.T @ a @ to_ned
    path, water = (to_ned.T @ (flow[3:6] + a @ v) for v in (velocity, flow[:3]))
    density = PARAMETERS.reference_density
    dnu = acceleration(
        PARAMETERS, to_ned[2].copy(), y[2], nu, PARTS, DISPLACED, density, path, water, g
    )
    if account == "omega":
        ours = of_impulse(nu[:3], nu[3:], nu[3:] - turning(g), g)
        dnu = dnu + BOTH @ (of_impulse(nu[:3], nu[3:], nu[3:], g) - ours)
    elif account == "complete":
        ahead, behind = (
            np.array(sample_gradient(program, t + s, *(y[:3] + s * velocity)))[6:].reshape(3, 3)
            for s in (0.5, -0.5)
        )
        dnu = dnu + BOTH @ left_out(nu, g, to_ned.T @ (ahead - behind) @ to_ned)
    return np.concatenate([velocity, quaternion_rate(y[3:7], nu[3:]), dnu])


@functools.cache
def track(current: str, account: str) -> Any:
    """Places (n, 3) of a turning glide."""
    program = parse_current(current).compile(2.0 * DURATION)
    y = np.zeros(13)
    y[2], y[3:7], y[7:10] = 20.0, euler_to_quaternion(0.0, -0.57, 0.4), (0.47, 0.0, 0.012)
    times = np.arange(1.0, DURATION, STEP)
    found = solve_ivp(
        lambda t, y: rate(program, account, t, y), (1.0, DURATION), y, t_eval=times, rtol=1e-9
    )
    return found.y[:3].T


def apart(current: str, account: str) -> float:
    """Largest distance from the track of our models, as a percentage of its length."""
    ours = track(current, "omega_r")
    length = np.linalg.norm(np.diff(ours, axis=0), axis=1).sum()
    return 100.0 * float(np.linalg.norm(track(current, account) - ours, axis=1).max()) / length


@pytest.mark.parametrize("current", CURRENTS)
def test_an_impulse_of_the_bodys_own_rate_is_another_model_and_what_is_left_out_is_small(current):
    assert 0.08 < apart(current, "omega") < 0.2
    assert 1e-4 < apart(current, "complete") < 0.04
    assert apart(current, "omega") > 3.0 * apart(current, "complete")


def water_turning(gradient: Any, half: Any) -> Any:
    """Rotation (3,) of water under an ellipsoid of half axes `half`: what disturbs it as much.

    The disturbance has the normal velocity n . (v_r + omega x s - G s) at the surface, whose normal
    is along s_i / half_i^2 (Lamb 1932, articles 114 and 115). The part with s_j s_k of the gradient
    is that of a rotation about axis i.
    """
    square = np.square(half)
    return np.array(
        [
            (square[j] * gradient[k, j] + square[k] * gradient[j, k]) / (square[j] - square[k])
            for j, k in ((1, 2), (2, 0), (0, 1))
        ]
    )


def test_an_ellipsoid_in_a_gradient_disturbs_the_water_as_one_that_turns_against_it():
    """Of a hull with wings, in any gradient: the rotation of the equations, not none at all."""
    rng = np.random.default_rng(4)
    half = np.array([1.0, 0.3, 0.1])
    s = rng.normal(size=(50, 3))
    s *= (1.0 / np.linalg.norm(s / half, axis=1))[:, None]
    normal = s / np.square(half)
    for _ in range(5):
        g = rng.normal(size=(3, 3))
        np.fill_diagonal(g, 0.0)  # an even disturbance, which has no impulse
        strained = np.sum(normal * (s @ g.T), axis=1)
        turned = np.sum(normal * np.cross(water_turning(g, half), s), axis=1)
        np.testing.assert_allclose(turned, strained, atol=1e-12 * np.abs(strained).max())
        # of a slender hull with flat wings it is the rotation that both models take
        flat = water_turning(g, np.array([1.0, 1e-3, 1e-6]))
        np.testing.assert_allclose(flat, turning(g), atol=1e-5)
        motion = np.concatenate([np.zeros(3), rng.normal(size=3)])
        np.testing.assert_allclose(turned_water(motion, g)[3:], motion[3:] - flat, atol=1e-5)


@pytest.mark.parametrize("name", vehicle_names())
def test_shipped_hulls_are_slender_enough_for_that_rotation(name):
    """A shear of the current over depth, on a level hull: `rogue` is the fat one."""
    vehicle = load_vehicle(name)
    half = 0.5 * np.array([vehicle.hull_length, vehicle.hull_diameter, 0.0])
    g = np.zeros((3, 3))
    g[1, 0] = 1.0
    exact = water_turning(g, half)[2]
    assert exact == pytest.approx(1.0, rel=0.75 if name == "rogue" else 0.06)
