"""Verify and replay: sound stores pass, every kind of damage is found and named."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr

from factory.__main__ import PROGRAM
from factory.__main__ import PROGRAM as FACTORY
from factory.commands.generate import WriteReference
from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.sampling import presets as sets
from factory.soundness import replay_mission, verify_store
from factory.store_check import StoreCheck, check_files, kinematic_problems
from learn.__main__ import PROGRAM as LEARN
from twin.cli.console import Console
from twin.errors import InputError, StoreError
from twin.records.attributes import SETTINGS, VERSION
from twin.records.schema import HYDROGRAPHY, SIMULATED
from twin.records.storage.checksums import array_checksums
from twin.records.storage.sharded import METADATA
from twin.records.store import read_trajectory
from twin.vehicle.vehicle import load_vehicle


def stored_signals(preset):
    """The water of preset field has temperature and salinity, and its vehicles a CTD."""
    return {*SIMULATED, *(HYDROGRAPHY if preset == "field_store" else ())}


def problems(report):
    return " | ".join(problem for check in report.checks for problem in check.problems)


@pytest.mark.parametrize("name", ["paper_store", "field_store"])
def test_a_sound_store_passes_with_everything_read(name, request):
    run = GeneratedStore(request.getfixturevalue(name))
    report = verify_store(run)
    assert report.ok, problems(report)
    chunks = next(check for check in report.checks if check.name == "chunks")
    assert chunks.done == len(run) * len(run.signals()) == len(run) * len(stored_signals(name))


@pytest.mark.parametrize("name", ["paper_store", "field_store"])
def test_every_mission_replays_bit_for_bit(name, request):
    run = GeneratedStore(request.getfixturevalue(name))
    for mission in range(len(run)):
        comparison = replay_mission(run, mission)
        assert comparison.identical, comparison.different
        assert comparison.signals == len(stored_signals(name))
        assert comparison.other_versions == ()


def flip_byte(path, position):
    data = bytearray(path.read_bytes())
    data[position] ^= 0xFF
    path.write_bytes(bytes(data))


def cut_in_half(store):
    path = store / "true_depth" / "c" / "0" / "0"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def edit(store, name, change):
    array = zarr.open_group(store, mode="r+")[name]
    assert isinstance(array, zarr.Array)
    values = np.asarray(array[:])
    change(values)
    array[:] = values


def edit_json(store, change):
    path = store / "zarr.json"
    group = json.loads(path.read_text())
    change(group)
    path.write_text(json.dumps(group))


def set_value(row, column, value):
    def change(values):
        values[row, column] = value

    return change


def reverse(values):
    np.negative(values, out=values)


def set_units(group):
    arrays = group["consolidated_metadata"]["metadata"]
    arrays["true_pitch"]["attributes"]["units"] = "radian"


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda s: flip_byte(s / "true_surge" / "c" / "0" / "0", 400), "true_surge of mission 0"),
        (cut_in_half, "true_depth of mission"),
        (lambda s: (s / "measured_roll" / "c" / "0" / "0").unlink(), "measured_roll is not finite"),
        (lambda s: edit(s, "true_sway", set_value(1, 5, np.nan)), "first at sample 5"),
        (lambda s: edit(s, "true_pitch", set_value(2, 9, 95.0)), "true_pitch runs from"),
        (lambda s: edit(s, "measured_pump", set_value(0, -1, 1.0)), "values after its"),
        (lambda s: edit(s, "true_yaw_rate", reverse), "attitude does not follow the rates"),
        (lambda s: edit(s, "true_current_east", reverse), "through the water plus current"),
        (lambda s: edit(s, "true_north", set_value(1, 50, 7.0)), "position does not follow"),
        (lambda s: edit_json(s, set_units), "true_pitch: units 'radian', not 'degree'"),
        (
            lambda s: edit_json(s, lambda g: g["attributes"].update(vehicle_mjcf="<mujoco/>")),
            "SHA-256",
        ),
        (
            lambda s: edit(s, "mission_pitch_deg", set_value(0, 0, 30.0)),
            "mission.pitch_deg = 30.0 cannot be drawn from",
        ),
        (lambda s: edit(s, "split", lambda v: v.fill(1)), "a split without a mission"),
        (lambda s: edit(s, "n_samples", lambda v: v.fill(3)), "3 samples, not"),
    ],
)
def test_damage_is_found_and_named(damage, message, copied):
    damage(copied)
    report = verify_store(GeneratedStore(copied))
    assert not report.ok
    assert message in problems(report)


def test_problems_that_differ_in_more_than_numbers_are_named_each():
    missing = ["surge-0.json is missing", "surge-1.json is missing", "true_roll/c/0/0 is missing"]
    assert StoreCheck("files", problems=missing).alike() == missing
    ranges = [f"mission {k}: roll runs from {-k} to 9{k}.5" for k in range(3)]
    assert StoreCheck("range", problems=ranges).alike() == [f"{ranges[0]} (and 2 more like it)"]


def test_the_missions_of_one_damaged_file_are_one_line(tmp_path, recipe, monkeypatch, capsys):
    monkeypatch.setattr("factory.generation.job.SHARDS_PER_STORE", 1)
    store = tmp_path / "one_shard.zarr"
    generate(recipe(), store, workers=1)
    for name in ("measured_pitch", "true_depth"):
        place = store / name / "c/0/0"
        place.write_bytes(place.read_bytes()[: place.stat().st_size // 2])
    assert PROGRAM.main(["verify", str(store)]) == 1
    said = capsys.readouterr().out
    lines = [line for line in said.splitlines() if line.startswith(("chunks:", "finite:"))]
    missions = len(GeneratedStore(store))
    assert len(lines) == 4
    assert all(f"(and {missions - 1} more like it)" in line for line in lines)
    assert PROGRAM.main(["verify", str(store), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["problems"]
    assert len(found["chunks"]) == 2 * missions


def test_a_lost_array_is_told(copied):
    (copied / "n_samples" / "c" / "0").write_bytes(b"short")
    with pytest.raises(StoreError, match="its array n_samples cannot be read"):
        verify_store(GeneratedStore(copied))


def test_replay_finds_a_changed_bit(copied):
    surge = read_trajectory(copied, 1)["true_surge"]
    edit(copied, "true_surge", set_value(1, 20, surge[20] + 2.0**-20))
    comparison = replay_mission(GeneratedStore(copied), 1)
    assert comparison.different == {"true_surge": 2.0**-20}
    assert replay_mission(GeneratedStore(copied), 0).identical
    with pytest.raises(StoreError, match=r"missions 0 to \d+, not 99"):
        replay_mission(GeneratedStore(copied), 99)


def test_the_kinematic_check_is_silent_on_a_coarse_but_right_record(paper_store):
    """Its tolerances leave room: rounding everything ten times coarser changes no verdict."""
    truth = {
        name: np.round(values, 3)
        for name, values in read_trajectory(paper_store, 0).signals.items()
        if name.startswith("true_") and "velocity" not in name and "current" not in name
    }
    exact = read_trajectory(paper_store, 0).signals
    kept = ("surge", "sway", "heave", "roll", "pitch", "heading")
    truth |= {f"true_{name}": exact[f"true_{name}"] for name in kept}
    truth |= {name: v for name, v in exact.items() if "velocity" in name or "current" in name}
    assert kinematic_problems(truth, 0.5) == []


def test_what_is_found_does_not_depend_on_the_workers(tmp_path, recipe, monkeypatch):
    monkeypatch.setattr("factory.store_check.MISSIONS_AT_ONCE", 1)
    monkeypatch.setattr("factory.store_check.SAMPLES_AT_ONCE", 1)
    monkeypatch.setattr("twin.records.storage.checksums.FILES_AT_ONCE", 2)
    store = tmp_path / "shards_of_one.zarr"
    generate(recipe(), store, workers=1)
    cut_in_half(store)
    run = GeneratedStore(store)
    read = []
    alone, together = verify_store(run), verify_store(run, read.append, workers=2)
    assert together == alone
    assert not alone.ok
    assert read == [1] * len(run)
    found = [check_files(run.path, workers).problems for workers in (1, 3)]
    assert found[0] == found[1] != []


@pytest.mark.parametrize("whole", [4, 0])
def test_every_flipped_bit_of_a_shard_is_found(monkeypatch, whole, copied):
    """Whether shards are decoded whole by the fast pipeline or in parts by zarr's own."""
    monkeypatch.setattr("factory.store_check.WHOLE_SHARD", whole)
    monkeypatch.setattr("factory.store_check.MISSIONS_AT_ONCE", 2)
    monkeypatch.setattr("factory.store_check.SAMPLES_AT_ONCE", 1)
    shard = copied / "true_surge/c/0/0"
    sound = shard.read_bytes()
    for place in np.linspace(0, len(sound) - 1, 5).astype(int).tolist():
        flip_byte(shard, place)
        (chunks,) = (c for c in verify_store(GeneratedStore(copied)).checks if c.name == "chunks")
        assert any("true_surge of mission" in problem for problem in chunks.problems), place
        shard.write_bytes(sound)
    assert verify_store(GeneratedStore(copied)).ok


