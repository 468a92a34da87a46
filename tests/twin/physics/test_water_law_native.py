"""The native force law beyond its identified range, at any pair of flow angles."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from twin.vehicle.laws.flow_frame import native_wrench
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")
VALUES, DENSITY = VEHICLE.law.values(), VEHICLE.reference_density
DAMPING = np.array([-19.83, -205.64, -389.30])
"""[N m s2/(m2 rad)] K_p, K_q, K_r of Zhang et al. (2013)"""
RATES = (0.01, 0.02, 0.03)
LIMITS = (10.0, 20.0)
"""[deg] where the identified range ends and where the cross-flow law is complete"""


def wrench(alpha, beta, rates=RATES, speed=0.5):
    """Force and moment (6,) at these flow angles [rad]."""
    u = speed * math.cos(alpha) * math.cos(beta)
    w = speed * math.sin(alpha) * math.cos(beta)
    return np.array(native_wrench(VALUES, DENSITY, u, speed * math.sin(beta), w, *rates))


def rate_moment(alpha, beta, rates, speed=0.5):
    """The part of the moment (3,) that the rates make."""
    return (wrench(alpha, beta, rates, speed) - wrench(alpha, beta, (0, 0, 0), speed))[3:]


@given(
    alpha=st.floats(-10, 10),
    beta=st.one_of(st.floats(20, 89.9), st.floats(-89.9, -20)),
    rates=st.tuples(*[st.floats(-1, 1)] * 3),
)
def test_rates_are_damped_axis_by_axis_in_a_flow_from_the_side(alpha, beta, rates):
    """docs/physics/equations.md: beyond 20 deg of EITHER angle the axes are those of the body."""
    found = rate_moment(math.radians(alpha), math.radians(beta), rates)
    np.testing.assert_allclose(found, DAMPING * rates * 0.5**2, atol=1e-9)


@given(
    alpha=st.floats(20, 180), beta=st.floats(-89.9, 89.9), rates=st.tuples(*[st.floats(-1, 1)] * 3)
)
def test_rates_are_damped_axis_by_axis_in_a_flow_from_below(alpha, beta, rates):
    found = rate_moment(math.radians(alpha), math.radians(beta), rates)
    np.testing.assert_allclose(found, DAMPING * rates * 0.5**2, atol=1e-9)


def test_damping_never_falls_below_that_of_a_tenth_of_a_metre_per_second():
    """docs/physics/equations.md: 0.1 m/s: a hull that turns in still water is damped too."""
    for speed in (0.0, 0.03, 0.0999):
        found = rate_moment(0.0, 0.0, RATES, speed)
        np.testing.assert_allclose(found, DAMPING * RATES * 0.1**2, rtol=1e-12)
    faster = rate_moment(0.0, 0.0, RATES, 0.2)
    np.testing.assert_allclose(faster, DAMPING * RATES * 0.2**2, rtol=1e-9)


@given(
    limit=st.sampled_from(LIMITS),
    side=st.sampled_from((1.0, -1.0)),
    other=st.floats(-85, 85),
    which=st.sampled_from(("alpha", "beta", "both")),
)
def test_the_law_is_continuous_where_it_changes(limit, side, other, which):
    """Across 10 and 20 deg of one angle at any other, and of both at once.

    Not across 90 deg of sideslip: the angle of attack has no value there.
    """
    step, edge = 1e-7, math.radians(side * limit)
    sides = []
    for angle in (edge - step, edge + step):
        pair = {
            "alpha": (angle, math.radians(other)),
            "beta": (math.radians(2.0 * other), angle),
            "both": (angle, math.copysign(angle, other)),
        }[which]
        sides.append(wrench(*pair))
    # the steepest slope of the law is some 100 N/rad and N m/rad at 0.5 m/s
    np.testing.assert_allclose(*sides, atol=1e-4)


def test_the_law_is_continuous_where_the_angle_of_attack_wraps():
    for beta in (0.0, 0.3, -1.2):
        ahead, behind = (wrench(angle, beta) for angle in (math.pi - 1e-7, -math.pi + 1e-7))
        np.testing.assert_allclose(ahead, behind, atol=1e-4)


def test_the_law_is_continuous_at_ninety_degrees_of_sideslip():
    """With v alone there is no angle of attack: the force must not depend on how v is reached."""
    forces = [wrench(alpha, math.pi / 2 - 1e-7)[:3] for alpha in np.linspace(-math.pi, math.pi, 9)]
    np.testing.assert_allclose(np.ptp(forces, axis=0), 0.0, atol=1e-3)


@given(
    alpha=st.floats(-180, 180),
    beta=st.floats(-89, 89),
    rates=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
)
def test_the_law_is_that_of_the_fossen_model_at_every_flow_angle(alpha, beta, rates):
    """Two codes after one paper, also where no manoeuvre of `twin check` goes."""
    from twin.fossen import FossenModel
    from twin.fossen.forces import damping_wrench

    a, b = math.radians(alpha), math.radians(beta)
    p = FossenModel(VEHICLE).parameters
    flow = 0.5 * np.array([math.cos(a) * math.cos(b), math.sin(b), math.sin(a) * math.cos(b)])
    theirs = damping_wrench(p, np.concatenate([flow, rates]), DENSITY)
    np.testing.assert_allclose(wrench(a, b, rates), theirs, atol=1e-9)
