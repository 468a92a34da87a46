"""Durations: one way to write them in every option that is a time."""

import dataclasses

import pytest

from factory.commands.generate import Generate
from glider_twin_ops.commands.forecast import ForecastSurfacings
from glider_twin_protocols.serve_command import Serve
from twin.cli.options import duration
from twin.cli.parsing import parse_options
from twin.commands.simulate import Simulate
from twin.errors import InputError


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [("6h", "s", 21600.0), ("90min", "h", 1.5), ("90 MIN", "s", 5400.0), ("2d", "h", 48.0),
     ("12", "h", 12.0), ("1e3", "s", 1000.0), ("0.1", "h", 0.1), (".5h", "min", 30.0)],
)  # fmt: skip
def test_units(text, unit, expected):
    assert duration(text, unit) == expected


@pytest.mark.parametrize("text", ["", "h", "6 weeks", "1h30", "six", "nan", "inf", "1e999h"])
def test_what_is_none_is_refused(text):
    with pytest.raises(InputError, match="is no duration: give a number with s, min, h or d"):
        duration(text, "s")


@pytest.mark.parametrize(
    ("command", "option", "hour", "bare"),
    [(Simulate, "duration", 3600.0, 90.0), (ForecastSurfacings, "hours", 1.0, 90.0),
     (Generate, "hours", 1.0, 90.0)],
)  # fmt: skip
def test_options_take_both(command, option, hour, bare):
    for word, expected in (("60min", hour), ("90", bare)):
        found = parse_options(command, prog="x", words=[f"--{option}", word])
        assert found is not None
        assert dataclasses.asdict(found)[option] == expected
    with pytest.raises(InputError, match=rf"--{option}.*'6 weeks'"):
        parse_options(command, prog="x", words=[f"--{option}", "6 weeks"])


@pytest.mark.parametrize(
    ("command", "words", "told"),
    [
        (Simulate, ["--duration", "6", "weeks"], "--duration: '6 weeks'.*s, min, h or d, .*42d"),
        (Simulate, ["--duration=6", "Hours", "--json"], "--duration: '6 Hours' .*such as 6h"),
        (Generate, ["--hours", "90", "min"], "--hours: '90 min' is no duration: .*such as 90min"),
        (Serve, ["--silence", "2", "s"], "--silence: '2 s' is no duration: .*such as 2s"),
    ],
)
def test_a_unit_that_stands_alone_is_no_mission(command, words, told):
    with pytest.raises(InputError, match=told):
        parse_options(command, prog="x", words=words)


def test_a_mission_may_stand_behind_a_duration():
    for number in ("3600", "6h"):
        found = parse_options(Simulate, prog="x", words=["--duration", number, "transects"])
        assert found is not None
        assert found.mission == "transects"
    # what is no duration's number is left to others
    found = parse_options(Simulate, prog="x", words=["--seed", "6", "weeks"])
    assert found is not None
    assert found.mission == "weeks"
