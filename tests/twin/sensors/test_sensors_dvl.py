"""The DVL: exact beam geometry over any floor, the sheet's statistics, lock and its loss."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from twin.errors import InputError
from twin.sensors import Dvl, Surroundings
from twin.sensors.dvl import MODES, OUTPUTS, beam_directions, beam_solutions
from twin.sensors.kernels import slant_kernel
from twin.water.current.profile import Profile
from twin.water.floor import GridFloor, RoughFloor
from twin.water.floor.lookup import floor_depth

DT = 0.5
DEG = math.pi / 180.0
BOTTOM, WATER, NONE = MODES["bottom"], MODES["water"], MODES["none"]
QUIET = Dvl.noise_free()
AT_THE_CB = dataclasses.replace(QUIET, lever_arm=(0.0, 0.0, 0.0))
BEAMS = beam_directions(30.0 * DEG)
BODY = np.array([0.4, 0.03, 0.02])
RATES = (0.01, -0.02, 0.03)
LEVEL = (0.0, 0.0, 70.0)
STILL = (0.0, 0.0, 0.0)
AXIS = np.array([-4000.0, 4000.0])
NAMES = (
    ("north", "east", "depth"), ("roll", "pitch", "heading"), ("surge", "sway", "heave"),
    ("velocity_north", "velocity_east", "velocity_down"), ("roll_rate", "pitch_rate", "yaw_rate"),
)  # fmt: skip


def turned(angles):
    """Rotation from body axes to NED at roll, pitch and heading [deg]."""
    return Rotation.from_euler("ZYX", angles[::-1], degrees=True)


def measure(
    dvl, *, n=40, place=(0.0, 0.0, 50.0), angles=(0.0, -20.0, 70.0), body=BODY,
    drift=(0.1, -0.2, 0.0), rates=RATES, gyro=None, drawn=(), changes=(), **around,
):  # fmt: skip
    """Velocity (n, 3), mode (n,) and the true velocity over ground (3,), all body FRD, of steady
    motion in a current over a bottom at 100 m."""
    turn = turned(angles)
    ground = turn.apply(body) + drift
    signals = {
        f"true_{name}": np.full(n, float(value))
        for names, values in zip(NAMES, (place, angles, body, ground, rates), strict=True)
        for name, value in zip(names, values, strict=True)
    }
    for name, rate in zip(NAMES[4], rates if gyro is None else gyro, strict=True):
        signals[f"measured_{name}"] = np.full(n, rate)
    around.setdefault("bottom_depth", 100.0)
    out = dvl.measure(
        signals | dict(changes), dt=DT, drawn=dict.fromkeys(Dvl.draws, 0.0) | dict(drawn),
        rng=np.random.default_rng(0), surroundings=Surroundings(**around),
    )  # fmt: skip
    velocity = np.stack([out[name] for name in OUTPUTS], axis=1)
    return velocity, out["measured_dvl_mode"], turn.inv().apply(ground)


def mode_of(dvl, *, altitude=None, **given):
    """The one lock of steady motion `altitude` [m] above a level bottom; None: out of reach."""
    depth = given.get("place", (0.0, 0.0, 50.0))[2]
    given.setdefault("bottom_depth", None if altitude is None else depth + altitude)
    velocity, mode, over_ground = measure(dvl, **{"angles": LEVEL, "drift": STILL, **given})
    assert (mode == mode[0]).all()
    if mode[0] != NONE:
        np.testing.assert_allclose(velocity, np.tile(over_ground, (len(mode), 1)), atol=1e-9)
    return mode[0]


@pytest.mark.parametrize("used", [0b1111, 0b0111, 0b1011, 0b1101, 0b1110])
def test_any_three_beams_give_the_velocity(used):
    velocity = np.array([0.5, -0.1, 0.2])
    assert np.linalg.norm(BEAMS, axis=1) == pytest.approx(1.0)
    assert np.arccos(BEAMS[:, 2]) == pytest.approx(30 * DEG)
    assert beam_solutions(30 * DEG)[used] @ (BEAMS @ velocity) == pytest.approx(velocity)


@pytest.mark.parametrize(
    "lever", [Dvl().lever_arm, (-0.6, 0.4, 0.1), (0.3, -0.5, 0.2), (0.0, 0.7, 0.0)]
)
def test_the_gyro_takes_any_lever_arm_out_of_the_velocity(lever):
    dvl, angles = dataclasses.replace(QUIET, lever_arm=lever), (20.0, -10.0, 200.0)
    velocity, mode, over_ground = measure(dvl, angles=angles)
    assert (mode == BOTTOM).all()
    np.testing.assert_allclose(velocity, np.tile(over_ground, (len(mode), 1)), atol=1e-12)
    # Without the gyro the velocity is that of the instrument: v + omega x r.
    raw, _, _ = measure(dvl, angles=angles, gyro=STILL)
    at_it = over_ground + np.cross(RATES, lever)
    np.testing.assert_allclose(raw, np.tile(at_it, (len(mode), 1)), atol=1e-12)


def test_a_turned_mount_gives_the_velocity_in_its_own_axes():
    """What the vehicle takes for body axes are the instrument's: R^T v, the beams turned too."""
    turn = np.array([0.004, -0.012, 0.009])
    drawn = {f"dvl_misalignment_{a}": t for a, t in zip("xyz", turn, strict=True)}
    velocity, mode, over_ground = measure(AT_THE_CB, angles=(5.0, -20.0, 70.0), drawn=drawn)
    assert (mode == BOTTOM).all()
    seen = Rotation.from_rotvec(turn).inv().apply(over_ground)
    assert velocity == pytest.approx(np.tile(seen, (mode.size, 1)), abs=1e-12)
    # half a degree about the vertical carries 9 m to the side in 1 km
    aside, straight = (
        measure(AT_THE_CB, angles=LEVEL, drift=STILL, drawn={"dvl_misalignment_z": angle})[0]
        for angle in (0.5 * DEG, 0.0)
    )
    across = (aside - straight)[0, 1] / straight[0, 0]
    assert across == pytest.approx(-np.sin(0.5 * DEG), rel=1e-2)


