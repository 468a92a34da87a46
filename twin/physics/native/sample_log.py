"""Log: the samples of a run, written inside MuJoCo's step."""

from __future__ import annotations

from twin.mission.guidance import HEADING_SETPOINT, PITCH_SETPOINT, SEGMENT
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import array, field, jit
from twin.physics.native.memory import load_f8, load_i8


@jit
def run_log(block, table, model, data, time, state):
    """Begin a log row when one is due; close the previous one with its acceleration."""
    qvel = array(field(table, data, at.D_QVEL), 8)
    timestep = load_f8(model + load_i8(table + 8 * at.M_TIMESTEP))
    logged = int(state[b.U_LOGGED])
    first = int(block[b.P_LOG])
    if state[b.U_OPEN] == 1.0:
        last = array(first + 8 * b.ROW * (logged - 1), b.ROW)
        elapsed = time - last[b.R_TIME]
        if elapsed > 0.5 * timestep:
            for i in range(6):
                last[b.R_ACCELERATION + i] = (qvel[i] - last[b.R_QVEL + i]) / elapsed
            state[b.U_OPEN] = 0.0
    due = logged * block[b.P_LOG_PERIOD]
    if logged >= int(block[b.P_LOG_ROWS]) or time < due - 0.5 * timestep:
        return
    row = array(first + 8 * b.ROW * logged, b.ROW)
    qpos = array(field(table, data, at.D_QPOS), 9)
    act = array(field(table, data, at.D_ACT), 3)
    control = array(field(table, data, at.D_CTRL), 3)
    row[b.R_TIME] = time
    for i in range(9):
        row[b.R_QPOS + i] = qpos[i]
    for i in range(8):
        row[b.R_QVEL + i] = qvel[i]
    for i in range(3):
        row[b.R_ACT + i] = act[i]
        row[b.R_CTRL + i] = control[i]
        row[b.R_CURRENT + i] = state[b.U_CURRENT + i]
    row[b.R_DENSITY] = state[b.U_DENSITY]
    row[b.R_IMMERSION] = state[b.U_IMMERSION]
    row[b.R_NET_MASS] = state[b.U_NET_MASS]
    row[b.R_PITCH_SETPOINT] = state[b.U_GUIDANCE + PITCH_SETPOINT]
    row[b.R_HEADING_SETPOINT] = state[b.U_GUIDANCE + HEADING_SETPOINT]
    row[b.R_SEGMENT] = state[b.U_GUIDANCE + SEGMENT]
    state[b.U_LOGGED] += 1.0
    state[b.U_OPEN] = 1.0
