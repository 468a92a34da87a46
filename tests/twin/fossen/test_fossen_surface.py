"""Weight and buoyancy of the Fossen model at the surface: vertical forces, and an energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fossen_terms import STRIPS, restoring, strip_immersion

from twin.fossen import FossenModel
from twin.fossen.steady import down_axis
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")
ATTITUDES = [(0.5, 0.2), (-0.5, 0.2), (1.2, -0.3), (math.pi / 2, 0.1), (2.5, -0.6)]
"""[rad] roll, pitch"""


@pytest.fixture(scope="module")
def parameters():
    return FossenModel(VEHICLE).parameters


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
