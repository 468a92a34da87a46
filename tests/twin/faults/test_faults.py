"""Every fault acts from its time on, alike in both engines; instruments err in the log."""

import dataclasses
import json
import math

import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.faults import FAULTS, Condition, condition_at, faults_of, parse_faults
from twin.faults.instruments import CTD, lagged
from twin.mission.controller import MissionController
from twin.mission.segments.base import surfaced_depth
from twin.navigation.settings import Navigation
from twin.physics.condition import healthy
from twin.physics.scenario import scenario_from_dict
from twin.physics.simulation import Simulation
from twin.sensors import SensorSuite
from twin.sensors.live import LiveSuite

PLAN = "section"
BEGINS = 300.0


def scenario(name, *faults, engine="lanes", duration=900.0):
    return twin.Scenario(
        vehicle=twin.load_vehicle(name), mission=twin.load_mission(PLAN), duration=duration,
        engine=engine, faults=faults,
    )  # fmt: skip


@pytest.mark.parametrize("kind", list(FAULTS))
def test_a_kind_says_what_a_pilot_needs(kind):
    fault = FAULTS[kind]()
    for text in (fault.says, fault.source, fault.shows, fault.otherwise, fault.find_out):
        assert text == text.strip()
        assert len(text) > 8
    low, high = fault.sizes
    assert 0.0 < low <= high
    assert type(fault).of_size(high, 5.0).at(4.0) == 0.0


@pytest.mark.parametrize("name", ["glider", "slocum-200", "seaglider", "tethys"])
def test_every_kind_of_a_vehicle_makes_a_vehicle(name):
    vehicle = twin.load_vehicle(name)
    sound = healthy(scenario(name))
    for kind in faults_of(vehicle):
        for choice in FAULTS[kind]().choices(vehicle):
            fault = FAULTS[kind].of_size(FAULTS[kind].sizes[1], **choice)
            changed = condition_at([fault], sound, 86400.0)
            assert isinstance(changed, Condition)
            assert json.loads(json.dumps(fault.describe()))["kind"] == kind


def test_a_blade_is_lost_by_what_has_blades():
    tethys, slocum = (faults_of(twin.load_vehicle(name)) for name in ("tethys", "slocum-200"))
    assert "blade_lost" in tethys
    assert "blade_lost" not in slocum
    assert "wing_lost" not in tethys


@pytest.mark.parametrize(
    "kind", ["wing_lost", "attached", "pump_air", "turn_slips", "pitch_slips", "compass_iron"]
)
def test_both_engines_fly_it_alike(kind):
    fault = FAULTS[kind](start=BEGINS)
    flown = [twin.simulate(scenario("slocum-200", fault, engine=e)) for e in ("mujoco", "lanes")]
    sound = twin.simulate(scenario("slocum-200"))
    for name, near in (("true_depth", 0.2), ("true_roll", 0.5), ("true_heading", 0.5)):
        apart = flown[0][name] - flown[1][name]
        if name == "true_heading":
            apart = (apart + 180.0) % 360.0 - 180.0
        assert np.abs(apart).max() < near, name
    before = sound.time < BEGINS - 1.0
    assert np.array_equal(flown[1]["true_depth"][before], sound["true_depth"][before])
    changes = [
        np.abs(flown[1][name] - sound[name]).max() / least
        for name, least in (("true_depth", 0.5), ("true_roll", 0.2), ("true_heading", 1.0))
    ]
    assert max(changes) > 1.0


def test_water_taken_sinks_it_by_its_weight():
    sound = healthy(scenario("glider"))
    changed = condition_at([FAULTS["water_taken"](per_day=0.5)], sound, 86400.0)
    density = sound.vehicle.reference_density
    assert changed.vehicle.mass - sound.vehicle.mass == pytest.approx(0.5e-3 * density, rel=1e-2)
    assert changed.volume == sound.volume


