"""The DVL's reach and its lever arm: slant ranges, water cells, an instrument off the keel."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from twin.sensors import Dvl, Surroundings
from twin.sensors.dvl import MODES, OUTPUTS, beam_directions, beam_solutions
from twin.water.current.profile import Profile

DT = 0.5
N = 40
DEPTH = 50.0
LEVEL = {"roll": 0.0, "pitch": 0.0, "heading": 70.0}
RATES = (0.02, -0.03, 0.05)
BOTTOM, WATER, NONE = MODES["bottom"], MODES["water"], MODES["none"]
AT_THE_CB = dataclasses.replace(Dvl.noise_free(), lever_arm=(0.0, 0.0, 0.0))


def measure(dvl, *, altitude=None, depth=DEPTH, angles=LEVEL, rates=RATES, gyro=None, current=None):
    """Velocity (N, 3), modes (N,) and the true velocity over ground, body FRD, of steady motion.

    altitude [m] is that of the CB; None puts the bottom out of reach.
    """
    body = np.array([0.4, 0.03, 0.02])
    turn = Rotation.from_euler("ZYX", [angles[n] for n in ("heading", "pitch", "roll")], True)
    over_ground = turn.apply(body)
    values = dict(angles) | {"depth": depth, "north": 0.0, "east": 0.0}
    values |= dict(zip(("surge", "sway", "heave"), body, strict=True))
    for name, value in zip(("north", "east", "down"), over_ground, strict=True):
        values[f"velocity_{name}"] = value
    names = ("roll_rate", "pitch_rate", "yaw_rate")
    values |= dict(zip(names, rates, strict=True))
    truth = {f"true_{name}": np.full(N, float(value)) for name, value in values.items()}
    felt = rates if gyro is None else gyro
    gyros = {f"measured_{n}": np.full(N, r) for n, r in zip(names, felt, strict=True)}
    bottom_depth = None if altitude is None else depth + altitude
    out = dvl.measure(
        truth | gyros, dt=DT, drawn=dict.fromkeys(Dvl.draws, 0.0),
        rng=np.random.default_rng(0),
        surroundings=Surroundings(bottom_depth=bottom_depth, current=current),
    )  # fmt: skip
    return np.stack([out[name] for name in OUTPUTS], axis=1), out["measured_dvl_mode"], body


def mode_of(dvl, **settings):
    _, mode, _ = measure(dvl, **settings)
    assert (mode == mode[0]).all()
    return mode[0]


@pytest.mark.parametrize(
    ("altitude", "expected"),
    [
        (95.0, BOTTOM),  # 109.7 m along a beam of 30 deg
        (100.0, WATER),  # 115.5 m along the beam, though the bottom is nearer than 110 m
        (0.28, BOTTOM),  # 0.323 m along the beam, though the bottom is nearer than 0.3 m
        (0.25, NONE),  # 0.289 m
    ],
)
def test_the_range_of_bottom_lock_is_a_slant_range(altitude, expected):
    assert mode_of(AT_THE_CB, altitude=altitude) == expected


@pytest.mark.parametrize(("below", "expected"), [(55.0, NONE), (59.9, NONE), (60.1, WATER)])
def test_the_water_cells_of_a_level_instrument_reach_down_to_cell_max(below, expected):
    """60 m straight below: where the bottom is nearer, the farthest cell would lie in it."""
    no_bottom_lock = dataclasses.replace(AT_THE_CB, max_range=1.0)
    assert no_bottom_lock.cell_max == 60.0
    assert mode_of(no_bottom_lock, altitude=below) == expected


def test_no_water_lock_through_the_surface():
    """On its back the beams point up: at 5 m their cells are in the air, at 100 m in the water."""
    over = {**LEVEL, "roll": 180.0}
    assert mode_of(AT_THE_CB, depth=5.0, angles=over) == NONE
    assert mode_of(AT_THE_CB, depth=100.0, angles=over) == WATER


@pytest.mark.parametrize("lever", [(-0.6, 0.4, 0.1), (0.3, -0.5, 0.2), (0.0, 0.7, 0.0)])
def test_the_gyro_takes_any_lever_arm_out_of_the_velocity(lever):
    dvl = dataclasses.replace(AT_THE_CB, lever_arm=lever)
    rolled = {"roll": 20.0, "pitch": -10.0, "heading": 200.0}
    velocity, _, body = measure(dvl, altitude=30.0, angles=rolled)
    np.testing.assert_allclose(velocity, np.tile(body, (N, 1)), atol=1e-12)
    # Without the gyro the velocity is that of the instrument: v + omega x r.
    raw, _, _ = measure(dvl, altitude=30.0, angles=rolled, gyro=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(raw, np.tile(body + np.cross(RATES, lever), (N, 1)), atol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_roll_lowers_the_instrument_on_the_side_that_goes_down(side):
    """2 m to starboard and rolled 30 deg starboard down it hangs 1 m below the CB."""
    dvl = dataclasses.replace(AT_THE_CB, lever_arm=(0.0, 2.0 * side, 0.0), max_range=40.0)
    rolled = {**LEVEL, "roll": 30.0}
    # Two beams point 22.2 deg from the vertical and two 52.2 deg: the farther ones decide.
    azimuth = math.sin(math.radians(30.0)) * math.sin(math.radians(45.0))
    cosine = math.cos(math.radians(30.0)) ** 2 - azimuth * math.sin(math.radians(30.0))
    edge = 40.0 * cosine + side  # altitude of the CB at which the slant range is 40 m
    assert mode_of(dvl, altitude=edge - 0.2, angles=rolled) == BOTTOM
    assert mode_of(dvl, altitude=edge + 0.2, angles=rolled) != BOTTOM


@pytest.mark.parametrize("pitch", [0.0, -30.0, 30.0])
def test_the_water_cells_of_a_tilted_instrument_are_nearer_in_depth(pitch):
    """The cells lie 20 to 60 m along the instrument's axis: on average 40 m cos(pitch) deeper."""
    shear = 0.002  # [1/s] to the north
    table = Profile(depth=(0.0, 200.0), north=(0.0, 200.0 * shear), east=(0.0, 0.0))
    tilted = {"roll": 0.0, "pitch": pitch, "heading": 0.0}
    velocity, mode, body = measure(AT_THE_CB, angles=tilted, current=table.compile(100.0))
    assert (mode == WATER).all()
    below = shear * (DEPTH + 40.0 * math.cos(math.radians(pitch)))
    against = Rotation.from_euler("ZYX", [0.0, pitch, 0.0], True).inv().apply([below, 0.0, 0.0])
    np.testing.assert_allclose(velocity, np.tile(body - against, (N, 1)), atol=1e-9)


