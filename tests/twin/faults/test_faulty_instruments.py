"""A fault of an instrument turns the vehicle that flies by it; the log shows it, the truth not."""

import dataclasses
import math

import numpy as np
import pytest

import twin
from twin.faults import FAULTS
from twin.faults.instruments import CTD, lagged
from twin.mission.controller import MissionController
from twin.mission.segments.base import surfaced_depth
from twin.navigation.settings import Navigation
from twin.sensors import SensorSuite
from twin.sensors.live import LiveSuite

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
