"""Tethys: the figures of its two public sets of numbers, and the traps in them.

Rows of tests named after osrf/lrauv are those of its own simulator at 31b2b90 and e7ad598, with
their tolerances, flown by `tethys:gazebo`. Figures of the equations are computed apart from any
simulator.
"""

import dataclasses
import math

import numpy as np
import pytest
from physics import held

from twin.checks.published import held_flight
from twin.errors import NoSteadyState
from twin.fossen import FossenModel
from twin.fossen.steady import SteadyProblem
from twin.frames import euler_to_matrix
from twin.mission.controller import Schedule
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.sensors import Dvl, Surroundings
from twin.sensors.dvl import MODES, OUTPUTS
from twin.vehicle.consumption import Consumption
from twin.vehicle.steady_motion import solve_steady_state
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.profile import Uniform

RATE = 10.0 * math.pi  # 300 rpm
MBARI, GAZEBO = load_vehicle("tethys"), load_vehicle("tethys:gazebo")
SETS = {"mbari": MBARI, "gazebo": GAZEBO}
NINE = math.radians(9.0)
ONE_FIN = 0.5 * 1025.0 * 4.13 * 0.0115  # [kg/m]


def fly(duration, *, vehicle=GAZEBO, start=None, current=None, period=0.1, **parts):
    """A run at fixed commands of some parts, the others at rest; a step of 0.02 s."""
    command = vehicle.rest
    for name, value in parts.items():
        command[vehicle.part_names.index(name)] = value
    options = {"start": start or Start(depth=10.0), "current": current, "timestep": 0.02}
    return simulate(held(vehicle, command, duration, sample_period=period, **options))


def radians(run, name):
    return np.deg2rad(run[f"true_{name}"])


# --- the propeller --------------------------------------------------------------------------------


@pytest.mark.parametrize("vehicle", SETS.values(), ids=SETS)
def test_the_propellers_law_and_its_ventilation(vehicle):
    propeller = vehicle.part("propeller")
    thrust = [
        propeller.wrench(RATE, np.array([u, 0, 0, 0, 0, 0.0]), 1025.0, depth)[0]
        for u, depth in ((0.0, 0.5), (1.0, 0.5), (0.0, 30.0), (0.0, 0.0), (0.0, -0.11))
    ]
    assert thrust[0] == pytest.approx(1025.0 * 0.2**4 * 0.004312328 * RATE**2)
    assert thrust[0] == pytest.approx(6.980, abs=5e-4)
    assert thrust[1:3] == pytest.approx([thrust[0]] * 2)  # neither speed nor depth takes any
    assert thrust[3:] == pytest.approx([0.5 * thrust[0], 0.0])  # half a disc, none


def test_propeller_action():
    """osrf/lrauv, test_propeller_action."""
    run = fly(130.0, start=Start(depth=0.5), propeller=RATE)
    north, time = run["true_north"], run.time
    reached = int(np.argmax(north > 100.0))
    assert 0.0 < time[reached] < 1000.0
    flown = slice(0, reached + 1)
    speed = np.linalg.norm(run.v_rel, axis=1)[flown]
    assert np.abs(speed[time[flown] >= 36.0] - 1.0).max() <= 0.06
    assert run["true_depth"][reached] == pytest.approx(0.5, abs=0.05)
    assert run["true_east"][reached] == pytest.approx(0.0, abs=1e-3)
    for name, most in (("roll", 1e-3), ("heading", 1e-3), ("pitch", 1e-2)):
        angle = math.remainder(radians(run, name)[reached], math.tau)
        assert angle == pytest.approx(0.0, abs=most), name


