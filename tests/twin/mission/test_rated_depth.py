"""Missions far deeper than the vehicle is built for: refused everywhere in one sentence."""

import dataclasses

import pytest

import twin
from factory.__main__ import PROGRAM as FACTORY
from factory.sampling import make_recipe
from twin.__main__ import PROGRAM
from twin.errors import MissionError
from twin.mission import Mission, load_mission
from twin.mission.segments import Hold, SawTooth, Surface, Transect
from twin.mission.shipped_missions import load_mission_for
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import load_vehicle

WORDS = "the mission dives to {} m, and {} is built for {} m: the limit is 1.2 times that, {} m"
LONG = Hold(duration_s=1.0)


def down_to(depth, **more):
    return Mission(name="down", segments=(SawTooth(max_depth_m=depth, yos=1),), **more)


@pytest.mark.parametrize(
    ("mission", "depth"),
    [
        (down_to(60.0), 60.0),
        (down_to(60.0, start_depth_m=70.0), 70.0),
        (down_to(60.0, max_depth_m=500.0), 60.0),  # an abort there is no dive
        (Mission(name="m", segments=(Transect(depth_m=80.0, length_m=9.0), LONG)), 80.0),
        (Mission(name="m", segments=(Transect(altitude_m=8.0, length_m=9.0), LONG)), 0.0),
        (Mission(name="m", segments=(Hold(until_depth_m=90.0), Surface(duration_s=9.0))), 90.0),
    ],
)
def test_the_deepest_of_a_mission_is_that_of_any_segment_and_of_its_start(mission, depth):
    assert mission.deepest == depth


def test_a_mission_is_flown_to_the_limit_and_refused_beyond(tmp_path, capsys):
    says = WORDS.format(241, "slocum-200", 200, 240)
    with pytest.raises(MissionError, match=says):
        twin.simulate(vehicle="slocum-200", mission=down_to(241.0), duration=1.0)
    twin.simulate(vehicle="slocum-200", mission=down_to(240.0), duration=1.0)
    path = tmp_path / "down.toml"
    path.write_text("[[segments]]\nkind = 'saw-tooth'\nyos = 1\nmax_depth_m = 241\n")
    for words in (["slocum-200", says], ["glider", ""]):
        ended = PROGRAM.main(["simulate", str(path), "--vehicle", words[0], "--duration", "1"])
        assert ended == (2 if words[1] else 0)
        assert words[1] in capsys.readouterr().err
    with pytest.raises(MissionError, match=WORDS.format(1801, "glider", 1500, 1800)):
        twin.simulate(mission=down_to(1801.0), duration=1.0)


@pytest.mark.parametrize("name", vehicle_names())
def test_no_vehicle_is_sent_by_default_below_what_it_is_built_for(name):
    vehicle = load_vehicle(name)
    usual = load_mission_for(vehicle)
    assert 0.0 < usual.deepest <= (vehicle.rated_depth or 1500.0)
    rated = min(12.0, 0.5 * usual.deepest)
    shallow = vehicle.replace(rated_depth=rated)
    says = WORDS.format(f"{usual.deepest:g}", name, f"{rated:g}", f"{1.2 * rated:g}")
    with pytest.warns(UserWarning, match=f"{usual.name!r} is flown to {rated:g} m: {says}"):
        own = load_mission_for(shallow)
    assert own.deepest == rated
    fields = ("max_depth_m", "depth_m")
    kept = [dataclasses.replace(s, **{f: 9.0 for f in fields if hasattr(s, f)})
            for m in (own, usual) for s in m.segments]  # fmt: skip
    assert kept[: len(own.segments)] == kept[len(own.segments) :]
    with pytest.raises(MissionError, match=says):
        load_mission_for(shallow, usual.name)


def test_a_data_set_of_given_depths_is_refused_and_one_of_a_preset_warned_of(tmp_path, capsys):
    slocum = {"vehicle": "slocum-200", "preset": "field"}
    for text, deepest in (
        ("uniform(60, 241)", 241), ("241", 241), ("choice(60, 300: 0, 250)", 250),
        ("normal(220, 5)", 250),
    ):  # fmt: skip
        says = rf"mission.max_depth_m = .*: {WORDS.format(deepest, 'slocum-200', 200, 240)}"
        with pytest.raises(MissionError, match=says):
            make_recipe(**slocum, changes={"mission.max_depth_m": text})
    for text in ("uniform(60, 240)", "choice(60, 300: 0)", "normal(180, 10)"):
        make_recipe(**slocum, changes={"mission.max_depth_m": text})
    words = ["--vehicle", "slocum-200", "--set", "mission.max_depth_m=300", "--hours", "1"]
    assert FACTORY.main(["generate", *words, "--out", str(tmp_path / "deep.zarr")]) == 2
    assert WORDS.format(300, "slocum-200", 200, 240) in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    mine = tmp_path / "mine.xml"
    mine.write_text(load_vehicle("spray").xml.replace('data="1500"', 'data="200"'))
    with pytest.warns(UserWarning, match="preset 'field': mission.max_depth_m = uniform"):
        make_recipe(vehicle=str(mine), preset="field")
    with pytest.raises(MissionError, match=f"{load_mission('spiral-level-spiral').deepest:g} m"):
        make_recipe(vehicle=str(mine), preset="paper-test")
