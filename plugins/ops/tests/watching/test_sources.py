"""Sources of a deployment's files: which belong together, and what vehicles say at the surface."""

import datetime
import re
from types import SimpleNamespace

import pytest
from examples import ROOT

from glider_twin_ops.pages import summary
from glider_twin_ops.watching import SOURCES, Source, WatchedDeployment, one_pass
from glider_twin_ops.watching.dialogues import read_calls, read_dialogues
from glider_twin_ops.watching.sources import newest_dialogue, source_of
from twin.errors import InputError

CALLS = """Connected at 2026-02-16T19:30:00Z (sg272)
logged in
61:0:1:0:2:96:0:232:2039:491:-45.2:1.26:8.1:15.00:14.98:8.27:54.0:9.7:32.2:24.8 \
GPS,160226,192609,4723.391,-12613.988,22,0.9,22,15.6
EOP_CODE=NO_VERTICAL_VELOCITY
RECOV_CODE=QUIT_COMMAND
ver=67.01,rev=7361M,frag=8,launch=020226:205935
61:0:1:0:2:96:1 logout
Disconnected at 2026-02-16T19:33:00Z (normal)


Connected at Wed Feb 18 02:00:00 UTC 2026
logged in
62:0:1:0:2:96:0:232:2026:491:-55.9:0.99:15.00:15.00:8.28:53.9 GPS,180226,013639,4724.892,-12610.597
EOP_CODE=CONTROL_FINISHED_OK
Disconnected at Wed Feb 18 02:03:00 UTC 2026
Connected at 2026-02-18T08:00:00Z (sg272)
"""


@pytest.mark.parametrize(
    ("address", "kind", "name"),
    [
        ("from-glider", "", "slocum"),
        ("from-glider", "seaglider", "seaglider"),
        ("from-glider", "ngdac", "netcdf"),
        ("from-glider", "mine", "tables"),
        ("https://data.example.org/erddap/tabledap/calypso", "", "erddap"),
    ],
)
def test_an_address_and_a_kind_of_log_choose_the_source(address, kind, name):
    assert source_of(address, kind).name == name


@pytest.mark.parametrize(
    ("source", "kind", "message"),
    [
        ("ftp://x/y", "auto", "no address that is known: a tabledap data set"),
        ("https://x/erddap/tabledap/y", "slocum", "brings logs of the kind csv, not slocum"),
    ],
)
def test_what_no_source_brings_is_refused(tmp_path, source, kind, message):
    with pytest.raises(InputError, match=message):
        WatchedDeployment(folder=tmp_path, source=source, kind=kind)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"says": ""}, "says is empty"),
        ({"dialogues": ".+"}, "dialogues and read_dialogues belong together"),
        ({"address": "(", "fetch": "x:y"}, "address is no pattern"),
    ],
)
def test_half_a_source_is_refused(fields, message):
    whole = {"name": "mine", "says": "x", "logs": ("csv",)}
    with pytest.raises(InputError, match=message):
        Source(**(whole | fields))


def test_the_page_s_own_source_is_known_by_its_kind_of_log():
    page = (ROOT / "docs" / "howto" / "watch.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    try:
        exec(block, {})
        assert source_of("from-glider", "buoys").joins
    finally:
        SOURCES.unregister("buoys")
    assert source_of("from-glider", "buoys").name == "tables"


# --- calls of a Seaglider -----------------------------------------------------------------------


@pytest.fixture
def calls(tmp_path):
    """Reads the calls after something in them has become another."""

    def read(was="", becomes=""):
        assert was in CALLS
        (tmp_path / "comm.log").write_text(CALLS.replace(was, becomes) if was else CALLS)
        return read_calls([tmp_path / "comm.log", tmp_path / "gone.log"])

    return read


def test_every_call_of_a_seaglider_is_read(calls):
    first, second = calls()
    assert (first.vehicle, second.vehicle) == ("sg272", "sg272")
    assert first.fix == pytest.approx((47.0 + 23.391 / 60.0, -(126.0 + 13.988 / 60.0)))
    clock = datetime.datetime(2026, 2, 16, 19, 26, 9, tzinfo=datetime.UTC).timestamp()
    assert (first.fix_time, first.time) == (clock, clock + 231.0)
    said = {"dive": (61.0, ""), "battery_24V": (14.98, "V"), "internal_pressure": (8.27, "psi"),
            "humidity": (54.0, "%")}  # fmt: skip
    assert first.sensors | said == first.sensors
    assert first.why == "dive ended by NO_VERTICAL_VELOCITY, stays up by QUIT_COMMAND"
    assert second.why == ""
    assert second.sensors["battery_10V"] == (15.0, "V")
    assert second.sensors["humidity"] == (53.9, "%")


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        ("GPS,160226,192609,4723.391", "GPS,160226,192609,9923.391"),
        ("GPS,160226,192609", "GPS,169926,192609"),
        (" GPS,160226,192609,4723.391,-12613.988,22,0.9,22,15.6", ""),
        (",-12613.988,22,0.9,", ",-12613.988,22,99.0,"),  # the receiver's word for none
    ],
)
def test_a_call_without_a_fix_has_its_counters(calls, was, becomes):
    first = calls(was, becomes)[0]
    assert first.fix is None
    assert first.sensors["dive"] == (61.0, "")


def test_a_clock_in_another_zone_counts_by_its_fix(calls):
    first = calls("2026-02-16T19:30:00Z", "Mon Feb 16 11:30:00 PST 2026")[0]
    assert first.time == first.fix_time


def test_half_a_call_says_nothing_and_the_newest_counts(tmp_path):
    (tmp_path / "comm.log").write_text(CALLS)
    assert newest_dialogue("seaglider", tmp_path, recursive=False).sensors["dive"] == (62.0, "")
    (tmp_path / "comm.log").write_text(CALLS[: CALLS.index("61:0")])
    assert newest_dialogue("seaglider", tmp_path, recursive=False) is None


# --- a Slocum's console, as a dockserver keeps it -------------------------------------------------

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
        surfacings=None, used=None, arrival=None, health=None, readings=(),
        missing=[f"file{marks}.dbd: cut"], deployment="x",
    )  # fmt: skip
    text = summary(said, [f"new: {marks}"])
    assert all(one.isprintable() or one == "\n" for one in text)
    first, *others = text.splitlines()
    assert first == "attention\\x1b]0;owned\\x07\\x9b2J\\u202e all is well"
    assert len(others) == 2
