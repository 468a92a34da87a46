"""The current in the native step, by code that is compiled when one is first met."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.compiled import changed
from twin.physics.lookup_tables import Tables
from twin.physics.mujoco_model import compile_model
from twin.physics.native.late import TABLE
from twin.water.current.base import parse_current


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
