"""What a pilot changes, what drove a vehicle and alarms that end are told for what they are."""

import dataclasses
import math

import numpy as np
import pytest

import twin
from glider_twin_ops.health import CHANNELS, DeploymentHealth, KindVerdict
from glider_twin_ops.health.assessment import flown_signatures
from glider_twin_ops.health.channels import (
    NAMES,
    NOISE,
    ORDERED,
    PLACE,
    groups_of,
    ordered_steps,
)
from glider_twin_ops.health.deployment_dives import changes_of
from glider_twin_ops.health.dive_channels import DiveSignals, channels_of, flight_model
from glider_twin_ops.health.judgement import follow, rings
from glider_twin_ops.health.remarks import ballast_remarks, remarks_of
from glider_twin_ops.health.signatures import usual_dive
from twin.vehicle import Consumption

DIVES = 20


def dive(depth=100.0, pitch=26.0, pump=200.0, **more):
    """A saw tooth without noise."""
    z = np.concatenate([np.linspace(0.0, depth, 200), np.linspace(depth, 0.0, 200)])
    down = np.arange(400) < 200
    signals = {
        "measured_depth": z,
        "measured_pitch": np.where(down, -pitch, pitch),
        "measured_pump": np.where(down, -pump, pump),
        "measured_vacuum": np.where(z < 5.0, 3e4, 2.5e4),
    }
    return DiveSignals(period=4.0, signals=signals, **more)


def test_a_change_of_the_dive_counts_by_depth_pitch_and_volume():
    found = np.abs(changes_of(
        [dive(), dive(102.0), dive(300.0), dive(300.0, 32.0), dive(300.0, 32.0, 150)]
    ))  # fmt: skip
    assert not found[0].any()
    assert found[1].max() < 1.0
    # depth; pitches; volumes, each in its own columns
    changed = [np.flatnonzero(row > 1.0).tolist() for row in found[2:]]
    assert changed == [[0], [1, 3], [2, 4]]
    assert groups_of(found)[2:].nonzero()[1].tolist() == [0, 1, 2]


def test_what_changed_over_a_test_dive_counts_after_it():
    dives = [dive(), dive(10.0, test=True), dive(10.0, powered=True), dive(102.0)]
    found = np.abs(changes_of(dives))
    assert found[1, 0] > 1.0
    assert found[3].max() < 1.0


def test_a_level_may_step_where_the_dive_was_changed_and_nowhere_else(noise):
    seen = noise()
    seen[10:] += 3.0 * NOISE
    changes = np.zeros((DIVES, 5))
    changes[10, 0] = -4.0
    same, changed = follow(seen), follow(seen, ordered_steps(changes))
    assert np.array_equal(same.innovation[1:10], changed.innovation[1:10])
    ratio = np.sqrt(changed.expected[10] / same.expected[10])
    assert ratio == pytest.approx(np.full(len(NAMES), 3.0 * ORDERED), rel=0.5)
    assert np.abs(changed.innovation[10:]).mean() < 0.6 * np.abs(same.innovation[10:]).mean()


def test_a_thruster_hides_the_glide_but_not_the_hull():
    calibration = flight_model(twin.load_vehicle("slocum-200"))
    told, driven = (channels_of(dive(powered=powered), calibration) for powered in (False, True))
    assert np.isfinite(told[PLACE["rate_dive"]])
    assert np.isnan(driven[[PLACE[n] for n in ("rate_dive", "trim_climb", "hotel")]]).all()
    assert driven[PLACE["air"]] == told[PLACE["air"]]
    # the bladder of the surface is no leak
    assert told[PLACE["air"]] == pytest.approx(math.log((101_325.0 - 2.5e4) / 283.15))