def test_damped_forward_thrust_is_the_same_on_four_headings():
    """osrf/lrauv, test_hydrodynamics DampForwardThrust."""
    speeds = []
    for heading in (0.0, 0.5 * math.pi, 2.5, 1.5 * math.pi):
        start = Start(depth=20.0, heading=heading, actuators={"propeller": RATE})
        run = fly(45.0, start=start, propeller=RATE)
        speed = np.linalg.norm(run.v_rel, axis=1)
        speeds.append(speed[-1])
        assert speed[-1] == pytest.approx(1.01, abs=0.1)
        assert run["true_velocity_down"][-1] == pytest.approx(0.0, abs=1e-3)
        acceleration = np.diff(speed)
        assert (np.diff(acceleration) <= 1e-9).all()
        for name, at_first in (("roll", 0.0), ("pitch", 0.0), ("heading", heading)):
            turned = math.remainder(radians(run, name)[-1] - at_first, math.tau)
            assert turned == pytest.approx(0.0, abs=1e-3), name
    assert speeds == pytest.approx([speeds[0]] * 4, abs=1e-3)


def test_speeds_on_the_way_to_the_steady_one():
    start = Start(depth=20.0, actuators={"propeller": RATE})
    run = fly(120.0, start=start, propeller=RATE)
    speed = np.interp([36.0, 45.0, 120.0], run.time, np.linalg.norm(run.v_rel, axis=1))
    assert speed == pytest.approx([0.967, 1.015, 1.059], abs=1e-3)


# --- the fins -------------------------------------------------------------------------------------


def test_circles_at_nine_degrees_of_rudder():
    """osrf/lrauv, test_mission_yoyocircle: a positive rudder turns to port."""
    run = fly(420.0, propeller=RATE, rudder=NINE)
    late = run.time > 300.0
    assert np.abs(run["true_yaw_rate"][late] + 0.037).max() <= 0.0023
    assert np.abs(np.linalg.norm(run.v_rel, axis=1)[late] - 1.0).max() <= 0.2
    assert np.abs(run["true_roll_rate"][late]).max() <= 0.1


def test_elevator_action():
    """osrf/lrauv, test_elevator_action."""
    run = fly(100.0, start=Start(depth=0.5), propeller=30.0, elevator=0.15)
    reached = int(np.argmax(run["true_depth"] > 1.5))
    assert reached > 0
    assert radians(run, "pitch")[reached] < 0.0
    assert run["true_depth"].min() > -0.01


def test_rudder_action():
    """osrf/lrauv, test_rudder_action: 0.8 rad is clipped, and the vehicle comes round to port."""
    run = fly(400.0, propeller=30.0, rudder=0.8)
    assert radians(run, "rudder").max() == pytest.approx(math.radians(15.0), abs=1e-6)
    aside = int(np.argmax(run["true_east"] < -1.5))
    assert aside > 0
    behind = int(np.argmax(run["true_north"] < -1.5))
    assert behind > aside
    assert run["true_east"][behind] < -1.0


# --- battery, buoyancy engine and drop weight -----------------------------------------------------


def test_mass_shifter():
    """osrf/lrauv, test_mass_shifter."""
    run = fly(400.0, shift=0.01)
    assert radians(run, "pitch").min() < -0.15
    for name in ("roll", "heading"):
        angle = [math.remainder(x, math.tau) for x in radians(run, name)]
        assert np.abs(angle).max() <= 1e-6, name
    moving = np.diff(run["true_shift"]) / np.diff(run.time)
    assert moving.max() <= 0.0007 + 1e-6


def test_buoyancy_action():
    """osrf/lrauv, test_buoyancy_action: no oil is asked for, 80 cm3 are the least."""
    run = fly(600.0, start=Start(depth=0.5), period=0.5, pump=0.0)
    assert run["true_pump"].min() == pytest.approx(80.0, abs=0.1)
    reached = int(np.argmax(run["true_depth"] > 5.0))
    assert reached > 0
    assert np.abs(radians(run, "pitch")[: reached + 1]).max() <= 0.1
    assert abs(run["true_north"][reached]) <= 2.5
    assert abs(run["true_east"][reached]) <= 1.0
    for name in ("roll", "heading"):
        angle = math.remainder(radians(run, name)[reached], math.tau)
        assert angle == pytest.approx(0.0, abs=1e-6)
    assert -np.diff(run["true_pump"]).min() / 0.5 <= 3.0 + 1e-6


