"""The gliders in use: they glide, stay stable, steer both ways and fly, in both models."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from torpedo import TORPEDO

import twin
from twin.__main__ import PROGRAM
from twin.errors import MissionError
from twin.fossen import FossenModel
from twin.mission import Mission
from twin.mission.glide_balance import imbalance, steady_glide
from twin.mission.mission_file import CLIMB_TURN, DIVE_TURN
from twin.mission.segments import SawTooth, Surface
from twin.mission.shipped_missions import (
    MISSING,
    VehicleLine,
    load_mission_for,
    shipped_vehicles,
    usual_mission,
)
from twin.mission.turning import LARGEST_FACTOR, turn_factor, turn_per_position
from twin.mission.way import way
from twin.physics.scenario import Scenario
from twin.physics.settle import trim as settle
from twin.physics.simulation import simulate
from twin.vehicle.presets import vehicle_names
from twin.vehicle.steady_motion import trim_positions
from twin.vehicle.vehicle import Vehicle, load_vehicle

IN_USE = ("slocum-200", "slocum-1000", "seaglider", "seaexplorer", "spray")
RUDDER = ("slocum-200", "slocum-1000")
BOTH_WAYS = (1.0, -1.0)  # heavy and nose down, light and nose up
PAGE = (Path(__file__).parents[3] / "docs" / "reference" / "vehicles.md").read_text(
    encoding="utf-8"
)


def usual(vehicle, sense):
    """(battery shift, net mass) of its usual glide down (1) or up (-1)."""
    pitch, net_mass = vehicle.usual_glide
    return steady_glide(vehicle, -sense * pitch, sense * net_mass).shift, sense * net_mass


def test_all_are_listed_with_a_source():
    lines = {line.name: line for line in shipped_vehicles()}
    assert set(lines) == set(vehicle_names()) >= set(IN_USE)
    assert all(line.summary and line.source.startswith("published: ") for line in lines.values())
    identified = [name for name, line in lines.items() if "identified: log" in line.source]
    assert set(identified) == set(IN_USE) - {"spray"}  # of which there is no log


@pytest.mark.parametrize("name", IN_USE)
def test_usual_glides_are_a_real_gliders(name):
    vehicle = load_vehicle(name)
    line = VehicleLine.of(vehicle)
    assert 0.25 <= line.speed_m_s <= 0.35
    assert 0.25 <= line.climb_speed_m_s <= 0.35
    assert 20.0 <= line.pitch_deg <= 28.0
    assert vehicle.net_mass_for_pump(line.pump_low_cm3) > line.net_mass_kg
    assert -vehicle.net_mass_for_pump(line.pump_high_cm3) > line.net_mass_kg
    slide = vehicle.steered("pitch")
    assert all(slide.low < usual(vehicle, sense)[0] < slide.high for sense in BOTH_WAYS)


@pytest.mark.parametrize("sense", BOTH_WAYS)
@pytest.mark.parametrize("name", IN_USE)
def test_trims_are_stable_and_the_inverse_of_the_steady_glide(name, sense):
    vehicle = load_vehicle(name)
    shift, net_mass = usual(vehicle, sense)
    motion = FossenModel(vehicle).steady_motion(shift, 0.0, net_mass)
    assert motion.stable
    assert math.radians(motion.trim.pitch_deg) == pytest.approx(
        -sense * vehicle.usual_glide[0], abs=1e-5
    )
    other = settle(vehicle, shift, 0.0, net_mass)
    assert other.speed_m_s == pytest.approx(motion.trim.speed_m_s, abs=1e-5)
    assert other.pitch_deg == pytest.approx(motion.trim.pitch_deg, abs=1e-3)


@pytest.mark.parametrize("name", IN_USE)
def test_rudders_turn_the_same_way_in_climbs_and_batteries_the_other_way(name):
    vehicle = load_vehicle(name)
    model = FossenModel(vehicle)
    turns, rolls = [], []
    for sense in BOTH_WAYS:
        shift, net_mass = usual(vehicle, sense)
        found = model.steady_motion(shift, math.radians(15.0), net_mass)
        assert found.stable
        turns.append(math.degrees(found.trim.turn_rate_rad_s) / 15.0)
        rolls.append(found.trim.roll_deg)
    dive, climb = turns
    if name in RUDDER:
        assert dive > climb > 0.01  # deg/s per degree
        assert max(abs(roll) for roll in rolls) < 1.0
    else:
        assert dive > 0.003
        assert climb < -0.003
        assert rolls == pytest.approx([rolls[0]] * 2, rel=0.05)  # at the same bank
        assert rolls[0] < -3.0


@pytest.mark.parametrize(
    ("name", "dive", "climb"),
    [("slocum-200", 0.050, 0.035), ("slocum-1000", 0.0254, 0.0129)],
)
def test_slocums_answer_their_rudder_as_the_logs_do(name, dive, climb):
    vehicle = load_vehicle(name)
    for sense, logged in zip(BOTH_WAYS, (dive, climb), strict=True):
        shift, net_mass = usual(vehicle, sense)
        found = FossenModel(vehicle).trim(shift, math.radians(5.0), net_mass)
        assert math.degrees(found.turn_rate_rad_s) / 5.0 == pytest.approx(logged, rel=0.25)


@pytest.mark.parametrize("name", IN_USE)
def test_pitch_and_heading_are_held_in_dives_and_climbs(name):
    vehicle = load_vehicle(name)
    leg = SawTooth(max_depth_m=100.0, min_depth_m=15.0, pitch_deg=26.0, heading_deg=20.0, yos=1)
    mission = Mission(name="leg", start_heading_deg=0.0, segments=(leg,))
    run = twin.simulate(vehicle=vehicle, mission=mission)
    assert run.complete
    depth, pitch, heading = (run[f"true_{x}"] for x in ("depth", "pitch", "heading"))
    wanted = run["commanded_pitch"]
    deepest = int(np.argmax(depth))
    # the last 20 m of each way; a turn of 20 deg and the inflection are over by then
    down = np.flatnonzero((depth > 70.0) & (np.arange(len(depth)) < deepest) & (wanted < 0))
    up = np.flatnonzero((depth < 35.0) & (np.arange(len(depth)) > deepest) & (wanted > 0))
    up = up[depth[up] > 17.0]
    for part in (down, up):
        assert len(part) > 50
        np.testing.assert_allclose(pitch[part], wanted[part], atol=1.0)
        np.testing.assert_allclose(heading[part], 20.0, atol=1.5)


@pytest.mark.parametrize("name", vehicle_names())
def test_the_mission_that_suits_a_vehicle_can_be_flown(name):
    vehicle = load_vehicle(name)
    assert load_mission_for(vehicle).name == usual_mission(vehicle)
    assert (usual_mission(vehicle) == "section") == (name in IN_USE)


def test_the_command_prints_every_vehicle(capsys):
    assert PROGRAM.main(["vehicles", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["vehicles"]
    lines = shipped_vehicles()
    assert [entry["name"] for entry in told] == [line.name for line in lines]
    assert PROGRAM.main(["vehicles"]) == 0
    printed = [re.split(r" {2,}", line) for line in capsys.readouterr().out.splitlines()]
    for line in lines:
        assert list(line.cells().values()) in printed
        assert f"`{line.name}`" in PAGE


def test_the_largest_rate_of_a_propeller_is_accepted_as_it_is_printed():
    told = {line.name: line.cells()["propeller rad/s"] for line in shipped_vehicles()}
    driven = {name: float(text) for name, text in told.items() if text != MISSING}
    assert set(driven) == {"remus", "tethys", "tethys:gazebo"}
    for name, rate in driven.items():
        vehicle = load_vehicle(name)
        place = vehicle.part_names.index("propeller")
        assert trim_positions(vehicle, positions={"propeller": rate})[place] == rate


@pytest.mark.parametrize("engine", ["mujoco", "lanes"])
def test_a_seaglider_at_its_usual_pitch_leaves_the_surface(engine):
    """Stalled there it fell backwards at 1 cm/s, by lift that no drag across the flow stopped."""
    leg = SawTooth(max_depth_m=40.0, min_depth_m=8.0, pitch_deg=20.0, heading_deg=30.0, yos=1)
    mission = Mission(segments=(Surface(duration_s=60.0), leg), start_heading_deg=30.0, name="leg")
    run = twin.simulate(vehicle="seaglider", mission=mission, engine=engine, duration=900.0)
    under = run["true_depth"] > 5.0
    assert run["true_depth"].max() > 39.0
    assert np.median(run["true_surge"][under]) > 0.2
    off = np.deg2rad(run["true_heading"][under] - 30.0)
    assert np.rad2deg(np.abs(np.angle(np.exp(1j * off)))).max() < 10.0


# --- turns for the position of what turns it, in any steady glide ---------------------------------


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
