"""Missions: checks of their fields, files, round trips, what a vehicle can fly, and their page."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from examples import script
from hypothesis import given, settings
from hypothesis import strategies as st
from torpedo import TORPEDO

from twin.errors import MissionError
from twin.mission import (
    Hold,
    Mission,
    SawTooth,
    Spiral,
    Surface,
    load_mission,
    mission_names,
    steady_glide,
)
from twin.mission import mission_file as g
from twin.mission.segments import SEGMENTS
from twin.mission.shipped_missions import PROPELLED
from twin.vehicle.vehicle import load_vehicle


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("glider")


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (SawTooth, {"max_depth_m": 100, "pitch_deg": 60}, "pitch_deg = 60 .* above 0 and below 60"),
        (SawTooth, {"max_depth_m": 100, "pitch_deg": 0}, "pitch_deg = 0 "),
        (SawTooth, {"max_depth_m": 100, "pitch_deg": -35}, "pitch_deg = -35 "),
        (SawTooth, {"max_depth_m": 100, "climb_pitch_deg": 89}, "climb_pitch_deg = 89 "),
        (SawTooth, {"max_depth_m": -5}, "max_depth_m = -5 .* above 0 m"),
        (SawTooth, {"max_depth_m": 50, "min_depth_m": -1}, "min_depth_m = -1 .* at least 1 m"),
        (SawTooth, {"max_depth_m": 50, "min_depth_m": 50}, "less than max_depth_m = 50 m"),
        (SawTooth, {"max_depth_m": 50, "yos": 0}, "yos = 0 .* above 0"),
        (SawTooth, {"max_depth_m": 50, "yos": 1.3}, "yos = 1.3 .* multiple of 0.5"),
        (SawTooth, {"max_depth_m": 50, "duration_s": 0}, "duration_s = 0 .* above 0 s"),
        (SawTooth, {"max_depth_m": 50, "until_depth_m": 60}, "until_depth_m = 60 .* 5 to 50 m"),
        (SawTooth, {"max_depth_m": 50, "net_mass_kg": -0.3}, "net_mass_kg = -0.3 .* above 0 kg"),
        (SawTooth, {"max_depth_m": 50, "heading_deg": 400}, "heading_deg = 400 .* -360 to 360 deg"),
        (SawTooth, {"max_depth_m": "deep"}, "max_depth_m = 'deep' .* a number"),
        (SawTooth, {"max_depth_m": True}, "max_depth_m = True .* a number"),
        (SawTooth, {"max_depth_m": math.nan}, "max_depth_m = nan .* a finite number"),
        (Spiral, {"max_depth_m": 50, "rotation_deg": 200}, "rotation_deg = 200 .* -180 to 180 deg"),
        (Surface, {"duration_s": -1}, "duration_s = -1 "),
        (Surface, {"pitch_deg": 75}, "pitch_deg = 75 "),
        (Hold, {"duration_s": 0}, "duration_s = 0 "),
        (Hold, {"until_depth_m": -3}, "until_depth_m = -3 "),
    ],
)
def test_impossible_field_names_itself_and_what_is_allowed(kind, values, message):
    with pytest.raises(MissionError, match=message) as raised:
        kind(**values)
    assert str(raised.value).startswith(kind.kind)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"segments": []}, "at least one"),
        ({"segments": ["dive"]}, r"segments\[0\] is 'dive'"),
        ({"segments": [Surface()], "duration_s": 0}, "duration_s = 0 "),
        ({"segments": [Surface()], "start_depth_m": -2}, "start_depth_m = -2 "),
        ({"segments": [Surface()], "at_end": "sink"}, "unknown at_end 'sink'.*hold, surface"),
        ({"segments": [Surface()], "name": " "}, "name = ' '"),
        ({"segments": [Surface()], "max_depth_m": 0}, "max_depth_m = 0 "),
        ({"segments": [Surface()], "max_depth_m": 9, "start_depth_m": 10}, "start_depth_m = 10"),
        ({"segments": [SawTooth(max_depth_m=100)]}, r"segments\[0\] saw-tooth never ends.*yos"),
        ({"segments": [Hold()]}, r"segments\[0\] hold never ends: give one of duration_s"),
        (
            {"segments": [SawTooth(max_depth_m=100), Surface()], "duration_s": 100},
            r"segments\[0\] saw-tooth never ends",
        ),
        (
            {"segments": [Surface(), SawTooth(max_depth_m=100, yos=1)], "max_depth_m": 100},
            r"segments\[1\] saw-tooth: max_depth_m = 100 .* 3 m less than the mission's",
        ),
    ],
)
def test_impossible_mission_is_refused(values, message):
    with pytest.raises(MissionError, match=message):
        Mission(**values)


@pytest.mark.parametrize(
    ("segment", "message"),
    [
        (SawTooth(max_depth_m=100, net_mass_kg=0.6), "net_mass_kg = 0.6 .* at most 0.5 kg heavy"),
        (SawTooth(max_depth_m=100, climb_net_mass_kg=0.7), "climb_net_mass_kg = 0.7 .* kg light"),
        (SawTooth(max_depth_m=100, pitch_deg=3), "pitch_deg = 3: .* too shallow .* glides from"),
        (SawTooth(max_depth_m=100, pitch_deg=59.9), "pitch_deg = 59.9 .* shallower pitch"),
        (Spiral(max_depth_m=100, rotation_deg=95), "rotation_deg = 95 .* -90 to 90 deg"),
        (
            Spiral(max_depth_m=100, rotation_deg=5, climb_rotation_deg=-99),
            "climb_rotation_deg = -99 ",
        ),
        (Surface(net_mass_kg=1), "net_mass_kg = 1 .* at most 0.5 kg light"),
        (Surface(shift_m=0.06), "shift_m = 0.06 .* -0.05 to 0.05 m"),
        (Hold(shift_m=-0.06), "shift_m = -0.06 "),
        (Hold(rotation_deg=100), "rotation_deg = 100 "),
        (Hold(net_mass_kg=-0.51), "net_mass_kg = 0.51 .* kg light"),
    ],
)
def test_beyond_the_vehicle_names_segment_field_and_limit(vehicle, segment, message):
    mission = Mission(name="trial", segments=[Surface(), segment], duration_s=100)
    prefix = rf"mission 'trial': segments\[1\] {segment.kind}: "
    with pytest.raises(MissionError, match=prefix + message):
        mission.check(vehicle)


def test_largest_actuator_values_are_allowed(vehicle):
    segments = [
        SawTooth(max_depth_m=100, net_mass_kg=0.5, yos=1),
        Spiral(max_depth_m=100, rotation_deg=-90, yos=1),
        Hold(shift_m=0.05, rotation_deg=90, net_mass_kg=-0.5, duration_s=1),
    ]
    Mission(segments=segments).check(vehicle)
    with pytest.raises(MissionError, match=r"shift_m = 0.0501 "):
        Mission(segments=[Hold(shift_m=0.0501, duration_s=1)]).check(vehicle)


def depths():
    return st.floats(1, 1000)


def optional(strategy):
    return st.none() | strategy


@st.composite
def profiles(draw, kind):
    low, high = sorted([draw(depths()), draw(depths())])
    high += 1.0
    common = {
        "min_depth_m": low,
        "max_depth_m": high,
        "pitch_deg": draw(st.floats(15, 50)),
        "climb_pitch_deg": draw(optional(st.floats(15, 50))),
        "net_mass_kg": draw(st.floats(0.1, 0.5)),
        "climb_net_mass_kg": draw(optional(st.floats(0.1, 0.5))),
        "yos": draw(optional(st.integers(1, 9).map(lambda n: n / 2))),
        "duration_s": draw(st.floats(1, 1e4)),
        "until_depth_m": draw(optional(st.floats(low, high))),
    }
    if kind is Spiral:
        common["rotation_deg"] = draw(st.floats(-90, 90))
        common["climb_rotation_deg"] = draw(optional(st.floats(-90, 90)))
    else:
        common["heading_deg"] = draw(optional(st.floats(-360, 360)))
    return kind(**common)


segments = st.one_of(
    profiles(SawTooth),
    profiles(Spiral),
    st.builds(Surface, duration_s=st.floats(1, 1000), shift_m=optional(st.floats(-0.05, 0.05))),
    st.builds(
        Hold,
        shift_m=st.floats(-0.05, 0.05),
        rotation_deg=st.floats(-90, 90),
        net_mass_kg=st.floats(-0.5, 0.5),
        duration_s=st.floats(1, 1000),
    ),
)
missions = st.builds(
    Mission,
    segments=st.lists(segments, min_size=1, max_size=4),
    duration_s=optional(st.floats(1, 1e5)),
    start_depth_m=st.floats(0, 100),
    start_heading_deg=st.floats(-360, 360),
    at_end=st.sampled_from(["surface", "hold"]),
)


@settings(max_examples=50, deadline=None)
@given(mission=missions)
def test_to_dict_round_trip_and_compiled_table_is_the_same(vehicle, mission):
    again = Mission.from_dict(mission.to_dict())
    assert again == mission
    table, gains = mission.compile(vehicle)
    table_again, gains_again = again.compile(vehicle)
    np.testing.assert_array_equal(table, table_again)
    np.testing.assert_array_equal(gains, gains_again)
    width = g.SEGMENT_COLUMNS + 3 * len(vehicle.parts)
    assert table.shape == (len(mission.segments) + 1, width)
    assert gains.shape == (g.GAINS,)


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "plan.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_toml_file_becomes_segments(tmp_path):
    path = write(
        tmp_path,
        """
        duration_s = 600
        start_heading_deg = 90
        [[segments]]
        kind = "saw-tooth"
        max_depth_m = 80
        heading_deg = 45
        yos = 1.5
        [[segments]]
        kind = "spiral"
        max_depth_m = 60
        rotation_deg = -30
        """,
    )
    assert Mission.from_toml(path) == Mission(
        name="plan",
        duration_s=600,
        start_heading_deg=90,
        segments=(
            SawTooth(max_depth_m=80, heading_deg=45, yos=1.5),
            Spiral(max_depth_m=60, rotation_deg=-30),
        ),
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("duration_s = ", "plan.toml is not TOML"),
        ("duration_s = 5", r"at least one \[\[segments\]\]"),
        ("durations = 5", "unknown key 'durations': did you mean 'duration_s'"),
        ("[[segments]]\nmax_depth_m = 5", r"segments\[0\]: kind is missing"),
        ("[[segments]]\nkind = 'sawtooth'", "unknown kind 'sawtooth': did you mean 'saw-tooth'"),
        ("[[segments]]\nkind = 'spiral'\nmax_depth_m = 50", "rotation_deg is missing"),
        (
            "[[segments]]\nkind = 'surface'\n[[segments]]\nkind = 'saw-tooth'\nmax_depth = 50",
            r"segments\[1\] saw-tooth: unknown key 'max_depth': did you mean 'max_depth_m'",
        ),
        (
            "[[segments]]\nkind = 'surface'\n[[segments]]\nkind = 'saw-tooth'\nmax_depth_m = 50\n"
            "pitch_deg = 75",
            r"plan.toml: segments\[1\] saw-tooth: pitch_deg = 75 .* below 60 deg",
        ),
        ("segments = [3]", r"segments\[0\] is 3"),
    ],
)
def test_bad_file_says_where_and_what(tmp_path, text, message):
    with pytest.raises(MissionError, match=message) as raised:
        Mission.from_toml(write(tmp_path, text))
    assert "\n" not in str(raised.value)


def test_missing_file_and_unknown_name(tmp_path):
    with pytest.raises(MissionError, match=r"cannot read mission file .*nowhere\.toml: No"):
        load_mission(tmp_path / "nowhere.toml")
    with pytest.raises(MissionError, match="unknown mission 'defualt': did you mean 'default'"):
        load_mission("defualt")


@pytest.mark.parametrize("name", mission_names())
def test_shipped_missions_can_be_flown(vehicle, name):
    mission = load_mission(name)
    other = dict.fromkeys((PROPELLED, "transects"), TORPEDO)
    other |= dict.fromkeys(("square", "inspection"), "bluerov2")
    mission.check(load_vehicle(other[name]) if name in other else vehicle)
    assert mission.name == name
    assert mission.max_depth_m is not None


def test_a_time_limit_is_known_without_flying(vehicle):
    assert load_mission("default").time_limit_s(vehicle) == 3600
    one = Mission(segments=[SawTooth(max_depth_m=105, yos=1)]).time_limit_s(vehicle)
    two = Mission(segments=[SawTooth(max_depth_m=105, yos=2)]).time_limit_s(vehicle)
    dive = steady_glide(vehicle, math.radians(-35), 0.3).vertical_speed
    climb = -steady_glide(vehicle, math.radians(35), -0.3).vertical_speed
    assert two - one == pytest.approx(1.5 * 100 * (1 / dive + 1 / climb), abs=1)
    clocked = Mission(segments=[Hold(duration_s=70)], at_end="hold")
    assert clocked.time_limit_s(vehicle) == 70
    with pytest.raises(MissionError, match="hold until a depth takes an unknown time"):
        Mission(segments=[Hold(until_depth_m=20)]).time_limit_s(vehicle)


def test_compiled_rows_carry_commands_in_si(vehicle):
    table, gains = Mission(
        segments=[
            SawTooth(max_depth_m=90, pitch_deg=30, heading_deg=-90, net_mass_kg=0.205, yos=2),
            Spiral(max_depth_m=90, rotation_deg=45, climb_rotation_deg=-45, duration_s=10),
            Hold(shift_m=0.01, rotation_deg=9, net_mass_kg=0.41, until_depth_m=70),
        ],
        max_depth_m=120,
    ).compile(vehicle)
    saw, spiral, hold, end = table

    def command(row, which):
        return row[g.SEGMENT_COLUMNS :].reshape(3, 3)[which]

    assert saw[g.DIVE_PITCH] == pytest.approx(-math.pi / 6)
    assert saw[g.CLIMB_PITCH] == pytest.approx(math.pi / 6)
    assert saw[g.HEADING] == pytest.approx(1.5 * math.pi)
    assert command(saw, g.DIVE_COMMAND)[2] == pytest.approx(-200)  # 0.205 kg / 1025 kg/m3
    assert command(saw, g.CLIMB_COMMAND)[2] == pytest.approx(200)
    assert saw[g.YO_LIMIT] == 2
    assert math.isnan(saw[g.DURATION])
    turned = [command(spiral, which)[1] for which in (g.DIVE_COMMAND, g.CLIMB_COMMAND)]
    assert turned == pytest.approx([math.pi / 4, -math.pi / 4])
    assert command(hold, g.REST_COMMAND) == pytest.approx([0.01, math.radians(9), -400])
    assert hold[g.UNTIL_DEPTH] == 70
    assert end[g.KIND] == g.END_AT_SURFACE
    assert (table[:, g.ABORT_DEPTH] == 120).all()
    loops = [*vehicle.pitch_pid, *vehicle.heading_pid, vehicle.control_period]
    # the shift pitches, forward is nose down; the rotation turns
    assert gains[: g.DEPTH_KP].tolist() == [*loops, 0.0, -1.0, 1.0]
    # neither a depth loop nor a battery beside an elevator
    assert (gains[g.DEPTH_KP : g.TRIM_PART] == 0.0).all()
    assert gains[g.TRIM_PART] == -1.0


# --- docs/reference/missions.md -------------------------------------------------------------------


PAGE = (Path(__file__).parents[3] / "docs" / "reference" / "missions.md").read_text(
    encoding="utf-8"
)


UNITS = ("m", "deg", "kg", "s")
"""Endings of keys"""


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_toml_example_can_be_flown(tmp_path):
    kinds = [["saw-tooth", "spiral", "surface"], ["waypoint"], ["pose", "orbit"]]
    for text, expected in zip(blocks("toml"), kinds, strict=True):
        path = tmp_path / "example.toml"
        path.write_text(text, encoding="utf-8")
        mission = Mission.from_toml(path)
        mission.check(load_vehicle("bluerov2" if "pose" in expected else "glider"))
        assert [segment.kind for segment in mission.segments] == expected


def test_python_examples_run():
    names = {}
    for block in blocks("python"):
        exec(compile(block, "docs/reference/missions.md", "exec"), names)
    assert names["run"].complete


def test_every_kind_of_segment_is_described():
    described = set(re.findall(r"\*\*`([\w-]+)`\*\*", PAGE))
    assert described == set(SEGMENTS.shipped())


@pytest.mark.parametrize("cls", [Mission, *(SEGMENTS[kind] for kind in SEGMENTS.shipped())])
def test_every_key_has_its_unit_in_the_made_tables(cls):
    sections = script("docs_settings").sections_by_name()
    section = sections["mission" if cls is Mission else cls.kind]
    for field in dataclasses.fields(cls):
        (row,) = re.findall(rf"^\| `{field.name}` \| (.*) \|$", section, re.MULTILINE)
        last = field.name.removesuffix("_m_s").rpartition("_")[2]
        rate = {"_m_s": "m/s", "eg_s": "deg/s"}.get(field.name[-4:])
        unit = rate or (last if last in UNITS else None)
        assert unit is None or f"[{unit}" in row.replace("\\", ""), row


def test_shipped_missions_are_named():
    assert all(f"`{name}`" in PAGE for name in mission_names())