@pytest.mark.parametrize(
    ("vehicle", "degrees"), [(GAZEBO, 17.1), (MBARI, 14.5)], ids=["gazebo", "mbari"]
)
def test_ten_millimetres_of_battery(vehicle, degrees):
    """atan(m_b dx / (m z_g))."""
    battery = vehicle.battery
    moment = vehicle.static_mass * vehicle.static_cg[2] + battery.mass * battery.eccentricity
    wanted = math.degrees(math.atan(battery.mass * 0.01 / moment))
    assert wanted == pytest.approx(degrees, abs=0.05)
    run = fly(900.0, vehicle=vehicle, period=1.0, shift=0.01)
    assert -run["true_pitch"][run.time > 600.0].mean() == pytest.approx(wanted, abs=0.2)


@pytest.mark.parametrize("vehicle", SETS.values(), ids=SETS)
def test_it_floats_level_and_upright_and_rises_without_its_weight(vehicle):
    run = fly(60.0, vehicle=vehicle, start=Start(depth=50.0))
    assert np.abs(run["true_depth"] - 50.0).max() < 1e-3
    assert np.abs(run["true_pitch"]).max() < 0.05
    up = fly(120.0, vehicle=vehicle, start=Start(depth=50.0), drop_weight=0.0)
    assert up["true_depth"][-1] < 45.0
    weight = vehicle.part("drop_weight")
    assert weight.told(run.time, run["true_drop_weight"]) == {"drop_weight": "held throughout"}
    assert weight.told(up.time, up["true_drop_weight"]) == {"drop_weight": "released at 0 s"}
    assert [weight.text(x) for x in (1.0, 0.0)] == ["held", "gone"]
    engine = vehicle.part("pump")
    assert (engine.low, engine.neutral, engine.high, engine.rate) == (80.0, 500.0, 955.0, 3.0)
    assert vehicle.net_mass_for_pump(80.0) == pytest.approx(0.4305)


def test_mass_and_inertia_are_those_of_the_whole_vehicle():
    """The battery is part of MBARI's 41.98 kg m2; Gazebo adds it to them."""

    def total(vehicle):
        inertia, mass, moment = np.zeros((3, 3)), 0.0, np.zeros(3)
        blocks = [(vehicle.static_mass, vehicle.static_cg, vehicle.static_inertia)]
        blocks += [(m.mass, m.position(0.0, 0.0), m.inertia) for m in vehicle.masses]
        for m, place, own in blocks:
            inertia += own + m * (place @ place * np.eye(3) - np.outer(place, place))
            mass, moment = mass + m, moment + m * np.asarray(place)
        return mass, moment / mass, inertia

    mass, cg, inertia = total(MBARI)
    assert mass == pytest.approx(147.8671)
    np.testing.assert_allclose(cg, [0.0, 0.0, 0.006794], atol=1e-6)
    np.testing.assert_allclose(inertia, np.diag([3.0, 41.980233, 41.980233]), atol=1e-3)
    mass, cg, inertia = total(GAZEBO)
    assert mass == pytest.approx(147.5671 + 0.8)
    assert mass * cg[2] == pytest.approx(147.5671 * 0.007, rel=1e-4)
    assert inertia[1, 1] == pytest.approx(56.5, abs=0.1)
    assert np.abs(inertia - np.diag(np.diag(inertia))).max() < 1e-3


# --- water ----------------------------------------------------------------------------------------


