"""Files for vehicles: Slocum arguments and Seaglider targets are read back as what was written."""

import dataclasses
import math
import re

import netCDF4
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logs import SHARED
from pyarrow import parquet

from glider_twin_ops.files import (
    commanded,
    commands_of,
    commands_text,
    read_commands,
    read_science,
    read_targets,
    science_text,
    sparser,
    targets_of,
    targets_text,
)
from twin import Mission, SawTooth, Waypoint, load_vehicle
from twin.errors import MissionError
from twin.mission import degrees, degrees_minutes, read_slocum, slocum_arguments

PLACES = (
    {"latitude": 48.123456, "longitude": -51.987654},
    {"latitude": -0.00001, "longitude": 179.99999},
    {"latitude": 47.999999, "longitude": -0.5},
)
SEGMENT = Waypoint(
    targets=PLACES,
    max_depth_m=180.0,
    min_depth_m=12.0,
    pitch_deg=26.0,
    climb_pitch_deg=24.0,
    net_mass_kg=0.2,
    surface_after_s=7200.0,
    stay_s=420.0,
    arrival_radius_m=250.0,
    min_altitude_m=15.0,
)


def mission(**changes):
    return Mission(name="goto", segments=(dataclasses.replace(SEGMENT, **changes),))


MISSION = mission()
FLIES = """
behavior: surface
    b_arg: args_from_file(enum) 7
behavior: goto_list
    b_arg: args_from_file(enum) 7
behavior: yo
    b_arg: args_from_file(enum) 7
"""


def test_slocum_arguments_are_read_back_as_the_mission(tmp_path):
    files = slocum_arguments(MISSION, number=7)
    assert list(files) == ["goto_l07.ma", "yo07.ma", "surfac07.ma"]
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "mine.mi").write_text(FLIES)
    reading = read_slocum(tmp_path / "mine.mi", above_floor=True)
    (segment,) = reading.mission.segments
    for name in (
        "max_depth_m", "min_depth_m", "pitch_deg", "climb_pitch_deg", "net_mass_kg", "stay_s",
        "surface_after_s", "arrival_radius_m", "min_altitude_m",
    ):  # fmt: skip
        assert getattr(segment, name) == pytest.approx(getattr(SEGMENT, name), rel=1e-4), name
    assert len(segment.targets) == len(PLACES)
    for read, written in zip(segment.targets, PLACES, strict=True):
        for axis in ("latitude", "longitude"):
            assert read[axis] == pytest.approx(written[axis], abs=1e-6)  # 0.1 m
    assert not any("not understood" in note or "left out" in note for note in reading.notes)


def test_a_slocum_is_told_to_dive_nose_down_and_heavy_and_to_climb_nose_up_and_light():
    files = slocum_arguments(MISSION)
    told = dict(re.findall(r"b_arg: (\w+)\(\w+\) +(\S+)", files["yo10.ma"]))
    assert float(told["d_pitch_value"]) == pytest.approx(-math.radians(26.0), abs=1e-4)
    assert float(told["c_pitch_value"]) == pytest.approx(math.radians(24.0), abs=1e-4)
    assert float(told["d_bpump_value"]) < 0.0 < float(told["c_bpump_value"])
    surfaces = dict(re.findall(r"b_arg: (\w+)\(\w+\) +(\S+)", files["surfac10.ma"]))
    assert float(surfaces["c_pitch_value"]) == pytest.approx(math.radians(24.0), abs=1e-4)


@pytest.mark.skipif(not SHARED.is_dir(), reason="no real logs in ../shared/data")
def test_a_real_slocum_dives_with_the_signs_that_it_is_told():
    columns = ["m_depth", "c_pitch", "m_pitch", "c_ballast_pumped"]
    log = SHARED / "slocum_unit334_2023" / "unit334_flight.parquet"
    table = parquet.read_table(log, columns=columns)
    depth, *others = (table[name].to_numpy() for name in columns)
    rate = np.gradient(depth)
    files = slocum_arguments(MISSION)
    told = dict(re.findall(r"b_arg: (\w+)\(\w+\) +(\S+)", files["yo10.ma"]))
    for letter, moving in (("d", rate > 0.5), ("c", rate < -0.5)):
        for values, name in zip(others, ("pitch", "pitch", "bpump"), strict=True):
            real = float(np.nanmedian(values[moving]))
            assert real * float(told[f"{letter}_{name}_value"]) > 0.0


def test_places_are_degrees_and_minutes_south_and_west_negative():
    places = ({"latitude": 49.5, "longitude": -58.25}, {"latitude": -0.75, "longitude": 10.0})
    texts = slocum_arguments(mission(targets=places))["goto_l10.ma"].splitlines()
    start = texts.index("# longitude latitude") + 1
    assert texts[start : start + 2] == ["-5815.0000 4930.0000", "1000.0000 -45.0000"]
    first, second = targets_text(targets_of(mission(targets=places))).splitlines()
    assert first == "T1 lat=4930.0000 lon=-5815.0000 radius=250 goto=T2"
    assert second == "T2 lat=-45.0000 lon=1000.0000 radius=250 goto=T2"


