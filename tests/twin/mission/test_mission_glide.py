"""The steady glide of a wanted pitch, against published trims and the independent model."""

import math

import pytest

from twin.errors import MissionError
from twin.fossen import FossenModel
from twin.mission import steady_glide
from twin.vehicle.vehicle import load_vehicle


@pytest.mark.parametrize(
    ("net_mass", "pitch_deg", "shift", "speed", "alpha_deg", "down"),
    [
        (0.30, -32.973, 0.0200, 0.4729, 1.457, 0.2674),
        (0.30, -17.984, 0.0100, 0.3586, 2.826, 0.1274),
        (-0.30, 35.058, -0.0200, 0.4861, -1.257, -0.2879),
    ],
)
def test_sea_wing_glides_of_the_reference_table(net_mass, pitch_deg, shift, speed, alpha_deg, down):
    glide = steady_glide(load_vehicle("glider"), math.radians(pitch_deg), net_mass)
    assert glide.shift == pytest.approx(shift, abs=1e-5)
    assert glide.speed == pytest.approx(speed, abs=1e-4)
    assert math.degrees(glide.angle_of_attack) == pytest.approx(alpha_deg, abs=1e-3)
    assert glide.vertical_speed == pytest.approx(down, abs=1e-4)


@pytest.mark.parametrize("name", ["glider", "rogue", "graver-2005"])
@pytest.mark.parametrize("pitch_deg", [-40, -25, 25, 40])
def test_inverse_of_the_fossen_trim(name, pitch_deg):
    vehicle = load_vehicle(name)
    net_mass = -0.25 * math.copysign(1, pitch_deg)
    glide = steady_glide(vehicle, math.radians(pitch_deg), net_mass)
    trim = FossenModel(vehicle).trim(glide.shift, 0.0, net_mass)
    assert trim.pitch_deg == pytest.approx(pitch_deg, abs=1e-3)
    assert trim.speed_m_s == pytest.approx(glide.speed, rel=1e-5)
    assert trim.vertical_speed_m_s == pytest.approx(glide.vertical_speed, rel=1e-5)


def test_too_shallow_a_pitch_names_the_shallowest():
    vehicle = load_vehicle("glider")
    with pytest.raises(MissionError, match=r"3 deg is too shallow .* glides from (\d+\.\d) deg on"):
        steady_glide(vehicle, math.radians(-3), 0.3)
    with pytest.raises(MissionError, match="heavy glider dives nose down"):
        steady_glide(vehicle, math.radians(20), 0.3)
