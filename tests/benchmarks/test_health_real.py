"""The page of real logs says what the benchmark kept."""

import json
from pathlib import Path

from benchmarks.health_real import PUT

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
