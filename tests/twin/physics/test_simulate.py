"""Simulations: determinism, batches, actuators, buoyancy, surface, instability, replay."""

import dataclasses
import json

import mujoco
import numpy as np
import pytest
from physics import glider, set_motion

from twin.errors import InputError, SimulationUnstable, StepTooLong
from twin.frames import euler_to_matrix
from twin.mission import Hold, Mission, SawTooth, Waypoint, load_mission
from twin.mission.controller import Command, Schedule
from twin.physics.fleet import Fleet
from twin.physics.model_block import state
from twin.physics.outcome import remarks
from twin.physics.scenario import Scenario, Start, scenario_from_dict
from twin.physics.simulation import Simulation, simulate, simulate_many
from twin.physics.start import out_of_trim, weighed
from twin.records.mission_dataset import dataset_of
from twin.records.store import open_store, write_store
from twin.records.trajectory import sample_times
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.profile import Profile, Uniform
from twin.water.density import DensityProfile
from twin.water.floor import FlatFloor, GridFloor

VEHICLE = load_vehicle("glider")
STIFF = VEHICLE.replace(side_force=(-800.0,))
JUMP = Profile(
    depth=(0.0, 20.0, 20.1, 320.0, 320.1), north=(0.0,) * 5, east=(0.0, 0.0, 10.0, 10.0, 0.0)
)
"""Water in which a glider meets 10 m/s from abeam, which nobody can foresee"""
WILD = {"vehicle": STIFF, "current": JUMP, "duration": 600.0}
YO = Mission(segments=(SawTooth(max_depth_m=40, pitch_deg=30, heading_deg=40, yos=1),))


def dive(**changes) -> Scenario:
    heavy = (0.02, 0.3, VEHICLE.pump_for_net_mass(0.3))
    fields = {
        "vehicle": VEHICLE,
        "mission": Schedule(times=[0.0], commands=[heavy]),
        "duration": 60.0,
        "start": Start(depth=300.0),
    }
    return Scenario(**{**fields, **changes})


def same(first, second):
    np.testing.assert_array_equal(first.states, second.states)
    for name, values in first.signals.items():
        np.testing.assert_array_equal(values, second.signals[name], err_msg=name)


def test_a_batch_on_any_threads_equals_one_by_one():
    scenarios = [
        Scenario(mission=YO, duration=120.0, current=Uniform(north=0.1 * i, east=-0.05), vehicle=v)
        for i, v in enumerate([VEHICLE, VEHICLE.replace(drag=(8.0, 350.0)), VEHICLE])
    ]
    alone = [simulate(s) for s in scenarios]
    for threads in (1, 2):
        for one, batched in zip(alone, Fleet(scenarios, threads=threads).run(), strict=True):
            same(one, batched)
        for one, pooled in zip(alone, simulate_many(scenarios, threads=threads), strict=True):
            same(one, pooled)
    assert not np.array_equal(alone[0].states, alone[1].states)


def test_stepping_in_pieces_changes_nothing():
    whole = simulate(dive())
    pieces = Simulation(dive())
    for _ in range(pieces.steps):
        mujoco.mj_step(pieces.model, pieces.data)
    same(whole, pieces.trajectory())


def test_lean_and_full_models_fly_alike():
    full = Simulation(dive(), lean=False).run()
    np.testing.assert_allclose(full.states, simulate(dive()).states, rtol=0, atol=1e-12)


def test_a_controller_must_return_a_command():
    free = Scenario(vehicle=VEHICLE, duration=10.0, start=Start(depth=100.0))
    with pytest.raises(InputError, match="must return a Command"):
        simulate(free, lambda observation: (0.0, 0.0, 0.0))
    flown = simulate(free, lambda observation: Command(pump=-200.0))
    assert flown["true_depth"][-1] > 100.0


def test_actuators_lag_and_are_rate_limited():
    """Pump 100 cm3/s and 4 s, shift 20 mm/s and 2 s, as the vehicle file says."""
    target = (0.05, 1.2, -400.0)
    schedule = Schedule(times=[0.0], commands=[target])
    t = simulate(dive(mission=schedule, duration=30.0))
    for index, name in enumerate(("shift", "rotation", "pump")):
        rate, lag = VEHICLE.actuator_rate[index], VEHICLE.actuator_lag[index]
        position = t.states[:, 17 + index]
        assert np.abs(np.diff(position)).max() <= rate * 0.5 * (1 + 1e-9), name
        reached = max(0.0, abs(target[index]) - rate * lag)
        begins = reached / rate  # the exponential takes over here
        late = t.time > begins + 0.2
        exact = np.abs(target[index]) - rate * lag * np.exp(-(t.time[late] - begins) / lag)
        np.testing.assert_allclose(np.abs(position[late]), exact, rtol=2e-3)