def test_a_pump_works_against_the_sea_and_the_vacuum_inside():
    """100 cm3 at 100 m against 1 MPa and 50 kPa are 105 J; 210 J are twice that."""
    volume = np.clip(np.arange(150.0) - 20.0, 0.0, 100.0)
    stroke = np.diff(volume, prepend=0.0) > 0.0
    signals = {
        "measured_depth": np.full(150, 100.0),
        "measured_pump": volume,
        "measured_vacuum": np.full(150, 5e4),
        "measured_pump_power": np.where(stroke, 2.1, 0.0),
    }
    found = channels_of(DiveSignals(period=1.0, signals=signals), None)
    assert found[PLACE["pump_work"]] == pytest.approx(math.log(2.0))
    assert found[PLACE["pump_rate"]] == pytest.approx(0.0)  # 1 cm3/s


def test_a_pump_is_judged_by_its_files_energy_at_any_depth():
    """A loss of the motor at any depth would look like a weaker pump in shallow dives."""
    vehicle = twin.load_vehicle("slocum-1000")
    losses = Consumption.of(vehicle)
    assert losses.pump_loss > 0.0
    volume = np.clip(np.arange(150.0) - 20.0, 0.0, 100.0)
    stroke = np.diff(volume, prepend=0.0) > 0.0

    def work(depth, spent=1.0, lost=()):
        pressure = (1e4 * depth + 3e4) / losses.pump_efficiency + losses.pump_loss
        power = np.where(stroke, spent * 1e-6 * pressure, 0.0)
        signals = {
            "measured_depth": np.full(150, depth), "measured_pump": volume,
            "measured_pump_power": power, "measured_depth_time": np.arange(150.0),
        }  # fmt: skip
        for sample in lost:  # what the importer interpolates is no stroke
            signals["measured_depth_time"][sample] += 100.0
            signals["measured_pump_power"][sample] = 0.0
        return channels_of(DiveSignals(period=1.0, signals=signals), flight_model(vehicle))[
            PLACE["pump_work"]
        ]

    assert [work(50.0), work(400.0), work(900.0)] == pytest.approx([0.0] * 3, abs=1e-9)
    assert work(400.0, lost=range(30, 40)) == pytest.approx(0.0, abs=1e-9)
    assert work(400.0, spent=1.25) == pytest.approx(math.log(1.25))


def electric(moving, load, seed=0):
    """Dive of 500 samples whose electronics take 20 mA; drives move in a part of the samples, and a
    pump takes `load` [A] in 30; the battery has 0.4 Ohm."""
    rng = np.random.default_rng(seed)
    amperes = 0.02 + 0.06 * (rng.random(500) < moving)
    amperes[100:130] += load
    volts = 15.0 - 0.4 * amperes + 0.01 * rng.standard_normal(500)
    signals = {
        "measured_depth": np.full(500, 50.0), "measured_voltage": volts,
        "measured_battery_current": amperes + 0.001 * rng.standard_normal(500),
    }  # fmt: skip
    found = channels_of(DiveSignals(period=4.0, signals=signals), None)
    return found[[PLACE["hotel"], PLACE["resistance"]]]


def test_drives_that_move_in_most_samples_are_no_electronics():
    for moving in (0.0, 0.3, 0.7):
        assert electric(moving, 2.0)[0] == pytest.approx(0.02 * 15.0, rel=0.1)


def test_a_battery_has_a_resistance_where_the_pump_draws_enough():
    assert electric(0.0, 2.0)[1] == pytest.approx(math.log(0.4), abs=0.05)
    assert math.isnan(electric(0.0, 0.12)[1])


def test_of_a_dive_that_lost_most_samples_the_hull_is_judged_alone():
    whole = dive()
    count = len(whole.signals["measured_depth"])
    time = whole.period * np.arange(count)
    for part, judged in ((0.3, True), (0.7, False)):
        lost = np.where(np.arange(count) < part * count, time + 500.0, time)
        signals = {**whole.signals, "measured_depth_time": lost}
        one = dataclasses.replace(whole, signals=signals)
        found = channels_of(one, flight_model(twin.load_vehicle("slocum-200")))
        assert one.masked is not judged
        assert np.isfinite(one.settings()[0]) == judged
        assert np.isfinite(found[PLACE["rate_climb"]]) == judged
        assert np.isfinite(found[PLACE["air"]])


