"""Slocum mission files: what they say is flown, and what is left out is listed."""

import warnings

import pytest

from twin.__main__ import PROGRAM
from twin.errors import MissionError
from twin.mission import Surface, load_mission
from twin.mission.slocum_mission import read_slocum
from twin.vehicle.vehicle import load_vehicle

FILES = {
    "box.mi": """
# a box off Monterey, one round
sensor: u_use_current_correction(nodim) 1
sensor: c_science_all_on(sec) 4
behavior: abend
    b_arg: overdepth(m)         180   # m
    b_arg: overtime(s)        86400
    b_arg: undervolts(volts)     -1
behavior: surface
    b_arg: args_from_file(enum)  10
    b_arg: start_when(enum)      12   # no calls
behavior: surface
    b_arg: start_when(enum)       8   # at every place
    b_arg: keystroke_wait_time(sec) 240
behavior: goto_list
    b_arg: args_from_file(enum)  10
    b_arg: start_when(enum)       0
behavior: yo
    b_arg: args_from_file(enum)  10
    b_arg: start_when(enum)       2
behavior: sample
    b_arg: args_from_file(enum)  10
behavior: prepare_to_dive
    b_arg: wait_time(s)         720
behavior: tack_upwind
""",
    "mafiles/GOTO_L10.MA": """
behavior_name=goto_list
<start:b_arg>
    b_arg: num_legs_to_run(nodim) -2
    b_arg: list_stop_when(enum)    7
    b_arg: list_when_wpt_dist(m)  60
    b_arg: initial_wpt(enum)       0
    b_arg: num_waypoints(nodim)    2
<end:b_arg>
<start:waypoints>
# longitude  latitude
-12221.000   3648.000
-12221.000   3649.500   # north
<end:waypoints>
""",
    "mafiles/yo10.ma": """
behavior_name=yo
<start:b_arg>
    b_arg: num_half_cycles_to_do(nodim) -1
    b_arg: d_target_depth(m)     90
    b_arg: d_target_altitude(m)  20
    b_arg: d_use_bpump(enum)      2
    b_arg: d_bpump_value(X)    -200
    b_arg: d_use_pitch(enum)      3
    b_arg: d_pitch_value(X)  -0.4538
    b_arg: c_target_depth(m)      6
    b_arg: c_use_bpump(enum)      2
    b_arg: c_bpump_value(X)    1000
    b_arg: c_use_pitch(enum)      3
    b_arg: c_pitch_value(X)   0.5236
    b_arg: d_speed_min(m/s)    0.05
<end:b_arg>
""",
    "mafiles/surfac10.ma": """
behavior_name=surface
<start:b_arg>
    b_arg: when_secs(sec)           3600
    b_arg: keystroke_wait_time(sec)  300
    b_arg: gps_wait_time(sec)        300
    b_arg: c_use_pitch(enum)           3
    b_arg: c_pitch_value(X)       0.4538
<end:b_arg>
nobody knows this line
""",
}


def written(folder, **changes):
    """The mission file, with parts of the texts replaced by file."""
    for name, text in FILES.items():
        for before, after in changes.get(name.split("/")[-1].split(".")[0].lower(), ()):
            assert before in text
            text = text.replace(before, after)
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder / "box.mi"


def test_a_mission_file_becomes_waypoints(tmp_path):
    reading = read_slocum(written(tmp_path))
    (segment,) = reading.mission.segments
    assert [tuple(t.values()) for t in segment.targets] == [(36.8, -122.35), (36.825, -122.35)]
    assert segment.arrival_radius_m == 60.0
    assert (segment.max_depth_m, segment.min_depth_m) == (90.0, 6.0)
    assert segment.pitch_deg == pytest.approx(26.0, abs=0.01)
    assert segment.climb_pitch_deg == pytest.approx(30.0, abs=0.01)
    assert segment.net_mass_kg == pytest.approx(0.205)
    assert (segment.surface_after_s, segment.surface_at_target) == (3600.0, True)
    assert (segment.stay_s, segment.current) == (300.0, "estimated")
    assert reading.mission.max_depth_m == 180.0
    assert reading.mission.ascent_pitch_deg == pytest.approx(26.0, abs=0.01)


