"""Dialogues of a Slocum at the surface, as a dockserver keeps them."""

import datetime
from types import SimpleNamespace

import pytest

from glider_twin_ops.pages import summary
from glider_twin_ops.watching import one_pass
from glider_twin_ops.watching.dialogues import read_dialogues
from glider_twin_ops.watching.sources import newest_dialogue

TEXT = """
Connection Event: Carrier Detect found.
Vehicle Name: calypso
Curr Time: Sat Mar 28 20:40:38 2026 MT:  169339
DR  Location:  3310.021 N -11741.800 E measured     60.812 secs ago
GPS TooFar:   69696969.000 N 69696969.000 E measured     1e+308 secs ago
GPS Invalid :  3310.066 N -11741.666 E measured    154.415 secs ago
GPS Location:  3310.021 N -11741.800 E measured     38.0 secs ago
   sensor:c_autoballast_state(enum)=5              1e+308 secs ago
   sensor:m_battery(volts)=15.2327964879377         51.99 secs ago
   sensor:m_vacuum(inHg)=7.89                       2.000 secs ago
Because:Hit a waypoint [behavior surface_3 start_when = 8.0]
ABORT HISTORY: total since reset: 2
"""


def written(path, text):
    path.write_bytes(text.encode() + b"\xff\x00 noise of a line\r\n")
    return path


def test_the_last_surfacing_is_told(tmp_path):
    later = TEXT.replace("20:40:38", "20:42:38").replace("7.89", "7.5")
    path = written(tmp_path / "calypso_20260328.log", TEXT + later)
    assert len(read_dialogues([path, tmp_path / "gone.log"])) == 2
    found = newest_dialogue("slocum", tmp_path, recursive=False)
    assert found.vehicle == "calypso"
    assert found.fix == pytest.approx((33.0 + 10.021 / 60.0, -(117.0 + 41.8 / 60.0)))
    clock = datetime.datetime(2026, 3, 28, 20, 42, 38, tzinfo=datetime.UTC).timestamp()
    assert (found.time, found.fix_time) == (clock, clock - 38.0)
    assert found.sensors == {"m_battery": (15.2327964879377, "volts"), "m_vacuum": (7.5, "inHg")}
    assert (found.why[:14], found.aborts) == ("Hit a waypoint", 2)
    moment = datetime.datetime(2026, 3, 28, 20, 41, tzinfo=datetime.UTC)
    early = newest_dialogue("", tmp_path, recursive=False, until=moment)
    assert early.sensors["m_vacuum"][0] == 7.89


@pytest.mark.parametrize(
    ("was", "becomes", "fix"),
    [
        ("GPS Location:  3310.021 N", "GPS Location:  69696969.000 N", None),
        ("38.0 secs", "1e+308 secs", None),
        ("-11741.800 E measured     38", "garbled E measured     38", None),
    ],
)
def test_what_is_no_fix_is_none(tmp_path, was, becomes, fix):
    assert was in TEXT
    (found,) = read_dialogues([written(tmp_path / "a.log", TEXT.replace(was, becomes))])
    assert found.fix is fix


def test_half_a_dialogue_and_other_logs_say_nothing(tmp_path):
    half = written(tmp_path / "half.log", TEXT[: TEXT.index("Curr Time")])
    other = written(tmp_path / "syslog.log", "Vehicle Name: x\nCurr Time: yesterday\n")
    hidden = written(tmp_path / ".part.log", TEXT)
    assert read_dialogues([half, other]) == []
    assert len(read_dialogues([hidden])) == 1
    assert newest_dialogue("slocum", tmp_path, recursive=True) is None


def test_a_page_has_the_dialogue_before_any_data_arrives(watched, source):
    made = watched(vehicle="slocum-200")
    assert one_pass(made).changed
    written(source / "calypso.log", TEXT)
    passed = one_pass(made)
    assert passed.changed
    assert "33.1670, -117.6967" in summary(passed.told, [])
    assert "2 aborts since its reset" in summary(passed.told, [])
    page = passed.page.read_text()
    assert "Said at its last surfacing" in page
    assert "7.89 inHg" in page
    assert not one_pass(made).changed
    early = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)
    past = one_pass(made, until=early)
    assert "Said at" not in past.page.read_text()


def test_the_mail_of_a_watch_is_lines_that_can_be_read():
    marks = "\x1b]0;owned\x07\x9b2J\u202e"
    said = SimpleNamespace(
        verdict=f"attention{marks}\nall is well", dives=(), legs=(), last_fix=None, dialogue=None,
        surfacings=None, used=None, missing=[f"file{marks}.dbd: cut"], deployment="x",
    )  # fmt: skip
    text = summary(said, [f"new: {marks}"])
    assert all(one.isprintable() or one == "\n" for one in text)
    first, *others = text.splitlines()
    assert first == "attention\\x1b]0;owned\\x07\\x9b2J\\u202e all is well"
    assert len(others) == 2