def test_a_weight_that_the_file_lacks_is_said_in_grams():
    assert ballast_remarks(0.02) == ()
    (heavy,), (light,) = ballast_remarks(0.131), ballast_remarks(-0.05)
    assert "131 g heavier in this water than its file says" in heavy
    assert "50 g lighter" in light


def test_an_alarm_stands_until_no_fault_is_as_likely():
    odds = np.array([-5.0, 4.0, 2.0, 4.0, 3.5, 1.0, -0.5, 2.0, -0.5, -0.5, 3.5, 3.5])
    assert rings(odds, 3.0) == [(4, 8), (11, 11)]
    assert rings(np.array([-math.inf, 1.0]), 3.0) == []
    # a level below even odds does not make it flap
    assert rings(np.array([-1.0, -1.0, -1.5, -2.0, -2.5, -2.5]), -1.2) == [(1, 4)]


def test_a_fault_that_stays_is_an_alarm_that_stands(slocum, noise):
    seen, fault = noise(), slocum.fault("attached")
    seen[12:] += np.nan_to_num(fault.signature) * fault.scale
    one = slocum.judge(seen)
    assert (one.alarm, one.kind) == (True, "attached")
    assert one.since_dive in (13, 14)
    assert one.rang == ((one.noticed_dive, DIVES),)
    assert one.since_dive <= one.noticed_dive <= one.since_dive + 2
    assert one.describe()["rang"] == [[one.noticed_dive, DIVES]]
    assert all(kind.kind not in kind.also for kind in one.kinds)
    assert one.describe()["also"] == list(one.kinds[0].also)


def test_nothing_rings_on_a_sound_vehicle(slocum, noise):
    one = slocum.judge(noise())
    assert (one.alarm, one.kind, one.rang, one.noticed_dive) == (False, "none", (), None)
    assert one.verdict().startswith(f"one: nothing wrong in {DIVES} dives")


def test_what_the_log_cannot_show_is_not_weighed(slocum, noise):
    seen = noise()
    seen[:, PLACE["lock"]] = math.nan  # it has no Doppler log
    every, some = ({k.kind for k in slocum.judge(told).kinds} for told in (noise(), seen))
    assert every - some == {"dvl_beam"}
    # and a compass shows by fixes alone
    assert "compass_iron" not in some


@pytest.mark.parametrize(
    ("untold", "lacking"),
    [
        (("temperature_lag",), ()),
        (("temperature_lag", "cell_lag"), ("temperature_lag", "cell_lag")),
        (("cell_lag",), ("cell_lag",)),
    ],
)
def test_a_log_lacks_what_it_tells_neither_so_nor_otherwise(slocum, noise, untold, lacking):
    seen = noise()
    seen[:, [PLACE[name] for name in untold]] = math.nan
    assert slocum.judge(seen, ways=0.2).lacking == lacking


def test_what_shows_in_a_loud_channel_comes_first(slocum, noise):
    quiet, loud, air = noise(), noise(), PLACE["air"]
    loud[-1, air] += 0.5  # a hundred times its noise, in the last dive alone
    one, before = (slocum.judge(told, threshold=30.0) for told in (loud, quiet))
    assert not one.alarm
    tell = {
        h.kind
        for h in slocum.signatures.hypotheses
        if np.nan_to_num(np.abs(np.atleast_2d(h.signature)[:, air])).max() * h.scale > NOISE[air]
    }
    shows = [kind.kind in tell for kind in one.kinds]
    assert 0 < sum(shows) < len(shows)
    assert shows == sorted(shows, reverse=True)
    parts = [[k.probability for k in one.kinds if (k.kind in tell) == part] for part in (0, 1)]
    for told in (*parts, [k.probability for k in before.kinds]):  # each the likeliest first
        assert told == sorted(told, reverse=True)