def test_hydrostatics_without_damping():
    """osrf/lrauv, test_hydrostatics: 200 s without any force of the flow."""
    still = {"lift_slope": 1e-12, "drag_slope": 0.0, "stalled_drag_slope": 0.0}
    bare = GAZEBO.replace(derivatives=(), rudder=still, elevator=still)
    neutral = fly(200.0, vehicle=bare, start=Start(depth=10.0))
    for name in ("north", "east", "depth"):
        assert np.ptp(neutral[f"true_{name}"]) < 1e-4, name
    for name in ("roll", "pitch"):
        assert np.ptp(radians(neutral, name)) < 1e-6, name
    tilted = fly(200.0, vehicle=bare, start=Start(depth=10.0, pitch=0.08))
    pitch = radians(tilted, "pitch")
    assert np.abs(pitch).max() <= 0.08 + 1e-6
    assert pitch.min() < -0.079  # it swings, and nothing damps it
    for name in ("north", "east"):
        assert np.abs(np.diff(tilted[f"true_{name}"])).max() < 1e-2


def test_currents():
    """osrf/lrauv, test_currents: at rest over ground in 1 m/s from abeam, with it after 2 min.

    What the current brings along the hull comes later, as its drag alone has it.
    """
    current = Uniform(north=0.0, east=1.0)
    run = fly(120.0, start=Start(depth=10.0, v_rel=(0.0, -1.0, 0.0)), current=current)
    assert run["true_velocity_east"][0] == pytest.approx(0.0, abs=1e-9)
    assert run["true_velocity_east"][-1] == pytest.approx(1.0, abs=0.1)
    assert run["true_velocity_north"][-1] == pytest.approx(0.0, abs=1e-2)
    assert run["true_velocity_down"][-1] == pytest.approx(0.0, abs=1e-2)
    adrift = fly(120.0, start=Start(depth=10.0, heading=0.5 * math.pi), current=current)
    assert adrift["true_velocity_east"][-1] == pytest.approx(1.0, abs=1e-6)
    along = fly(
        240.0, start=Start(depth=10.0, heading=0.5 * math.pi, v_rel=(-1.0, 0.0, 0.0)),
        current=current,
    )  # fmt: skip
    left = 1.0 / (1.0 + 6.2282 / (GAZEBO.mass + 4.876161) * 240.0)
    assert along["true_velocity_east"][-1] == pytest.approx(1.0 - left, abs=5e-3)


LRAUV_DVL = Dvl(
    lever_arm=(0.6, 0.0, 0.16), tilt_deg=30.0, min_range=0.1, max_range=80.0,
    bottom_noise=0.002, water_noise=0.0035, scale=0.0, misalignment_deg=0.0,
    mean_loss_time=0.0, outlier_probability=0.0,
)  # fmt: skip
"""Teledyne Pathfinder of osrf/lrauv: where it sits, its beams and noise"""


def doppler(run, dvl, bottom_depth, current=None):
    signals = {name: run[name] for name in run if name.startswith("true_")}
    for axis in ("roll", "pitch", "yaw"):
        signals[f"measured_{axis}_rate"] = run[f"true_{axis}_rate"]
    out = dvl.measure(
        signals, dt=0.5, drawn=dict.fromkeys(Dvl.draws, 0.0), rng=np.random.default_rng(0),
        surroundings=Surroundings(bottom_depth=bottom_depth, current=current),
    )  # fmt: skip
    return np.stack([out[name] for name in OUTPUTS], axis=1), out["measured_dvl_mode"]


def over_ground(run):
    turn = euler_to_matrix(*(radians(run, name) for name in ("roll", "pitch", "heading")))
    ned = np.stack([run[f"true_velocity_{x}"] for x in ("north", "east", "down")], axis=-1)
    return np.einsum("tji,tj->ti", turn, ned)


def test_doppler_log_on_the_bottom():
    """osrf/lrauv, test_dvl BottomTracking: 20 m below the vehicle, at rest and in a turn."""
    still = fly(10.0, period=0.5)
    slant = (20.0 - 0.16) / math.cos(math.radians(30.0))
    for reach, mode in ((slant + 0.2, "bottom"), (slant - 0.2, "none")):
        dvl = dataclasses.replace(LRAUV_DVL, max_range=reach)
        assert (doppler(still, dvl, 30.0)[1] == MODES[mode]).all()
    velocity, _ = doppler(still, LRAUV_DVL, 30.0)
    assert np.abs(velocity).max() <= 0.01
    turning = fly(50.0, period=0.5, propeller=RATE, rudder=0.8)
    velocity, mode = doppler(turning, LRAUV_DVL, 30.0)
    assert (mode == MODES["bottom"]).all()
    assert np.abs(turning["true_yaw_rate"][-1]) > 0.03
    assert velocity[-1] == pytest.approx(over_ground(turning)[-1], abs=0.01)
    # the instrument itself moves by omega x r more: 0.6 m ahead, to port
    assert abs(turning["true_yaw_rate"][-1] * 0.6) > 0.02


