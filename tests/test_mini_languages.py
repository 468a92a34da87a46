"""Mini-languages, settings and files of settings: whatever is given is a value, or one line.

Cases are texts and tables altered at random; FUZZED_CASES=20000 in the environment asks for more.
"""

import contextlib
import json
import math
import os
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from factory.exporting.metadata import parse_metadata
from factory.importing.columns import read_table
from factory.importing.formats.base import sniff
from factory.importing.formats.csv.mapping_file import parse_mapping
from factory.importing.payload import parse_payload
from factory.sampling.distribution import parse_distribution
from factory.sampling.presets import read_changes
from factory.sampling.recipe import Recipe
from glider_twin_ops.forecast import mission_to
from twin.bounded import LONGEST_NAME, compile_pattern
from twin.cli.options import parse_numbers
from twin.errors import CurrentError, InputError, TwinError
from twin.mission.plan import Mission
from twin.mission.slocum_mission import read_slocum
from twin.physics.mujoco_model import compile_model
from twin.records.tracks import read_tracks
from twin.sensors import SensorSuite
from twin.vehicle.presets import apply_preset, asset_path
from twin.vehicle.vehicle import load_vehicle, parse_vehicle
from twin.water.current.base import current_from_dict, parse_current
from twin.water.current.profile import Profile
from twin.water.density import parse_density, read_density_csv
from twin.water.floor.bathymetry import floor_from_dict, parse_floor

CASES = int(os.environ.get("FUZZED_CASES", "40"))
SLOW = {"compiled-vehicle": 0.2}
LONGEST_S = 60.0
"""[s] of the processor that one case may take, with what it compiles"""

NUMBERS = ["0", "-1", "3.5", "1e400", "-1e308", "1e-320", "nan", "-inf", "9" * 400, "0x1", "1_0"]
MARKS = [*"()[]{}<>=:,;+-*/\\\"'#&!|@%$?.~^`\0\n\t \ufeff\u2028é", "\r\n"]
WORDS = [*NUMBERS, *MARKS, "none", "true", "except", "[[", "]]", "<!--", "<![CDATA[", "&#0;", ""]


@st.composite
def mutated(draw, *bases, words=()):
    """One of the texts with some pieces replaced by words, or by random text."""
    text = draw(st.sampled_from(bases))
    piece = st.sampled_from([*words, *WORDS]) | st.text(max_size=8)
    for _ in range(draw(st.integers(0, 4))):
        start = draw(st.integers(0, len(text)))
        length = draw(st.sampled_from([0, 0, 1, 2, 5, 30]))
        text = text[:start] + draw(piece) + text[start + length :]
    return text


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6)
    | st.sampled_from([10**400, "nan", "x", "", "uniform(0, 1)"]),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=4,
)  # fmt: skip
"""What a TOML or JSON file may hold where something else belongs"""


@st.composite
def altered(draw, base):
    """A tree of tables with some values replaced, left out or added."""
    table = json.loads(json.dumps(base))
    for _ in range(draw(st.integers(0, 3))):
        place = table
        while isinstance(place, dict | list) and place:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            key = draw(st.sampled_from(keys))
            inner = place[key]
            if isinstance(inner, dict | list) and inner and draw(st.booleans()):
                place = inner
                continue
            if draw(st.integers(0, 3)) == 0 and isinstance(place, dict):
                place[draw(st.text(max_size=6))] = place.pop(key)
            else:
                place[key] = draw(VALUES)
            break
    return table


def distribution(text):
    """A distribution's text form reads back as itself, and draws what it allows."""
    found = parse_distribution(text, "p")
    assert parse_distribution(found.text(), "p").text() == found.text()
    drawn = found.draw(np.random.default_rng(0))
    assert found.allows(drawn), f"{drawn!r} cannot be drawn"


def current(text):
    found = parse_current(text)
    assert current_from_dict(found.describe()).describe() == found.describe()


def floor(text):
    found = parse_floor(text)
    assert found is None or floor_from_dict(found.describe()) == found


def mission(text):
    found = Mission.from_toml(_file("m.toml", text))
    assert Mission.from_dict(found.to_dict()) == found


def slocum(text):
    reading = read_slocum(_file("m.mi", text))
    assert all("\n" not in note for note in reading.notes)


def profile(text):
    """CSV profiles of density and current."""
    path = _file("d.csv", text)
    try:
        Profile.from_csv(path)
    except CurrentError:
        read_density_csv(path).compile()


def sniffed(data):
    """The kind of log that a file looks like, and its names as each importer asks for them."""
    for name in ("a.csv", "a.csv.gz", "a.dbd", "a.dcd", "a.nc", "a.parquet"):
        with contextlib.suppress(TwinError):
            sniff(_file(name, data))
    read_table(_file("a.csv", data))


def pattern(text):
    """A regular expression of a user, on the longest names that files have."""
    compiled = compile_pattern(text, "p")
    for letter in "a1_":
        compiled.search(letter * LONGEST_NAME)


