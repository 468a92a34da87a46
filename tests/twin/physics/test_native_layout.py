"""The native callbacks look only where MuJoCo keeps its fields, and touch only gliders."""

from __future__ import annotations

import time

import mujoco
import numpy as np
import pytest
from physics import glider, set_motion

from twin.errors import LayoutError, TwinError
from twin.physics.native import struct_offsets as layout
from twin.physics.native.install import install, uninstall

OTHER = """<mujoco><custom><numeric name="big" size="400" data="7"/></custom>
<worldbody><body><freejoint/><geom size=".1"/><body pos="0 0 1"><joint/><geom size=".1"/></body>
</body></worldbody><actuator><general joint="" dyntype="user" actdim="1"/></actuator></mujoco>"""


def test_derived_offsets_pass_the_proof():
    table = layout.derive()
    layout.prove(table, 101, 203)
    for fields in (layout._MODEL_FIELDS, layout._DATA_FIELDS):
        assert len({int(table[slot]) for slot in fields}) == len(fields)


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


def test_two_gliders_in_one_process_do_not_disturb_each_other():
    tracks = []
    for _ in range(2):
        model, data = glider()
        set_motion(data, pitch=-0.3, velocity=(0.3, 0.0, 0.1))
        mujoco.mj_step(model, data, nstep=200)
        tracks.append(data.qpos.copy())
        other, other_data = glider(vehicle="graver-2005", hydrodynamics="ellipsoid")
        mujoco.mj_step(other, other_data, nstep=50)
    np.testing.assert_array_equal(*tracks)


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
    """The hull's row of xfrc_applied is the water's; the rest is the user's."""
    model, data = glider()
    battery = model.body("battery").id
    data.xfrc_applied[battery, 1] = 3.0
    data.qfrc_applied[2] = -5.0
    mujoco.mj_forward(model, data)
    assert data.xfrc_applied[battery, 1] == 3.0
    assert data.qfrc_applied[2] == -5.0
    assert data.qfrc_smooth[2] < -4.0