def test_doppler_log_in_the_water_and_without_a_bottom():
    """osrf/lrauv, test_dvl WaterMassTracking and NoTracking."""
    current = Uniform(north=0.5, east=-1.0)
    run = fly(50.0, period=0.5, current=current, propeller=RATE, rudder=0.8)
    velocity, mode = doppler(run, LRAUV_DVL, None, current.compile(50.0))
    assert (mode == MODES["water"]).all()  # without a bottom there is no bottom lock
    assert np.abs(velocity - run.v_rel).max() <= 0.1
    assert np.abs(over_ground(run)[-1] - velocity[-1]).max() > 0.5


# --- steady figures of the equations --------------------------------------------------------------


@pytest.mark.parametrize("model", ["mujoco", "fossen"])
@pytest.mark.parametrize(
    ("vehicle", "speed", "rate", "radius"),
    [(GAZEBO, 1.059, 0.0373, 27.0), (MBARI, 0.953, 0.0734, 10.75)],
    ids=["gazebo", "mbari"],
)
def test_steady_speeds_and_turns(vehicle, speed, rate, radius, model):
    straight = held_flight(vehicle, {"propeller": RATE}, model=model)
    assert straight.trim.speed_m_s == pytest.approx(speed, abs=1e-3)
    for sense in (1.0, -1.0):
        turn = held_flight(
            vehicle, {"propeller": RATE, "rudder": sense * NINE}, turning=True, model=model
        ).trim
        assert turn.turn_rate_rad_s == pytest.approx(-sense * rate, abs=1e-4)
        assert turn.turn_radius_m == pytest.approx(radius, rel=2e-3)


@pytest.mark.parametrize("model", ["mujoco", "fossen"])
@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(
    ("vehicle", "pitch", "rate", "attack", "elevator"),
    [
        (MBARI, 20.0, 0.298, 1.65, 3.07),
        (MBARI, 15.0, 0.226, 1.27, 2.24),
        (GAZEBO, 20.0, 0.282, 4.12, 7.59),
        (GAZEBO, 15.0, 0.206, 3.55, 6.13),
    ],
    ids=["mbari-20", "mbari-15", "gazebo-20", "gazebo-15"],
)
def test_dives_and_climbs(vehicle, pitch, rate, attack, elevator, sense, model):
    found = held_flight(
        vehicle, {"propeller": RATE}, pitch=-math.radians(sense * pitch), model=model
    )
    assert found.trim.vertical_speed_m_s == pytest.approx(sense * rate, abs=1e-3)
    assert found.trim.angle_of_attack_deg == pytest.approx(-sense * attack, abs=0.01)
    assert math.degrees(found.held["elevator"]) == pytest.approx(sense * elevator, abs=0.01)


# --- the traps ------------------------------------------------------------------------------------


def derivatives(vehicle, **changes):
    return vehicle.replace(
        derivatives=tuple(
            (name, changes.get(name, value)) for name, value in vehicle.law.derivatives
        )
    )


def dive(vehicle):
    return held_flight(vehicle, {"propeller": RATE}, pitch=math.radians(-20.0))


def turn_rate(vehicle):
    found = held_flight(vehicle, {"propeller": RATE, "rudder": NINE}, turning=True)
    return found.trim.turn_rate_rad_s


