"""The DVL over an uneven sea floor: each beam ends where it meets it."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from twin.sensors import Dvl, Surroundings
from twin.sensors.dvl import MODES, beam_directions
from twin.sensors.kernels import slant_kernel
from twin.water.floor import GridFloor, RoughFloor

DEG = np.pi / 180
N, DT = 40, 0.5
BOTTOM, WATER, NONE = MODES["bottom"], MODES["water"], MODES["none"]
AT_THE_CB = dataclasses.replace(Dvl.noise_free(), lever_arm=(0.0, 0.0, 0.0))
AXIS = np.array([-4000.0, 4000.0])


def plane(depth=60.0, north=0.0, east=0.0):
    """A floor that is `depth` [m] at the start and gets deeper by these per metre."""
    depths = depth + np.add.outer(north * AXIS, east * AXIS)
    return GridFloor(north_m=AXIS, east_m=AXIS, depth_m=depths)


def slants(floor, *, place, angles, lever, farthest=110.0):
    """Ranges [m] of the four beams from a CB at `place`, at roll, pitch and heading [deg]."""
    out = np.empty((4, 1))
    columns = [np.array([x]) for x in (*place, *angles)]
    beams, arm = beam_directions(30 * DEG), np.array(lever)
    slant_kernel(floor.compile(0.0), *columns, arm, beams, farthest, 2.0, out)
    return out[:, 0]


def mode_of(dvl, floor, *, place=(0.0, 0.0, 20.0), angles=(0.0, 0.0, 0.0)):
    values = dict(zip(("north", "east", "depth"), place, strict=True))
    values |= dict(zip(("roll", "pitch", "heading"), angles, strict=True))
    values |= {"surge": 0.9, "sway": 0.0, "heave": 0.0}
    over_ground = Rotation.from_euler("ZYX", angles[::-1], degrees=True).apply([0.9, 0.0, 0.0])
    values |= dict(
        zip(("velocity_north", "velocity_east", "velocity_down"), over_ground, strict=True)
    )
    values |= dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), 0.0)
    truth = {f"true_{name}": np.full(N, float(value)) for name, value in values.items()}
    gyro = {f"measured_{n}": np.zeros(N) for n in ("roll_rate", "pitch_rate", "yaw_rate")}
    made = dvl.measure(
        truth | gyro, dt=DT, drawn=dict.fromkeys(Dvl.draws, 0.0), rng=np.random.default_rng(0),
        surroundings=Surroundings(bottom_depth=500.0, floor=floor.compile(0.0)),
    )  # fmt: skip
    mode = made["measured_dvl_mode"]
    assert (mode == mode[0]).all()
    if mode[0] != NONE:
        assert made["measured_dvl_surge"] == pytest.approx(0.9)
    return mode[0]


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (12.0, -20.0, 75.0), (-25.0, 15.0, 230.0)])
def test_each_beam_ends_on_a_slope_where_geometry_says(angles):
    """On a plane the distance is (depth below the CB) / (beam . normal), for any attitude."""
    slope, place, lever = np.array([0.08, -0.05]), np.array([120.0, -60.0, 15.0]), (-0.6, 0.1, 0.16)
    turn = Rotation.from_euler("ZYX", angles[::-1], degrees=True)
    at = place + turn.apply(lever)
    toward = turn.apply(beam_directions(30 * DEG))
    under = 60.0 + slope @ at[:2] - at[2]
    expected = under / (toward[:, 2] - toward[:, :2] @ slope)
    floor = plane(60.0, *slope)
    found = slants(floor, place=place, angles=angles, lever=lever, farthest=200.0)
    assert found == pytest.approx(expected, abs=2e-4)
    near = slants(floor, place=place, angles=angles, lever=lever, farthest=float(min(expected)) + 1)
    assert sorted(np.isinf(near)) == sorted(expected > min(expected) + 1)


def test_a_level_floor_is_as_a_bottom_depth():
    """The lock of both ways to say it, over attitudes and ranges."""
    rng = np.random.default_rng(3)
    found = set()
    for _ in range(60):
        angles = tuple(rng.uniform((-50.0, -50.0, 0.0), (50.0, 50.0, 360.0)))
        depth = rng.uniform(25.0, 140.0)
        mode = mode_of(AT_THE_CB, plane(depth), angles=angles)
        found.add(mode)
        assert mode == level_mode(depth, angles)
    assert found == {BOTTOM, WATER, NONE}


def level_mode(depth, angles):
    """The lock over a level bottom by the beams' angles from the vertical, 20 m deep."""
    turn = Rotation.from_euler("ZYX", angles[::-1], degrees=True)
    cosine = turn.apply(beam_directions(30 * DEG))[:, 2]
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
    assert mode_of(AT_THE_CB, cliff, place=(-30.0, 0.0, 20.0)) == BOTTOM
    assert mode_of(AT_THE_CB, cliff, place=(-20.0, 0.0, 20.0)) == NONE
    # turned by 45 deg one beam looks ahead and three do not
    ahead = (0.0, 0.0, 45.0)
    assert mode_of(AT_THE_CB, cliff, place=(-30.0, 0.0, 20.0), angles=ahead) == BOTTOM
    # the aft beams are too few, and over the drop the cells of all four are clear of the floor
    assert mode_of(AT_THE_CB, cliff, place=(200.0, 0.0, 20.0)) == WATER


def test_over_a_rough_floor_ranges_end_on_it():
    floor = RoughFloor(depth_m=50.0, height_m=6.0, length_m=80.0, seed=2, reach_m=600.0)
    table = floor.compile(0.0)
    from twin.water.floor.lookup import floor_depth

    rng = np.random.default_rng(1)
    for _ in range(30):
        place = rng.uniform((-400.0, -400.0, 2.0), (400.0, 400.0, 20.0))
        angles = rng.uniform((-20.0, -25.0, 0.0), (20.0, 25.0, 360.0))
        turn = Rotation.from_euler("ZYX", angles[::-1], degrees=True)
        found = slants(floor, place=place, angles=angles, lever=(0.0, 0.0, 0.0))
        ends = place + found[:, None] * turn.apply(beam_directions(30 * DEG))
        assert np.isfinite(found).all()
        for end in ends:
            assert floor_depth(table, end[0], end[1]) == pytest.approx(end[2], abs=1e-3)
