"""Files for vehicles: Slocum arguments and Seaglider targets are read back as what was written."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.errors import MissionError
from twin.mission import (
    Mission,
    SawTooth,
    Waypoint,
    read_targets,
    slocum_arguments,
    targets_of,
    targets_text,
)
from twin.mission.slocum_arguments import degrees_minutes
from twin.mission.slocum_behavior import degrees
from twin.mission.slocum_mission import read_slocum

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
MISSION = Mission(name="goto", segments=(SEGMENT,))
FLIES = """
behavior: surface
    b_arg: args_from_file(enum) 7
behavior: goto_list
    b_arg: args_from_file(enum) 7
behavior: yo
    b_arg: args_from_file(enum) 7
"""


def test_slocum_arguments_are_read_back_as_the_mission(tmp_path: Path) -> None:
    files = slocum_arguments(MISSION, number=7)
    assert list(files) == ["goto_l07.ma", "yo07.ma", "surfac07.ma"]
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "mine.mi").write_text(FLIES)
    reading = read_slocum(tmp_path / "mine.mi", above_floor=True)
    (segment,) = reading.mission.segments
    assert isinstance(segment, Waypoint)
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


def test_a_dive_turns_above_the_floor_where_nobody_says_how_far() -> None:
    open_ended = dataclasses.replace(SEGMENT, min_altitude_m=None, net_mass_kg=None)
    text = slocum_arguments(Mission(name="goto", segments=(open_ended,)))["yo10.ma"]
    assert "d_target_altitude(m) 20\n" in text
    assert "bpump" not in text


@given(st.floats(-180.0, 180.0))
def test_coordinates_keep_their_place_and_have_no_sixty_minutes(value: float) -> None:
    text = degrees_minutes(value)
    assert degrees("test", text) == pytest.approx(value, abs=1e-6)


def test_seaglider_targets_are_read_back(tmp_path: Path) -> None:
    targets = targets_of(MISSION)
    assert [one.goto for one in targets] == ["T2", "T3", "T3"]
    (tmp_path / "targets").write_text("/ mine\n" + targets_text(targets))
    read = read_targets(tmp_path / "targets")
    for back, one in zip(read, targets, strict=True):
        assert (back.name, back.goto, back.radius_m) == (one.name, one.goto, 250.0)
        assert back.latitude == pytest.approx(one.latitude, abs=1e-6)
        assert back.longitude == pytest.approx(one.longitude, abs=1e-6)


def test_targets_as_people_write_them(tmp_path: Path) -> None:
    path = tmp_path / "targets"
    path.write_text(
        "A lat= 4807.0 lon=-12223.0 radius=200 goto=B escape=A\nB radius=1 goto=B lat=1 lon=2\n"
    )
    first, second = read_targets(path)
    assert first.latitude == pytest.approx(48 + 7 / 60)
    assert first.longitude == pytest.approx(-(122 + 23 / 60))
    assert second.latitude == pytest.approx(1 / 60)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no target"),
        ("A lat=4807.0 lon=-12223.0 radius=200 goto=B", "A goes to B, which is not in it"),
        ("A lat=4807.0 lon=-12223.0 radius=200", "line 1: A has no goto="),
        ("A lat=4861.0 lon=-12223.0 radius=200 goto=A", "61 minutes"),
        ("A lat=4807.0 lon=-12223.0 radius=far goto=A", "radius=far must be metres"),
        ("A lat=4807.0 lon=-12223.0 radius=2 goto=A colour=red", "'colour' is not one of"),
        ("A lat=9107.0 lon=-12223.0 radius=2 goto=A", "is no place"),
    ],
)
def test_targets_that_cannot_be_used(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "targets").write_text(text)
    with pytest.raises(MissionError, match=message):
        read_targets(tmp_path / "targets")


def test_missions_that_such_files_cannot_say() -> None:
    down = Mission(name="down", segments=(SawTooth(max_depth_m=50.0, yos=1),))
    with pytest.raises(MissionError, match="one segment of waypoints"):
        slocum_arguments(down)
    near = dataclasses.replace(SEGMENT, targets=({"north_m": 10.0, "east_m": 0.0},))
    with pytest.raises(MissionError, match="latitude and longitude"):
        targets_of(Mission(name="near", segments=(near,)))
    yos = dataclasses.replace(SEGMENT, surface_after_yos=2.0)
    with pytest.raises(MissionError, match="leave surface_after_yos out"):
        slocum_arguments(Mission(name="yos", segments=(yos,)))
    with pytest.raises(MissionError, match="0 to 99"):
        slocum_arguments(MISSION, number=100)