def test_everything_that_is_left_out_is_listed(tmp_path):
    notes = read_slocum(written(tmp_path)).notes
    for words in (
        "surfac10.ma line 10: not understood: nobody knows this line",
        "sensor c_science_all_on = 4",
        "overtime = 86400 never aborts",
        "yo10.ma: yo: d_target_altitude 20 m needs a sea floor",
        "yo10.ma: yo: d_speed_min = 0.05 is left out",
        "keystroke_wait_time of the first; others say 240 s",
        "box.mi: sample: no effect on the motion",
        "box.mi: prepare_to_dive: no effect on the motion",
        "box.mi: tack_upwind: this behavior is not flown",
    ):
        assert any(words in note for note in notes), (words, notes)
    assert not any("undervolts" in note for note in notes)  # switched off in the file
    assert sum(": sample:" in note for note in notes) == 1


def test_every_argument_is_used_or_listed(tmp_path):
    """A new argument anywhere changes the mission or the notes."""
    before = read_slocum(written(tmp_path))
    for file, line in (("yo10", "d_target_depth(m)"), ("goto_l10", "list_stop_when(enum)"),
                       ("surfac10", "when_secs(sec)"), ("box", "overdepth(m)")):  # fmt: skip
        name = next(name for name in FILES if file in name.lower())
        path = tmp_path / name
        text = path.read_text(encoding="utf-8")
        path.write_text(
            text.replace(f"b_arg: {line}", f"b_arg: something_new(m) 3\n b_arg: {line}")
        )
        after = read_slocum(tmp_path / "box.mi")
        assert any("something_new" in note for note in after.notes), file
        assert after.mission == before.mission
        path.write_text(text, encoding="utf-8")


@pytest.mark.parametrize("depth", ["0", "92"])
def test_an_overdepth_that_would_abort_at_once_is_listed(tmp_path, depth):
    reading = read_slocum(written(tmp_path, box=[("(m)         180", f"(m)  {depth}")]))
    assert reading.mission.max_depth_m is None
    assert any(f"overdepth {depth} m is left out" in note for note in reading.notes)


@pytest.mark.parametrize(
    "words",
    ["| far away, any words", "// 36 m deep", "; WP 1", "far", "-- north", "(A)", ", B"],
)
def test_words_behind_numbers_are_left_out_and_told(tmp_path, words):
    """Pilots write them behind waypoints and arguments, not always behind a #."""
    plain = read_slocum(written(tmp_path)).mission
    path = written(
        tmp_path,
        goto_l10=[
            ("3648.000", f"3648.000 {words}"),
            ("<end:waypoints>", f"<end:waypoints> {words}"),
        ],
        yo10=[("d_target_depth(m)     90", f"d_target_depth(m)     90 {words}")],
        box=[("behavior: yo", f"behavior: yo {words}")],
    )
    reading = read_slocum(path)
    assert reading.mission == plain
    assert sum(f"words are left out: {words}" in note for note in reading.notes) == 4


@pytest.mark.parametrize("place", ["-12221,0 3648,0", "-12221.0 3648.0 90", "-122 21.0 36 48.0"])
def test_a_third_number_of_a_waypoint_is_no_word(tmp_path, place):
    path = written(tmp_path, goto_l10=[("-12221.000   3648.000", place)])
    with pytest.raises(MissionError, match=r"GOTO_L10\.MA line 12: .*words behind a #"):
        read_slocum(path)


def test_a_pitch_in_degrees_is_refused_with_its_line(tmp_path):
    path = written(tmp_path, yo10=[("d_pitch_value(X)  -0.4538", "d_pitch_value(X)  -26")])
    with pytest.raises(MissionError, match=r"yo10\.ma line 10: yo: .*radian: write -0\.4538"):
        read_slocum(path)


def test_the_mode_of_the_pump_is_taken_by_either_name(tmp_path):
    before = read_slocum(written(tmp_path))
    path = written(tmp_path, yo10=[("d_use_bpump(enum)", "d_bpump_mode(enum)")])
    after = read_slocum(path)
    assert after.mission == before.mission
    assert not any("bpump_mode" in note for note in after.notes)


def test_decimal_degrees_are_told_from_minutes(tmp_path):
    path = written(
        tmp_path, goto_l10=[("-12221.000   3648.000", "-122.36 36.81"),
                            ("-12221.000   3649.500", "-122.36 36.82")],
    )  # fmt: skip
    mission = read_slocum(path).mission
    with pytest.raises(
        MissionError, match=r"did you mean 36\.81, -122\.36 .*DDMM\.mmm.*-12221\.600"
    ):
        mission.placed(36.8, -122.4)


