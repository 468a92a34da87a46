"""Flipped bits of a store: every one is found by `factory verify`."""

from __future__ import annotations

import json
import random

import numpy as np
import pytest
import xarray as xr

from benchmarks.flips import count, flipped, verified
from factory.__main__ import PROGRAM
from twin.records.attributes import CONVENTIONS
from twin.records.store import write_store


@pytest.fixture
def store(tmp_path):
    depth = np.linspace(0.0, 9.0, 40).reshape(2, 20)
    data = xr.Dataset({"measured_depth": (("mission", "time"), depth)}, attrs=CONVENTIONS)
    return write_store(data, tmp_path / "store.zarr")


def test_every_flip_is_found_and_counted(store):
    files = sorted(path for path in store.rglob("*") if path.is_file())
    rows = count(store, files, verified(store), flips=60, seed=1)
    assert rows[-1] == {"file": "all", "flipped": 120, "found": 120}
    assert {"list of checksums", "metadata of the store", "values"} <= {row["file"] for row in rows}


def test_a_judge_that_finds_nothing_is_counted_so(store):
    files = sorted(path for path in store.rglob("*") if path.is_file())
    rows = count(store, files, lambda path: False, flips=5, seed=1)
    assert (rows[-1]["flipped"], rows[-1]["found"]) == (10, 0)
    assert flipped(files, 3, random.Random(0)) == flipped(files, 3, random.Random(0))


def test_verify_names_damaged_files_of_a_store_that_cannot_be_opened(store, capsys):
    (store / "zarr.json").write_bytes(b"{" + (store / "zarr.json").read_bytes()[1:-1] + b" ")
    assert PROGRAM.main(["verify", str(store), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert not answer["ok"]
    assert answer["problems"]["files"][0] == "zarr.json is changed: its SHA-256 is another one"
