"""Guidance flying the Sea-Wing in the native plant, with the gains of its file."""

import itertools
import math

import numpy as np
import pytest

from twin.mission import Mission, SawTooth, Spiral, Surface, load_mission, steady_glide
from twin.mission.controller import MissionController
from twin.physics.simulation import Scenario, simulate
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")


def wrapped(degrees):
    return (np.asarray(degrees) + 180.0) % 360.0 - 180.0


def fly(*segments, start=None, **mission):
    return simulate(
        Scenario(vehicle=VEHICLE, mission=Mission(segments=segments, **mission), start=start)
    )


def legs(trajectory):
    """Slices of constant commanded pitch."""
    pitch = trajectory["commanded_pitch"]
    changes = np.flatnonzero(np.diff(pitch) != 0) + 1
    bounds = [0, *changes, len(pitch)]
    return [slice(a, b) for a, b in itertools.pairwise(bounds)]


def gliding(direction, depth):
    """A start on a steady 35 deg glide: direction +1 dives, -1 climbs."""
    pitch = -direction * math.radians(35)
    glide = steady_glide(VEHICLE, pitch, 0.3 * direction)
    surge = glide.speed * math.cos(glide.angle_of_attack)
    heave = glide.speed * math.sin(glide.angle_of_attack)
    pump = VEHICLE.pump_for_net_mass(0.3 * direction)
    return Start(
        depth=depth, pitch=pitch, v_rel=(surge, 0.0, heave), actuators=(glide.shift, 0.0, pump)
    )


@pytest.fixture(scope="module")
def saw_tooth():
    return fly(
        SawTooth(max_depth_m=100, min_depth_m=10, pitch_deg=35, heading_deg=0, yos=3),
        Surface(duration_s=60),
        name="saw",
        duration_s=2600,
    )


def test_pitch_settles_within_a_minute_and_stays_within_half_a_degree(saw_tooth):
    settle = round(60 / 0.5)
    flown = [leg for leg in legs(saw_tooth) if leg.stop - leg.start > 2 * settle][:6]
    assert len(flown) == 6
    for leg in flown:
        error = (saw_tooth["true_pitch"] - saw_tooth["commanded_pitch"])[leg]
        assert np.abs(error[settle:]).max() < 0.5


def test_saw_tooth_overshoots_its_depths_by_little_and_counts(saw_tooth):
    segment, depth = saw_tooth["commanded_segment"], saw_tooth["true_depth"]
    first = segment == 0
    assert depth.max() < 103
    after_first_dive = np.flatnonzero(depth > 50)[0]
    assert depth[after_first_dive : np.flatnonzero(first)[-1]].min() > 7
    crossings = np.flatnonzero(np.diff((depth[first] > 55).astype(int)) != 0)
    assert len(crossings) == 2 * 3
    assert segment[-1] == 2
    assert depth[-1] < 0.6


@pytest.mark.parametrize("turn_deg", [60, -60])
@pytest.mark.parametrize(("direction", "depth"), [(1, 50.0), (-1, 900.0)], ids=["dive", "climb"])
def test_heading_step_settles_without_a_limit_cycle(direction, depth, turn_deg):
    run = fly(
        SawTooth(max_depth_m=800, min_depth_m=20, heading_deg=turn_deg),
        start=gliding(direction, depth),
        duration_s=1200,
    )
    error = wrapped(run["true_heading"] - turn_deg)
    assert np.abs(error[0]) == pytest.approx(60)
    assert np.abs(error[run.time > 400]).max() < 1.0
    late = run.time > 900
    assert np.ptp(run["commanded_rotation"][late]) < 0.3
    assert np.ptp(run["true_roll"][late]) < 0.3
    pitch_error = (run["true_pitch"] - run["commanded_pitch"])[run.time > 60]
    assert np.abs(pitch_error).max() < 1.0


