"""Sample log: the samples of a run, written inside MuJoCo's step into the ring in `userdata`."""

from __future__ import annotations

from twin.compiled import jit
from twin.mission.mission_file import HEADING_SETPOINT, PITCH_SETPOINT, SEGMENT
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import array, field, load_f8, load_i8

STATE_WORDS = b.STATE_WORDS


@jit
def run_log(head, table, model, data, time, state):
    """Begin a log row when one is due; close the previous one with its acceleration.

    The row of sample k is row k modulo the ring: the last `log_ring` samples are there. The order
    of the numbers is that of `block.log_row`.
    """
    nq, nv, nu, ring = int(head.nq), int(head.nv), int(head.nu), int(head.log_ring)
    if ring < 1 or not 0.0 <= state.logged <= head.log_samples:
        return
    width = 17 + nq + nv + 2 * nu
    first = field(table, data, at.D_USERDATA) + 8 * STATE_WORDS
    qvel = array(field(table, data, at.D_QVEL), nv)
    timestep = load_f8(model + load_i8(table + 8 * at.M_TIMESTEP))
    logged = int(state.logged)
    if state.open == 1.0 and logged > 0:
        last = array(first + 8 * width * ((logged - 1) % ring), width)
        elapsed = time - last[0]
        if elapsed > 0.5 * timestep:
            for i in range(6):
                last[width - 6 + i] = (qvel[i] - last[1 + nq + i]) / elapsed
            state.open = 0.0
    due = logged * head.log_period
    if logged >= head.log_samples or time < due - 0.5 * timestep:
        return
    row = array(first + 8 * width * (logged % ring), width)
    qpos = array(field(table, data, at.D_QPOS), nq)
    act = array(field(table, data, at.D_ACT), nu)
    control = array(field(table, data, at.D_CTRL), nu)
    row[0] = time
    k = 1
    for i in range(nq):
        row[k + i] = qpos[i]
    k += nq
    for i in range(nv):
        row[k + i] = qvel[i]
    k += nv
    for i in range(nu):
        row[k + i] = act[i]
        row[k + nu + i] = control[i]
    k += 2 * nu
    for i in range(3):
        row[k + i] = state.current[i]
    row[k + 3] = state.density
    row[k + 4] = state.immersion
    row[k + 5] = state.net_mass
    row[k + 6] = state.contact
    state.contact = 0.0
    row[k + 7] = state.guidance[PITCH_SETPOINT]
    row[k + 8] = state.guidance[HEADING_SETPOINT]
    row[k + 9] = state.guidance[SEGMENT]
    for i in range(6):
        row[k + 10 + i] = 0.0
    state.logged += 1.0
    state.open = 1.0
