"""Control: guidance or a schedule, once per control period, inside MuJoCo's step."""

from __future__ import annotations

import math

from twin.compiled import jit
from twin.mission.guidance import guidance_step
from twin.mission.table import SEGMENT_COLUMNS
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import array, field, table_of

CONTROL_SCHEDULE = b.CONTROL_SCHEDULE


@jit
def run_control(head, start, table, data, time, state):
    """Write `ctrl` when a control period has passed."""
    period = head.control_period
    step_tolerance = 1e-6 * period
    if time < state.ticks * period - step_tolerance:
        return
    state.ticks += 1.0
    count, rows = int(head.nu), int(head.plan_rows)
    control = array(field(table, data, at.D_CTRL), count)
    plan = table_of(start, head, head.plan)
    if rows < 1:
        return
    if head.control == CONTROL_SCHEDULE:
        width = 1 + count
        if rows * width > plan.size:
            return
        k = 0
        while k + 1 < rows and time >= plan[(k + 1) * width] - step_tolerance:
            k += 1
        for i in range(count):
            control[i] = plan[k * width + 1 + i]
        return
    if rows * (SEGMENT_COLUMNS + 3 * count) > plan.size:
        return
    hull = int(head.hull_body)
    velocity = array(field(table, data, at.D_QVEL), 6)
    rotation = array(field(table, data, at.D_XMAT) + 72 * hull, 9)
    roll = math.atan2(rotation[7], rotation[8])
    pitch = math.asin(min(max(rotation[6], -1.0), 1.0))
    heading = math.atan2(-rotation[3], rotation[0])
    if heading < 0.0:
        heading += 2.0 * math.pi
    position = array(field(table, data, at.D_QPOS), 7)
    depth = -position[2]
    guidance_step(
        plan[: rows * (SEGMENT_COLUMNS + 3 * count)].reshape((rows, SEGMENT_COLUMNS + 3 * count)),
        head.gains,
        state.guidance,
        time,
        depth,
        roll,
        pitch,
        heading,
        velocity[3],
        -velocity[4],
        -velocity[5],
        control,
        state.altitude,
        position[0],
        -position[1],
    )