def test_the_pump_is_clipped_as_the_glider_does(tmp_path):
    path, vehicle = written(tmp_path), load_vehicle("glider")
    reading = read_slocum(path, vehicle)
    reading.mission.check(vehicle)
    assert any("1000 cm3 is clipped" in note for note in reading.notes)


def test_altitudes_are_taken_above_a_floor(tmp_path):
    reading = read_slocum(written(tmp_path), above_floor=True)
    assert reading.mission.segments[0].min_altitude_m == 20.0
    assert not any("altitude" in note for note in reading.notes)


@pytest.mark.parametrize(
    ("legs", "first", "targets"),
    [("-2", "1", 1), ("3", "0", 3), ("3", "1", 3), ("-1", "0", 2), ("-2", "-2", 2)],
)
def test_lists_are_flown_as_often_as_they_say(tmp_path, legs, first, targets):
    path = written(
        tmp_path,
        goto_l10=[
            ("num_legs_to_run(nodim) -2", f"num_legs_to_run(nodim) {legs}"),
            ("initial_wpt(enum)       0", f"initial_wpt(enum) {first}"),
        ],
    )
    reading = read_slocum(path)
    found = reading.mission.segments[0].targets
    assert len(found) == targets
    if first == "1":
        assert found[0]["latitude"] == pytest.approx(36.825)
    assert any("for ever" in note for note in reading.notes) == (legs == "-1")
    assert any("closest" in note for note in reading.notes) == (first == "-2")


def test_yos_that_end_bring_it_up(tmp_path):
    path = written(
        tmp_path,
        yo10=[("to_do(nodim) -1", "to_do(nodim) 6")],
        box=[("start_when(enum)       8   # at every place", "start_when(enum) 2")],
    )
    segment = read_slocum(path).mission.segments[0]
    assert segment.surface_after_yos == 3.0
    assert not segment.surface_at_target


def test_a_first_surfacing_comes_before_the_first_dive(tmp_path):
    path = written(tmp_path, box=[("start_when(enum)       8", "start_when(enum) 0")])
    first = read_slocum(path).mission.segments[0]
    assert isinstance(first, Surface)
    assert first.duration_s == 300.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"goto_l10": [("-12221.000   3648", "-12271.000   3648")]}, "71 minutes"),
        ({"goto_l10": [("-12221.000   3648", "3648.0 -12221")]}, "longitude comes first"),
        ({"goto_l10": [("behavior_name=goto_list", "behavior_name=yo")]}, "is for the behavior yo"),
        ({"yo10": [("d_target_depth(m)     90", "d_target_depth(m) deep")]}, "give a number"),
        ({"box": [("behavior: yo", "behavior: hover")]}, "hove.*10.ma|no behavior yo"),
        ({"box": [("args_from_file(enum)  10\n    b_arg: start_when(enum)       0",
                    "args_from_file(enum) 11")]}, "goto_l11.ma"),
    ],
)  # fmt: skip
def test_files_that_cannot_be_flown_are_refused_in_a_line(tmp_path, changes, words):
    with pytest.raises(MissionError, match=words) as caught:
        read_slocum(written(tmp_path, **changes))
    assert "\n" not in str(caught.value)


def test_an_argument_file_alone_is_no_mission(tmp_path):
    written(tmp_path)
    with pytest.raises(MissionError, match="give the mission file"):
        load_mission(tmp_path / "mafiles" / "yo10.ma")


def test_missions_are_loaded_with_a_warning_for_each_line(tmp_path):
    path = written(tmp_path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mission = load_mission(path)
    assert mission.name == "box"
    assert {str(w.message) for w in caught} == set(read_slocum(path).notes)


@pytest.mark.filterwarnings("default")
def test_the_command_flies_it(tmp_path, capsys):
    path = written(tmp_path)
    assert (
        PROGRAM.main(["simulate", str(path), "--start", "36.8,-122.352", "--duration", "1800"]) == 0
    )
    said = capsys.readouterr()
    assert "tack_upwind: this behavior is not flown" in said.err
    assert "1800 s" in said.out


@pytest.mark.parametrize("stop", ["7", "5"])
def test_only_a_list_that_ends_otherwise_than_by_distance_is_told(tmp_path, stop):
    change = ("list_stop_when(enum)    7", f"list_stop_when(enum)    {stop}")
    notes = read_slocum(written(tmp_path, goto_l10=[change])).notes
    told = [note for note in notes if "list_stop_when" in note]
    assert len(told) == (stop != "7")
    assert all("list_stop_when 5 is flown as 7, by distance" in note for note in told)