def test_a_dive_turns_above_the_floor_where_nobody_says_how_far():
    open_ended = mission(min_altitude_m=None, net_mass_kg=None)
    text = slocum_arguments(open_ended)["yo10.ma"]
    assert "d_target_altitude(m) 20\n" in text
    assert "bpump" not in text


@given(st.floats(-180.0, 180.0))
def test_coordinates_keep_their_place_and_have_no_sixty_minutes(value):
    text = degrees_minutes(value)
    assert degrees("test", text) == pytest.approx(value, abs=1e-6)


def test_seaglider_targets_are_read_back(tmp_path):
    targets = targets_of(MISSION)
    assert [one.goto for one in targets] == ["T2", "T3", "T3"]
    (tmp_path / "targets").write_text("/ mine\n" + targets_text(targets))
    read = read_targets(tmp_path / "targets")
    for back, one in zip(read, targets, strict=True):
        assert (back.name, back.goto, back.radius_m) == (one.name, one.goto, 250.0)
        assert back.latitude == pytest.approx(one.latitude, abs=1e-6)
        assert back.longitude == pytest.approx(one.longitude, abs=1e-6)


def test_targets_as_people_write_them(tmp_path):
    path = tmp_path / "targets"
    path.write_text("A lat= 4807.0 lon=-12223.0 radius=200 goto=B\nB radius=1 goto=B lat=1 lon=2\n")
    first, second = read_targets(path)
    assert first.latitude == pytest.approx(48 + 7 / 60)
    assert first.longitude == pytest.approx(-(122 + 23 / 60))
    assert second.latitude == pytest.approx(1 / 60)


def test_missions_that_such_files_cannot_say():
    down = Mission(name="down", segments=(SawTooth(max_depth_m=50.0, yos=1),))
    with pytest.raises(MissionError, match="one segment of waypoints"):
        slocum_arguments(down)
    with pytest.raises(MissionError, match="latitude and longitude"):
        targets_of(mission(targets=({"north_m": 10.0, "east_m": 0.0},)))
    with pytest.raises(MissionError, match="leave surface_after_yos out"):
        slocum_arguments(mission(surface_after_yos=2.0))
    with pytest.raises(MissionError, match="0 to 99"):
        slocum_arguments(MISSION, number=100)


# --- a Seaglider's commands and science -------------------------------------------------------

GLIDE = {"climb_pitch_deg": None, "max_depth_m": 990.0, "pitch_deg": 20.0}
OLD = "/ shallow first\n200 5 111 60\n1000 30 101 120\n"
NEW = "200 seconds=5 sensors=111 gc=60 profile=b\nloiter seconds=30 sensors=101 gc=120\n"


@pytest.mark.parametrize(("pitch", "mass"), [(14.0, 0.1), (20.0, 0.2), (40.0, 0.05)])
def test_a_seaglider_s_commands_are_read_back_as_the_dive(tmp_path, pitch, mass):
    vehicle = load_vehicle("seaglider")
    goto = mission(**GLIDE | {"pitch_deg": pitch, "net_mass_kg": mass})
    (tmp_path / "cmdfile").write_text("/ mine\n" + commands_text(commands_of(goto, vehicle)))
    (tmp_path / "targets").write_text(targets_text(targets_of(goto)))
    commands = read_commands(tmp_path / "cmdfile")
    targets = read_targets(tmp_path / "targets")
    (read,) = commanded(commands, targets, vehicle).segments
    assert read.max_depth_m == 990.0
    assert read.pitch_deg == pytest.approx(pitch, abs=0.3)  # $T_DIVE is in whole minutes
    assert read.net_mass_kg == pytest.approx(mass, rel=1e-3)
    assert (read.surface_after_yos, read.arrival_radius_m) == (1.0, 250.0)
    assert read.surface_after_s == pytest.approx(90.0 * commands["T_DIVE"] + 600.0, abs=30.0)
    assert read.targets[0]["latitude"] == pytest.approx(PLACES[0]["latitude"], abs=1e-6)
    slow = commands | {"T_DIVE": 1.3 * commands["T_DIVE"]}
    (flatter,) = commanded(slow, targets, vehicle).segments
    assert flatter.pitch_deg < pitch


def test_a_seaglider_s_commands_are_positive_for_a_heavy_dive():
    said = commands_of(mission(**GLIDE), load_vehicle("seaglider"))
    assert said["MAX_BUOY"] == pytest.approx(1e3 * SEGMENT.net_mass_kg)
    assert min(said.values()) > 0.0
    assert GLIDE["pitch_deg"] < said["GLIDE_SLOPE"] < GLIDE["pitch_deg"] + 10.0


