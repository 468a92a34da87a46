"""Code that is compiled inside MuJoCo's step: errors there reach Python and end no process."""

from __future__ import annotations

import logging
import signal
import threading
import time

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch, SimulationError

from twin.physics.lookup_tables import Tables
from twin.physics.mujoco_model import compile_model
from twin.physics.native import block as b
from twin.physics.native.flow import SAMPLER
from twin.physics.native.install import install
from twin.physics.native.late import REFUSED
from twin.physics.native.plane import LAYER
from twin.water.current.base import parse_current
from twin.water.floor.bathymetry import parse_floor

STEPS = 30


@pytest.fixture(scope="module")
def model():
    current = parse_current("uniform:0.2,-0.1").compile(60.0)
    return compile_model("glider", tables=Tables(current=current))


@pytest.fixture
def failing(monkeypatch):
    """Forget what was compiled, and have compiling it again fail at first."""

    def fail(error: BaseException, times: int, late=SAMPLER) -> list[BaseException]:
        compiled, left = late._compile, [error] * times

        def compile_it():
            if left:
                raise left.pop()
            return compiled()

        monkeypatch.setattr(late, "_compile", compile_it)
        late.address = 0
        return left

    yield fail
    monkeypatch.undo()
    install(current=True, floor=True)


def flown(model):
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=STEPS)
    return data.qpos.tobytes() + data.qvel.tobytes()


@pytest.mark.parametrize("error", [ValueError("too hot"), SystemExit(3)])
def test_an_error_reaches_python_and_the_next_step_tries_again(model, failing, error):
    expected = flown(model)
    failing(error, 2)
    for _ in range(2):
        with pytest.raises(mujoco.FatalError, match=f"currents.*{type(error).__name__}: {error}"):
            flown(model)
    assert flown(model) == expected


@pytest.fixture
def interruptible():
    """Ctrl-C as in a terminal: what a shell starts in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interruption_comes_when_the_step_has_ended_as_it_should(model, failing):
    expected = flown(model)
    left = failing(KeyboardInterrupt(), 2)
    data = mujoco.MjData(model)
    with pytest.raises(KeyboardInterrupt):
        mujoco.mj_step(model, data, nstep=STEPS)
    assert not left
    assert data.qpos.tobytes() + data.qvel.tobytes() == expected


def test_a_floor_that_cannot_be_compiled_is_an_error_too(failing):
    floored = compile_model("glider", tables=Tables(floor=parse_floor("depth:100").compile(60.0)))
    expected = flown(floored)
    failing(ValueError("too deep"), 1, LAYER)
    with pytest.raises(mujoco.FatalError, match=r"sea floor.*too deep"):
        flown(floored)
    assert flown(floored) == expected


def test_in_threads_of_mujoco_it_fails_the_runs_and_is_logged(model, failing, caplog):
    def flown_together():
        batch = Batch(model, 8, 2)
        raised = set()
        try:
            batch.step(nstep=STEPS)
        except SimulationError:  # of those that the thread of this test has stepped
            raised = {k for k in range(8) if batch.status[k]}
        failed = [row[: b.STATE_WORDS].view(b.STATE)[0]["failed"] for row in batch.bind("userdata")]
        return np.array(batch.bind("qpos")).tobytes(), {k for k in range(8) if failed[k]}, raised

    expected, _, _ = flown_together()
    SAMPLER.address = 0
    assert flown_together() == (expected, set(), set())
    failing(ValueError("too hot"), 1000)
    with caplog.at_level(logging.ERROR):
        _, failed, raised = flown_together()
    assert failed | raised == set(range(8))
    if SAMPLER.address == REFUSED:  # else this thread has stepped them all
        assert 1 <= len(caplog.records) <= 2  # not at every step
        assert all("too hot" in record.getMessage() for record in caplog.records)
    install()
    assert SAMPLER.address == 0


def test_threads_that_meet_a_current_at_once_compile_it_once(model, monkeypatch):
    expected = flown(model)
    compiled, counted, found = SAMPLER._compile, [], []

    def compile_it():
        counted.append(1)
        time.sleep(0.1)
        return compiled()

    monkeypatch.setattr(SAMPLER, "_compile", compile_it)
    SAMPLER.address = 0
    threads = [threading.Thread(target=lambda: found.append(flown(model))) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected] * 3
    assert len(counted) == 1
