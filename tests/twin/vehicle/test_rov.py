"""BlueROV2 Heavy: its source's drag, six axes written anew, upside down, held in currents."""

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from physics import DEEP, glider, held, set_motion
from scipy.optimize import brentq

import twin
from twin.errors import MissionError, VehicleError
from twin.fossen import FossenModel
from twin.fossen.equations import derivative
from twin.frames import euler_to_quaternion, flip_vector, quaternion_to_matrix
from twin.mission import Mission
from twin.mission.segments import Hold, Hover, Mow, Orbit, Pose, Sticks, Transect
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle, parse_vehicle

ROV = load_vehicle("bluerov2")
WU = load_vehicle("bluerov2:wu")
HALF = math.sqrt(0.5)
AXES = {
    "surge": (0, {1: 1, 2: 1, 3: -1, 4: -1}, (13.7, 141.0), (4.03, 18.18)),
    "sway": (1, {1: -1, 2: 1, 3: -1, 4: 1}, (0.0, 217.0), (6.22, 21.66)),
    "heave": (2, {5: -1, 6: 1, 7: 1, 8: -1}, (33.0, 190.0), (5.18, 36.99)),
    "yaw": (5, {1: -1, 2: 1, 3: 1, 4: -1}, (0.0, 1.5), (0.07, 1.55)),
}
"""Axis, the thrusters that push along it, printed damping of Benzon and of Wu"""


def pushed(vehicle, signs, size):
    """Commands in the vehicle's order: thruster k at sign times size."""
    command = vehicle.rest
    for k, sign in signs.items():
        command[vehicle.part_names.index(f"thruster_{k}")] = sign * size
    return command


def along(vehicle, axis, command, speed):
    """Force or moment that the parts give on one axis at a motion along that axis alone."""
    nu = np.zeros(6)
    nu[axis] = speed
    found = zip(vehicle.parts, command, strict=True)
    return sum(part.wrench(c, nu, 1000.0, DEEP)[axis] for part, c in found)


@pytest.mark.parametrize("vehicle", [ROV, WU], ids=["benzon", "wu"])
@pytest.mark.parametrize("name", AXES)
def test_terminal_speeds_are_those_of_the_printed_damping(vehicle, name):
    """T = d u + D u |u| with the paper's d and D, and the thrust that is left at that speed."""
    axis, _, *sources = AXES[name]
    sticks = "yaw_deg_s" if axis == 5 else name
    linear, quadratic = sources[vehicle is WU]
    stick = Sticks(**{sticks: 60.0 if axis == 5 else 0.2}, duration_s=60.0)
    plan = Mission(segments=(stick,), at_end="hold", start_depth_m=30.0)
    run = twin.simulate(vehicle=vehicle, mission=plan, start=Start(depth=30.0))
    command = [run[f"true_{name}"][-1] for name in vehicle.part_names]

    def left(u):
        return along(vehicle, axis, command, u) - linear * u - quadratic * u * u

    reached = run["true_yaw_rate"][-1] if axis == 5 else run.v_rel[-1, axis]
    assert reached > 0.2
    assert reached == pytest.approx(brentq(left, 1e-3, 20.0), rel=0.01)


def test_full_thrust_ahead_gives_the_speed_of_each_source():
    """Bollard 13.2 kgf; 1.5 m/s, the maker's figure, lies between the two identifications."""
    full = pushed(ROV, AXES["surge"][1], 1.0)
    assert along(ROV, 0, full, 0.0) == pytest.approx(2.0 * HALF * (51.5 + 40.2))
    reached = []
    for vehicle in (ROV, WU):
        linear, quadratic = AXES["surge"][2 + (vehicle is WU)]

        def left(u, vehicle=vehicle, linear=linear, quadratic=quadratic):
            return along(vehicle, 0, full, u) - linear * u - quadratic * u * u

        reached.append(brentq(left, 0.01, 5.0))
    assert reached[0] < 1.5 < reached[1]


# --- six axes written anew ------------------------------------------------------------------------