def test_pings_average_a_changing_velocity_about_the_sample():
    ramp = 0.4 + 1e-3 * np.arange(400) * DT
    velocity, _, _ = measure(QUIET, n=400, angles=STILL, changes={"true_velocity_north": ramp})
    # 2 or 3 pings of 0.2 s around each sample: their mean lies within 0.05 s of it.
    assert np.abs(velocity[1:-1, 0] - ramp[1:-1]).max() < 1e-3 * 0.0501


def test_ideal_is_the_velocity_over_ground_at_any_depth():
    velocity, mode, over_ground = measure(
        Dvl.ideal(), place=(0.0, 0.0, 900.0), angles=(0.0, -80.0, 70.0), bottom_depth=None
    )
    assert (mode == BOTTOM).all()
    assert velocity == pytest.approx(np.tile(over_ground, (mode.size, 1)), abs=1e-15)


def test_a_vehicle_without_one_reports_none():
    velocity, mode, _ = measure(Dvl(fitted=False))
    assert np.isnan(velocity).all()
    assert (mode == NONE).all()


# --- reach ------------------------------------------------------------------------------------

NO_BOTTOM_LOCK = dataclasses.replace(AT_THE_CB, max_range=1.0)
ASIDE = dataclasses.replace(AT_THE_CB, lever_arm=(0.0, 2.0, 0.0))