def test_the_fins_arm_is_that_of_each_set():
    """0.633 m against 1.05 m: another set's arm is another vehicle."""
    for name in ("rudder", "elevator"):
        assert MBARI.part(name).position[0] == -0.633
        assert GAZEBO.part(name).position[0] == -1.05
    ahead = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for vehicle, arm in ((MBARI, -0.633), (GAZEBO, -1.05)):
        wrench = vehicle.part("rudder").wrench(0.1, ahead, 1025.0, 100.0)
        assert wrench[5] == pytest.approx(arm * wrench[1])
    swapped = {name: {"position": (-1.05, 0.0, 0.0)} for name in ("rudder", "elevator")}
    assert turn_rate(MBARI) == pytest.approx(-0.0734, abs=1e-4)
    assert abs(turn_rate(MBARI.replace(**swapped))) < 0.067
    swapped = {name: {"position": (-0.633, 0.0, 0.0)} for name in ("rudder", "elevator")}
    assert math.degrees(dive(GAZEBO).held["elevator"]) == pytest.approx(7.59, abs=0.01)
    assert math.degrees(dive(GAZEBO.replace(**swapped)).held["elevator"]) > 9.0


def lift_slopes(vehicle):
    """Y and N per sway [kg/m, kg] of hull and fins together at 1 m/s."""
    total = np.zeros(6)
    for v in (1e-4, -1e-4):
        nu = np.array([1.0, v, 0.0, 0.0, 0.0, 0.0])
        wrench = vehicle.law.wrench(nu, 1025.0)
        wrench = wrench + vehicle.part("rudder").wrench(0.0, nu, 1025.0, 100.0)
        total += math.copysign(1.0, v) * wrench / 2e-4
    return total[1], total[5]


def test_the_list_holds_one_fin_and_the_simulator_adds_four():
    """MBARI's lrauv.m adds the fins of robsFins.m to a list that holds the lift of one already.

    Its figures are those of the sum. Counted once, the vehicle has no steady circle at 9 deg;
    counted in the list alone, it is too fast and its elevator too strong.
    """
    listed = dict(MBARI.law.derivatives)
    munk = -(126.324739 - 4.876161)
    assert listed["Yuv"] == pytest.approx(-ONE_FIN, abs=0.5)  # the one fin is all the lift in it
    assert listed["Nuv"] == pytest.approx(munk + 0.633 * ONE_FIN, abs=0.5)
    side, yaw = lift_slopes(MBARI)
    drag = 0.03 * 0.5 * 1025.0 * 0.023  # C_D0 stands along the flow too
    assert side == pytest.approx(listed["Yuv"] - 2.0 * ONE_FIN - drag, abs=0.1)
    assert yaw == pytest.approx(listed["Nuv"] + 0.633 * (2.0 * ONE_FIN + drag), abs=0.1)
    assert not any(MBARI.part(name).in_hull for name in ("rudder", "elevator"))

    fin = {"Yuv": ONE_FIN, "Zuw": ONE_FIN, "Nuv": -0.633 * ONE_FIN, "Muw": 0.633 * ONE_FIN}
    once = derivatives(MBARI, **{name: listed[name] + value for name, value in fin.items()})
    assert math.degrees(dive(once).held["elevator"]) < 2.4  # 3.1 is asked for
    with pytest.raises(NoSteadyState):
        FossenModel(once).trim(positions={"propeller": RATE, "rudder": NINE})
    in_list = MBARI.replace(rudder={"in_hull": True}, elevator={"in_hull": True})
    assert held_flight(in_list, {"propeller": RATE}).trim.speed_m_s > 0.99  # 0.95 is asked for
    assert math.degrees(dive(in_list).held["elevator"]) < 2.4


