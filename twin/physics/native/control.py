"""Control: guidance or a schedule, once per control period, inside MuJoCo's step."""

from __future__ import annotations

import math

import numba

from twin.mission.guidance import GAINS, GUIDANCE_STATE, SEGMENT_COLUMNS, guidance_step
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import array, field, jit
from twin.physics.native.memory import as_f8_pointer


@jit
def run_control(block, table, data, time, state):
    """Guidance or schedule, once per control period."""
    period = block[b.P_CONTROL_PERIOD]
    step_tolerance = 1e-6 * period
    if time < state[b.U_TICKS] * period - step_tolerance:
        return
    state[b.U_TICKS] += 1.0
    control = array(field(table, data, at.D_CTRL), 3)
    rows = int(block[b.P_TABLE_ROWS])
    if block[b.P_CONTROL] == b.CONTROL_SCHEDULE:
        steps = numba.carray(as_f8_pointer(int(block[b.P_TABLE])), (rows, 4))
        k = 0
        while k + 1 < rows and time >= steps[k + 1, 0] - step_tolerance:
            k += 1
        for i in range(3):
            control[i] = steps[k, 1 + i]
        return
    qpos = array(field(table, data, at.D_QPOS), 9)
    velocity = array(field(table, data, at.D_QVEL), 6)
    hull = int(block[b.P_HULL_BODY])
    rotation = array(field(table, data, at.D_XMAT) + 72 * hull, 9)
    roll = math.atan2(rotation[7], rotation[8])
    pitch = math.asin(min(max(rotation[6], -1.0), 1.0))
    heading = math.atan2(-rotation[3], rotation[0])
    if heading < 0.0:
        heading += 2.0 * math.pi
    position = array(field(table, data, at.D_ACT), 3)
    plan = numba.carray(as_f8_pointer(int(block[b.P_TABLE])), (rows, SEGMENT_COLUMNS))
    gains = block[b.P_GAINS : b.P_GAINS + GAINS]
    memory = state[b.U_GUIDANCE : b.U_GUIDANCE + GUIDANCE_STATE]
    command = state[b.U_COMMAND : b.U_COMMAND + 3]
    guidance_step(
        plan,
        gains,
        memory,
        time,
        -qpos[2],
        roll,
        pitch,
        heading,
        velocity[3],
        -velocity[4],
        -velocity[5],
        position[0],
        position[1],
        position[2],
        command,
    )
    for i in range(3):
        control[i] = command[i]
