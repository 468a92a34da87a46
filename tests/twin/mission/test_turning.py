"""Steady glides, and how a vehicle turns for the position of what turns it."""

import math

import numpy as np
import pytest
from torpedo import TORPEDO

from twin.errors import MissionError
from twin.fossen import FossenModel
from twin.mission import Mission
from twin.mission.glide_balance import imbalance, steady_glide
from twin.mission.mission_file import CLIMB_TURN, DIVE_TURN
from twin.mission.segments import SawTooth
from twin.mission.turning import LARGEST_FACTOR, turn_factor, turn_per_position
from twin.mission.way import way
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.vehicle.vehicle import Vehicle, load_vehicle

PRINTED = load_vehicle("glider")


def split(share: float) -> Vehicle:
    """The Sea-Wing with this part of its roll moment of sideslip made by the wings."""
    return PRINTED.replace(law=PRINTED.law.scaled({"roll_lift_share": share}))


def steady(vehicle: Vehicle, pitch_deg: float, net_mass: float):
    return way(vehicle, "test", "pitch_deg", pitch_deg, net_mass, None)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9, 1.0])
@pytest.mark.parametrize(("pitch", "net_mass"), [(-30, 0.3), (30, -0.3), (-20, 0.2), (35, -0.45)])
def test_it_is_the_slope_of_the_fossen_models_spirals(share, pitch, net_mass):
    vehicle = split(share)
    here = steady(vehicle, pitch, net_mass)
    angle = math.radians(0.5)
    spiral = FossenModel(vehicle).trim(float(here.command[0]), angle, net_mass)
    expected = spiral.turn_rate_rad_s / angle
    assert turn_per_position(vehicle, here) == pytest.approx(expected, rel=2e-3)


def test_the_printed_glider_turns_one_way_and_wings_turn_the_other_in_climbs():
    for vehicle, sign in ((PRINTED, 1.0), (split(0.9), -1.0)):
        dive, climb = steady(vehicle, -30, 0.3), steady(vehicle, 30, -0.3)
        assert turn_per_position(vehicle, dive) > 0.0
        assert math.copysign(1.0, turn_factor(vehicle, climb)) == sign
        assert turn_factor(vehicle, dive) == pytest.approx(1.0, abs=0.05)
        slow = steady(vehicle, 15, -0.05)
        assert 1.0 / LARGEST_FACTOR <= abs(turn_factor(vehicle, slow)) <= LARGEST_FACTOR


@pytest.mark.parametrize("share", [0.0, 0.9])
def test_the_heading_is_held_in_both_phases(share):
    vehicle = split(share)
    mission = Mission(
        segments=(SawTooth(max_depth_m=120, heading_deg=40, pitch_deg=28, yos=2),),
        start_heading_deg=20,
    )
    run = simulate(Scenario(vehicle=vehicle, mission=mission))
    settled = (run.time > 250.0) & (run["true_depth"] > 8.0)
    climbing = run["true_pitch"] > 10.0
    for phase in (settled & climbing, settled & ~climbing):
        assert np.abs(run["true_heading"][phase] - 40.0).max() < 2.0
    table, _ = mission.compile(vehicle)
    signs = np.sign(table[0, [DIVE_TURN, CLIMB_TURN]])
    assert signs.tolist() == ([1.0, 1.0] if share == 0.0 else [1.0, -1.0])


def test_a_mass_in_a_turn_has_its_weight_and_its_centrifugal_force():
    """Newton's law of a point mass, as it moves from one place of the hull to another."""
    vehicle, here = PRINTED, np.array([0.02, -0.01, 0.03])
    there = here + np.array([0.05, 0.04, -0.02])
    position = np.array([part.rest for part in vehicle.parts])
    velocity, pitch, roll, turn_rate = np.array([0.4, 0.05, -0.1]), 0.4, -0.3, 0.2
    down = np.array(
        [-math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)]
    )
    omega = turn_rate * down

    def left_over(place):
        moved = vehicle.replace(static_cg=place)
        motion = {"pitch": pitch, "roll": roll, "turn_rate": turn_rate}
        return imbalance(moved, position, velocity, **motion)

    def of_point(place):
        acceleration = np.cross(omega, velocity + np.cross(omega, place))
        force = vehicle.static_mass * (vehicle.gravity * down - acceleration)
        return np.concatenate([force, np.cross(place, force)])

    found = left_over(there) - left_over(here)
    np.testing.assert_allclose(found, of_point(there) - of_point(here), rtol=1e-9, atol=1e-9)


def test_a_rudder_turns_the_same_way_in_all_phases():
    torpedo = load_vehicle(TORPEDO)
    turns = [
        turn_per_position(torpedo, way(torpedo, "test", "pitch_deg", pitch, 0.0, 1.5))
        for pitch in (-20.0, 0.0, 20.0)
    ]
    assert len({math.copysign(1.0, turn) for turn in turns}) == 1
    np.testing.assert_allclose(turns, turns[1], rtol=0.1)


@pytest.mark.parametrize(("pitch", "net_mass"), [(-26, 0.15), (-33, 0.4), (30, -0.45)])
def test_the_loop_is_as_strong_on_every_way_as_on_the_usual_one(pitch, net_mass):
    """Where a way turns more for the same position its loop is weaker, and the other way round."""
    gain, target = load_vehicle("glider").usual_glide
    usual = steady(PRINTED, -math.degrees(gain), target)
    here = steady(PRINTED, pitch, net_mass)
    turned = turn_per_position(PRINTED, here)
    assert turned != pytest.approx(turn_per_position(PRINTED, usual), rel=0.1)
    looped = turn_factor(PRINTED, here) * turned
    assert looped == pytest.approx(turn_per_position(PRINTED, usual), rel=1e-3)


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
