"""Every mini-language and reader gives a value or one line, whatever it is given."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings

from benchmarks import fuzz
from twin.errors import InputError

CASES = 40
SLOW = {"compiled-vehicle": 8}


@pytest.mark.parametrize("name", list(fuzz.TARGETS))
def test_a_value_or_one_line(name):
    target, strategy = fuzz.TARGETS[name]

    @settings(
        max_examples=SLOW.get(name, CASES), deadline=None, database=None, derandomize=True,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(strategy)
    def run(case):
        fuzz.check(target, case)

    run()


@pytest.mark.parametrize(
    ("name", "case"),
    [
        ("mission", fuzz.MISSION),
        ("mapping", fuzz.MAPPING),
        ("vehicle", fuzz.XML[0]),
        ("profile", "depth,density\n0,1025\n9,1026\n"),
        ("distribution", "uniform(0,1) except (0.2,0.3), (0.4,0.5)"),
        ("current", "tide:m2=0.1,s2=0.03,direction=30+none"),
    ],
)
def test_what_is_altered_is_sound_before(name, case):
    assert fuzz.check(fuzz.TARGETS[name][0], case) == "value"


def test_other_errors_and_long_messages_are_findings():
    def wrong(case):
        raise case

    with pytest.raises(KeyError):
        fuzz.check(wrong, KeyError("x"))
    with pytest.raises(AssertionError, match="empty"):
        fuzz.check(wrong, InputError(" "))
    assert fuzz.check(wrong, InputError("x" * 10**6)) == "InputError"


def test_a_case_that_takes_long_is_a_finding(monkeypatch):
    monkeypatch.setattr(fuzz, "LONGEST_S", 0.0)
    with pytest.raises(AssertionError, match="it took"):
        fuzz.check(lambda case: None, "")
