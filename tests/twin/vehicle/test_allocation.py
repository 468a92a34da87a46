"""Parts that share what guidance asks, rest off their zero, or are put into a file."""

import math
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from physics import held
from torpedo import TORPEDO

import twin
from twin.checks.agreement import check_manoeuvres
from twin.checks.published import held_flight
from twin.errors import InputError, VehicleError
from twin.fossen import FossenModel
from twin.mission.glide_balance import cruise_rate, surplus
from twin.mission.segments import Hold, SawTooth
from twin.physics.mujoco_model import compile_model
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.vehicle.additions import with_law, with_part
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle

AHEAD = np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0])
TRAVEL = {"travel": (-0.3, 0.3), "lag": 0.3, "rate": 0.5}
BLADE = {"area": 0.015, "lift_slope": 3.1, "stall_angle": 0.4, "zero_lift_drag": 0.02}
DIAGONAL = math.sqrt(0.5)


def x_tail() -> Vehicle:
    """Four blades at 45 degrees, 0.14 m off the axis."""
    text = TORPEDO.read_text()
    for name, axis, port, blade in (
        ("rudder", "0 0 1", 0.1, f"0 {DIAGONAL} {DIAGONAL}"),
        ("elevator", "0 1 0", -0.1, f"0 {-DIAGONAL} {DIAGONAL}"),
    ):
        text = text.replace(f'"{name}.axis" data="{axis}"', f'"{name}.axis" data="{blade}"')
        text = text.replace(f'"{name}.area" data="0.03"', f'"{name}.area" data="0.015"')
        text = text.replace(
            f'<site name="{name}" pos="-0.7 0 0"', f'<site name="{name}" pos="-0.7 {port} 0.1"'
        )
    vehicle = parse_vehicle(text, TORPEDO)
    for name, side in (("low_port", 1.0), ("low_starboard", -1.0)):
        vehicle = with_part(
            vehicle, name, kind="fin", place=(-0.7, -0.1 * side, 0.1),
            numbers={"axis": (0.0, side * DIAGONAL, -DIAGONAL), **BLADE}, **TRAVEL,
        )  # fmt: skip
    return vehicle


def two_screws(starboard: float = 0.3) -> Vehicle:
    """The torpedo with its screw 0.3 m to port and a second one to starboard."""
    text = TORPEDO.read_text()
    text = text.replace(
        '<site name="propeller" pos="-0.8 0 0"', '<site name="propeller" pos="-0.8 0.3 0"'
    )
    screw = parse_vehicle(text, TORPEDO).part("propeller")
    numbers = {"diameter": 0.14, "thrust_coefficient": 0.0045, "zero_thrust_advance": 0.16}
    return with_part(
        parse_vehicle(text, TORPEDO), "starboard_screw", kind="propeller",
        place=(-0.8, starboard, 0.0), travel=(screw.low, screw.high), lag=screw.lag,
        rate=screw.rate,
        numbers={**numbers, "torque_coefficient": -0.0002},
    )  # fmt: skip


def six_fins(aft: float = 0.3) -> Vehicle:
    """Two rudders and two elevators more, of other sizes and arms; travel of those aft [rad]."""
    vehicle = load_vehicle(TORPEDO)
    for name, axis, x in (
        ("rudder_2", (0.0, 0.0, 1.0), -0.5),
        ("rudder_3", (0.0, 0.0, -1.0), 0.4),
        ("elevator_2", (0.0, 1.0, 0.0), -0.5),
        ("elevator_3", (0.0, -1.0, 0.0), 0.4),
    ):
        vehicle = with_part(
            vehicle, name, kind="fin", place=(x, 0.0, 0.0), numbers={"axis": axis, **BLADE},
            **TRAVEL if x > 0.0 else {**TRAVEL, "travel": (-aft, aft)},
        )  # fmt: skip
    return vehicle


def fins_of_unequal_travel() -> Vehicle:
    """Those aft turn half as far: they take less of the work."""
    return six_fins(aft=0.15)


def moments(vehicle: Vehicle, position: np.ndarray) -> np.ndarray:
    """Wrench of the parts less that at rest, at 1.2 m/s ahead."""
    total = np.zeros(6)
    for part, at, rest in zip(vehicle.parts, position, vehicle.rest, strict=True):
        total += part.wrench(float(at), AHEAD, 1025.0, 50.0)
        total -= part.wrench(float(rest), AHEAD, 1025.0, 50.0)
    return total