@pytest.mark.parametrize(
    ("dvl", "given", "expected"),
    [
        # the range of bottom lock is a slant range, at beams of 30 deg
        (AT_THE_CB, {"altitude": 95.0}, BOTTOM),  # 109.7 m along the beam
        (AT_THE_CB, {"altitude": 100.0}, WATER),  # 115.5 m, though the bottom is nearer than 110 m
        (AT_THE_CB, {"altitude": 0.28}, BOTTOM),  # 0.323 m, though it is nearer than 0.3 m
        (AT_THE_CB, {"altitude": 0.25}, NONE),  # 0.289 m
        # and counts from the instrument, 0.11 m below the CB
        (QUIET, {"altitude": 110.0 * np.cos(30 * DEG) + 0.11 - 1e-6}, BOTTOM),
        (QUIET, {"altitude": 110.0 * np.cos(30 * DEG) + 0.11 + 1e-6}, WATER),
        # the farthest cell of a level instrument is 60 m straight below
        (NO_BOTTOM_LOCK, {"altitude": 55.0}, NONE),
        (NO_BOTTOM_LOCK, {"altitude": 59.9}, NONE),
        (NO_BOTTOM_LOCK, {"altitude": 60.1}, WATER),
        # on its back the beams point up: at 5 m their cells are in the air, at 100 m in the water
        (AT_THE_CB, {"place": (0, 0, 5.0), "angles": (180.0, 0.0, 70.0)}, NONE),
        (AT_THE_CB, {"place": (0, 0, 100.0), "angles": (180.0, 0.0, 70.0)}, WATER),
        # the aft beams of 37 deg of pitch are 42 m long at 20 m, and 61.7 deg from the vertical
        (AT_THE_CB, {"altitude": 20.0, "angles": (0.0, -34.0, 70.0)}, BOTTOM),
        (AT_THE_CB, {"altitude": 20.0, "angles": (0.0, -37.0, 70.0)}, NONE),
        (AT_THE_CB, {"altitude": 75.0, "angles": (0.0, -37.0, 70.0)}, WATER),
        # rolled by 25 deg and pitched, one beam is out of reach and three still solve exactly
        (dataclasses.replace(QUIET, max_beam_angle_deg=52.0),
         {"altitude": 30.0, "angles": (25.0, -20.0, 70.0)}, BOTTOM),
        # half a metre deep and rolled 30 deg, 2 m to starboard: 1.5 m deep, or 0.5 m in the air
        (ASIDE, {"altitude": 20.0, "place": (0, 0, 0.5), "angles": (30.0, 0.0, 70.0)}, BOTTOM),
        (ASIDE, {"altitude": 20.0, "place": (0, 0, 0.5), "angles": (-30.0, 0.0, 70.0)}, NONE),
    ],
)  # fmt: skip
def test_a_lock_ends_where_geometry_says(dvl, given, expected):
    assert mode_of(dvl, **given) == expected


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_roll_lowers_the_instrument_on_the_side_that_goes_down(side):
    """2 m to starboard and rolled 30 deg starboard down it hangs 1 m below the CB."""
    dvl = dataclasses.replace(AT_THE_CB, lever_arm=(0.0, 2.0 * side, 0.0), max_range=40.0)
    # Two beams point 22.2 deg from the vertical and two 52.2 deg: the farther ones decide.
    azimuth = math.sin(30.0 * DEG) * math.sin(45.0 * DEG)
    cosine = math.cos(30.0 * DEG) ** 2 - azimuth * math.sin(30.0 * DEG)
    edge = 40.0 * cosine + side  # altitude of the CB at which the slant range is 40 m
    for off, locked in ((-0.2, True), (0.2, False)):
        mode = mode_of(dvl, altitude=edge + off, angles=(30.0, 0.0, 70.0))
        assert (mode == BOTTOM) == locked


@pytest.mark.parametrize("pitch", [0.0, -30.0, 30.0])
def test_water_lock_is_relative_to_the_cells_below(pitch):
    """The cells lie 20 to 60 m along the instrument's axis: on average 40 m cos(pitch) deeper."""
    shear = 0.002  # [1/s] to the north
    table = Profile(depth=(0.0, 200.0), north=(0.0, 200.0 * shear), east=(0.0, 0.0))
    given = {"angles": (0.0, pitch, 0.0), "drift": STILL, "bottom_depth": None}
    velocity, mode, body = measure(AT_THE_CB, **given, current=table.compile(100.0))
    assert (mode == WATER).all()
    below = shear * (50.0 + 40.0 * math.cos(pitch * DEG))
    against = turned((0.0, pitch, 0.0)).inv().apply([below, 0.0, 0.0])
    np.testing.assert_allclose(velocity, np.tile(body - against, (len(mode), 1)), atol=1e-9)
    own, _, _ = measure(AT_THE_CB, **{**given, "drift": (0.1, -0.2, 0.0)})
    np.testing.assert_allclose(own, np.tile(BODY, (len(mode), 1)), atol=1e-12)


# --- statistics -------------------------------------------------------------------------------


