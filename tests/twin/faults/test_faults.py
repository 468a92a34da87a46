"""Every fault changes a vehicle from its time on, alike in both engines."""

import json

import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.faults import FAULTS, Condition, condition_at, faults_of, parse_faults
from twin.faults.instruments import lagged
from twin.physics.condition import healthy
from twin.physics.scenario import scenario_from_dict
from twin.physics.simulation import Simulation

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


def test_a_lost_port_wing_rolls_it_to_port_in_climbs_and_starboard_is_its_mirror():
    rolls = {}
    for side in ("port", "starboard"):
        fault = FAULTS["wing_lost"](start=0.0, side=side)
        flown = twin.simulate(scenario("slocum-200", fault, duration=1800.0))
        deep = flown["true_depth"] > 20.0
        climbing = deep & (flown["true_velocity_down"] < -0.05)
        diving = deep & (flown["true_velocity_down"] > 0.05)
        rolls[side] = np.median(flown["true_roll"][climbing]), np.median(flown["true_roll"][diving])
    assert abs(rolls["port"][0]) > 3.0
    assert abs(rolls["port"][0] - rolls["port"][1]) > 3.0  # as both gliders of the source
    assert rolls["starboard"] == pytest.approx([-roll for roll in rolls["port"]], abs=0.2)


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