def newton_euler(vehicle, down, nu, positions):
    """Acceleration of the CB, (6,): Newton and Euler about the CG, Kirchhoff's water, by hand."""
    mass, g = vehicle.mass, np.asarray(vehicle.static_cg)
    inertia, added = np.asarray(vehicle.static_inertia), np.asarray(vehicle.added_mass)
    v, omega = nu[:3], nu[3:]
    law = dict(vehicle.law.derivatives)
    force = np.zeros(6)
    for axis, (name, x) in enumerate(zip(("Xu", "Yv", "Zw", "Kp", "Mq", "Nr"), nu, strict=True)):
        force[axis] = law[name] * x + law[name + name[1]] * x * abs(x)
    for part, c in zip(vehicle.parts, positions, strict=True):
        r = np.array(part.position)
        there = v + np.cross(omega, r)
        if part.name == "tether":
            push = -0.5 * 1000.0 * 0.25 * 1.1 * 0.0076 * c * np.linalg.norm(there) * there
        else:
            s = max(abs(c) - 0.0625, 0.0) / (1.0 - 0.0625)
            most = 51.5 if c > 0 else 40.2
            curve = math.copysign(0.3 * s + 0.7 * s * s, c)
            push = most * (curve - s * np.dot(part.axis, there) / 4.0) * np.array(part.axis)
        force += [*push, *np.cross(r, push)]
    weight = mass * vehicle.gravity * down  # neutral: only its moment about the CB is left
    force[3:] += np.cross(g, weight)
    impulse = added @ nu
    force[:3] -= np.cross(omega, impulse[:3])
    force[3:] -= np.cross(omega, impulse[3:]) + np.cross(v, impulse[:3])
    # m (a + alpha x g + omega x (omega x g) + omega x v), and its moment about the CB
    carried = np.cross(omega, v) + np.cross(omega, np.cross(omega, g))
    force[:3] -= mass * carried
    force[3:] -= np.cross(omega, inertia @ omega) + np.cross(g, mass * carried)
    skew = np.cross(np.eye(3), g)  # skew @ x = g x x
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = mass * np.eye(3)
    matrix[:3, 3:] = mass * skew.T
    matrix[3:, :3] = mass * skew
    matrix[3:, 3:] = inertia - mass * skew @ skew
    return np.linalg.solve(matrix + added, force)


@pytest.mark.parametrize("vehicle", [ROV, WU], ids=["benzon", "wu"])
def test_six_axes_are_those_written_anew(vehicle):
    """Both engines accelerate as the equations above to 1e-6, at any attitude and motion."""
    fossen, rng = FossenModel(vehicle), np.random.default_rng(5)
    model, data = glider(vehicle=vehicle)
    model.opt.timestep = 1e-9  # the implicit step takes drag to the end of the step
    for _ in range(20):
        roll, pitch, heading = rng.uniform(-math.pi, math.pi, 3) * [1.0, 0.45, 1.0]
        attitude = euler_to_quaternion(roll, pitch, heading)
        rotation, nu = quaternion_to_matrix(attitude), rng.uniform(-1.0, 1.0, 6)
        positions = rng.uniform(vehicle.actuator_min, vehicle.actuator_max)
        anew = newton_euler(vehicle, rotation.T @ [0.0, 0.0, 1.0], nu, positions)
        y = np.array([0.0, 0.0, DEEP, *attitude, *nu, vehicle.hull_reference_temperature])
        theirs = derivative(fossen.parameters, fossen.program, 0.0, y, positions)
        np.testing.assert_allclose(theirs[7:13], anew, rtol=1e-6, atol=1e-6)
        motion = {"velocity": rotation @ nu[:3], "rates": nu[3:]}
        set_motion(data, roll=roll, pitch=pitch, heading=heading, **motion)
        data.act[:] = data.ctrl[:] = positions
        mujoco.mj_forward(model, data)
        ahead = rotation.T @ flip_vector(data.qacc[:3]) - np.cross(nu[3:], nu[:3])
        found = [*ahead, *flip_vector(data.qacc[3:6])]
        np.testing.assert_allclose(found, anew, rtol=1e-6, atol=1e-6)


# --- roll, upside down ----------------------------------------------------------------------------


@pytest.mark.parametrize("roll", [90.0, 179.0, -135.0])
def test_it_rights_itself_as_the_weight_below_the_centre_of_buoyancy_does(roll):
    rolled = math.radians(roll)
    start = Start(depth=20.0, roll=rolled)
    run = simulate(held(ROV, ROV.rest, 60.0, start=start, sample_period=0.05))
    expected = -13.5 * 9.81 * 0.01 * math.sin(rolled) / (0.26 + 0.189 + 13.5 * 0.01**2)
    early = run["true_roll_rate"][1] / run.time[1]
    assert early == pytest.approx(expected, rel=0.02)
    assert abs(run["true_roll"][-1]) < 20.0