def test_statistics_are_one_percent_and_one_millimetre_per_second():
    dvl = dataclasses.replace(
        Dvl(), outlier_probability=0.0, mean_loss_time=0.0, lever_arm=(0, 0, 0)
    )
    scales = [dvl.draw(np.random.default_rng(seed))["dvl_scale"] for seed in range(2000)]
    assert 2 * np.std(scales) == pytest.approx(0.01, rel=0.06)
    velocity, _, over_ground = measure(dvl, n=40_000, drawn={"dvl_scale": 0.01})
    assert velocity.mean(axis=0) == pytest.approx(1.01 * over_ground, abs=5e-5)
    # Least squares over four beams at 30 deg: 1/sqrt(4 sin^2/2) horizontally, 1/sqrt(4 cos^2)
    # vertically, and 2.5 pings per sample: mean of 1/count over 2 and 3 pings.
    one_ping = 0.001 * np.array([np.sqrt(2.0), np.sqrt(2.0), 1 / np.sqrt(3.0)])
    assert velocity.std(axis=0) == pytest.approx(one_ping * np.sqrt((1 / 2 + 1 / 3) / 2), rel=0.03)


def test_lock_is_lost_as_often_as_the_chain_says():
    velocity, mode, _ = measure(Dvl(mean_lock_time=100.0, mean_loss_time=10.0), n=400_000)
    lost = mode == NONE
    assert np.isnan(velocity[lost]).all()
    assert np.isfinite(velocity[~lost]).all()
    # A sample keeps lock while one of its pings has it, so gaps are shorter by some 0.2 s.
    assert lost.mean() == pytest.approx(10.0 / 110.0, rel=0.12)
    losses = np.count_nonzero(np.diff(lost.astype(int)) == 1)
    assert losses == pytest.approx(200_000.0 / 110.0, rel=0.12)


def test_outliers_come_at_their_rate():
    dvl = dataclasses.replace(
        QUIET, outlier_probability=0.0075, wrong_beam_share=0.0, ping_rate=2.0
    )
    velocity, _, over_ground = measure(dvl, n=100_000)
    off = np.abs(velocity - over_ground)
    assert (off.max(axis=1) > 1e-9).mean() == pytest.approx(0.0075, rel=0.15)
    # A component answers to one wrong beam with that beam's weight in the least squares.
    worst = 0.5 * np.abs(beam_solutions(30 * DEG)[15]).max(axis=1)
    assert np.all(off.max(axis=0) <= worst + 1e-12)
    assert off.max() > 0.9 * worst.max()


def test_a_wrong_beam_reports_the_velocity_of_its_neighbour():
    """Every ping an outlier of that kind: beam i shows b_(i+1) . v, which the solution takes in."""
    every_ping = dataclasses.replace(
        AT_THE_CB, ping_rate=2.0, outlier_probability=1.0, wrong_beam_share=1.0
    )
    velocity, _, body = measure(every_ping, angles=LEVEL, rates=STILL, drift=STILL)
    solve, radial = beam_solutions(30 * DEG)[15], BEAMS @ body
    possible = [solve @ radial]
    for i in range(4):
        wrong = radial.copy()
        wrong[i] = BEAMS[(i + 1) % 4] @ body
        possible.append(solve @ wrong)
    nearest = [np.abs(sample - possible).max(axis=1) for sample in velocity]
    assert np.max(np.min(nearest, axis=1)) < 1e-12
    assert np.mean(np.argmin(nearest, axis=1) > 0) > 0.4  # some pings are drawn twice, some never


# --- an uneven sea floor ----------------------------------------------------------------------


def slants(floor, *, place, angles, lever=STILL, farthest=110.0):
    """Ranges [m] of the four beams from a CB at `place`, at roll, pitch and heading [deg]."""
    out = np.empty((4, 1))
    columns = [np.array([x]) for x in (*place, *angles)]
    slant_kernel(floor.compile(0.0), *columns, np.array(lever), BEAMS, farthest, 2.0, out)
    return out[:, 0]


def plane(depth=60.0, north=0.0, east=0.0):
    """A floor that is `depth` [m] at the start and gets deeper by these per metre."""
    depths = depth + np.add.outer(north * AXIS, east * AXIS)
    return GridFloor(north_m=AXIS, east_m=AXIS, depth_m=depths)