def parsed(text):
    """A vehicle file, without the memory of those that were read."""
    return parse_vehicle.__wrapped__(text, Path("mine.xml"))


def numbers(text):
    """`twin trim --set`"""
    assert all(math.isfinite(value) for value in parse_numbers("set", (text,), "").values())


MISSION = """name = "mine"
duration_s = 3600
max_depth_m = 250
at_end = "surface"

[[segments]]
kind = "saw-tooth"
max_depth_m = 200
min_depth_m = 10
pitch_deg = 30
yos = 2

[[segments]]
kind = "surface"
duration_s = 300
"""
MAPPING = {
    "vehicle": "auv", "frame": "FRD", "rows": "file", "deployment": "file", "gap_s": 60,
    "time": {"column": "t", "unit": "s", "start_from_name": r"^(\d{8})_"},
    "signals": {
        "measured_depth": {"column": "depth", "unit": "m", "sentinels": [-999]},
        "measured_heading": {"column": "yaw", "unit": "degree", "zero": "east"},
    },
    "ignored": {"spare*": "not used"},
    "corrections": [{"files": "*", "signal": "measured_depth", "reason": "r", "sign": -1}],
}  # fmt: skip
CURRENTS = (
    "uniform:speed=0.3,direction=90", "tide:m2=0.1,s2=0.03,direction=30+none",
    "ekman:tau=0.1,direction=90", "gauss-markov:speed=0.1,std=0.05,seed=1", "profile:x.csv",
    "log-layer:friction=0.01,direction=0,bottom=100", "inertial:speed=0.08,layer=40",
    "geostrophic:surface=0.2,direction=45,scale=800,barotropic=0.05", "grid:x.nc,lat=1,lon=2",
)  # fmt: skip
DISTRIBUTIONS = (
    "uniform(15, 45) except (28, 32) (38, 40)", "loguniform(40, 500)", "normal(0, 0.7)",
    "choice(saw-tooth: 0.7, spiral: 0.3)", "35", "none", "uniform(0,1) except (2,3), (4,5)",
)  # fmt: skip
XML = (asset_path("remus.xml").read_text(encoding="utf-8"),)
TAGS = ("<include file='x.xml'/>", "<replicate count='9999999'>", "<body>", "</body>", "pos=''",
        "name=", "mass='-1'", "mass='nan'", "data='1 2'", "0 0 0", "<geom/>",
        "<joint/>", "general")  # fmt: skip
SLOCUM = """sensor: u_use_current_correction(nodim) 1
behavior: abend
    b_arg: overdepth(m) 180
behavior: surface
    b_arg: start_when(enum) 9
    b_arg: when_secs(s) 3600
    b_arg: c_use_pitch(enum) 3
    b_arg: c_pitch_value(X) 0.4
behavior: goto_list
    b_arg: num_legs_to_run(nodim) -2
    b_arg: wpt_x_0(X) -12221.5
    b_arg: wpt_y_0(X) 3648.5
behavior: yo
    b_arg: d_target_depth(m) 90
    b_arg: c_target_depth(m) 6
    b_arg: d_use_bpump(enum) 2
    b_arg: d_bpump_value(X) -200
"""
START_BYTES = (
    b"", b"dbd_label: a\nnum_sensors: 9\n", b"CDF\x01",
    b"\x89HDF\r\n\x1a\n", b"PK\x03\x04", b"PAR1",
    b"\x1f\x8b\x08", b"a,b\n1,2\n", b"time;lat\n", b"\xef\xbb\xbfa,b\n",
)  # fmt: skip

