"""Native callbacks: where MuJoCo keeps its fields, whom they touch, and what is compiled late."""

import logging
import signal
import threading
import time

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch, SimulationError
from physics import glider

from twin.compiled import changed
from twin.errors import LayoutError, TwinError
from twin.physics.model_block import Tables
from twin.physics.mujoco_model import compile_model
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as layout
from twin.physics.native.install import install, uninstall
from twin.physics.native.late import LAYER, REFUSED, SAMPLER, TABLE
from twin.water.current.base import parse_current
from twin.water.floor.bathymetry import parse_floor

OTHER = """<mujoco><custom><numeric name="big" size="400" data="7"/></custom>
<worldbody><body><freejoint/><geom size=".1"/><body pos="0 0 1"><joint/><geom size=".1"/></body>
</body></worldbody><actuator><general joint="" dyntype="user" actdim="1"/></actuator></mujoco>"""


def test_derived_offsets_pass_the_proof():
    table = layout.derive()
    layout.prove(table, 101, 203)
    places = {(owner, int(at)) for (owner, _), at in zip(layout._FIELDS, table, strict=False)}
    assert len(places) == layout.SLOTS - 1


@pytest.mark.parametrize("slot", range(layout.SLOTS))
def test_a_shifted_field_is_refused(slot):
    table = layout.derive().copy()
    table[slot] += 8
    with pytest.raises(LayoutError, match=r"MuJoCo .* is not at byte .*constraints.txt"):
        layout.prove(table, 101, 203)


def test_another_model_in_the_process_is_untouched():
    glider()  # installs the callbacks
    xml = OTHER.replace("<joint/>", '<joint name="hinge"/>').replace('joint=""', 'joint="hinge"')
    uninstall()
    try:
        bare = _roll_out(xml)
    finally:
        install()
    np.testing.assert_array_equal(_roll_out(xml), bare)


def test_the_clock_of_timers_is_read_by_no_step_but_where_it_was_given():
    model, data = glider()
    mujoco.mj_step(model, data)
    assert not any(timer.duration for timer in data.timer)
    uninstall()
    try:
        mujoco.mj_step(model, data)
        assert data.timer[0].duration > 0.0  # as MuJoCo's package has it
    finally:
        install()
    mujoco.set_mjcb_time(time.perf_counter)
    try:
        install()
        before = data.timer[0].duration
        mujoco.mj_step(model, data)
        assert data.timer[0].duration > before
    finally:
        mujoco.set_mjcb_time(None)
        install()


def _roll_out(xml):
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    data.qvel[:] = 0.1
    mujoco.mj_step(model, data, nstep=50)
    return np.concatenate([data.qpos, data.qvel, data.act, data.xfrc_applied.ravel()])


def test_a_foreign_callback_is_not_silently_replaced():
    glider()
    uninstall()
    mujoco.set_mjcb_passive(lambda model, data: None)
    try:
        with pytest.raises(TwinError, match="mjcb_passive is already taken"):
            install()
    finally:
        mujoco.set_mjcb_passive(None)
        install()


def test_users_own_forces_survive():
    """Rows of other bodies are the user's alone; test_user_force.py has the hull's."""
    model, data = glider()
    battery = model.body("battery").id
    data.xfrc_applied[battery, 1] = 3.0
    data.qfrc_applied[2] = -5.0
    mujoco.mj_forward(model, data)
    assert data.xfrc_applied[battery, 1] == 3.0
    assert data.qfrc_applied[2] == -5.0
    assert data.qfrc_smooth[2] < -4.0


# --- compiled inside the step: errors there reach Python and end no process ----------------------


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


def drifted(model):
    data = mujoco.MjData(model)
    for _ in range(50):
        mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel])


def test_a_current_is_sampled_by_code_that_is_compiled_when_one_is_met():
    program = parse_current("uniform:0.2,-0.1").compile(60.0)
    model = compile_model("glider", tables=Tables(current=program))
    assert TABLE[0] != 0
    beforehand = drifted(model)
    TABLE[0] = 0  # as in a process that loads the model, or gives a current to one without
    late = drifted(model)
    assert TABLE[0] != 0
    assert late.tobytes() == beforehand.tobytes()
    still = drifted(compile_model("glider"))
    assert np.abs(late - still)[:2].max() > 1e-3
    changed()  # as a kind of current does that is registered
    try:
        compile_model("glider")
        assert TABLE[0] == 0
        assert drifted(model).tobytes() == beforehand.tobytes()
    finally:
        changed()
