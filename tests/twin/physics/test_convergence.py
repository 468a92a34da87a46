"""Error against the time step: the order of the scheme, the shipped step, stiff vehicles.

The truth is the Fossen model under DOP853 at a tolerance of 1e-11, which shares no equation and no
integrator with the twin. It takes the battery as held in place, so the commands that change here
are the pump's, which moves no mass; one test moves the battery, slowly.
"""

import warnings

import numpy as np
import pytest
from physics import fossen_state, held, reference

import twin
from twin.checks.agreement import draw_manoeuvre
from twin.errors import InaccurateStep, InputError, StepTooLong
from twin.fossen import FossenModel
from twin.mission import Mission
from twin.mission.controller import Schedule
from twin.mission.segments import SawTooth
from twin.physics import stiffness as stiffness_module
from twin.physics.model_block import header
from twin.physics.mujoco_model import compile_model
from twin.physics.native.hydrodynamics import add_rotary_damping
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.physics.start import Start
from twin.physics.stiffness import STABLE, stiffness, stiffness_of
from twin.vehicle.laws.flow_frame import native_rotary_damping, native_wrench
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")
SHIPPED = 0.1
SAMPLE = 4.0
"""[s] a whole number of every step used here"""
DURATION = 80.0
TIMES = [0.0, 20.0, 40.0]


def pumped(rotation: float):
    """A dive at one battery position whose net mass [kg] is 0.3, 0.15, then -0.1."""
    return [(0.02, rotation, VEHICLE.pump_for_net_mass(m)) for m in (0.3, 0.15, -0.1)]


def start(commands) -> Start:
    """Off the steady state of the first command."""
    return Start(depth=500.0, pitch=-0.4, v_rel=(0.4, 0.0, 0.01), actuators=commands[0])


def truth(commands, *, vehicle=VEHICLE, duration=DURATION):
    """Velocity through the water (time, 3) of the independent model at a tight tolerance."""
    schedule = Schedule(times=TIMES[: len(commands)], commands=commands)
    state = fossen_state(start(commands))
    return reference(FossenModel(vehicle), state, schedule, duration, sample_period=SAMPLE)


def fly(
    commands, timestep: float, *, vehicle=VEHICLE, centred=True, solved=None, duration=DURATION
):
    """`solved` overrules whether rotary damping is solved for or extrapolated."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InaccurateStep)
        simulation = Simulation(
            Scenario(
                vehicle=vehicle,
                mission=Schedule(times=TIMES[: len(commands)], commands=commands),
                duration=duration,
                start=start(commands),
                timestep=timestep,
                centred=centred,
                sample_period=SAMPLE,
            )
        )
    if solved is not None:
        header(simulation.model)["implicit"] = float(solved)
        simulation.reset()
    return simulation.run()


def test_shipped_timestep_is_the_one_tested():
    assert compile_model("glider", lean=True).opt.timestep == SHIPPED


@pytest.mark.parametrize(
    ("centred", "solved", "order"),
    [(True, False, 2.0), (True, True, 2.0), (False, None, 1.0)],
    ids=["extrapolated", "solved", "plain"],
)
@pytest.mark.parametrize("rotation", [0.0, 0.5], ids=["straight", "turning"])
def test_error_falls_at_the_order_of_the_scheme(centred, solved, order, rotation, monkeypatch):
    """Semi-implicit Euler is first order; time-centred water makes it second.

    Below some 4e-6 m/s the servos that hold the battery end the agreement.
    """
    commands = pumped(rotation)
    exact = truth(commands)
    steps = (0.4, 0.2, 0.1)
    monkeypatch.setattr(stiffness_module, "STABLE", 1.0)  # a smooth dive: 0.4 s is still stable
    errors = [
        np.abs(fly(commands, step, centred=centred, solved=solved).v_rel - exact.v_rel).max()
        for step in steps
    ]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    # what the servos leave weighs on the smaller errors of what is solved for
    assert orders.min() > order - (0.2 if solved else 0.1)
    # the errors of the longest step fall faster than its order says
    assert orders.max() < order + (0.8 if centred else 0.1)
    assert errors[2] < (3e-5 if solved else 2e-5 if centred else 5e-4)


def test_shipped_step_is_within_a_tenth_of_a_percent_of_the_true_speed():
    """Through a dive that is pumped light and turns up, and a battery that moves slowly."""
    moving = [(0.02, 0.5, pump) for _, _, pump in pumped(0.0)]
    moving[1] = (0.012, 0.2, moving[1][2])
    moving[2] = (0.025, -0.4, moving[2][2])
    slow = VEHICLE.replace(
        **{part.name: {"rate": part.rate / 16, "lag": part.lag * 16} for part in VEHICLE.parts}
    )
    for commands, vehicle in ((pumped(0.0), VEHICLE), (pumped(0.5), VEHICLE), (moving, slow)):
        exact = truth(commands, vehicle=vehicle)
        flown = fly(commands, SHIPPED, vehicle=vehicle)
        np.testing.assert_allclose(np.linalg.norm(flown.v_rel, axis=1), exact.speed, rtol=1e-3)


def test_steady_state_does_not_depend_on_the_step():
    """A fixed point of the motion is one at every step size; only the spin of a spiral is left."""
    commands = pumped(0.5)[:1]
    end = truth(commands, duration=400.0).v_rel[-1]
    flown = [fly(commands, step, duration=400.0).v_rel[-1] for step in (0.2, 0.1, 0.05)]
    np.testing.assert_allclose(flown, np.tile(flown[2], (3, 1)), atol=1e-6)
    np.testing.assert_allclose(flown, np.tile(end, (3, 1)), atol=1e-5)


# --- stiff vehicles: what a step solves for, and which step is too long ---------------------------


EVERY, FLIGHT = 2.0, 200.0
GLIDERS = ("glider", "slocum-200", "slocum-1000", "seaglider", "seaexplorer", "spray")


def flown(vehicle, timestep, *, seed=0, solved=None):
    """A manoeuvre whose commands come on samples; `solved` overrules how it is stepped."""
    manoeuvre = draw_manoeuvre(vehicle.replace(control_period=EVERY), seed, FLIGHT)
    simulation = Simulation(
        Scenario(
            vehicle=vehicle,
            mission=manoeuvre.schedule,
            start=manoeuvre.start,
            duration=FLIGHT,
            timestep=timestep,
            sample_period=EVERY,
        )
    )
    if solved is not None:
        header(simulation.model)["implicit"] = float(solved)
        simulation.reset()
    return simulation, simulation.run()


def off(one, other):
    """Largest and RMS difference of the velocities through the water [m/s]."""
    gap = np.linalg.norm(one.v_rel - other.v_rel, axis=1)
    return float(gap.max()), float(np.sqrt(np.mean(gap**2)))


def test_a_stiff_vehicle_flies_at_ten_times_its_step():
    """ROGUE's rates settle by 17 1/s at its usual speed: a step of 0.1 s is 1.7 of that."""
    vehicle = load_vehicle("rogue")
    assert stiffness_of(vehicle).whole == pytest.approx(16.9, abs=0.1)
    simulation, found = flown(vehicle, 0.1)
    assert header(simulation.model)["implicit"] == 1.0
    _, truth = flown(vehicle, 0.005)
    assert off(found, truth)[0] < 1e-3
    turned = np.abs((found["true_heading"] - truth["true_heading"] + 180.0) % 360.0 - 180.0)
    assert turned.max() < 1.0


