"""Sources of a deployment's files: which belong together, and what else comes with them."""

import datetime
import re

import pytest
from examples import ROOT

from glider_twin_ops.watching import SOURCES, Source, WatchedDeployment
from glider_twin_ops.watching.dialogues import read_calls
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
