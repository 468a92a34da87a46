"""What the benchmark of health counts: alarms in time, days at risk, levels by false alarms."""

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
    counts,
    interval,
    level_of,
    of_confusion,
    of_vehicles,
    sound_days,
)
from benchmarks.health_real import PUT


def judged(statistic, *, onset=None, seen=None, truth="none", kind="", since=None):
    statistic = np.asarray(statistic, float)
    case = {"truth": truth, "vehicle": "glider", "fault": {}}
    alarms = {OURS: Alarms(statistic, kind, (), since)}
    return Judged(case, np.arange(len(statistic)) / 2.0, onset, seen, alarms)


def test_an_alarm_is_in_time_from_the_onset_to_three_dives_after_it_can_be_seen():
    for at, right in ((4, False), (5, True), (9, True), (10, False)):
        statistic = np.zeros(20)
        statistic[at] = 5.0
        one = judged(statistic, onset=5, seen=6, truth="fouling", kind="fouling", since=7)
        assert one.in_time(OURS, 3.0) is right
        found = counts([one], OURS, 3.0)
        assert found["noticed"] == found["named"] == found["onset"] == (at >= 5)


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
    assert "| all | 0 | 0 | 0 | 0 | 0 | 0 | 4 | 0 | 0.00 | 0.00 to" in of_vehicles(
        [judged(np.zeros(9))], 3.0
    )


def test_the_rate_of_false_alarms_on_fresh_seeds_is_where_the_page_says():
    """One in 30 days was asked for: no interval lies above it, and all together are below."""
    every = load()["tables"]["health.vehicles"]["rows"]
    rows = {row[0]: row[-5:] for row in every if row[0] != "vehicle"}
    for days, alarms, rate, low, high in rows.values():
        every = 30.0 * alarms / days, *interval(int(alarms), days)
        for shown, found in zip((rate, low, high), every, strict=True):
            # days are whole there, and rates have two digits
            assert abs(shown - found) <= 0.0051 + found * 0.51 / days
    assert not [vehicle for vehicle, row in rows.items() if row[-2] > 1.0]
    assert rows["all"][-3] < 1.0


# --- The page of real logs says what the benchmark kept


RESULTS = Path(__file__).parents[2] / "docs" / "results"
KEPT = json.loads((RESULTS / "health_real.json").read_text())
PAGE = (RESULTS / "health_real.md").read_text()
LOGS, FAULTS = PAGE.split("## Faults put in")


def rows_of(name):
    return [line.split(" | ") for line in LOGS.splitlines() if f" {name} |" in line]


def test_odds_and_days_are_those_that_were_measured():
    for one in KEPT["logs"]:
        (row,) = (r for r in rows_of(one["deployment"]) if r[0] == f"| {one['log']}")
        assert row[2] == str(one["dives"])
        assert float(row[3]) == one["days"]
        place = 5 if one["vehicle"] == "shipped" else 6
        assert row[place] == ("-" if one["highest"] is None else f"{one['highest']:.1f}")
    shipped = [one for one in KEPT["logs"] if one["vehicle"] == "shipped"]
    days, alarms = (sum(values) for values in zip(
        *((one["days"], len(one["rang"])) for one in shipped), strict=True
    ))  # fmt: skip
    assert alarms == 3
    assert f"Three alarms of two deployments in {days:.1f} days" in PAGE
    assert f"{30.0 * alarms / days:.1f} in 30 d" in PAGE


def test_every_fault_that_was_put_in_is_told():
    for name in dict.fromkeys(one["deployment"] for one in KEPT["faults"]):
        (line,) = (one for one in FAULTS.splitlines() if one.startswith(f"| {name} |"))
        cells = [cell.strip() for cell in line.split("|")[2:-1]]
        ours = [one for one in KEPT["faults"] if one["deployment"] == name]
        assert len(cells) == len(ours) == len(PUT)
        for cell, one in zip(cells, ours, strict=True):
            after = one["noticed_after"]
            assert cell.split()[0] == ("no" if after is None else str(after))
            assert (one["named"] in cell) == (after is not None and one["named"] != one["fault"])