def test_a_mass_that_is_added_and_taken_away_leaves_the_vehicle_as_it_was():
    sound = healthy(scenario("glider"))
    place = (0.3, 0.1, 0.05)
    back = sound.with_mass(2.0, place).with_mass(-2.0, place)
    assert back.vehicle.static_mass == pytest.approx(sound.vehicle.static_mass)
    np.testing.assert_allclose(back.vehicle.static_cg, sound.vehicle.static_cg, atol=1e-12)
    np.testing.assert_allclose(back.vehicle.static_inertia, sound.vehicle.static_inertia, atol=1e-9)


def test_growth_is_a_table_over_time():
    fault = FAULTS["fouling"](per_day=0.5, start=3600.0)
    assert fault.at([0.0, 3599.0]).tolist() == [0.0, 0.0]
    assert fault.at(3600.0 + 86400.0) == pytest.approx(0.5)


def test_a_run_that_is_reset_flies_the_same_again():
    run = Simulation(scenario("glider", FAULTS["wing_lost"](start=BEGINS), engine="mujoco"))
    first = run.run()
    run.reset()
    again = run.run()
    assert np.array_equal(first["true_roll"], again["true_roll"])
    assert np.abs(first["true_roll"]).max() > 3.0


def test_a_scenario_keeps_its_faults():
    one = scenario("glider", *parse_faults(["fouling:per_day=0.1,from=10min", "wing_lost"]))
    again = scenario_from_dict(json.loads(json.dumps(one.describe())))
    assert again.faults == one.faults
    assert "faults" not in scenario("glider").describe()


def test_words():
    (fault,) = parse_faults("wing_lost:side=starboard,part=0.5,from=3d")
    assert (fault.side, fault.part, fault.start) == ("starboard", 0.5, 3 * 86400.0)
    for word, message in {
        "wing": "wing_lost",
        "fouling:per_dya=1": "^fault 'fouling': unknown setting 'per_dya': did you mean 'per_day'",
        "fouling:per_day": "NAME=VALUE",
        "fouling:per_day=much": "a number",
        "fouling:from=3weeks": "unit of time",
        "wing_lost:side=left": "port",
        "pump_weak:loss=2": "between 0 and 1",
    }.items():
        with pytest.raises(InputError, match=message):
            parse_faults(word)


def test_what_nothing_shows_is_refused():
    with pytest.raises(InputError, match="give sensors"):
        twin.simulate(mission=PLAN, duration=60.0, faults="hotel_raised")
    with pytest.raises(InputError, match="is no glider"):
        twin.simulate(vehicle="tethys", faults="wing_lost")


def test_sensors_read_what_the_fault_makes_of_it():
    sound, wrong = (
        twin.simulate(scenario("slocum-200", *faults, duration=300.0), sensors="ideal")
        for faults in ((), parse_faults("pressure_drift:per_day=86.4"))
    )
    grown = (wrong["measured_pressure"] - sound["measured_pressure"])[-1]
    assert grown == pytest.approx(86.4 * 300.0 / 86400.0, rel=0.01)


def test_an_instrument_is_late_from_its_onset_on_and_right_before():
    ramp = 0.1 * np.arange(400.0)
    ramp[7] = np.nan
    lag = np.where(np.arange(400) < 200, 0.0, 40.0)
    shown = lagged(ramp, lag, 4.0)
    np.testing.assert_array_equal(shown[:200], ramp[:200])
    # after many time constants a ramp is late by the lag, less the half sample of a step
    assert ramp[-1] - shown[-1] == pytest.approx(0.1 * 40.0 / 4.0, rel=0.06)
    assert shown[200] == pytest.approx(ramp[199], abs=0.02)
    np.testing.assert_array_equal(lagged(ramp, np.zeros(400), 4.0), ramp)


# --- instruments: the log shows it, the truth not -------------------------------------------------


WAYS = ("mujoco", "lanes", "navigated")
DAY = 86400.0
IRON = 20.0


def saw_tooth(**settings):
    usual = {"max_depth_m": 50.0, "min_depth_m": 12.0, "pitch_deg": 26.0, "yos": 1}
    return twin.Mission(name="plan", segments=[twin.SawTooth(**{**usual, **settings})])