def test_remarks_name_thruster_rudder_and_the_pilots_changes(slocum, noise):
    seen, changes = noise(), np.zeros((DIVES, 5))
    seen[:, PLACE["turn_dive"]], seen[:, PLACE["turn_climb"]] = -14.0, -11.0
    changes[[3, 4, 9], [0, 1, 4]] = 2.0
    powered = [d >= 18 for d in range(DIVES)]
    tests = [d < 2 for d in range(DIVES)]
    thruster, tested, leaning, changed = remarks_of(
        range(DIVES), seen, changes, powered, tests, slocum.vehicle
    )
    assert tested.endswith("judged: dives 0 to 1.")
    assert "thruster drove dives 18 to 19" in thruster
    assert "rudder at -14 degrees in dives and -11 in climbs" in leaning
    assert "dives 3 to 4, 9:" in changed
    assert remarks_of(range(DIVES), noise(), np.zeros((DIVES, 5)), [], [], slocum.vehicle) == ()


def test_signatures_are_of_the_water_that_the_vehicle_is_ballasted_for(slocum):
    shape = usual_dive(slocum.vehicle, depth=40.0)
    ocean, brackish = (
        next(h for h in flown_signatures(v, shape).hypotheses if h.kind == "attached").signature
        for v in (slocum.vehicle, slocum.vehicle.replace(reference_density=1005.0))
    )
    place = PLACE["rate_climb"]
    assert ocean[place] < -0.1
    assert brackish[place] == pytest.approx(ocean[place], rel=0.1)


# --- verdicts -------------------------------------------------------------------------------------


def deployment(values, **settings):
    """Of dives with these channels, four days, without an alarm."""
    kind = KindVerdict(
        kind="leak", says="water in the hull", probability=0.9, since_dive=2, size=0.1,
        size_deviation=0.02, unit="kg", dives=(2,), channels=(), also=(), otherwise="",
        find_out="",
    )  # fmt: skip
    usual = {
        "name": "unit1", "days": 4.0, "dives": tuple(range(len(values))), "kinds": (kind,),
        "evidence": np.zeros(1), "threshold": 5.0, "levels": follow(values), "values": values,
        "time": np.zeros(1), "lacking": (), "remarks": (),
    }  # fmt: skip
    return DeploymentHealth(**usual | settings)


def loud(noise):
    values = noise(0, 40)
    values[-1, 3] += 40.0 * NOISE[3]
    return values


def test_a_verdict_says_by_how_few_channels_it_is(noise):
    values, names = noise(0, 40), NAMES[2:]
    assert deployment(values).verdict().endswith("dives, 4.0 d")
    few = deployment(values, lacking=names).verdict()
    assert few.endswith(f"4.0 d, judged by 2 of {len(NAMES)} channels only")
    said = deployment(loud(noise)).verdict()
    assert "unit1: no alarm in" in said
    assert f"; look at dive 39: {CHANNELS[3].name} was " in said
    said = deployment(values, evidence=np.append(np.full(39, -9.0), 6.0)).verdict()
    assert said.startswith("unit1: no alarm in")
    assert said.endswith("; dive 39 alone would be an alarm: the next one decides")


def test_an_alarm_says_since_when_a_thruster_drove_it(noise):
    called = {"alarm": True, "kind": "leak", "since_dive": 2, "noticed_dive": 2}
    health = deployment(noise(0, 4), dives=(1, 2, 3, 4), probability=0.9, **called)
    assert "thruster" not in health.verdict()
    driven = dataclasses.replace(health, driven=(1, 3, 4))
    assert driven.verdict().endswith("a thruster drove it after dive 2: hardly judged since")
    assert "thruster" not in dataclasses.replace(health, driven=(1, 3)).verdict()


def test_a_channel_far_off_its_level_in_the_last_dive_is_told(slocum, noise):
    (said,) = slocum.judge(loud(noise)).remarks
    assert said.startswith(f"In dive 40 {CHANNELS[3].name} was ")
    assert slocum.judge(noise(0, 40)).remarks == ()
