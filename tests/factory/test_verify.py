"""Verify and replay: sound stores pass, every kind of damage is found and named."""

import json

import numpy as np
import pytest
import zarr

from factory.__main__ import PROGRAM
from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.soundness import replay_mission, verify_store
from factory.store_check import StoreCheck, check_files, kinematic_problems
from twin.errors import StoreError
from twin.records.schema import HYDROGRAPHY, SIMULATED
from twin.records.store import read_trajectory


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
    read: list[int] = []
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
    for place in np.linspace(0, len(sound) - 1, 9).astype(int).tolist():
        flip_byte(shard, place)
        (chunks,) = (c for c in verify_store(GeneratedStore(copied)).checks if c.name == "chunks")
        assert any("true_surge of mission" in problem for problem in chunks.problems), place
        shard.write_bytes(sound)
    assert verify_store(GeneratedStore(copied)).ok


def test_workers_of_verify_are_a_number_above_zero(paper_store, capsys):
    assert PROGRAM.main(["verify", str(paper_store), "--workers", "0"]) == 2
    assert "--workers 0 must be at least 1" in capsys.readouterr().err