def test_a_light_glider_floats_and_a_heavy_one_sinks():
    light = Schedule(times=[0.0], commands=[(0.0, 0.0, 400.0)])
    t = simulate(dive(mission=light, duration=600.0, start=Start(depth=20.0)))
    assert abs(t["true_depth"][-1]) < 0.5
    assert 0.5 < t["true_immersion"][-1] < 1.0
    assert np.abs(t["true_velocity_down"][-20:]).max() < 1e-3
    # floating: the immersed volume carries the weight
    volume = VEHICLE.neutral_volume + 400e-6
    assert t["true_immersion"][-1] * volume * 1025 == pytest.approx(VEHICLE.mass, rel=2e-3)


def test_accelerometer_feels_gravity_at_rest():
    still = Schedule(times=[0.0], commands=[(0.0, 0.0, 0.0)])
    vehicle = VEHICLE.replace(static_cg=np.array([-0.0813889, 0.0, 0.0032]))
    t = simulate(dive(vehicle=vehicle, mission=still, duration=2.0))
    force = np.stack([t[f"true_specific_force_{a}"] for a in "xyz"], -1)
    np.testing.assert_allclose(force[0], [0.0, 0.0, -9.81], atol=0.02)


def test_specific_force_is_the_second_derivative_less_gravity():
    """Against a central difference of the logged velocity, at the CB."""
    vehicle = VEHICLE.replace(imu_position=np.zeros(3))
    t = simulate(dive(vehicle=vehicle, sample_period=0.1, duration=20.0))
    velocity = np.stack([t[f"true_velocity_{n}"] for n in ("north", "east", "down")], -1)
    acceleration = (velocity[2:] - velocity[:-2]) / 0.2
    angles = [np.deg2rad(t[f"true_{n}"][1:-1]) for n in ("roll", "pitch", "heading")]
    felt = np.einsum("tji,tj->ti", euler_to_matrix(*angles), acceleration - [0, 0, 9.81])
    logged = np.stack([t[f"true_specific_force_{a}"] for a in "xyz"], -1)[1:-1]
    np.testing.assert_allclose(logged[5:], felt[5:], atol=2e-3)


def test_depth_rate_and_heave_belong_together():
    t = simulate(dive(current=Uniform(north=0.2, east=0.1)))
    theta, phi = np.deg2rad(t["true_pitch"]), np.deg2rad(t["true_roll"])
    u, v, w = t.v_rel.T
    rate = -u * np.sin(theta) + np.cos(theta) * (v * np.sin(phi) + w * np.cos(phi))
    np.testing.assert_allclose(t["true_velocity_down"], rate, atol=1e-9)


def test_an_unstable_run_names_itself_and_keeps_what_it_had():
    with pytest.raises(
        SimulationUnstable,
        match=r"the run went unstable at .* s, .* m/s .*timestep 0.1 s.*as 0.02,",
    ) as error:
        simulate(dive(**WILD))
    partial = error.value.partial
    assert error.value.time_s > 0
    assert len(partial.time) > 0
    assert np.isfinite(partial.states).all()
    assert not partial.complete


def test_an_unstable_mission_is_called_by_its_name():
    wild = Scenario(mission=load_mission("default"), **WILD)
    with pytest.raises(SimulationUnstable, match=r"mission 'default' went unstable"):
        simulate(wild)
    results = simulate_many([dive(), wild])
    assert str(results[1]).startswith("mission 1 ('default') went unstable")


@pytest.mark.parametrize(
    ("scenarios", "threads", "message"),
    [
        (lambda: dive(), 1, "takes a list of scenarios; fly a single one with simulate$"),
        (lambda: 7, 1, "takes a list of scenarios, not a value of type int"),
        (lambda: [dive(), "dive"], 1, "element 1 is a value of type str, not a Scenario; make one"),
        (lambda: [dive()], 0, "threads must be at least 1, not 0"),
        (lambda: [dive()], -1, "threads must be at least 1, not -1"),
    ],
)
def test_what_simulate_many_refuses(scenarios, threads, message):
    with pytest.raises(InputError, match=message):
        simulate_many(scenarios(), threads=threads)


def test_samples_are_at_exact_multiples_of_their_period(tmp_path):
    """MuJoCo's clock drifts by nanoseconds; `sel(time=...)` finds whole seconds all the same."""
    for period in (0.5, 0.1):
        run = simulate(dive(duration=120.0, sample_period=period))
        store = write_store(dataset_of([run]), tmp_path / f"{period}.zarr")
        with open_store(store) as data:
            exact = data.sel(time=np.arange(121))
            step = round(1 / period)
            np.testing.assert_array_equal(exact["true_depth"][0], data["true_depth"][0, ::step])