@pytest.mark.parametrize("name", GLIDERS)
def test_real_gliders_fly_at_a_fifth_of_a_second(name):
    """Against a twentieth of the step, in dives, climbs and turns with steps of every part."""
    vehicle = load_vehicle(name)
    _, long = flown(vehicle, 0.2)
    _, short = flown(vehicle, 0.01)
    assert off(long, short)[1] < 1e-3


@pytest.mark.parametrize("step", [0.1, 0.2, 0.5])
def test_solving_for_the_damping_keeps_the_turn(step):
    """Its yaw rate to four digits: in a steady turn the rates of the body do not change."""
    vehicle = load_vehicle("slocum-200").replace(hull_compressibility=0.0)
    named = dict(zip(vehicle.part_names, vehicle.rest.tolist(), strict=True))
    named |= {"pump": vehicle.pump_for_net_mass(0.2), "rudder": 0.3}
    named[vehicle.steering["pitch"]] = 0.02
    trim = FossenModel(vehicle).trim(positions=named)
    command = tuple(named[name] for name in vehicle.part_names)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        start = Start(depth=500.0, pitch=-0.4, v_rel=(0.3, 0.0, 0.01), actuators=command)
        times = {"timestep": step, "sample_period": EVERY}
        simulation = Simulation(held(vehicle, command, 600.0, start=start, **times))
    header(simulation.model)["implicit"] = 1.0
    simulation.reset()
    run = simulation.run()
    turned = np.unwrap(np.radians(run["true_heading"][-40:]))
    rate = (turned[-1] - turned[0]) / (39 * EVERY)
    assert rate == pytest.approx(trim.turn_rate_rad_s, rel=1e-4)


def test_the_rotary_damping_of_the_flow_law_is_the_slope_of_its_moment():
    """Everywhere on the sphere, with every cross term, body axes."""
    law = load_vehicle("slocum-200").law.values().copy()
    law[15:19] = 0.3, 2.0, 0.2, -1.0  # yaw and roll damp each other too
    rng = np.random.default_rng(0)
    for _ in range(300):
        motion = np.concatenate([0.4 * rng.normal(size=3), 0.1 * rng.normal(size=3)])
        slopes = np.empty((3, 3))
        for k in range(3):
            step = np.zeros(6)
            step[3 + k] = 1e-4
            ahead, behind = (native_wrench(law, 1025.0, *(motion + s * step)) for s in (1, -1))
            slopes[:, k] = (np.array(ahead) - np.array(behind))[3:] / 2e-4
        pp, pq, qq, pr, qr, rr = native_rotary_damping(law, 1025.0, *motion)
        found = np.array([[pp, pq, pr], [pq, qq, qr], [pr, qr, rr]])
        wanted = -0.5 * (slopes + slopes.T)
        np.testing.assert_allclose(found, wanted, atol=1e-9 * np.abs(wanted).max())