@pytest.mark.parametrize("make", [x_tail, six_fins, fins_of_unequal_travel])
@pytest.mark.parametrize(("control", "row"), [("pitch", 4), ("heading", 5)])
def test_fins_together_make_the_moment_that_is_asked_and_no_other(make, control, row):
    vehicle = make()
    lead = vehicle.steered_index(control)
    position = vehicle.rest
    position[lead] = 0.05
    found = moments(vehicle, vehicle.allocated(position))
    alone = moments(vehicle, position)
    assert vehicle.parts[lead].sense(control) * found[row] > 1.1 * abs(alone[row])
    others = [k for k in (3, 4, 5) if k != row]
    assert np.abs(found[others]).max() < 0.01 * abs(found[row])  # drag, which is not linear
    # each part does what is its own effect's share: the least sum of squares for this moment
    ways = vehicle.allocated(position)
    effects = np.array([part.effectiveness() for part in vehicle.parts])
    travel = np.array([p.high - p.low for p in vehicle.parts])
    moved = np.array([p.kind == "fin" and control in p.controls() for p in vehicle.parts])
    matrix = (effects[:, [3, 4, 5]].T * travel)[:, moved]
    wanted = matrix @ (ways / travel)[moved]
    least = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
    np.testing.assert_allclose((ways / travel)[moved], least, atol=1e-9)


def test_both_controls_of_an_x_tail_add_and_stop_at_the_ends_of_travel():
    vehicle = x_tail()
    pitch, heading = vehicle.steered_index("pitch"), vehicle.steered_index("heading")
    assert pitch != heading
    each = []
    for moved in ((pitch,), (heading,), (pitch, heading)):
        position = vehicle.rest
        position[list(moved)] = 0.04
        each.append(vehicle.allocated(position))
    np.testing.assert_allclose(each[0] + each[1], each[2], atol=1e-12)
    position[[pitch, heading]] = 0.25
    far = vehicle.allocated(position)
    assert np.all((vehicle.actuator_min <= far) & (far <= vehicle.actuator_max))
    assert np.abs(far).max() == pytest.approx(0.3)


def test_an_x_tail_keeps_depth_and_heading():
    mission = twin.Mission.from_dict(
        {
            "segments": [{"kind": "transect", "depth_m": 12.0, "heading_deg": 60.0,
                          "duration_s": 240.0}],
            "start_depth_m": 10.0, "at_end": "hold",
        }
    )  # fmt: skip
    run = twin.simulate(vehicle=x_tail(), mission=mission)
    assert run["true_depth"][-1] == pytest.approx(12.0, abs=0.3)
    assert run["true_heading"][-1] == pytest.approx(60.0, abs=1.0)
    for name in ("rudder", "elevator", "low_port", "low_starboard"):
        assert np.ptp(run[f"true_{name}"]) > 0.5, name


def test_two_screws_drive_straight_and_share_the_thrust():
    vehicle = two_screws()
    assert vehicle.steering["speed"] == "propeller"
    assert [(f.lead, f.part) for f in vehicle.followers] == [("propeller", "starboard_screw")]
    one = load_vehicle(TORPEDO)
    rate = cruise_rate(vehicle, 1.5)
    assert rate < cruise_rate(one, 1.5)
    assert surplus(vehicle, rate, 1.5) == pytest.approx(0.0, abs=1e-6)
    position = vehicle.rest
    position[vehicle.part_names.index("propeller")] = rate
    position = vehicle.allocated(position)
    flight = held_flight(vehicle, dict(zip(vehicle.part_names, position.tolist(), strict=True)))
    assert flight.trim.speed_m_s == pytest.approx(1.5, abs=0.01)
    assert abs(flight.held["rudder"]) < 1e-6
    assert abs(moments(vehicle, position)[5]) < 1e-9


def test_screws_at_unequal_arms_turn_nothing():
    """The one nearer the axis pushes more: the yaw moments of small ways cancel."""
    vehicle = two_screws(starboard=0.2)
    (follower,) = vehicle.followers
    lead, mate = (vehicle.part(name).effectiveness() for name in (follower.lead, follower.part))
    together = lead + follower.weight * mate
    assert follower.weight == pytest.approx(1.5, rel=1e-6)
    assert abs(together[5]) < 1e-9 * abs(lead[5])
    assert together[0] == pytest.approx(2.5 * lead[0], rel=1e-6)