@pytest.mark.parametrize("period", [0.5, 0.1, 0.3, 1 / 3, 0.02, 10.0, 0.0123, 2**0.5])
def test_sample_times_are_rounded_once(period):
    count = 50_000
    times = sample_times(count, period)
    np.testing.assert_allclose(times, np.arange(count) * period, rtol=1e-15)
    per_second = round(1 / period)
    if abs(per_second * period - 1) < 1e-12:
        np.testing.assert_array_equal(times[::per_second], np.arange(len(times[::per_second])))


def test_an_unstable_run_does_not_stop_the_others():
    stiff = dive(vehicle=VEHICLE.replace(side_force=(-1e5,)))
    results = simulate_many([dive(), dive(**WILD), stiff, dive()])
    assert isinstance(results[1], SimulationUnstable)
    assert results[1].mission == 1
    assert str(results[1]).startswith("mission 1 went unstable")
    assert isinstance(results[2], StepTooLong)
    same(results[0], results[3])


def test_open_ended_mission_stops_when_it_is_flown():
    t = simulate(Scenario(vehicle=VEHICLE, mission=YO))
    assert t["true_depth"].max() == pytest.approx(42, abs=3)
    assert t["true_depth"][-1] < 2.0
    assert t.time[-1] < YO.time_limit_s(VEHICLE)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("duration", None, "give a duration"),
        ("duration", -5.0, "duration -5 s is outside"),
        ("hydrodynamics", "elipsoid", r"unknown hydrodynamics 'elipsoid'.*mean 'ellipsoid'"),
        ("integrator", "rk5", r"unknown integrator 'rk5'.*did you mean 'rk4'"),
    ],
)
def test_impossible_fields_are_refused(field, value, message):
    with pytest.raises(InputError, match=message):
        simulate(dive(**{field: value}))


def test_a_described_scenario_replays_bit_for_bit():
    scenario = Scenario(
        vehicle=VEHICLE.replace(drag=(7.5, 380.0), static_cg=np.array([-0.081, 0.0, 0.003])),
        mission=load_mission("default"),
        duration=200.0,
        current=Uniform(north=0.1, east=0.2),
        density=DensityProfile.thermocline(),
    )
    rebuilt = scenario_from_dict(json.loads(json.dumps(scenario.describe())))
    same(simulate(scenario), simulate(rebuilt))


def test_repeated_forward_does_not_advance_guidance_or_log():
    simulation = Simulation(Scenario(vehicle=VEHICLE, mission=YO, duration=60.0))
    mujoco.mj_step(simulation.model, simulation.data, nstep=11)
    ours = state(simulation.data)
    ticks, logged = float(ours["ticks"]), float(ours["logged"])
    for _ in range(5):
        mujoco.mj_forward(simulation.model, simulation.data)
    # a forward at a new time may begin what is due there, once
    assert ours["ticks"] <= ticks + 1
    assert ours["logged"] <= logged + 1


def test_forward_dynamics_depend_on_the_state_alone():
    """Outside a Simulation nothing is remembered: two ways to a state give one acceleration."""
    model, data = glider()
    set_motion(data, pitch=-0.3, velocity=(0.4, 0, 0.1))
    mujoco.mj_forward(model, data)
    first = data.qacc.copy()
    mujoco.mj_step(model, data, nstep=20)
    fresh = mujoco.MjData(model)
    fresh.qpos[:], fresh.qvel[:], fresh.act[:] = data.qpos, data.qvel, data.act
    mujoco.mj_forward(model, data)
    mujoco.mj_forward(model, fresh)
    np.testing.assert_allclose(data.qacc, fresh.qacc, rtol=1e-12, atol=1e-14)
    assert np.isfinite(first).all()


@pytest.mark.parametrize("name", ["rogue", "glider"])
def test_tumbling_at_up_to_a_metre_per_second_is_stable_at_the_shipped_step(name):
    """ROGUE's rates settle by 150 1/s and more there."""
    rng = np.random.default_rng(1)
    rest = Schedule(times=[0.0], commands=[load_vehicle(name).rest])
    flights, speeds = [], rng.uniform(0.05, 1.0, 30)
    for speed in speeds:
        ahead = rng.normal(size=3)
        start = Start(
            depth=500.0,
            roll=rng.uniform(-3.0, 3.0),
            pitch=rng.uniform(-1.4, 1.4),
            v_rel=tuple(ahead / np.linalg.norm(ahead) * speed),
            rates=tuple(rng.uniform(-1.0, 1.0, 3)),
        )
        flights.append(Scenario(vehicle=name, start=start, mission=rest, duration=30.0))
    for speed, run in zip(speeds, simulate_many(flights), strict=True):
        assert not isinstance(run, SimulationUnstable)
        assert np.linalg.norm(run.v_rel, axis=1).max() <= speed + 0.2