def test_a_turn_between_legs_takes_longer_than_one_in_a_long_glide():
    """docs/reference/missions.md: the inflections disturb it."""
    turn = 60
    first, second = (
        SawTooth(max_depth_m=100, min_depth_m=10, pitch_deg=35, heading_deg=h, yos=3)
        for h in (0, turn)
    )
    run = fly(first, second, name="turn")
    inside = run["commanded_segment"] == 1
    begun = np.flatnonzero(inside)[0]
    time = run.time - run.time[begun]
    off = np.abs(wrapped(run["true_heading"] - turn)) > 1.0
    assert time[inside & ~off].min() < 300
    assert 900 < time[inside & off].max() < 1020
    worst = []
    for leg in legs(run):
        if leg.stop - leg.start > 240 and inside[leg].all():
            error = (run["true_pitch"] - run["commanded_pitch"])[leg]
            worst.append(np.abs(error[120:]).max())
    assert 0.5 < worst[0] < 0.9
    assert max(worst[1:]) < 0.5


@pytest.mark.parametrize("rotation_deg", [35, -35])
def test_spiral_turns_to_the_side_of_its_rotation_both_ways(rotation_deg):
    run = fly(
        Spiral(max_depth_m=150, rotation_deg=rotation_deg), start=gliding(1, 50), duration_s=1000
    )
    heading = np.unwrap(np.radians(run["true_heading"]))
    rate = np.diff(heading) / 0.5
    up = run["commanded_pitch"][1:] > 0
    for way in (up, ~up):
        settled = np.flatnonzero(way)[200:]
        assert len(settled) > 100
        assert (np.sign(rate[settled]) == np.sign(rotation_deg)).all()
    error = (run["true_pitch"] - run["commanded_pitch"])[legs(run)[-1]]
    assert np.abs(error[240:]).max() < 0.5


def test_errors_of_the_vehicle_are_trimmed_away():
    off = VEHICLE.replace(
        battery={"neutral_x": VEHICLE.battery.neutral_x + 1e-3},
        static_cg=VEHICLE.static_cg + np.array([0.0, 2e-4, 0.0]),
    )
    mission = Mission(segments=[SawTooth(max_depth_m=500, heading_deg=20)], duration_s=1100)
    run = simulate(Scenario(vehicle=off, mission=mission))
    late = run.time > 900
    assert np.abs(run["true_pitch"] - run["commanded_pitch"])[late].max() < 0.1
    assert np.abs(wrapped(run["true_heading"] - 20))[late].max() < 0.3


def test_mission_controller_flies_as_the_native_guidance_does():
    mission = Mission(segments=[SawTooth(max_depth_m=40, heading_deg=50)], duration_s=400)
    scenario = Scenario(vehicle=VEHICLE, mission=mission)
    native = simulate(scenario)
    python = simulate(
        Scenario(vehicle=VEHICLE, duration=400), controller=MissionController(mission, VEHICLE)
    )
    for name in ("true_depth", "true_pitch", "true_heading", "true_shift", "true_rotation"):
        np.testing.assert_allclose(python[name], native[name], atol=1e-6, err_msg=name)


def test_shipped_field_mission_surfaces_three_times():
    mission = load_mission("field")
    limit = mission.time_limit_s(VEHICLE)
    run = simulate(Scenario(vehicle=VEHICLE, mission=mission, duration=limit))
    segment = run["commanded_segment"]
    flown = run.time[np.flatnonzero(segment == len(mission.segments))[0]]
    assert flown < limit
    at_surface = run["true_depth"] < 0.6
    for index, interval in ((0, 180), (2, 300), (4, 300)):
        inside = segment == index
        assert 0.5 * np.count_nonzero(inside & at_surface) == pytest.approx(interval, rel=0.1)
        # lying still, tail up
        end = np.flatnonzero(inside)[-1]
        assert run["true_pitch"][end] < -10
        assert abs(run["true_surge"][end]) < 0.1
