"""Stores whose missions fly in lanes: the same bytes however they are made, and made again so."""

import json

import numpy as np
import pytest
from trees import contents

import factory
from factory.__main__ import PROGRAM
from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.generation.parts import StorePart, finish, generate_part
from factory.generation.shard import MOST_SAMPLES, fly_missions, together
from factory.sampling.recipe import make_recipe, read_recipe
from factory.soundness import replay_mission, verify_store
from twin.errors import InputError
from twin.records.coordinates import COORDINATES
from twin.vehicle.vehicle import load_vehicle


@pytest.fixture(scope="module")
def lanes_store(tmp_path_factory, recipe):
    out = tmp_path_factory.mktemp("lanes") / "missions.zarr"
    generate(recipe(engine="lanes", hours=0.4), out, workers=1)
    return out


def test_any_number_of_workers_parts_and_resumed_runs_make_the_same_bytes(
    tmp_path, recipe, lanes_store
):
    made = recipe(engine="lanes", hours=0.4)
    two, parts = tmp_path / "two.zarr", tmp_path / "parts.zarr"
    generate(made, two, workers=2)
    assert generate_part(made, parts, StorePart(1, 2))[0] > 0
    generate(made, parts, workers=1, resume=True)
    again = tmp_path / "again.zarr"
    for index in (1, 0):
        generate_part(made, again, StorePart(index, 2))
    finish(again)
    wanted = contents(lanes_store)
    assert contents(two) == contents(parts) == contents(again) == wanted


def test_a_mission_is_the_same_alone_and_beside_others(recipe):
    made = recipe(engine="lanes", hours=1.0)
    count = len(made.plan)
    assert count > 12
    beside = fly_missions(made, range(count))
    for mission in (0, count - 1):
        ((flown, signals),) = fly_missions(made, [mission])
        assert flown == beside[mission][0]
        for name, values in signals.items():
            np.testing.assert_array_equal(values, beside[mission][1][name], err_msg=name)


def test_the_store_names_its_engine_and_flies_again_by_it(lanes_store, recipe, capsys):
    run = GeneratedStore(lanes_store)
    assert run.settings["engine"] == run.recipe.engine == "lanes"
    assert verify_store(run).ok
    for mission in (0, len(run) - 1):
        found = replay_mission(run, mission)
        assert found.identical
        assert found.samples > 200
    assert PROGRAM.main(["info", str(lanes_store)]) == 0
    assert "engine     lanes" in capsys.readouterr().out
    other = recipe(hours=0.4)
    assert "engine" not in other.describe()
    assert other.digest != run.recipe.digest
    assert read_recipe(other.document()).engine == "mujoco"


def test_both_engines_draw_and_fly_the_same_missions(lanes_store, recipe):
    run = GeneratedStore(lanes_store)
    made = recipe(hours=0.4)
    for (flown, signals), mission in zip(fly_missions(made, [0, 3]), (0, 3), strict=True):
        assert repr(flown.parameters.segments) == repr(run.parameters(mission).segments)
        assert set(signals) - {*COORDINATES} <= set(run.signals())
        way = 0.0
        apart = np.zeros(flown.samples)
        for name in ("true_north", "true_east", "true_depth"):
            theirs = run.row(name, mission)[: flown.samples]
            apart = np.hypot(apart, theirs - signals[name])
            way = float(np.hypot(way, np.abs(np.diff(signals[name])).sum()))
        assert 0.0 < apart.max() < 0.003 * way


def test_a_mission_that_comes_to_the_floor_is_replaced():
    changes = {
        "mission.kind": "saw-tooth", "mission.max_depth_m": "100", "mission.pitch_deg": "20",
        "mission.min_altitude_m": "choice(0.2, 10)", "mission.duration_h": "0.1",
        "mission.segment_duration_s": "600", "floor.depth_m": "40",
    }  # fmt: skip
    made = make_recipe(hours=0.5, vehicle="tethys", engine="lanes", changes=changes)
    found = fly_missions(made, range(5))
    failures = [failure for flown, _ in found for failure in flown.failures]
    grounded = [failure for failure in failures if "ran aground at" in failure.reason]
    assert grounded
    assert all(failure.time_s is not None for failure in grounded)


def test_groups_that_fly_together_are_bounded(recipe):
    long = recipe(engine="lanes", hours=300.0, changes={"mission.duration_h": "30"})
    groups = list(together(long, range(len(long.plan))))
    assert [mission for group in groups for mission in group] == list(range(len(long.plan)))
    assert max(map(len, groups)) == MOST_SAMPLES // (30 * 7200)
    assert [len(group) for group in together(recipe(), range(4))] == [1] * 4


def test_what_cannot_fly_in_lanes_is_refused_before_a_store_is_touched(tmp_path, capsys):
    with pytest.raises(InputError, match=r"engine 'lane'.*did you mean 'lanes'"):
        factory.generate(tmp_path / "a.zarr", hours=0.1, engine="lane")
    rock = '<worldbody><geom name="rock" type="box" size="9 9 9" pos="50 0 -50"/>'
    vehicle = tmp_path / "mine.xml"
    vehicle.write_text(load_vehicle("glider").xml.replace("<worldbody>", rock, 1))
    with pytest.raises(InputError, match=r"obstacles \(rock\), which engine='lanes' would"):
        factory.generate(tmp_path / "a.zarr", hours=0.1, engine="lanes", vehicle=str(vehicle))
    assert list(tmp_path.iterdir()) == [vehicle]
    out = tmp_path / "b.zarr"
    words = ["--hours", "0.1", "--engine", "lanes", "--out", str(out), "--workers", "1", "--json"]
    changes = ["--set", "mission.duration_h=0.05", "mission.segment_duration_s=60"]
    assert PROGRAM.main(["generate", *words, *changes]) == 0
    assert json.loads(capsys.readouterr().out)["engine"] == "lanes"