# --- what a pilot is told of a run beside its figures --------------------------------------------


DIVES = Mission(segments=(SawTooth(max_depth_m=20, pitch_deg=30, heading_deg=0, yos=1),))
AWAY = Waypoint(targets=({"north_m": 2000.0, "east_m": 0.0},), max_depth_m=30)


def told(**fields) -> list[str]:
    scenario = Scenario(**fields)
    return remarks(scenario, Simulation(scenario).run())


def test_nothing_is_said_of_a_mission_that_was_flown():
    assert told(mission=DIVES) == []


def test_a_run_that_ends_before_its_target_says_how_far():
    (text,) = told(mission=Mission(segments=(AWAY,)), duration=300.0)
    assert text.startswith("the run ended 1.8")
    assert text.endswith(" km short of target 1 of 1, at 300 s")


def test_a_current_beyond_the_vehicle_comes_before_the_target_that_it_costs():
    stronger, short = told(
        mission=Mission(segments=(AWAY,)), duration=300.0, current=Uniform(north=-2.0)
    )
    assert stronger.startswith("the current of 2.00 m/s is stronger than the vehicle")
    assert "km short of target 1 of 1" in short


@pytest.mark.parametrize(("seconds", "said"), [(400, False), (900, True)])
def test_a_fall_with_stalled_wings_is_told(seconds, said):
    """A fall of 15 minutes with the flow 40 deg from below; one of 7 is an inflection's."""
    scenario = Scenario(mission=DIVES)
    run = Simulation(scenario).run()
    count, period = 2400, run.time[1] - run.time[0]
    run = dataclasses.replace(
        run,
        time=np.arange(count) * period,
        signals={name: np.resize(values, count) for name, values in run.signals.items()},
    )
    run.signals["true_depth"] = np.full(count, 30.0)
    stalled = (run.time >= 100.0) & (run.time <= 100.0 + seconds)
    angle = np.deg2rad(np.where(stalled, -40.0, -3.0))
    run.signals["true_surge"], run.signals["true_heave"] = np.cos(angle), np.sin(angle)
    texts = [text for text in remarks(scenario, run) if "stalled wings" in text]
    assert bool(texts) == said
    if said:
        assert "an angle of attack of 40 deg, for 75% of the run, first at 100 s" in texts[0]


def test_a_dive_beyond_the_largest_depth_is_aborted():
    sinks = Hold(shift_m=0.02, rotation_deg=0, net_mass_kg=0.3, duration_s=600)
    (text,) = told(mission=Mission(segments=(sinks,), max_depth_m=15.0))
    assert text == (
        "the mission was not flown to its end: it went deeper than max_depth_m and climbed to the "
        "surface"
    )


def test_ground_that_is_touched_is_said_with_the_way_out():
    unfinished, text = told(mission=DIVES, floor=FlatFloor(depth_m=12.0))
    assert unfinished.startswith("the mission was not flown to its end: its segments took more")
    assert text.startswith("the vehicle touched the sea floor or an obstacle at ")
    assert "min_altitude_m" in text


def test_a_track_beyond_the_bathymetry_says_when():
    small = GridFloor(north_m=[-5.0, 5.0], east_m=[-5.0, 5.0], depth_m=np.full((2, 2), 200.0))
    (text,) = told(mission=DIVES, floor=small)
    assert text.startswith("the vehicle left the bathymetry's area at ")
    assert text.endswith(" s; from there on the depth at its edge was used")


@pytest.mark.parametrize(
    ("more", "water", "said"),
    [
        (0.1, None, ""),
        (2.0, None, "is 2.00 kg heavy at the surface of this water, and its pump carries 0.25 kg"),
        (-2.0, None, "is 2.00 kg light"),
        (0.0, None, ""),
        (0.0, 1040.0, "is 0.79 kg light"),
    ],
)
def test_a_vehicle_beyond_its_pump_is_told_before_it_flies(more, water, said):
    vehicle = load_vehicle("slocum-200")
    heavy, ballast = weighed(vehicle, mass=vehicle.mass + more)
    column = None
    if water is not None:
        column = DensityProfile(depth=np.array([0.0, 1e3]), values=np.full(2, water))
    told = out_of_trim(heavy, ballast, column)
    assert said in told
    assert bool(told) == bool(said)
    neutral, ballast = weighed(vehicle, mass=vehicle.mass + more, ballast_at=0.0)
    assert out_of_trim(neutral, ballast, column) == ""
