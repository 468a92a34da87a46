"""The DVL: exact beam geometry, the sheet's statistics, lock and its loss, outliers."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from twin.errors import InputError
from twin.sensors import Dvl, Surroundings
from twin.sensors.dvl import MODES, OUTPUTS, beam_directions, beam_solutions
from twin.water.current.profile import Profile

DT = 0.5
DEG = np.pi / 180
NO_DRAW = dict.fromkeys(Dvl.draws, 0.0)
BOTTOM, WATER, NONE = MODES["bottom"], MODES["water"], MODES["none"]


def glide(n=400, *, depth=50.0, roll=0.0, pitch=-20.0, heading=70.0, current=(0.1, -0.2, 0.0)):
    """Steady motion of (0.4, 0.03, 0.02) m/s through the water in a current, with body rates."""
    through = np.array([0.4, 0.03, 0.02])
    turn = Rotation.from_euler("ZYX", [heading, pitch, roll], degrees=True)
    ground = turn.apply(through) + current
    values = {
        "roll": roll, "pitch": pitch, "heading": heading, "depth": depth, "north": 0.0,
        "east": 0.0, "surge": through[0], "sway": through[1], "heave": through[2],
        "velocity_north": ground[0], "velocity_east": ground[1], "velocity_down": ground[2],
        "roll_rate": 0.01, "pitch_rate": -0.02, "yaw_rate": 0.03,
    }  # fmt: skip
    truth = {f"true_{name}": np.full(n, float(value)) for name, value in values.items()}
    return truth, turn.inv().apply(ground)


def measure(dvl, truth, *, seed=0, drawn=NO_DRAW, bottom_depth=100.0, current=None, gyro=None):
    if gyro is None:
        gyro = {name.replace("true", "measured"): truth[name] for name in truth if "rate" in name}
    out = dvl.measure(
        truth | gyro, dt=DT, drawn=drawn, rng=np.random.default_rng(seed),
        surroundings=Surroundings(bottom_depth=bottom_depth, current=current),
    )  # fmt: skip
    return np.stack([out[name] for name in OUTPUTS], axis=1), out["measured_dvl_mode"]


@pytest.mark.parametrize("used", [0b1111, 0b0111, 0b1011, 0b1101, 0b1110])
def test_any_three_beams_give_the_velocity(used):
    beams = beam_directions(30 * DEG)
    velocity = np.array([0.5, -0.1, 0.2])
    assert np.linalg.norm(beams, axis=1) == pytest.approx(1.0)
    assert np.arccos(beams[:, 2]) == pytest.approx(30 * DEG)
    assert beam_solutions(30 * DEG)[used] @ (beams @ velocity) == pytest.approx(velocity)


def test_noise_free_geometry_is_exact_with_its_lever_arm():
    truth, over_ground = glide(roll=5.0)
    velocity, mode = measure(Dvl.noise_free(), truth)
    assert (mode == BOTTOM).all()
    assert velocity == pytest.approx(np.tile(over_ground, (mode.size, 1)), abs=1e-12)


def test_a_turned_mount_gives_the_velocity_in_its_own_axes():
    """What the vehicle takes for body axes are the instrument's: R^T v, the beams turned too."""
    truth, over_ground = glide(roll=5.0)
    turn = np.array([0.004, -0.012, 0.009])
    drawn = NO_DRAW | {f"dvl_misalignment_{a}": t for a, t in zip("xyz", turn, strict=True)}
    at_cb = dataclasses.replace(Dvl.noise_free(), lever_arm=(0.0, 0.0, 0.0))
    velocity, mode = measure(at_cb, truth, drawn=drawn)
    assert (mode == BOTTOM).all()
    seen = Rotation.from_rotvec(turn).inv().apply(over_ground)
    assert velocity == pytest.approx(np.tile(seen, (mode.size, 1)), abs=1e-12)
    # half a degree about the vertical carries 9 m to the side in 1 km
    aside, _ = measure(
        at_cb, glide(pitch=0.0, current=(0.0, 0.0, 0.0))[0],
        drawn=NO_DRAW | {"dvl_misalignment_z": 0.5 * DEG},
    )  # fmt: skip
    straight, _ = measure(at_cb, glide(pitch=0.0, current=(0.0, 0.0, 0.0))[0])
    across = (aside - straight)[0, 1] / straight[0, 0]
    assert across == pytest.approx(-np.sin(0.5 * DEG), rel=1e-2)


