"""What the benchmark of health counts: alarms in time, days at risk, levels by false alarms."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.command import markdown
from benchmarks.figures import load
from benchmarks.health import (
    OURS,
    Alarms,
    Judged,
    _bound,
    counts,
    interval,
    level_of,
    of_confusion,
    of_probabilities,
    of_vehicles,
    sound_days,
)
from benchmarks.health_learning import fitted_chance, of_chance
from benchmarks.health_real import DRAG, DRIFT, PUMP, TURN, put_in
from glider_twin_ops.health.assessment import flown_signatures
from glider_twin_ops.health.assessment import judged as health
from glider_twin_ops.health.channels import NAMES, NOISE
from glider_twin_ops.health.dive_channels import DiveSignals, strokes_of
from glider_twin_ops.health.signatures import usual_dive
from twin.vehicle.vehicle import load_vehicle

RESULTS = Path(__file__).parents[2] / "docs" / "results"


def judged(statistic, *, onset=None, seen=None, ideal=None, truth="none", kind="", since=None):
    statistic = np.asarray(statistic, float)
    case = {"truth": truth, "vehicle": "glider", "fault": {}}
    alarms = {OURS: Alarms(statistic, kind, (), since)}
    return Judged(case, np.arange(len(statistic)) / 2.0, onset, seen, ideal, alarms)


def test_an_alarm_is_in_time_from_the_onset_to_three_dives_after_it_can_be_seen():
    for at, right in ((4, False), (5, True), (9, True), (10, False)):
        statistic = np.zeros(20)
        statistic[at] = 5.0
        one = judged(statistic, onset=5, seen=6, truth="fouling", kind="fouling", since=7)
        assert one.in_time(OURS, 3.0) is right
        found = counts([one], OURS, 3.0)
        assert found["noticed"] == found["named"] == found["onset"] == (at >= 5)


def test_the_ideal_detector_bounds_what_can_be_in_time():
    """A fault of a standard deviation in one channel is seen in no dive, and in many dives is."""
    vehicle = load_vehicle("slocum-200")
    dive = usual_dive(vehicle)
    (weak,) = (
        one for one in flown_signatures(vehicle, dive).in_dives(np.zeros((60, 2)))
        if one.kind == "hotel_raised"
    )  # fmt: skip
    hotel, rng = NAMES.index("hotel"), np.random.default_rng(3)

    def bound(size, lost=()):
        values = NOISE * rng.standard_normal((60, len(NAMES)))
        values[list(lost), hotel] = math.nan
        one = health(
            "one", range(60), values, 1e4 * np.arange(60.0), np.zeros((60, 2)), dive, vehicle, 0.0
        )
        watts = size * NOISE[hotel] / weak.signature[hotel]
        fault = {"kind": "hotel_raised", "start": 0.0, "watts": float(watts)}
        case = {"fault": fault, "dive": dataclasses.asdict(dive), "ways": np.zeros((60, 2))}
        return _bound(one, case, 20, vehicle)

    assert bound(0.2) == (None, None)
    assert bound(20.0) == (20, 21)  # two dives make an alarm
    assert bound(20.0, range(20, 31)) == (31, 32)  # what is not measured shows nothing
    seen, ideal = bound(2.4)
    assert seen is None
    assert 21 < ideal < 40  # together the dives show it
    found = counts([judged(np.zeros(60), onset=20, seen=20, ideal=24, truth="fouling")], OURS, 3.0)
    assert (found["to be noticed"], found["could be"], found["in time"]) == (1, 0, 0)


def test_days_at_risk_end_with_the_alarm_and_with_the_onset():
    quiet, rung = np.zeros(11), np.zeros(11)
    rung[4] = 5.0
    assert sound_days([judged(quiet), judged(rung)], OURS, 3.0) == (1, 5.0 + 2.0)
    late = judged(rung, onset=3, seen=3, truth="fouling")
    assert sound_days([late], OURS, 3.0) == (0, 1.0)


def test_a_level_has_no_more_false_alarms_than_were_asked():
    rng = np.random.default_rng(2)
    ones = [judged(rng.standard_normal(40)) for _ in range(60)]
    for days in (10.0, 30.0, 100.0):
        level = level_of(ones, OURS, days)
        alarms, at_risk = sound_days(ones, OURS, level)
        assert alarms * days <= at_risk
        more, fewer_days = sound_days(ones, OURS, level - 0.1)
        assert more * days > 0.7 * fewer_days
    assert level_of(ones, OURS, 100.0) > level_of(ones, OURS, 10.0)


def test_an_interval_of_no_alarms_and_of_some():
    low, high = interval(0, 30.0)
    assert low == 0.0
    assert high == pytest.approx(-math.log(0.025))
    low, high = interval(10, 300.0)
    assert (low, high) == pytest.approx((0.480, 1.839), abs=0.001)  # Garwood 1936


def test_tables_are_markdown():
    assert markdown(["a", "b"], [[1, "x"]]) == "| a | b |\n| --- | --- |\n| 1 | x |"
    ones = [
        judged(np.full(9, 4.0), onset=0, seen=0, truth="fouling", kind=kind)
        for kind in ("attached", "fouling", "fouling")
    ]
    assert of_confusion(ones, OURS, 3.0).endswith("| fouling | fouling 2, attached 1 |")
    assert "| all | 0 | 0 | 0 | 0 | 0 | 0 | 0 | 4 | 0 | 0.00 | 0.00 to" in of_vehicles(
        [judged(np.zeros(9))], 3.0
    )


def test_the_rate_of_false_alarms_on_fresh_seeds_is_where_the_page_says():
    """One in 30 days was asked for: no interval lies above it, and the page says what it is."""
    tables = load()["tables"]
    fresh = tables["health.vehicles"]["rows"]
    every = [*fresh, *tables["health.taught"]["rows"]]
    rows = [row[-5:] for row in every if row[0] not in ("vehicle", "all")]
    for days, alarms, rate, low, high in rows:
        found = 30.0 * alarms / days, *interval(int(alarms), days)
        for shown, right in zip((rate, low, high), found, strict=True):
            # days are whole there, and rates have two digits
            assert abs(shown - right) <= 0.0051 + right * 0.51 / days
    assert not [row for row in rows if row[-2] > 1.0]
    days, alarms = (sum(row[k] for row in rows) for k in (0, 1))
    low, high = interval(int(alarms), days)
    said = (RESULTS / "health.md").read_text()
    assert f"{alarms:.0f} in {days:.0f} days, {30.0 * alarms / days:.2f} in 30" in said
    assert f"{low:.2f} to {high:.2f}" in said


def test_probabilities_are_counted_with_the_rate_at_which_faults_begin():
    """Nine deployments of 40 dives with a fault and one without: as once in 200 dives."""

    def one(probability, truth, onset):
        found = judged(np.full(40, 9.0), onset=onset, seen=onset, truth=truth, kind="fouling")
        said = found.alarms[OURS]._replace(probability=probability)
        return found._replace(alarms={OURS: said})

    ones = [*(one(0.7, "fouling", 0) for _ in range(9)), one(0.7, "none", None)]
    (row,) = of_probabilities(ones).splitlines()[2:]
    # 400 dives: two faults are due, each of the nine counts 2 / 9
    assert row == "| 0.6 to 0.8 | 10 | 9 | 0.70 | 0.67 |"


def test_the_chance_is_fitted_to_the_part_of_deployments_whose_fault_is_named():
    rng = np.random.default_rng(1)
    said = rng.uniform(-3.0, 6.0, 6000)
    faulty = rng.random(6000) < 1.0 / (1.0 + np.exp(1.0 - 0.8 * said))
    ones = [
        judged(np.full(2, odds), onset=1 if fault else None, truth="fouling", kind="fouling")
        for odds, fault in zip(said, faulty, strict=True)
    ]
    due = 2.0 * 6000 / 200.0 / np.sum(faulty)  # weight of each with a fault
    level, slope = fitted_chance(ones)
    assert (level, slope) == pytest.approx((math.log(due) - 1.0, 0.8), abs=0.1)
    for row in of_chance(ones).splitlines()[2:-2]:
        _, odds, part, fitted = (float(x) for x in row.split("|")[1:-1])
        assert fitted == pytest.approx(part, abs=0.05)
        assert fitted == pytest.approx(1.0 / (1.0 + np.exp(-level - slope * odds)), abs=0.05)
    # a fault that gets another name is none
    wrong = [judged(one.alarms[OURS].statistic, onset=1, truth="fouling", kind="") for one in ones]
    assert fitted_chance([*ones, *wrong])[0] < level


# --- faults put into the signals of a dive


def a_dive():
    """A dive of 100 m and its climb at 0.2 m/s, a stroke of 20 s at the turn."""
    count = np.arange(250)
    depth = np.interp(count, [0, 125, 249], [0.0, 100.0, 0.8])
    signals = {
        "measured_depth": depth, "measured_heading": np.full(250, 355.0),
        "measured_depth_time": 4.0 * count,
        "measured_pump": np.interp(count, [0, 123, 128, 249], [-200.0, -200.0, 200.0, 200.0]),
    }  # fmt: skip
    return DiveSignals(period=4.0, signals=signals, way=(0.2, 0.1), current=(0.05, -0.02))


def test_more_drag_slows_the_glide_and_not_the_pump():
    before, after = a_dive(), put_in("attached", a_dive(), 1.0)
    rates = [np.gradient(one.signals["measured_depth"], 4.0)[20:100] for one in (before, after)]
    assert rates[1].mean() == pytest.approx(rates[0].mean() / math.sqrt(1.0 + DRAG), rel=0.01)
    strokes = [strokes_of(one.signals["measured_pump"], 4.0) for one in (before, after)]
    assert strokes[1].rate.max() == pytest.approx(strokes[0].rate.max(), rel=0.01)
    assert len(after.signals["measured_depth"]) > 1.1 * len(before.signals["measured_depth"])


def test_a_weak_pump_takes_longer_for_the_same_volume():
    before, after = a_dive(), put_in("pump_weak", a_dive(), 1.0)
    rate = [np.median(s.rate[s.inner]) for one in (before, after)
            for s in [strokes_of(one.signals["measured_pump"], 4.0)]]  # fmt: skip
    assert rate[1] == pytest.approx((1.0 - PUMP) * rate[0], rel=0.05)
    assert after.signals["measured_pump"][-1] == 200.0
    assert after.sampled().all()


def test_a_turned_compass_turns_the_way_and_leaves_the_track():
    before, after = a_dive(), put_in("compass_turned", a_dive(), 1.0)
    assert after.signals["measured_heading"][0] == 355.0 + TURN
    for k in range(2):
        assert before.way[k] + before.current[k] == pytest.approx(after.way[k] + after.current[k])
    turn = np.angle(complex(*after.way) / complex(*before.way))
    assert math.degrees(turn) == pytest.approx(TURN)
    drifted = put_in("pressure_drift", a_dive(), 0.5).signals["measured_depth"]
    assert drifted[7] - before.signals["measured_depth"][7] == pytest.approx(0.99 * DRIFT * 0.5)


# --- The page of real logs says what the benchmark kept


KEPT = json.loads((RESULTS / "health_real.json").read_text())
PAGE = (RESULTS / "health_real.md").read_text()
LOGS, FAULTS = PAGE.split("## Faults put in")


def rows_of(name):
    return [line.split(" | ") for line in LOGS.splitlines() if f" {name} |" in line]


def test_the_page_has_what_was_measured_of_each_log():
    for one in KEPT["logs"]:
        (row,) = (r for r in rows_of(one["deployment"]) if r[0] == f"| {one['log']}")
        assert row[2:4] == [str(one["dives"]), f"{one['judged']} of {one['dives'] - one['masked']}"]
        assert float(row[4]) == one["days"]
        place = 6 if one["vehicle"] == "shipped" else 7
        assert row[place] == ("-" if one["highest"] is None else f"{one['highest']:.1f}")
    judged_days = sum(one["days"] for one in KEPT["logs"]
                      if one["vehicle"] == "shipped" and one["channels"] >= 5)  # fmt: skip
    rang = [one for one in KEPT["logs"] if one["rang"]]
    assert f"{len(rang)} alarm" in LOGS
    assert f"{judged_days:.1f} days" in LOGS


def test_every_fault_that_was_put_in_is_told():
    seen = [one for one in KEPT["faults"] if one["can_be_seen"]]
    right = [one for one in seen if one["rightly"] and one["noticed_after"] is not None]
    assert f"{len(right)} of {len(seen)} are noticed and rightly named" in FAULTS
    assert len(right) >= 0.8 * len(seen)
    shown = {(one["deployment"], one["fault"]): one
             for one in KEPT["faults"] if one["vehicle"] == "shipped"}  # fmt: skip
    for one in seen:  # "with identified ones the same faults are noticed, after as many dives"
        other = shown[one["deployment"], one["fault"]]
        assert one["noticed_after"] == other["noticed_after"]
    for one in shown.values():
        row = (f"| {one['deployment']} | {one['vehicle']} | {one['fault']} | "
               f"{one['deviations']:.1f} |")  # fmt: skip
        (line,) = (text for text in FAULTS.splitlines() if text.startswith(row))
        after, called = (cell.strip() for cell in line.split("|")[5:7])
        assert after == ("no" if one["noticed_after"] is None else str(one["noticed_after"]))
        assert called == one["called"]