def test_a_second_screw_turns_in_a_mission():
    mission = twin.Mission.from_dict(
        {
            "segments": [{"kind": "transect", "depth_m": 10.0, "heading_deg": 0.0,
                          "duration_s": 60.0, "speed_m_s": 1.5}],
            "start_depth_m": 10.0, "at_end": "hold",
        }
    )  # fmt: skip
    run = twin.simulate(vehicle=two_screws(), mission=mission)
    assert run["true_surge"][-1] == pytest.approx(1.5, abs=0.02)
    np.testing.assert_allclose(run["true_starboard_screw"], run["true_propeller"], rtol=1e-6)


def test_a_named_part_steers_alone_and_nobody_is_told():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vehicle = with_part(
            load_vehicle(TORPEDO), "aft_rudder", kind="fin", place=(-0.9, 0.0, 0.0),
            numbers={"axis": (0.0, 0.0, 1.0), **BLADE}, steers=("heading",), **TRAVEL,
        )  # fmt: skip
    assert vehicle.steering["heading"] == "aft_rudder"
    assert (vehicle.followers, vehicle.idle) == ((), {})


def test_what_cannot_go_along_is_named():
    vehicle = with_part(
        "glider", "ballast", kind="pump", travel=(-100.0, 100.0), lag=2.0, rate=50.0
    )
    assert vehicle.followers == ()
    assert vehicle.idle == {"ballast": "pump"}
    dive = twin.Mission(segments=[SawTooth(yos=1, max_depth_m=50.0)])
    with pytest.warns(RuntimeWarning, match=r"leaves ballast \(beside pump\) at rest"):
        dive.compile(vehicle)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hold = Hold(net_mass_kg=0.3, parts={"ballast": 20.0}, duration_s=60.0)
        twin.Mission(segments=[hold], at_end="hold").compile(vehicle)


def test_one_part_cannot_be_named_for_two_controls():
    text = x_tail().xml.replace(
        "</custom>",
        '<text name="steer.pitch" data="rudder"/><text name="steer.heading" data="rudder"/>'
        "</custom>",
    )
    with pytest.raises(VehicleError, match=r"steer\.heading.*'rudder' again"):
        parse_vehicle(text, TORPEDO)


def test_shipped_vehicles_have_one_part_of_each():
    for name in vehicle_names():
        vehicle = load_vehicle(name)
        assert (vehicle.followers, vehicle.idle) == ((), {})
        position = vehicle.rest
        assert vehicle.allocated(position) is position


# --- neutral positions ----------------------------------------------------------------------------


TURNED = {"slocum-200": ("rudder", -0.19), "glider": ("rotation", 0.3)}


def flown(vehicle, part, position):
    named = dict(zip(vehicle.part_names, vehicle.rest.tolist(), strict=True))
    named |= {"pump": vehicle.pump_for_net_mass(0.2), vehicle.steering["pitch"]: 0.015}
    named[part] = position
    command = tuple(named[name] for name in vehicle.part_names)
    start = Start(depth=300.0, pitch=-0.4, v_rel=(0.3, 0.0, 0.01), actuators=command)
    return simulate(held(vehicle, command, 120.0, start=start))


@pytest.mark.parametrize("name", TURNED)
def test_a_part_at_its_neutral_position_steers_as_an_even_vehicles_at_0(name):
    part, neutral = TURNED[name]
    even = load_vehicle(name)
    uneven = even.replace(**{part: {"neutral": neutral}})
    assert uneven.rest[uneven.part_names.index(part)] == neutral
    for turned in (0.0, 0.2):
        mine, theirs = flown(uneven, part, neutral + turned), flown(even, part, turned)
        np.testing.assert_allclose(mine.v_rel, theirs.v_rel, atol=1e-9)
        np.testing.assert_allclose(mine["true_heading"], theirs["true_heading"], atol=1e-6)
    # and by both models: its steady turn at 0 is the even one's the other way
    there = {"pump": even.pump_for_net_mass(0.2), even.steering["pitch"]: 0.015}
    turn = FossenModel(uneven).trim(positions={**there, part: 0.0}).turn_rate_rad_s
    other = FossenModel(even).trim(positions={**there, part: -neutral}).turn_rate_rad_s
    assert turn == pytest.approx(other, rel=1e-9)
    assert abs(math.degrees(turn)) > 0.1