@pytest.mark.parametrize("engine", ["mujoco", "lanes"])
def test_upside_down_it_levels_and_keeps_its_place(engine):
    mission = Mission(
        segments=(Hover(depth_m=10.0, duration_s=40.0),), at_end="hold", start_depth_m=10.0
    )
    start = Start(depth=10.0, roll=math.radians(175.0), pitch=0.3)
    run = twin.simulate(vehicle=ROV, mission=mission, start=start, engine=engine)
    assert np.abs(run["true_depth"] - 10.0).max() < 1.0
    assert np.hypot(run["true_north"], run["true_east"]).max() < 1.0
    late = run.time > 20.0
    assert max(np.abs(run[f"true_{angle}"][late]).max() for angle in ("roll", "pitch")) < 2.0


# --- missions and currents ------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["mujoco", "lanes"])
def test_the_square_is_flown_in_a_current_of_its_own_speed(engine):
    run = twin.simulate(vehicle=ROV, mission="square", engine=engine, current="uniform:0.2,0.2")
    assert run.provenance["ended"] == "flown"
    at = run.time < 100.0  # before the ascent
    north, east = run["true_north"][at], run["true_east"][at]
    for corner in ((5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (0.0, 0.0)):
        assert np.hypot(north - corner[0], east - corner[1]).min() < 0.3, corner
    assert np.abs(run["true_depth"][at][run.time[at] > 40.0] - 4.0).max() < 0.3


def test_a_current_above_its_speed_carries_it_away_at_its_depth():
    hover = Hover(depth_m=10.0, duration_s=60.0)
    run = twin.simulate(
        vehicle=ROV,
        mission=Mission(segments=(hover,), at_end="hold", start_depth_m=10.0),
        start=Start(depth=10.0),
        current="uniform:1.5,0",
    )
    assert run["true_north"][-1] > 20.0
    assert np.abs(run["true_depth"] - 10.0).max() < 0.5
    assert np.abs(run["true_roll"]).max() < 45.0


def test_orbit_with_sway_and_lawn_mower_above_a_floor():
    circle = Orbit(north_m=4.0, east_m=0.0, radius_m=3.0, heading_deg=30.0, depth_m=5.0)
    mower = Mow(heading_deg=30.0, leg_length_m=6.0, spacing_m=2.0, legs=3, altitude_m=3.0)
    options = {"vehicle": ROV, "start": Start(depth=5.0, heading=math.radians(30.0))}
    plan = Mission(segments=(circle,), at_end="hold", start_depth_m=5.0, start_heading_deg=30.0)
    run = twin.simulate(mission=plan, **options)
    on = run.time > 15.0
    away = np.hypot(run["true_north"] - 4.0, run["true_east"])[on]
    assert np.abs(away - 3.0).max() < 0.5
    assert np.abs(run["true_heading"][on] - 30.0).max() < 10.0
    assert run["true_sway"].max() > 0.2
    assert run["true_sway"].min() < -0.2
    plan = Mission(segments=(mower,), at_end="hold", start_depth_m=5.0, start_heading_deg=30.0)
    run = twin.simulate(mission=plan, floor="rough:12,height=1,length=30", **options)
    assert np.abs(run["true_altitude"][run.time > 25.0] - 3.0).max() < 0.4
    c, s = math.cos(math.radians(30.0)), math.sin(math.radians(30.0))
    aside = c * run["true_east"] - s * run["true_north"]
    assert aside[-1] == pytest.approx(4.0, abs=0.5)


def test_sticks_push_in_body_axes_and_hold_depth_and_heading():
    legs = (
        Sticks(surge=0.5, duration_s=20.0),
        Sticks(sway=0.5, yaw_deg_s=9.0, duration_s=10.0),
        Sticks(heave=-0.3, duration_s=5.0),
        Sticks(duration_s=20.0),
    )
    plan = Mission(segments=legs, at_end="hold", start_depth_m=10.0)
    run = twin.simulate(vehicle=ROV, mission=plan, start=Start(depth=10.0))
    surge, sway, time = run["true_surge"], run["true_sway"], run.time
    assert surge[time < 20.0][-1] > 0.4
    assert sway[(time > 20.0) & (time < 30.0)][-1] > 0.25
    assert np.abs(run["true_depth"][time < 29.0] - 10.0).max() < 0.3
    heading = (run["true_heading"][-1] + 180.0) % 360.0 - 180.0
    assert heading == pytest.approx(90.0, abs=3.0)
    risen = 10.0 - run["true_depth"][-1]
    assert 0.5 < risen < 4.0  # and held there
    assert np.ptp(run["true_depth"][time > 48.0]) < 0.2


def test_manual_thrusts_follow_dead_band_and_lag():
    thruster = ROV.part("thruster_6")
    still = np.zeros(6)
    assert thruster.wrench(0.06, still, 1000.0, DEEP)[2] == 0.0
    assert thruster.wrench(1.0, still, 1000.0, DEEP)[2] == pytest.approx(51.5)
    assert thruster.wrench(-1.0, still, 1000.0, DEEP)[2] == pytest.approx(-40.2)
    assert thruster.wrench(1.0, still, 1000.0, 0.0)[2] == pytest.approx(0.5 * 51.5)  # half a disc
    hold = Hold(parts={"thruster_6": 0.5}, duration_s=1.0)
    plan = Mission(segments=(hold,), at_end="hold", duration_s=1.0, start_depth_m=10.0)
    run = simulate(Scenario(vehicle=ROV, mission=plan, sample_period=0.05))
    late = run.time > 0.1
    assert run["true_thruster_6"][late] == pytest.approx(
        0.5 * (1.0 - np.exp(-run.time[late] / 0.15)), abs=0.02
    )


def test_the_tether_is_a_drag_at_its_end():
    tether = ROV.part("tether")
    pull = tether.wrench(40.0, np.array([0.5, 0, 0, 0, 0, 0.0]), 1000.0, DEEP)
    assert pull[0] == pytest.approx(-0.25 * 0.5 * 1000.0 * 1.1 * 0.0076 * 40.0 * 0.25)
    assert pull[4] == pytest.approx(tether.position[2] * pull[0])


# --- frames and refusals --------------------------------------------------------------------------


def without(*numbers):
    """The ROV without some thrusters."""
    text = ROV.xml
    for k in numbers:
        text = re.sub(rf'\n.*<(text|numeric|general) name="thruster_{k}[."].*', "", text)
    return parse_vehicle(text, Path("frame.xml"))


def test_six_thrusters_hold_a_pose_and_leave_pitch_to_the_weight():
    six = without(7, 8)  # horizontal four, and two at port and starboard
    assert six.holds_pose
    np.testing.assert_allclose(six.thrust_weights[:, 4], 0.0)
    mission = Mission(
        segments=(Pose(targets=({"north_m": 3.0, "east_m": 0.0},), stay_s=20.0),),
        at_end="hold", start_depth_m=10.0,
    )  # fmt: skip
    run = twin.simulate(vehicle=six, mission=mission, start=Start(depth=10.0))
    assert run["true_north"][-1] == pytest.approx(3.0, abs=0.3)
    assert not without(1, 2, 3).holds_pose


def test_others_refuse_poses_and_a_bad_axis_is_named():
    with pytest.raises(MissionError, match="nothing holds a pose"):
        Mission(segments=(Pose(duration_s=10.0),)).check(load_vehicle("remus"))
    with pytest.raises(MissionError, match="give a saw-tooth"):
        Mission(segments=(Transect(depth_m=5.0, length_m=10.0),)).check(ROV)
    text = ROV.xml.replace('axis" data="0 0 1"', 'axis" data="0 0 0"', 1)
    with pytest.raises(VehicleError, match="a direction"):
        parse_vehicle(text, Path("bad.xml"))
    with pytest.raises(VehicleError, match="dead_band must be at least 0 and below 1"):
        ROV.replace(thruster_1={"dead_band": 1.0})


def test_hovering_takes_less_than_flying():
    """The thrusters' electrical power by the maker's curve, above the hotel's 15 W."""
    fast = Mission(segments=(Sticks(surge=1.0, duration_s=20.0),), at_end="hold", start_depth_m=5)
    slow = Mission(segments=(Hover(duration_s=20.0, depth_m=5),), at_end="hold", start_depth_m=5)
    used = []
    for plan in (fast, slow):
        run = twin.simulate(vehicle=ROV, mission=plan, start=Start(depth=5.0))
        assert run["true_energy_hotel"][-1] == pytest.approx(15.0 * run.time[-1])
        used.append(sum(run[f"true_energy_thruster_{k}"][-1] for k in range(1, 9)))
    assert used[0] / 20.0 > 500.0  # four thrusters ahead, two of them in reverse
    assert used[1] / 20.0 < 20.0
