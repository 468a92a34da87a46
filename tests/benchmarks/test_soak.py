"""A soak makes, verifies and removes stores, goes on where it stopped, and reports."""

from __future__ import annotations

import pytest

from benchmarks import soak


def test_it_goes_on_where_it_stopped(tmp_path, capsys):
    out = tmp_path / "soak.jsonl"
    for hours in (1.0, 2.0, 2.0):
        soak.soak(hours, 1.0, "paper", out)
    lines = soak.read(out)
    assert [line["seed"] for line in lines] == [1, 2]
    assert all(line["verified"] == 1.0 and line["missions"] >= 1 for line in lines)
    assert [path.name for path in tmp_path.iterdir()] == ["soak.jsonl"]
    soak.report(lines)
    said = capsys.readouterr().out
    assert "2 of 2" in said
    assert "2 h, " in said
    soak.plan(lines)
    assert "1,000,000 missions of preset paper" in capsys.readouterr().out


def test_a_slope_is_a_change_over_the_range():
    hours = [1.0, 2.0, 3.0, 4.0]
    assert soak.slope(hours, [10.0, 10.0, 10.0, 10.0]) == "+0.0 +- 0.0 %"
    assert soak.slope(hours, [8.0, 9.0, 11.0, 12.0]).startswith("+42.0")


def test_nothing_flown_says_what_to_give():
    with pytest.raises(SystemExit, match="--hours"):
        soak.report([])