def test_the_eigenvalues_are_those_of_the_free_motion():
    """A small roll rate and a small heave of a free hull die out as the block says."""
    vehicle = load_vehicle("glider")
    found = stiffness(vehicle, 0.45)
    # the roll is alone but for the yaw: its own damping over its own inertia is the fastest
    roll = vehicle.law.roll_moment[1] * 0.45**2
    inertia = vehicle.static_inertia[0, 0] + vehicle.added_mass[3, 3]
    inertia += sum(mass.inertia[0, 0] for mass in vehicle.masses)
    assert found.whole == pytest.approx(-roll / inertia, rel=0.06)
    assert found.rest < 0.5 * found.whole


@pytest.mark.parametrize(("step", "kind"), [(0.16, InaccurateStep), (0.2, InputError)])
def test_a_step_that_is_too_long_is_told_before_the_flight(step, kind):
    scenario = Scenario(
        vehicle=load_vehicle("rogue"), timestep=step, duration=60.0, sample_period=0.8
    )
    said = r"timestep 0\.\d+ s is too long at 0\.30 m/s.*take at most 0\.1 s"
    told = pytest.raises if kind is InputError else pytest.warns
    with told(kind, match=said):
        Simulation(scenario)


def test_the_plan_says_how_fast_it_will_be():
    """A heavy dive is faster than the usual one, and its step shorter."""
    vehicle = load_vehicle("rogue")
    plan = Mission(
        segments=(SawTooth(max_depth_m=50.0, pitch_deg=40.0, net_mass_kg=0.5, yos=1),),
    )
    table, _ = plan.compile(vehicle)
    usual, planned = stiffness_of(vehicle), stiffness_of(vehicle, table)
    assert planned.speed > 1.2 * usual.speed
    assert planned.longest < usual.longest
    # and a start says so too
    assert stiffness_of(vehicle, start=1.0).speed == 1.0


def test_a_run_that_became_too_fast_for_its_step_says_so():
    vehicle = load_vehicle("rogue")
    start = Start(depth=100.0, v_rel=(0.35, 0.0, 0.0))
    scenario = held(vehicle, tuple(vehicle.rest.tolist()), 20.0, start=start, timestep=0.1)
    run = Simulation(scenario).run()
    assert not any("too long" in text for text in twin.remarks(scenario, run))
    for name in ("surge", "sway", "heave"):
        run.signals[f"true_{name}"] = run[f"true_{name}"] * 4.0
    (told,) = [text for text in twin.remarks(scenario, run) if "too long" in text]
    assert told.startswith("from 0 s on the timestep 0.1 s is too long at 1.4")
    assert 0.1 * stiffness(vehicle, 0.35).rest < STABLE < 0.1 * stiffness(vehicle, 1.4).rest


@pytest.mark.parametrize("engine", ["mujoco", "lanes"])
@pytest.mark.parametrize("name", ["rogue", "seaexplorer", "slocum-200", "glider", "seaglider"])
def test_every_step_that_is_not_refused_is_within_millimetres_per_second(name, engine):
    """Just below the bound, in dives, climbs and turns, beside a sixteenth of the step."""
    vehicle = load_vehicle(name)
    plan = twin.load_mission("section")
    table, _ = plan.compile(vehicle)
    step = 0.97 * STABLE / stiffness_of(vehicle, table).rest
    flown = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InaccurateStep)
        for part in (1, 16):
            flown.append(twin.simulate(Scenario(
                vehicle=vehicle, mission=plan, duration=400.0, engine=engine, timestep=step / part,
                sample_period=4.0 * step,
            )))  # fmt: skip
    for name in ("true_surge", "true_sway", "true_heave"):
        assert np.abs(flown[0][name] - flown[1][name]).max() < 5e-3
    with pytest.raises(StepTooLong):
        twin.simulate(Scenario(vehicle=vehicle, mission=plan, duration=60.0, engine=engine,
                               timestep=1.05 * step, sample_period=1.05 * step))  # fmt: skip


def test_a_rotary_damping_enters_the_mass_matrix_in_axes_to_port_and_up():
    """FRD to the axes of MuJoCo's free joint: products of roll with pitch or yaw change sign."""
    damping = np.array([[5.0, 0.3, -0.7], [0.3, 20.0, 1.1], [-0.7, 1.1, 17.0]])
    flip = np.diag([1.0, -1.0, -1.0])
    rows, columns = np.tril_indices(6)
    mass = np.zeros(21)
    add_rotary_damping(tuple(damping[np.tril_indices(3)]), 0.2, mass)
    whole = np.zeros((6, 6))
    whole[rows, columns] = mass
    expected = np.zeros((6, 6))
    expected[3:, 3:] = np.tril(0.2 * flip @ damping @ flip)
    np.testing.assert_allclose(whole, expected, atol=1e-15)