REAL = SHARED / "seaglider_apl_basestation3" / "p2490010.nc"


@pytest.mark.skipif(not REAL.is_file(), reason=f"no real dive {REAL}")
def test_a_real_seaglider_was_told_with_these_signs():
    said = commands_of(mission(**GLIDE), load_vehicle("seaglider"))
    with netCDF4.Dataset(REAL) as file:
        for name, value in said.items():
            assert float(file[f"log_{name}"][...]) * value > 0.0, name
        text = str(netCDF4.chartostring(file["log_TGT_LATLONG"][:]))
        fixed = float(file["log_gps_lon"][0])
    latitude, longitude = (degrees("test", word) for word in text.split(","))
    assert latitude == pytest.approx(47.0)
    assert longitude * fixed > 0.0  # both west


def test_dives_that_commands_cannot_say():
    vehicle = load_vehicle("seaglider")
    with pytest.raises(MissionError, match="leave climb_pitch_deg out"):
        commands_of(mission(**GLIDE | {"climb_pitch_deg": 30.0}), vehicle)
    commands = commands_of(mission(**GLIDE), vehicle)
    targets = targets_of(MISSION)
    with pytest.raises(MissionError, match="steeper than \\$GLIDE_SLOPE"):
        commanded(commands | {"T_DIVE": 0.5 * commands["T_DIVE"]}, targets, vehicle)
    del commands["T_DIVE"]
    with pytest.raises(MissionError, match="has no \\$T_DIVE"):
        commanded(commands, targets, vehicle)
    far = [dataclasses.replace(targets[0], radius_m=900.0), *targets[1:]]
    with pytest.raises(MissionError, match="radii 250, 900"):
        commanded(commands | {"T_DIVE": 300.0}, far, vehicle)


@pytest.mark.parametrize("text", [OLD, NEW])
def test_science_is_read_and_made_sparser(tmp_path, text):
    path = tmp_path / "science"
    path.write_text(text)
    layers = read_science(path)
    assert [(one.seconds, one.sensors, one.gc) for one in layers] == [
        (5.0, "111", "60"), (30.0, "101", "120"),
    ]  # fmt: skip
    assert science_text(layers) == text.partition("first\n")[2] or science_text(layers) == text
    path.write_text(science_text(sparser(layers, 0.5)))
    assert [one.seconds for one in read_science(path)] == [10.0, 60.0]
    assert [one.more for one in read_science(path)] == [one.more for one in layers]


PLACE = "A lat=4807.0 lon=-12223.0 radius=200"


@pytest.mark.parametrize(
    ("read", "text", "message"),
    [
        (read_targets, "", "has no target"),
        (read_targets, f"{PLACE} goto=B", "A goes to B, which is not in it"),
        (read_targets, PLACE, "line 1: A has no goto="),
        (read_targets, f"{PLACE} goto=A".replace("07.0", "61.0"), "61 minutes"),
        (read_targets, f"{PLACE} goto=A".replace("200", "far"), "radius=far must be metres"),
        (read_targets, f"{PLACE} goto=A colour=red", "'colour' is not one of .*, goto$"),
        *(
            (read_targets, f"{PLACE} goto=A {key}=A", f"line 1: '{key}' .* leave it out")
            for key in ("escape", "depth", "finish", "timeout")
        ),
        (read_targets, f"{PLACE} goto=A".replace("48", "91"), "is no place"),
        (read_commands, "$D_TGT,990\n", "no directive"),
        (read_commands, "$D_TGT,deep\n$GO\n", "line 1: \\$D_TGT,deep must be a number"),
        (read_commands, "$D_TGT,2000\n$GO\n", "within 0 to 1100"),
        (read_commands, "$T_DIVE,60.5\n$GO\n", "a whole number within 5 to 2880"),
        (read_commands, "D_TGT 990\n$GO\n", "is no \\$NAME,VALUE"),
        (read_science, "/ nothing\n", "has no layer"),
        (read_science, "200 5 111\n", "is no DEPTH SECONDS SENSORS GC"),
        (read_science, "deep 5 111 60\n", "depth 'deep' must be a number"),
        (read_science, "200 5 1x1 60\n", "a digit for each"),
        (read_science, "200 seconds=5 gc=60\n", "sensors= is missing"),
        (read_science, "200 5 111 60\n100 5 111 60\n", "depths must grow"),
    ],
)
def test_files_that_cannot_be_used(tmp_path, read, text, message):
    (tmp_path / "file").write_text(text)
    with pytest.raises(MissionError, match=message):
        read(tmp_path / "file")


def test_hardly_any_samples_are_refused(tmp_path):
    (tmp_path / "science").write_text(OLD)
    with pytest.raises(MissionError, match=r"0.01 of the samples: take a part from 0.05 to 4"):
        sparser(read_science(tmp_path / "science"), 0.01)