def test_a_wrong_beam_reports_the_velocity_of_its_neighbour():
    """Every ping an outlier of that kind: beam i shows b_(i+1) . v, which the solution takes in."""
    every_ping = dataclasses.replace(
        AT_THE_CB, ping_rate=2.0, outlier_probability=1.0, wrong_beam_share=1.0
    )
    still = (0.0, 0.0, 0.0)
    velocity, _, body = measure(every_ping, altitude=30.0, rates=still)
    beams = beam_directions(math.radians(30.0))
    solve, radial = beam_solutions(math.radians(30.0))[15], beams @ body
    possible = [solve @ radial]
    for i in range(4):
        wrong = radial.copy()
        wrong[i] = beams[(i + 1) % 4] @ body
        possible.append(solve @ wrong)
    nearest = [np.abs(sample - possible).max(axis=1) for sample in velocity]
    assert np.max(np.min(nearest, axis=1)) < 1e-12
    assert np.mean(np.argmin(nearest, axis=1) > 0) > 0.4  # some pings are drawn twice, some never


@pytest.mark.parametrize(("pitch", "expected"), [(-34.0, BOTTOM), (-37.0, NONE)])
def test_a_beam_that_looks_too_far_aside_sees_no_bottom_however_near(pitch, expected):
    """At 20 m the aft beams of 37 deg of pitch are 42 m long, and 61.7 deg from the vertical."""
    assert AT_THE_CB.max_beam_angle_deg == 60.0
    assert mode_of(AT_THE_CB, altitude=20.0, angles={**LEVEL, "pitch": pitch}) == expected


@pytest.mark.parametrize(("side", "expected"), [(1.0, BOTTOM), (-1.0, NONE)])
def test_an_instrument_that_a_roll_lifts_out_of_the_water_sees_nothing(side, expected):
    """Half a metre deep and rolled 30 deg, 2 m to starboard: 1.5 m deep, or 0.5 m in the air."""
    dvl = dataclasses.replace(AT_THE_CB, lever_arm=(0.0, 2.0, 0.0))
    rolled = {**LEVEL, "roll": 30.0 * side}
    assert mode_of(dvl, depth=0.5, altitude=20.0, angles=rolled) == expected
