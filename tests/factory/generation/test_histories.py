"""Histories of a store: made, killed at any file operation, spoilt, resumed, verified.

A process that is killed does no more operations: from the n-th one on, each one raises. Whatever
happened before, the name has an old store whole or the new one, and the next run completes it.
`python -m benchmarks.histories` does the same with processes that are killed.
"""

import os
import shutil
import sys
import tempfile
from pathlib import Path

import pytest
from clusters import Here
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test
from trees import contents

import factory.generation.shard
from factory.generation import StorePart, finish, generate, generate_part
from factory.generation.job import unfinished
from factory.sampling import make_recipe
from factory.store_check import check_files
from twin.errors import StoreError
from twin.records.presence import generating

HISTORIES, STEPS = int(os.environ.get("HISTORIES", "200")), 6
MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Where stores are made: nothing then waits for a disk"""
MISSIONS_H = 0.14
"""[h] of three missions"""
SHORT = {
    "mission.duration_h": "uniform(0.03, 0.06)",
    "mission.segment_duration_s": "uniform(30, 90)",
}
PARTS = 2
CHANGES = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.truncate")
KEPT = ("recipe.json", "array.json", "lock")
"""Files of an unfinished store without which it is another one"""
MOMENT = st.none() | st.floats(0.0, 1.0)
"""Share of the operations of an undisturbed run after which a run is killed"""
SEED = st.integers(0, 1)


class Killed(BaseException):
    """Raised by each operation of a process that is no more."""


class Operations:
    """Changes of files below a folder, which are counted, and from one on refused."""

    def __init__(self):
        self.folder, self.count, self.left = "", 0, 0
        sys.addaudithook(self._hear)

    def _hear(self, event, given):
        if not self.folder or not (event == "open" or event in CHANGES):
            return
        if event == "open" and not (given[2] or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            return
        path = "" if isinstance(given[0], int) else os.fsdecode(given[0])
        if not path or (path.startswith("/") and not path.startswith(self.folder)):
            return  # what `rmtree` removes has a name without its folder
        self.count += 1
        if self.count > self.left:
            raise Killed

    def watch(self, folder, left=sys.maxsize):
        """Count below a folder from now on, and refuse all but `left`; None: do no more."""
        self.folder, self.count, self.left = str(folder or ""), 0, left


@pytest.fixture(scope="module")
def operations():
    return Operations()


@pytest.fixture(scope="module")
def recipes():
    return [make_recipe(hours=MISSIONS_H, seed=seed, changes=SHORT) for seed in (0, 1)]


@pytest.fixture
def flown(monkeypatch):
    """Each mission is flown once: what is made of it is tested here."""
    fly, known = factory.generation.shard.fly_abreast, {}

    def remembered(draws, *given, **named):
        for index, draw in enumerate(draws):
            name = repr(draw.sensor_seed)
            if name not in known:
                ((_, known[name]),) = fly([draw], *given, **named)
            yield index, known[name]

    monkeypatch.setattr(factory.generation.shard, "fly_abreast", remembered)


def undisturbed(recipe, operations):
    """Bytes of the files of a store, and the operations that it takes."""
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        store = Path(folder) / "missions.zarr"
        operations.watch(Path(folder))
        generate(recipe, store, executor=Here())
        count = operations.count
        operations.watch(None)
        return contents(store), count


def machine(recipes, operations):
    """The histories of a store of either recipe."""
    expected, counts = zip(*(undisturbed(one, operations) for one in recipes), strict=True)

    class Histories(RuleBasedStateMachine):
        def __init__(self):
            super().__init__()
            self.folder = Path(tempfile.mkdtemp(dir=MEMORY))
            self.store = self.folder / "missions.zarr"
            self.now: int | None = None
            """whose store has the name"""

        @rule(seed=SEED, moment=MOMENT, overwrite=st.booleans())
        def make(self, seed, moment, overwrite):
            def work():
                recipe = recipes[seed]
                generate(recipe, self.store, executor=Here(), resume=True, overwrite=overwrite)

            self.attempt(work, seed, moment)

        @rule(seed=SEED, part=st.integers(0, PARTS - 1), moment=MOMENT)
        def make_part(self, seed, part, moment):
            def work():
                generate_part(recipes[seed], self.store, StorePart(part, PARTS))

            self.attempt(work, self.now, moment)

        @rule(moment=MOMENT)
        def complete(self, moment):
            begun = unfinished(self.store)
            seed = self.now if begun is None else begun.settings["seed"]
            self.attempt(lambda: finish(self.store), seed, moment)

        @rule(which=st.integers(0), cut=st.booleans())
        def spoil(self, which, cut):
            place = generating(self.store)
            assert isinstance(place, Path)
            found = sorted(p for p in place.rglob("*") if p.is_file() and p.name not in KEPT)
            if found:
                path = found[which % len(found)]
                os.truncate(path, path.stat().st_size // 2) if cut else path.unlink()

        @rule(which=st.integers(0), bit=st.integers(0))
        def flip(self, which, bit):
            if self.now is None:
                return
            name = sorted(expected[self.now])[which % len(expected[self.now])]
            data = bytearray(expected[self.now][name])
            data[bit // 8 % len(data)] ^= 1 << bit % 8
            (self.store / name).write_bytes(data)
            assert any(one.startswith(f"{name} is ") for one in check_files(self.store).problems)
            (self.store / name).write_bytes(expected[self.now][name])

        def attempt(self, work, seed, moment):
            """Do something that may make the store of a seed, up to a moment."""
            most = max(counts)
            operations.watch(self.folder, sys.maxsize if moment is None else int(moment * most))
            done = False
            try:
                work()
                done = True
            except (Killed, StoreError):
                pass
            finally:
                operations.watch(None)
            here = contents(self.store) if self.store.exists() else None
            before = None if self.now is None else expected[self.now]
            if here != before:
                assert seed is not None
                assert here == expected[seed]
                self.now = seed
            assert not done or here == (None if seed is None else expected[seed])

        def teardown(self):
            again = {"executor": Here(), "overwrite": True}
            try:
                generate(recipes[0], self.store, resume=True, **again)
            except StoreError:  # the other recipe was begun
                generate(recipes[0], self.store, **again)
            assert contents(self.store) == expected[0]
            names = {path.name for path in self.folder.iterdir()}
            assert names == {self.store.name, f"{self.store.name}.log"}
            shutil.rmtree(self.folder)

    return Histories


@pytest.mark.usefixtures("flown")
def test_no_history_loses_anything(recipes, operations):
    run_state_machine_as_test(
        machine(recipes, operations),
        settings=settings(
            max_examples=HISTORIES,
            stateful_step_count=STEPS,
            deadline=None,
            phases=[phase for phase in Phase if phase not in (Phase.shrink, Phase.explain)],
            suppress_health_check=list(HealthCheck),
        ),
    )