@pytest.mark.parametrize("name", TURNED)
def test_both_models_fly_an_uneven_vehicle_alike(name):
    part, neutral = TURNED[name]
    uneven = load_vehicle(name).replace(**{part: {"neutral": neutral}})
    (found,) = check_manoeuvres(uneven, count=1, duration=300.0)
    assert found.ok, found


# --- parts and laws that a program puts into a file -----------------------------------------------


TAIL: dict[str, Any] = {
    "kind": "fin",
    "travel": (-0.3, 0.3),
    "lag": 0.3,
    "rate": 0.5,
    "place": (-0.9, 0.1, -0.2),
    "numbers": {"axis": (0.0, 0.0, 1.0), "area": 0.02, "lift_slope": 3.0},
}


@pytest.mark.parametrize("name", vehicle_names())
def test_every_shipped_vehicle_takes_a_part_and_its_file_stands_alone(name, tmp_path):
    vehicle = with_part(name, "tail", **TAIL)
    path = tmp_path / "own.xml"
    path.write_text(vehicle.xml)
    again = twin.load_vehicle(path)
    assert again.part_names == (*twin.load_vehicle(name).part_names, "tail")
    part = again.part("tail")
    assert (part.low, part.high, part.lag, part.rate) == (-0.3, 0.3, 0.3, 0.5)
    assert part.position == (-0.9, 0.1, -0.2)
    model = compile_model(again)
    assert model.nu == len(again.parts)
    assert isinstance(model, mujoco.MjModel)


def test_comments_which_have_the_sources_stay():
    text = twin.load_vehicle("rogue").xml
    found = with_part("rogue", "tail", **TAIL).xml
    assert found.count("<!--") == text.count("<!--")
    assert found.startswith(text[: text.index("<mujoco")])


def test_a_pose_of_the_file_has_the_part_at_rest():
    model = compile_model(with_part("glider", "tail", **TAIL))
    assert model.nkey == 4
    assert (model.key_act[:, -1] == 0.0).all()
    held = with_part(
        "glider", "weight", kind="drop-weight", travel=(0.0, 1.0), lag=0.5, rate=1.0,
        numbers={"mass": 1.0},
    )  # fmt: skip
    assert (compile_model(held).key_act[:, -1] == held.part("weight").rest).all()


def test_a_mission_commands_the_part_and_guidance_steers_with_it():
    vehicle = with_part("glider", "tail", **TAIL, steers=["heading"])
    assert vehicle.steered("heading") is vehicle.part("tail")
    hold = Hold(net_mass_kg=0.3, shift_m=0.02, parts={"tail": 0.2}, duration_s=60.0)
    run = twin.simulate(vehicle=vehicle, mission=twin.Mission(segments=[hold], at_end="hold"))
    assert run["true_tail"][-1] == pytest.approx(np.degrees(0.2), abs=1e-6)
    assert abs(run["true_yaw_rate"][-1]) > 1e-3


def test_a_law_replaces_the_files_own_and_its_numbers():
    vehicle = with_law("graver-2005", "body-axes", {"Xuu": -5.0, "Yvv": -50.0, "Zww": -60.0})
    assert vehicle.law.kind == "body-axes"
    again = with_law(vehicle, "body-axes", {"Xuu": -7.0})
    assert again.xml.count('name="Xuu"') == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "fim"}, "did you mean 'fin'"),
        ({"kind": "battery-slide"}, "moves a mass on a joint"),
        ({"numbers": {"axis": (0.0, 0.0, 1.0), "area": 0.02}}, "tail.lift_slope"),
        ({"numbers": {**TAIL["numbers"], "aera": 1.0}}, "did you mean 'tail.area'"),
        ({"travel": (0.3, -0.3)}, "actrange"),
        ({"lag": "slow"}, "lag is 'slow': give a number"),
        ({"steers": ["depth"]}, "unknown steers 'depth'"),
    ],
)
def test_what_is_wrong_is_named(change, message):
    with pytest.raises(InputError, match=message):
        with_part("glider", "tail", **{**TAIL, **change})


def test_a_second_part_of_a_name_and_values_beside_the_file_are_refused():
    vehicle = with_part("glider", "tail", **TAIL)
    with pytest.raises(InputError, match="'tail' of two"):
        with_part(vehicle, "tail", **TAIL)
    changed = vehicle.replace(hull_compressibility=1e-10)
    with pytest.raises(InputError, match=r"other values than its file \(hull_compressibility\)"):
        with_part(changed, "other", **TAIL)
    assert Path(vehicle.path).name == "glider.xml"