def flown(way, mission, *faults, **others):
    """A flight with exact sensors, by one engine or by what is known on board."""
    navigated = way == "navigated"
    scenario = twin.Scenario(
        vehicle=twin.load_vehicle("glider"), mission=mission, faults=faults,
        engine="mujoco" if navigated else way,
        navigate=Navigation(estimator="ekf", sensors="ideal") if navigated else None, **others,
    )  # fmt: skip
    return twin.simulate(scenario, sensors=None if navigated else "ideal")


def turned(angles):
    """Angles [degree] within half a turn."""
    return (np.asarray(angles) + 180.0) % 360.0 - 180.0


def course(run):
    """Course through the still water [degree] of the second half of the run."""
    half = len(run.time) // 2
    north, east = (run[n][-1] - run[n][half] for n in ("true_north", "true_east"))
    return math.degrees(math.atan2(east, north))


def steered(heading, toward):
    """True heading [degree] at which a compass with the iron reads a wanted one."""
    true = heading
    for _ in range(100):
        true = heading - IRON * math.sin(math.radians(true - toward))
    return true


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("heading", "toward"), [(0.0, -90.0), (90.0, 180.0), (200.0, 110.0)])
def test_a_compass_that_reads_too_much_turns_the_track_to_port(way, heading, toward):
    plan = saw_tooth(max_depth_m=100.0, heading_deg=heading)
    plan = dataclasses.replace(plan, start_heading_deg=heading)
    fault = FAULTS["compass_iron"](degrees=IRON, toward=toward)
    sound, wrong = (flown(way, plan, *faults, duration=900.0) for faults in ((), (fault,)))
    off = turned(steered(heading, toward) - heading)
    assert abs(off) > 15.0
    # by the sine of the heading: port where it reads too much, starboard where too little
    assert np.sign(off) == -np.sign(math.sin(math.radians(heading - toward)))
    assert turned(course(wrong) - course(sound)) == pytest.approx(off, abs=1.5)
    reads = wrong["true_heading"] + IRON * np.sin(np.deg2rad(wrong["true_heading"] - toward))
    np.testing.assert_allclose(turned(wrong["measured_heading"] - reads), 0.0, atol=1e-6)
    late = wrong.time > 600.0
    assert np.median(turned(wrong["measured_heading"][late] - heading)) == pytest.approx(0, abs=1.5)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("degrees", [12.0, -25.0])
def test_a_compass_turned_as_a_whole_turns_the_track_as_much_the_other_way(way, degrees):
    """The heading that it reads is held, so that the vehicle flies `degrees` to port of it."""
    plan = saw_tooth(max_depth_m=100.0, heading_deg=70.0)
    plan = dataclasses.replace(plan, start_heading_deg=70.0)
    fault = FAULTS["compass_turned"](degrees=degrees)
    sound, wrong = (flown(way, plan, *faults, duration=900.0) for faults in ((), (fault,)))
    assert turned(course(wrong) - course(sound)) == pytest.approx(-degrees, abs=1.5)
    reads = turned(wrong["measured_heading"] - wrong["true_heading"])
    np.testing.assert_allclose(reads, degrees, atol=1e-6)
    late = wrong.time > 600.0
    assert np.median(turned(wrong["measured_heading"][late] - 70.0)) == pytest.approx(0, abs=1.5)


def test_a_compass_that_was_off_before_is_off_by_both():
    """An offset of the scenario's own stays under a fault of another kind, and adds to a turn."""
    plan = saw_tooth(max_depth_m=100.0, heading_deg=70.0)
    plan = dataclasses.replace(plan, start_heading_deg=70.0)
    own = {"compass_offset": math.radians(10.0), "duration": 900.0}
    courses = [
        course(flown("lanes", plan, *faults, **own))
        for faults in ((), (FAULTS["hotel_raised"](start=300.0),),
                       (FAULTS["compass_turned"](degrees=20.0, start=300.0),))
    ]  # fmt: skip
    assert courses[1] == courses[0]
    assert turned(courses[2] - courses[0]) == pytest.approx(-20.0, abs=1.5)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("dbar", [5.0, -5.0])