def test_without_a_gyro_the_lever_arm_stays_in_the_velocity():
    truth, over_ground = glide()
    still = {f"measured_{name}_rate": np.zeros(400) for name in ("roll", "pitch", "yaw")}
    velocity, _ = measure(Dvl.noise_free(), truth, gyro=still)
    lever = np.array(Dvl().lever_arm)
    assert velocity[7] == pytest.approx(over_ground + np.cross([0.01, -0.02, 0.03], lever))


def test_pings_average_a_changing_velocity_about_the_sample():
    truth, _ = glide(pitch=0.0, heading=0.0)
    ramp = 0.4 + 1e-3 * np.arange(400) * DT
    truth["true_velocity_north"] = ramp
    velocity, _ = measure(Dvl.noise_free(), truth)
    # 2 or 3 pings of 0.2 s around each sample: their mean lies within 0.05 s of it.
    assert np.abs(velocity[1:-1, 0] - ramp[1:-1]).max() < 1e-3 * 0.0501


def test_ideal_is_the_velocity_over_ground_at_any_depth():
    truth, over_ground = glide(depth=900.0, pitch=-80.0)
    velocity, mode = measure(Dvl.ideal(), truth, bottom_depth=None)
    assert (mode == BOTTOM).all()
    assert velocity == pytest.approx(np.tile(over_ground, (mode.size, 1)), abs=1e-15)


def test_bottom_lock_ends_at_the_range_of_the_slant():
    dvl = Dvl.noise_free()
    level, _ = glide(pitch=0.0)
    for altitude, expected in ((110.0 * np.cos(30 * DEG), BOTTOM), (111.0, WATER), (0.2, NONE)):
        # The lever arm puts the instrument 0.11 m below the CB.
        _, mode = measure(dvl, level, bottom_depth=50.0 + 0.11 + altitude - 1e-6)
        assert (mode == expected).all()


def test_beams_are_lost_at_large_tilt():
    dvl = Dvl.noise_free()
    # The aft beams are 60 deg from the vertical at 35.3 deg of pitch; then two are left.
    for pitch, expected in ((-34.0, BOTTOM), (-37.0, WATER), (-20.0, BOTTOM)):
        truth, over_ground = glide(pitch=pitch, current=(0.0, 0.0, 0.0))
        velocity, mode = measure(dvl, truth, bottom_depth=125.0 if pitch == -37.0 else 80.0)
        assert (mode == expected).all()
        assert velocity[3] == pytest.approx(over_ground, abs=1e-12)
    # Rolled by 25 deg and pitched, one beam is out of reach and three still solve exactly.
    truth, over_ground = glide(pitch=-20.0, roll=25.0)
    one_out = dataclasses.replace(dvl, max_beam_angle_deg=52.0)
    velocity, mode = measure(one_out, truth, bottom_depth=80.0)
    assert (mode == BOTTOM).all()
    assert velocity[3] == pytest.approx(over_ground, abs=1e-12)


