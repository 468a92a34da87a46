"""The reference set: what everybody's copy is compared with."""

import dataclasses
import shutil

import pytest
import zarr

from factory.__main__ import PROGRAM
from factory.commands.generate import WriteReference
from factory.sampling import presets as sets
from twin.cli.console import Console
from twin.errors import InputError
from twin.records.storage.checksums import array_checksums
from twin.vehicle.vehicle import load_vehicle


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


def listed_physics():
    return sets.reference_set("field-2h").physics


def test_unusable_requests_say_what_to_do(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="did you mean 'field-2h'"):
        sets.reference_set("field-2")
    console = Console("factory")
    there = WriteReference(name="field-2h", out=tmp_path / "none.zarr", compare=True)
    with pytest.raises(InputError, match=r"is not there: leave --compare out"):
        there.run(console)
    with pytest.raises(InputError, match=r"leave out --workers, --resume and --overwrite"):
        dataclasses.replace(there, overwrite=True).run(console)
    monkeypatch.setattr("twin.vehicle.vehicle.PHYSICS_VERSION", listed_physics() + 1)
    with pytest.raises(InputError, match=r"install the version of glider-twin that has them"):
        there.run(console)
