"""Missions go into any zarr store that a program has opened."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray as xr
from zarr.storage import MemoryStore

import factory
from factory.generation.generation import generate_into
from twin.errors import InputError, StoreError


def test_a_store_in_memory_has_every_byte(recipe, paper_store):
    kept: dict = {}
    store = MemoryStore(kept)
    made = recipe()
    summary = factory.generate(store=store, hours=made.plan.hours, changes=made.changes, workers=1)
    assert summary.store is store
    assert summary.missions == len(made.plan)
    assert {key: value.to_bytes() for key, value in kept.items()} == {
        path.relative_to(paper_store).as_posix(): path.read_bytes()
        for path in paper_store.rglob("*")
        if path.is_file()
    }
    with pytest.raises(StoreError, match="holds something already"):
        generate_into(recipe(), MemoryStore(kept), workers=1)
    with pytest.raises(StoreError, match="is read-only"):
        generate_into(recipe(), MemoryStore(read_only=True), workers=1)


def test_a_store_and_a_path_exclude_each_other(tmp_path):
    for settings in ({}, {"out": tmp_path / "a.zarr", "store": MemoryStore()}):
        with pytest.raises(InputError, match="give either out, a path or an address, or store"):
            factory.generate(**settings)
    with pytest.raises(InputError, match="a zarr store must be empty"):
        factory.generate(store=MemoryStore(), resume=True)
    with pytest.raises(InputError, match="either a scheduler or an executor"):
        factory.generate(store=MemoryStore(), scheduler="tcp://x", executor=ThreadPoolExecutor())


def test_icechunk_keeps_it_in_one_commit(recipe, paper_store):
    icechunk = pytest.importorskip("icechunk", reason='needs pip install "glider-twin[icechunk]"')
    repository = icechunk.Repository.create(icechunk.in_memory_storage())
    session = repository.writable_session("main")
    generate_into(recipe(), session.store, workers=1)
    before = repository.readonly_session("main").store
    assert asyncio.run(before.is_empty(""))
    session.commit("missions of preset paper")
    assert len(list(repository.ancestry(branch="main"))) == 2  # the empty one and this
    there = xr.open_zarr(repository.readonly_session("main").store, consolidated=False)
    here = xr.open_zarr(paper_store)
    np.testing.assert_array_equal(there["true_depth"], here["true_depth"])
    assert there.attrs == here.attrs