def test_water_lock_is_relative_to_the_cells_below():
    truth, _ = glide(depth=50.0, pitch=0.0, heading=0.0)
    dvl = Dvl.noise_free()
    own, mode = measure(dvl, truth, bottom_depth=None)
    assert (mode == WATER).all()
    assert own[5] == pytest.approx([0.4, 0.03, 0.02], abs=1e-12)
    table = Profile(depth=(0.0, 50.0, 150.0), north=(0.1, 0.1, 0.3), east=(-0.2, -0.2, -0.2))
    sheared, _ = measure(dvl, truth, bottom_depth=None, current=table.compile(200.0))
    # The cells' mean depth is 40 m deeper: 0.08 m/s more to the north.
    assert sheared[5] == pytest.approx(own[5] - [0.08, 0.0, 0.0], abs=1e-6)


def test_statistics_are_one_percent_and_one_millimetre_per_second():
    truth, over_ground = glide(n=40_000, pitch=-20.0)
    dvl = dataclasses.replace(
        Dvl(), outlier_probability=0.0, mean_loss_time=0.0, lever_arm=(0, 0, 0)
    )
    scales = [dvl.draw(np.random.default_rng(seed))["dvl_scale"] for seed in range(2000)]
    assert 2 * np.std(scales) == pytest.approx(0.01, rel=0.06)
    velocity, _ = measure(dvl, truth, drawn=NO_DRAW | {"dvl_scale": 0.01})
    assert velocity.mean(axis=0) == pytest.approx(1.01 * over_ground, abs=5e-5)
    # Least squares over four beams at 30 deg: 1/sqrt(4 sin^2/2) horizontally, 1/sqrt(4 cos^2)
    # vertically, and 2.5 pings per sample: mean of 1/count over 2 and 3 pings.
    one_ping = 0.001 * np.array([np.sqrt(2.0), np.sqrt(2.0), 1 / np.sqrt(3.0)])
    assert velocity.std(axis=0) == pytest.approx(one_ping * np.sqrt((1 / 2 + 1 / 3) / 2), rel=0.03)


def test_lock_is_lost_as_often_as_the_chain_says():
    truth, _ = glide(n=400_000)
    dvl = Dvl(mean_lock_time=100.0, mean_loss_time=10.0)
    velocity, mode = measure(dvl, truth)
    lost = mode == NONE
    assert np.isnan(velocity[lost]).all()
    assert np.isfinite(velocity[~lost]).all()
    # A sample keeps lock while one of its pings has it, so gaps are shorter by some 0.2 s.
    assert lost.mean() == pytest.approx(10.0 / 110.0, rel=0.12)
    losses = np.count_nonzero(np.diff(lost.astype(int)) == 1)
    assert losses == pytest.approx(200_000.0 / 110.0, rel=0.12)


def test_outliers_come_at_their_rate():
    truth, over_ground = glide(n=100_000)
    dvl = dataclasses.replace(
        Dvl.noise_free(), outlier_probability=0.0075, wrong_beam_share=0.0, ping_rate=2.0
    )
    velocity, _ = measure(dvl, truth)
    wrong = np.abs(velocity - over_ground).max(axis=1) > 1e-9
    assert wrong.mean() == pytest.approx(0.0075, rel=0.15)
    # A component answers to one wrong beam with that beam's weight in the least squares.
    worst = 0.5 * np.abs(beam_solutions(30 * DEG)[15]).max(axis=1)
    assert np.all(np.abs(velocity - over_ground).max(axis=0) <= worst + 1e-12)
    assert np.abs(velocity - over_ground).max() > 0.9 * worst.max()


def test_a_vehicle_without_one_reports_none():
    truth, _ = glide()
    velocity, mode = measure(Dvl(fitted=False), truth)
    assert np.isnan(velocity).all()
    assert (mode == NONE).all()


def test_wrong_settings_are_explained():
    with pytest.raises(InputError, match="each maximum must exceed its minimum"):
        Dvl(min_range=200.0)
    with pytest.raises(InputError, match=r"Dvl\.tilt_deg is 95 deg"):
        Dvl(tilt_deg=95.0)
    with pytest.raises(InputError, match=r"outlier_probability is 1\.5"):
        Dvl(outlier_probability=1.5)