def test_workers_of_verify_are_a_number_above_zero(paper_store, capsys):
    assert PROGRAM.main(["verify", str(paper_store), "--workers", "0"]) == 2
    assert "--workers 0 must be at least 1" in capsys.readouterr().err


# --- Stores that other versions wrote are read, or refused in one line


OLD = Path(__file__).parents[1] / "data" / "e2ff189"
"""Stores of the commit of that name, of version 0.1.0"""
NEWER = 99

old_readers = pytest.mark.filterwarnings("ignore:.*imported by version 1 of the readers")


@old_readers
@pytest.mark.parametrize("name", ["simulated.zarr", "logged.zarr"])
@pytest.mark.parametrize("command", ["info", "verify"])
def test_a_store_of_version_0_1_is_read(command, name):
    assert FACTORY.main([command, str(OLD / name)]) == 0


@old_readers
@pytest.mark.parametrize(
    ("words", "name", "message"),
    [
        (["verify", "--replay", "0"], "simulated.zarr", "physics"),
        (["generate", "--resume", "--out"], "simulated.zarr", "other settings"),
        (["generate", "--resume", "--out"], "logged.zarr", "logs"),
    ],
)
def test_its_missions_are_not_mixed_with_new_ones(tmp_path, capsys, words, name, message):
    store = tmp_path / name
    shutil.copytree(OLD / name, store)
    command, *options = words
    words = [command, str(store), *options] if command == "verify" else [*words, str(store)]
    assert FACTORY.main(words) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert message in line