def test_a_gauge_that_reads_too_deep_turns_it_as_much_higher(way, dbar):
    fault = FAULTS["pressure_drift"](per_day=dbar / 10.0, start=-10.0 * DAY)
    plan = saw_tooth(yos=1.5)
    sound, wrong = (flown(way, plan, *faults) for faults in ((), (fault,)))
    metres = 0.99 * dbar
    for run, off in ((sound, 0.0), (wrong, metres)):
        gap = run["measured_depth"] - run["true_depth"]
        np.testing.assert_allclose(gap, off, atol=0.02 * abs(off) + 1e-9)
    lower, upper = zip(*(turns(run["true_depth"]) for run in (sound, wrong)), strict=True)
    assert lower[1] - lower[0] == pytest.approx(-metres, abs=0.4)
    assert upper[1] - upper[0] == pytest.approx(-metres, abs=0.4)


def turns(depth):
    """Depths [m] of the lowest turn, and of the one between two dives."""
    climbing = depth[np.argmax(depth > 40.0) :]
    climbing = climbing[np.argmax(climbing < 30.0) :]
    return depth.max(), climbing[: np.argmax(climbing > 40.0)].min()


@pytest.mark.parametrize("way", WAYS)
def test_a_gauge_that_never_reads_the_surface_does_not_keep_it_there(way):
    fault = FAULTS["pressure_drift"](per_day=2.0, start=-10.0 * DAY)
    (deep,), (shallow,) = saw_tooth(yos=2).segments, saw_tooth(max_depth_m=40.0).segments
    segments = [deep, twin.Surface(duration_s=60.0), shallow]
    plan = twin.Mission(name="plan", at_end="surface", segments=segments)
    run = flown(way, plan, fault)
    depth = run["true_depth"]
    below = depth > 10.0
    assert np.count_nonzero(np.diff(below.astype(int)) == 1) == 3
    assert depth.max() == pytest.approx(30.2, abs=1.0)
    assert depth[-1] <= surfaced_depth(twin.load_vehicle("glider"))
    assert run.time[-1] < 0.9 * plan.time_limit_s(twin.load_vehicle("glider"))


@pytest.mark.parametrize("way", WAYS)
def test_a_blind_altimeter_does_not_turn_it_above_the_floor(way):
    plan = saw_tooth(max_depth_m=56.0, min_altitude_m=25.0)
    floor = twin.parse_floor("depth:60")
    sound, half, blind = (
        flown(way, plan, *faults, floor=floor)["true_depth"].max()
        for faults in ((), *((FAULTS["altimeter_blind"](part=part),) for part in (0.5, 1.0)))
    )
    assert sound == pytest.approx(35.0, abs=1.5)
    assert 0.0 <= half - sound < 3.0  # an echo now and then is enough
    assert blind == pytest.approx(56.0, abs=1.5)


def test_an_altimeter_that_goes_blind_holds_its_last_echo_for_a_while():
    plan = saw_tooth(max_depth_m=56.0, min_altitude_m=25.0, yos=9)
    floor, begin = twin.parse_floor("depth:60"), 700.0
    fault = FAULTS["altimeter_blind"](part=1.0, start=begin)
    sound, wrong = (
        flown("lanes", plan, *faults, floor=floor, duration=1500.0) for faults in ((), (fault,))
    )
    before = sound.time < begin
    assert np.array_equal(wrong["true_depth"][before], sound["true_depth"][before])
    assert sound["true_depth"].max() < 37.0
    assert wrong["true_depth"].max() > 54.0