def test_straight_flight_of_mbaris_set_needs_the_rudder():
    """docs/reference/vehicles.md: it grows into one of two mirrored turns; a kick picks it."""
    model = FossenModel(MBARI)
    assert abs(model.trim(positions={"propeller": RATE}).turn_rate_rad_s) == pytest.approx(
        0.0166, abs=5e-5
    )
    ahead = MBARI.rest
    ahead[MBARI.part_names.index("propeller")] = RATE
    problem = SteadyProblem(model.parameters, ahead, MBARI.steered_index("heading"), True)
    straight = solve_steady_state(problem.residual, problem.straight_guesses())
    growths = [problem.eigenvalues(x).real.max() for x in straight if abs(x[5]) < 1e-6]
    assert growths
    assert growths == pytest.approx([0.0738] * len(growths), abs=1e-3)
    command, kick = MBARI.rest, MBARI.rest
    command[MBARI.part_names.index("propeller")] = kick[MBARI.part_names.index("propeller")] = RATE
    turns = []
    for side in (1.0, -1.0):
        kick[MBARI.part_names.index("rudder")] = side * math.radians(3.0)  # + turns to port
        plan = Schedule(times=[0.0, 60.0, 80.0], commands=[command, kick.copy(), command])
        run = simulate(
            Scenario(vehicle=MBARI, mission=plan, duration=500.0, start=Start(depth=50.0))
        )
        turns.append(run["true_yaw_rate"][-1])
    assert turns == pytest.approx([-0.0166, 0.0166], abs=5e-5)


def test_the_munk_moment_turns_the_hull_across_the_flow():
    """Muw > 0 and Nuv < 0 in forward-starboard-down; Gazebo's set has none."""
    listed = dict(MBARI.law.derivatives)
    assert listed["Muw"] > 0.0 > listed["Nuv"]
    rising = MBARI.law.wrench(np.array([1.0, 0.0, 0.01, 0.0, 0.0, 0.0]), 1025.0)
    assert rising[4] > 0.0  # flow from below lifts the nose further
    drifting = MBARI.law.wrench(np.array([1.0, 0.01, 0.0, 0.0, 0.0, 0.0]), 1025.0)
    assert drifting[5] < 0.0
    wrong = derivatives(MBARI, Muw=-listed["Muw"], Nuv=-listed["Nuv"])
    assert abs(math.degrees(dive(wrong).held["elevator"]) - 3.1) > 3.0
    assert abs(turn_rate(wrong)) < 0.03  # 0.073 is
    assert not {"Muw", "Nuv", "Yuv", "Zuw"} & set(dict(GAZEBO.law.derivatives))
    # neither set has its added mass's own coupling twice
    assert not MBARI.added_mass_coupling
    assert not GAZEBO.added_mass_coupling
    assert turn_rate(GAZEBO) == pytest.approx(-0.0373, abs=1e-4)


def test_the_listed_coupling_is_kirchhoffs():
    """The terms without fins are those of M_A: what `added_mass_coupling` 0 says is true."""
    listed = dict(MBARI.law.derivatives)
    a = MBARI.added_mass
    kirchhoff = {
        "Xwq": -a[2, 2], "Xvr": a[1, 1], "Xqq": -a[2, 4], "Xrr": a[1, 5], "Ywp": a[2, 2],
        "Zvp": -a[1, 1], "Ypq": a[2, 4], "Zrp": -a[1, 5], "Mpr": a[5, 5], "Npq": -a[4, 4],
        "Mvp": a[1, 5], "Nwp": -a[2, 4],
    }  # fmt: skip
    for name, value in kirchhoff.items():
        assert listed[name] == pytest.approx(value), name


# --- both models, energy --------------------------------------------------------------------------


def test_its_range_is_mbaris():
    """8 W of payload and 400 Ah at 14.4 V (osrf/lrauv): more than 1000 km at 1 m/s."""
    rate = RATE / 0.953  # 1 m/s
    at = np.array([rate, 0.0, 0.0, 0.0, 500.0, 1.0])

    def power(vehicle):
        losses = Consumption.of(vehicle)
        found = losses.shares(vehicle, at, at, depth=10.0, pitch=0.0, duration=1.0)
        return sum(found.values())

    assert 1000.0 < 400.0 * 14.4 * 3600.0 / power(MBARI) / 1000.0 < 2000.0
    assert power(GAZEBO) == pytest.approx(28.8, abs=0.5)  # its test_battery
