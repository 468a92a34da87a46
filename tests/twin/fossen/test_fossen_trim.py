"""Steady motions of the Fossen model against published and independently computed figures."""

import math

import numpy as np
import pytest

from twin.errors import InputError, NoSteadyState
from twin.fossen import FossenModel
from twin.fossen.steady import SteadyProblem, steady_motions
from twin.vehicle.steady_motion import Trim, solve_steady_state, trim_positions
from twin.vehicle.vehicle import load_vehicle

# net mass kg, block position m, rotation deg: V, alpha, beta, roll, pitch, turn rate, down.
# Computed with an independent solver of the equations of Zhang et al. (2013).
COMPUTED = [
    ((0.30, 0.4216, 45), (0.4902, 1.272, -1.285, -13.688, -35.547, 0.00385, 0.2956)),
    ((0.30, 0.4216, 10), (0.4738, 1.447, -0.325, -3.125, -33.095, 0.00087, 0.2687)),
    ((0.30, 0.4216, 0), (0.4729, 1.457, 0.0, 0.0, -32.973, 0.0, 0.2674)),
    ((0.30, 0.4116, 0), (0.3586, 2.826, 0.0, 0.0, -17.984, 0.0, 0.1274)),
    ((-0.30, 0.3816, 0), (0.4861, -1.257, 0.0, 0.0, 35.058, 0.0, -0.2879)),
]


@pytest.fixture(scope="module")
def seawing():
    return load_vehicle("glider")


@pytest.fixture(scope="module")
def model(seawing):
    return FossenModel(seawing)


@pytest.mark.parametrize(("setting", "expected"), COMPUTED)
def test_computed_steady_states(model, setting, expected):
    net_mass, position, rotation_deg = setting
    shift = position - model.vehicle.battery.neutral_x
    trim = model.trim(shift, math.radians(rotation_deg), net_mass)
    speed, alpha, beta, roll, pitch, turn_rate, down = expected
    assert trim.speed_m_s == pytest.approx(speed, rel=0.003)
    assert trim.angle_of_attack_deg == pytest.approx(alpha, abs=0.01)
    assert trim.sideslip_deg == pytest.approx(beta, abs=0.01)
    assert trim.roll_deg == pytest.approx(roll, abs=0.01)
    assert trim.pitch_deg == pytest.approx(pitch, abs=0.01)
    assert trim.turn_rate_rad_s == pytest.approx(turn_rate, rel=0.01, abs=1e-9)
    assert trim.vertical_speed_m_s == pytest.approx(down, rel=0.003)
    assert trim.in_identified_range
    if rotation_deg == 45:  # printed too; the other figures of that row are in published.toml
        assert trim.turn_radius_m == pytest.approx(100.5, rel=0.02)


def test_spiral_eigenvalues(seawing):
    """The listed eigenvalues belong to the misprinted block inertia I_yy = 10.16 kg m2."""
    inertia = seawing.battery.inertia.copy()
    inertia[1, 1] = 10.16
    misprinted = FossenModel(seawing.replace(battery={"inertia": inertia}))
    motion = misprinted.steady_motion(0.02, math.radians(45), 0.3)
    values = motion.eigenvalues
    np.testing.assert_allclose(values.real[:4], [-3.56, -3.00, -1.81, -1.35], atol=0.006)
    np.testing.assert_allclose(values.real[4:], [-0.585, -0.585, -0.092, -0.092], atol=0.0006)
    np.testing.assert_allclose(
        np.abs(values.imag), [0, 0, 0, 0, 0.258, 0.258, 0.0075, 0.0075], atol=0.0006
    )


def test_slow_modes_do_not_depend_on_the_misprint(model):
    motion = model.steady_motion(0.02, math.radians(45), 0.3)
    np.testing.assert_allclose(
        motion.eigenvalues.real[4:], [-0.585, -0.585, -0.092, -0.092], atol=0.001
    )
    assert motion.stable


