"""The compass: classical deviation, its size, tilt, and the battery's share."""

import math

import numpy as np
import pytest

from twin.errors import InputError
from twin.sensors import Compass
from twin.vehicle.vehicle import load_vehicle

DEG = math.pi / 180.0
HEADINGS = np.arange(0.0, 360.0, 2.0)


def truth(heading=HEADINGS, **constant):
    """Steady angles, and an AHRS without errors."""
    names = ("roll", "pitch", "shift", "rotation", "pitch_rate", "yaw_rate")
    angles = dict.fromkeys(names, 0.0) | constant
    found = {"true_heading": heading}
    for name, value in angles.items():
        steady = np.broadcast_to(float(value), heading.shape)
        found |= {f"true_{name}": steady, f"measured_{name}": steady}
    return found


def deviation(drawn, compass=None, **constant):
    """measured - true heading [deg] over all headings."""
    compass = compass or Compass.ideal()
    drawn = dict.fromkeys(compass.draw(np.random.default_rng(0)), 0.0) | drawn
    out = compass.measure(truth(**constant), dt=0.5, drawn=drawn, rng=np.random.default_rng(0))[
        "measured_heading"
    ]
    assert out.min() >= 0.0
    assert out.max() < 360.0
    return (out - HEADINGS + 180.0) % 360.0 - 180.0


def test_level_deviation_is_the_five_coefficient_formula():
    a0, b, c, d, e = 0.2, 0.5, -0.3, 0.25, 0.15
    got = deviation(
        {
            "compass_a0_deg": a0, "compass_b_deg": b, "compass_c_deg": c,
            "compass_d_deg": d, "compass_e_deg": e,
        }
    )  # fmt: skip
    psi = HEADINGS * DEG
    classical = a0 + b * np.sin(psi) + c * np.cos(psi) + d * np.sin(2 * psi) + e * np.cos(2 * psi)
    assert got == pytest.approx(classical, abs=0.02)  # second order: (0.6 deg)^2 = 0.006 deg
    assert np.abs(classical).max() > 0.5


def test_one_microtesla_in_25_turns_the_heading_by_2_3_degrees():
    eps = 1.0 / 25.0 / DEG
    assert np.abs(deviation({"compass_b_deg": eps})).max() == pytest.approx(2.3, abs=0.05)


def test_clean_compass_reads_the_true_heading_at_any_tilt():
    for roll, pitch in ((0, 0), (-14, -35), (40, 60), (-30, 85)):
        assert np.abs(deviation({}, roll=roll, pitch=pitch)).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "low", "high"), [("calibrated", 0.8, 1.0), ("uncalibrated", 4.5, 5.6)]
)
def test_preset_rms_over_headings_and_missions(name, low, high):
    compass = Compass.preset(name)
    rng = np.random.default_rng(11)
    square = []
    for seed in range(400):
        drawn = compass.draw(np.random.default_rng(seed))
        out = compass.measure(truth(rotation=30.0), dt=60.0, drawn=drawn, rng=rng)
        error = (out["measured_heading"] - HEADINGS + 180.0) % 360.0 - 180.0
        square.append(np.mean(error**2))
    assert low <= np.sqrt(np.mean(square)) <= high


def test_deviation_moves_with_the_battery_and_not_at_its_neutral_position():
    battery = {"compass_battery_x_deg": 0.5, "compass_battery_y_deg": 0.8}
    assert np.abs(deviation(battery)).max() < 1e-9
    turned = deviation(battery, rotation=90.0)
    # The y component has turned to z: on a level vehicle its deviation is gone, -0.8 cos(psi)
    # became 0, a change of +0.8 cos(psi); x is not changed.
    assert turned == pytest.approx(0.8 * np.cos(HEADINGS * DEG), abs=0.02)
    # Moving away by 0.05 m of 0.3 m leaves (0.3/0.35)^3 = 0.63 of the battery's field.
    away = deviation({"compass_battery_x_deg": 0.5}, shift=0.05)
    expected = (1 - (0.3 / 0.35) ** 3) * 0.5 * np.sin(HEADINGS * DEG)
    assert away == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("rotation", [0.0, 30.0, -30.0, 90.0, -90.0])
def test_the_field_of_the_battery_turns_as_its_mass_does(rotation):
    """A positive rotation carries what was below to port, and what was starboard downwards.

    A field to starboard (y) turns the reading of a vehicle that heads north to the west. It is
    calibrated away at rotation 0, so only its change counts.
    """
    battery, strength = load_vehicle("glider").battery, 5.0
    below = battery.position(0.0, math.radians(rotation))[1:] / battery.eccentricity
    to_port, downwards = -below[0], below[1]
    for axis, change in {"x": 0.0, "y": downwards - 1.0, "z": -to_port}.items():
        expected = -math.degrees(math.atan(math.radians(strength) * change))
        found = deviation({f"compass_battery_{axis}_deg": strength}, rotation=rotation)[0]
        assert found == pytest.approx(expected, abs=1e-9), axis


def test_noise_has_its_rms():
    compass = Compass(offset_deg=0, hard_iron_deg=0, soft_iron_deg=0, battery_deg=0)
    heading = np.full(200_000, 123.0)
    drawn = compass.draw(np.random.default_rng(1))
    out = compass.measure(truth(heading), dt=0.5, drawn=drawn, rng=np.random.default_rng(1))
    assert np.std(out["measured_heading"]) == pytest.approx(0.2, rel=0.03)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Compass.preset("calibrate"), "did you mean 'calibrated'"),
        (lambda: Compass(dip_deg=89.0), "beyond 85 deg"),
        (lambda: Compass(battery_distance=0.1), r"must exceed 0\.2 m"),
    ],
)
def test_wrong_settings_are_explained(make, message):
    with pytest.raises(InputError, match=message):
        make()