TARGETS = {
    "distribution": (distribution, mutated(*DISTRIBUTIONS, words=("uniform(", "choice(", "inf"))),
    "current": (current, mutated(*CURRENTS, words=("speed=", "none", "uniform:", "m2="))),
    "density": (parse_density, mutated("usual", "constant", "x.csv", "grid", "thermocline")),
    "floor": (floor, mutated("depth:200", "rough:60,height=3,length=400,seed=1", "G.nc,reach=9")),
    "sensors": (
        SensorSuite.from_settings,
        altered(
            {
                "imu": {"gyro_scale": 1e-3, "misalignment_deg": 0.1},
                "dvl": {"scale": 0.01},
                "encoders": {"resolutions": {"rudder": 0.1}},
                "pressure": {"vehicle_density": 1025},
            }
        ),
    ),
    "mission": (mission, mutated(MISSION, words=("[[segments]]\n", "kind = []", "inf", "[" * 500))),
    "mission-table": (
        Mission.from_dict,
        altered(
            {
                "name": "m",
                "segments": [
                    {"kind": "saw-tooth", "max_depth_m": 100.0, "yos": 2, "heading_deg": 10.0},
                    {"kind": "hold", "parts": {"rudder": 0.1}, "duration_s": 60.0},
                    {
                        "kind": "waypoint",
                        "max_depth_m": 80.0,
                        "targets": [{"latitude": 49.0, "longitude": -16.0}],
                        "surface_at_target": False,
                    },
                ],
            }
        ),
    ),
    "slocum": (
        slocum,
        mutated(SLOCUM, words=("b_arg:", "<start:waypoints>", "behavior: yo", "9e9")),
    ),
    "goto": (
        lambda text: mission_to(
            text, depth=200.0, pitch_deg=26.0, surface_after_s=7200.0, radius=100.0
        ),
        mutated("36.9,-122.5;37,-122.6", words=("nan", "89,0", ";")),
    ),
    "parameters": (
        lambda text: Recipe(
            changes=read_changes(_file("p.toml", text)), vehicle=load_vehicle("glider")
        ),
        mutated('[mission]\npitch_deg = "uniform(15, 35)"\n[current]\nspeed = 0.1\n'),
    ),
    "mapping": (lambda data: parse_mapping(data, "mine.toml"), altered(MAPPING)),
    "tracks": (
        lambda text: read_tracks(_file("t.csv", text), 0),
        mutated("time,north,east,track\n0,1,2,a\n1,2,3,a\n", "time,north,east\n"),
    ),
    "profile": (
        profile,
        mutated(
            "depth,density\n0,1025\n9,1026\n",
            "depth,north,east\n0,0,0\n5,1,1\n",
            "depth,temperature,salinity\n0,10,35\n",
        ),
    ),
    "vehicle": (parsed, mutated(*XML, words=TAGS)),
    "compiled-vehicle": (
        lambda text: compile_model(parsed(text), lean=True),
        mutated(*XML, words=TAGS),
    ),
    "preset": (
        lambda text: apply_preset(text, Path("mine.xml"), "gazebo"),
        mutated(asset_path("tethys.xml").read_text(encoding="utf-8"), words=TAGS),
    ),
    "sniff": (
        sniffed,
        st.builds(bytes.__add__, st.sampled_from(START_BYTES), st.binary(max_size=300)),
    ),
    "metadata": (
        lambda text: parse_metadata(text, "m.yml"),
        mutated(
            "metadata:\n  title: x\n  wmo_id: 1\nglider_devices:\n  ctd:\n    make: m\n",
            words=("&a", "*a", "<<: ", "!!python/object:os.system", "- ", "2022-13-45"),
        ),
    ),
    "payload": (
        lambda text: parse_payload([text]),
        mutated("oxygen=oxy[umol kg-1]", "chlorophyll=x"),
    ),
    "pattern": (pattern, mutated(r"^(\d{8})_", "(a+)+$", "[a-z]*_(.+)", words=("{1,200}", "(?:"))),
    "positions": (numbers, mutated("rudder=0.1,elevator=0", "propeller=60")),
}
"""What is asked: the function that takes a case, and what cases are drawn from"""

_FOLDER = []


@pytest.fixture(autouse=True, scope="module")
def folder(tmp_path_factory):
    _FOLDER[:] = [tmp_path_factory.mktemp("given")]


def _file(name, content):
    path = _FOLDER[0] / name
    data = content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content
    path.write_bytes(data)
    return path


def check(target, case):
    """Run one case; "value" or the name of the `TwinError` that it gave."""
    start = time.process_time()
    try:
        target(case)
        outcome = said = "value"
    except TwinError as error:
        outcome, said = type(error).__name__, str(error)
    assert said.strip(), "an empty message"
    assert len(said) < 2100, f"a message of {len(said)} characters"
    took = time.process_time() - start
    assert took < LONGEST_S, f"it took {took:.1f} s"
    return outcome


@pytest.mark.parametrize("name", list(TARGETS))
def test_a_value_or_one_line(name):
    target, strategy = TARGETS[name]

    @settings(
        max_examples=int(CASES * SLOW.get(name, 1.0)), deadline=None, database=None,
        derandomize=True, suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(strategy)
    def run(case):
        check(target, case)

    run()


@pytest.mark.parametrize(
    ("name", "case"),
    [
        ("mission", MISSION),
        ("mapping", MAPPING),
        ("vehicle", XML[0]),
        ("profile", "depth,density\n0,1025\n9,1026\n"),
        ("distribution", "uniform(0,1) except (0.2,0.3), (0.4,0.5)"),
        ("current", "tide:m2=0.1,s2=0.03,direction=30+none"),
    ],
)
def test_what_is_altered_is_sound_before(name, case):
    assert check(TARGETS[name][0], case) == "value"


def test_other_errors_and_long_messages_are_noticed(monkeypatch):
    def wrong(case):
        raise case

    with pytest.raises(KeyError):
        check(wrong, KeyError("x"))
    with pytest.raises(AssertionError, match="empty"):
        check(wrong, InputError(" "))
    assert check(wrong, InputError("x" * 10**6)) == "InputError"
    monkeypatch.setitem(check.__globals__, "LONGEST_S", -1.0)
    with pytest.raises(AssertionError, match="it took"):
        check(lambda case: None, "")