@pytest.mark.parametrize("net_mass", [0.3, -0.3])
def test_starboard_and_port_spirals_mirror(model, net_mass):
    shift = math.copysign(0.02, net_mass)
    one = model.trim(shift, math.radians(30), net_mass)
    other = model.trim(shift, math.radians(-30), net_mass)
    assert other.roll_deg == pytest.approx(-one.roll_deg, abs=1e-8)
    assert other.sideslip_deg == pytest.approx(-one.sideslip_deg, abs=1e-8)
    assert other.turn_rate_rad_s == pytest.approx(-one.turn_rate_rad_s, abs=1e-12)
    assert other.pitch_deg == pytest.approx(one.pitch_deg, abs=1e-8)
    assert other.turn_radius_m == pytest.approx(one.turn_radius_m, rel=1e-9)
    # Dive and climb turn to the same side for the same rotation.
    assert one.turn_rate_rad_s > 0
    assert one.roll_deg < 0


def test_no_steady_state_says_why(model):
    with pytest.raises(NoSteadyState, match="net mass 0 kg"):
        model.trim(0.02, 0.0, 0.0)
    with pytest.raises(NoSteadyState, match=r"at shift -0\.02 m, .* flies tail first"):
        model.trim(-0.02, 0.0, 0.3)


@pytest.mark.parametrize(("shift", "rotation_deg"), [(0.025, 90), (0.04, 70), (0.05, 45)])
def test_spin_of_a_nearly_neutral_glider_is_found(model, shift, rotation_deg):
    """No family of spirals leads from the straight glide to these; following time does."""
    trim = model.trim(shift, math.radians(rotation_deg), 0.02)
    assert trim.turn_rate_rad_s > 0.05
    assert trim.vertical_speed_m_s > 0


def test_every_usual_setting_has_one_stable_forward_motion(model):
    for net_mass in (-0.4, 0.4):
        for shift in (0.01, 0.05):
            for rotation in (0.0, 0.8, 1.5):
                signed = math.copysign(shift, net_mass)
                positions = trim_positions(model.vehicle, signed, rotation, net_mass)
                turning = model.vehicle.steered_index("heading")
                problem = SteadyProblem(model.parameters, positions, turning, driven=False)
                motions = steady_motions(problem, model.vehicle.flow_frame.linear_angle)
                assert sum(m.stable and m.forward for m in motions) == 1


def test_stall_is_flagged(model):
    """With the block at neutral the glider sinks flat, far outside the identified range."""
    trim = model.trim(0.0, 0.0, 0.3)
    assert trim.angle_of_attack_deg > 10
    assert not trim.in_identified_range


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ((0.06, 0.0, 0.3), r"shift 0.06 m is outside .* from -0.05 to 0.05 m"),
        ((0.02, 2.0, 0.3), r"rotation 114.592 deg is outside .* from -90 to 90 deg"),
        ((0.02, 0.0, 0.7), r"net mass 0.7 kg is outside .* from -0.5 to 0.5 kg"),
        ((math.nan, 0.0, 0.3), r"shift nan m is outside"),
    ],
)
def test_unreachable_positions(model, setting, message):
    with pytest.raises(InputError, match=message):
        model.trim(*setting)


def test_trim_figures_from_a_motion():
    level = {"roll": 0.0, "pitch": 0.0, "linear_angle": 0.2}
    trim = Trim.from_motion(v_rel=[0.4, 0.0, 0.3], turn_rate=-0.01, **level)
    assert trim.speed_m_s == pytest.approx(0.5)
    assert trim.vertical_speed_m_s == pytest.approx(0.3)
    assert trim.turn_radius_m == pytest.approx(40.0)
    assert trim.angle_of_attack_deg == pytest.approx(math.degrees(math.atan2(0.3, 0.4)))
    assert not trim.in_identified_range
    assert Trim.from_motion(v_rel=[1, 0, 0], turn_rate=0, **level).turn_radius_m is None


def test_root_finder_keeps_distinct_roots_only():
    roots = solve_steady_state(lambda x: x * x - 4.0, [[1.0], [1.1], [-3.0]])
    assert sorted(float(x[0]) for x in roots) == pytest.approx([-2.0, 2.0])
    assert solve_steady_state(lambda x: x * x + 1.0, [[1.0]]) == []