@pytest.fixture
def newer(tmp_path, paper_store):
    """A store of a schema that is not known."""
    store = tmp_path / "newer.zarr"
    shutil.copytree(paper_store, store)
    document = json.loads((store / METADATA).read_text())
    document["attributes"][VERSION] = NEWER
    settings = json.loads(document["attributes"][SETTINGS])
    settings["versions"]["glider-twin"] = f"{NEWER}.0"
    document["attributes"][SETTINGS] = json.dumps(settings)
    (store / METADATA).write_text(json.dumps(document))
    return store


@pytest.mark.parametrize(
    "words",
    ["info {}", "generate --resume --out {}", "verify {} --replay 0", "plot {}",
     "export {} --to og1", "fit {} --name newer"],
)  # fmt: skip
def test_a_newer_store_is_refused_with_both_versions(newer, capsys, words):
    program = LEARN if words.startswith("fit") else FACTORY
    assert program.main(words.format(newer).split()) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"version {NEWER}" in line
    assert "upgrade glider-twin to 99.0" in line


# --- The reference set: what everybody's copy is compared with


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    out = tmp_path_factory.mktemp("reference") / "reference.zarr"
    assert PROGRAM.main(["reference", "--name", "field-2h", "--out", str(out)]) == 0
    return out


def test_the_small_set_is_made_as_listed(store, capsys):
    again = ["reference", "--name", "field-2h", "--out", str(store), "--compare"]
    assert PROGRAM.main(again) == 0
    assert "arrays, all as listed" in capsys.readouterr().out


def test_a_changed_array_is_named(store, tmp_path, capsys):
    copy = tmp_path / "changed.zarr"
    shutil.copytree(store, copy)
    array = zarr.open_group(copy)["true_surge"]
    array[0, 100] = array[0, 100] + 1e-6
    command = ["reference", "--name", "field-2h", "--out", str(copy), "--compare"]
    assert PROGRAM.main(command) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "is NOT field-2h, 1 of" in said
    assert "true_surge has other values" in said


@pytest.mark.parametrize("name", sets.reference_names())
def test_the_lists_are_of_this_physics_and_whole(name, store):
    listed = sets.reference_set(name)
    assert (listed.preset, listed.physics) == ("field", load_vehicle().physics_version)
    assert listed.hours == float(name.removeprefix("field-").removesuffix("h"))
    assert set(listed.arrays) == set(array_checksums(store))
    assert all(len(value) == 64 for value in listed.arrays.values())


def test_missing_and_unlisted_arrays_differ():
    listed = sets.reference_set("field-2h")
    found = {**listed.arrays, "new": "0"}
    del found["true_sway"]
    assert listed.differences(found) == {"new": "is not listed", "true_sway": "is missing"}


def test_unusable_requests_say_what_to_do(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="did you mean 'field-2h'"):
        sets.reference_set("field-2")
    console = Console("factory")
    there = WriteReference(name="field-2h", out=tmp_path / "none.zarr", compare=True)
    with pytest.raises(InputError, match=r"is not there: leave --compare out"):
        there.run(console)
    with pytest.raises(InputError, match=r"leave out --workers, --resume and --overwrite"):
        dataclasses.replace(there, overwrite=True).run(console)
    monkeypatch.setattr(
        "twin.vehicle.vehicle.PHYSICS_VERSION", sets.reference_set("field-2h").physics + 1
    )
    with pytest.raises(InputError, match=r"install the version of glider-twin that has them"):
        there.run(console)