@pytest.mark.parametrize(
    "fault",
    [
        FAULTS["compass_iron"](degrees=IRON, toward=-90.0),
        FAULTS["compass_turned"](degrees=IRON),
        FAULTS["pressure_drift"](per_day=1.0, start=-10.0 * DAY),
    ],
    ids=lambda fault: fault.kind,
)
def test_a_controller_in_python_sees_it_too(fault):
    plan = saw_tooth(heading_deg=0.0)
    vehicle = twin.load_vehicle("glider")
    natively = flown("mujoco", plan, fault, duration=900.0)
    scenario = twin.Scenario(vehicle=vehicle, faults=(fault,), duration=900.0, start=twin.Start(
        depth=natively["true_depth"][0]
    ))  # fmt: skip
    by_hand = twin.simulate(scenario, controller=MissionController(plan, vehicle))
    np.testing.assert_allclose(by_hand["true_depth"], natively["true_depth"], atol=0.3)
    np.testing.assert_allclose(
        turned(by_hand["true_heading"] - natively["true_heading"]), 0.0, atol=1.0
    )


def test_the_track_on_board_is_that_of_the_compass_as_it_reads():
    plan = saw_tooth(max_depth_m=100.0, heading_deg=0.0)
    fault = FAULTS["compass_iron"](degrees=IRON, toward=-90.0)
    run = flown("lanes", plan, fault, duration=900.0)
    half = len(run.time) // 2
    moved = [run[f"measured_onboard_{n}"][-1] - run[f"measured_onboard_{n}"][half]
             for n in ("north", "east")]  # fmt: skip
    believed = math.degrees(math.atan2(moved[1], moved[0]))
    assert believed == pytest.approx(0.0, abs=3.0)
    assert course(run) == pytest.approx(steered(0.0, -90.0), abs=3.0)


def test_under_way_an_instrument_is_as_late_as_in_a_whole_log():
    rng = np.random.default_rng(3)
    n = 300
    signals = dict(zip(CTD, (10.0 + rng.random(n), 3.5 + 0.1 * rng.random(n),
                               np.linspace(5.0, 80.0, n)), strict=True))  # fmt: skip
    fault = FAULTS["thermistor_slow"](lag=15.0, start=400.0)
    size = fault.at(4.0 * np.arange(n))
    whole = fault.readings(signals, size, 4.0, rng)
    begun = fault.begin()
    for k in range(n):
        one = {name: values[k : k + 1] for name, values in signals.items()}
        found = begun.readings(one, size[k : k + 1], 4.0, rng)
        for name, values in found.items():
            assert values[0] == pytest.approx(whole[name][k], rel=1e-12), (name, k)
    assert np.array_equal(
        whole["measured_temperature"], lagged(signals["measured_temperature"], size, 4.0)
    )


def test_live_readings_of_a_doppler_log_keep_their_faults_when_they_come_late():
    run = twin.simulate(mission="section", duration=400.0)
    truth = {n: np.array(run[n]) for n in run if n.startswith(("true_", "commanded_"))}
    n, seed = len(run.time), np.random.SeedSequence(4)
    fault = FAULTS["dvl_beam"](part=0.5, start=100.0)

    def live(faults):
        return LiveSuite(SensorSuite(), truth, n, dt=0.5, rng_seed=seed, faults=faults)

    sound, wrong, again = live(()), live((fault,)), live((fault,))
    for k in range(n):
        sample = {name: values[k] for name, values in truth.items()}
        sound.step(sample)
        wrong.step(sample)
        if k == n // 2:
            again.restore(wrong.state())
        if k > n // 2:
            again.step(sample)
        if k % 100 == 0:
            wrong.measured()  # looks alone
    was, now = sound.measured(), wrong.measured()
    before = 0.5 * np.arange(n) < 100.0
    lost = np.isnan(now["measured_dvl_surge"]) & np.isfinite(was["measured_dvl_surge"])
    assert not lost[before].any()
    had = np.isfinite(was["measured_dvl_surge"]) & ~before
    assert np.mean(lost[had]) == pytest.approx(0.5, abs=0.1)
    for name, values in again.measured().items():
        np.testing.assert_array_equal(values, now[name], err_msg=name)