def mode_over(floor, *, place=(0.0, 0.0, 20.0), angles=STILL):
    return mode_of(
        AT_THE_CB, place=place, angles=angles, rates=STILL, body=(0.9, 0.0, 0.0),
        bottom_depth=500.0, floor=floor.compile(0.0),
    )  # fmt: skip


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (12.0, -20.0, 75.0), (-25.0, 15.0, 230.0)])
def test_each_beam_ends_on_a_slope_where_geometry_says(angles):
    """On a plane the distance is (depth below the CB) / (beam . normal), for any attitude."""
    slope, place, lever = np.array([0.08, -0.05]), np.array([120.0, -60.0, 15.0]), (-0.6, 0.1, 0.16)
    at, toward = place + turned(angles).apply(lever), turned(angles).apply(BEAMS)
    under = 60.0 + slope @ at[:2] - at[2]
    expected = under / (toward[:, 2] - toward[:, :2] @ slope)
    given = {"place": place, "angles": angles, "lever": lever}
    found = slants(plane(60.0, *slope), **given, farthest=200.0)
    assert found == pytest.approx(expected, abs=2e-4)
    near = slants(plane(60.0, *slope), **given, farthest=float(min(expected)) + 1)
    assert sorted(np.isinf(near)) == sorted(expected > min(expected) + 1)


def test_a_level_floor_is_as_a_bottom_depth():
    """The lock of both ways to say it, over attitudes and ranges."""
    rng = np.random.default_rng(3)
    found = set()
    for _ in range(60):
        angles = tuple(rng.uniform((-50.0, -50.0, 0.0), (50.0, 50.0, 360.0)))
        depth = rng.uniform(25.0, 140.0)
        mode = mode_over(plane(depth), angles=angles)
        found.add(mode)
        assert mode == level_mode(depth, angles)
    assert found == {BOTTOM, WATER, NONE}


def level_mode(depth, angles):
    """The lock over a level bottom by the beams' angles from the vertical, 20 m deep."""
    cosine = turned(angles).apply(BEAMS)[:, 2]
    slant = np.where(cosine > 0.0, (depth - 20.0) / np.maximum(cosine, 1e-9), np.inf)
    reach = 60.0 / np.cos(30 * DEG)
    if np.sum((cosine > 0.5) & (slant >= 0.3) & (slant <= 110.0)) >= 3:
        return BOTTOM
    return WATER if np.sum((reach * cosine > -20.0) & (reach < slant)) >= 3 else NONE


def test_a_drop_off_takes_the_beams_that_look_over_it():
    """North of a cliff edge the sea is out of reach: beams 0 and 3 look forward."""
    north = np.array([-4000.0, 0.0, 1.0, 4000.0])
    depths = np.repeat([[78.0], [78.0], [900.0], [900.0]], 2, axis=1)
    cliff = GridFloor(north_m=north, east_m=AXIS, depth_m=depths)
    # beams reach 23.7 m forward at 58 m of altitude
    assert mode_over(cliff, place=(-30.0, 0.0, 20.0)) == BOTTOM
    assert mode_over(cliff, place=(-20.0, 0.0, 20.0)) == NONE
    # turned by 45 deg one beam looks ahead and three do not
    assert mode_over(cliff, place=(-30.0, 0.0, 20.0), angles=(0.0, 0.0, 45.0)) == BOTTOM
    # the aft beams are too few, and over the drop the cells of all four are clear of the floor
    assert mode_over(cliff, place=(200.0, 0.0, 20.0)) == WATER


def test_over_a_rough_floor_ranges_end_on_it():
    floor = RoughFloor(depth_m=50.0, height_m=6.0, length_m=80.0, seed=2, reach_m=600.0)
    table, rng = floor.compile(0.0), np.random.default_rng(1)
    for _ in range(30):
        place = rng.uniform((-400.0, -400.0, 2.0), (400.0, 400.0, 20.0))
        angles = rng.uniform((-20.0, -25.0, 0.0), (20.0, 25.0, 360.0))
        found = slants(floor, place=place, angles=angles)
        assert np.isfinite(found).all()
        for end in place + found[:, None] * turned(angles).apply(BEAMS):
            assert floor_depth(table, end[0], end[1]) == pytest.approx(end[2], abs=1e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"min_range": 200.0}, "each maximum must exceed its minimum"),
        ({"tilt_deg": 95.0}, r"Dvl\.tilt_deg is 95 deg"),
        ({"outlier_probability": 1.5}, r"outlier_probability is 1\.5"),
    ],
)
def test_wrong_settings_are_explained(settings, message):
    with pytest.raises(InputError, match=message):
        Dvl(**settings)
