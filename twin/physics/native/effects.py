"""Effects: kernels of hull laws and parts by type, and the control and log of each step.

`LAWS` and `PARTS` name the kernels of their types. A type that is registered later is compiled in
when the callbacks are next installed.

`run_control` runs guidance or a schedule once per control period, inside MuJoCo's step.
`run_log` writes the samples of a run into the ring in `userdata`, inside MuJoCo's step.
"""

from __future__ import annotations

import math
from typing import Any

from twin.compiled import dispatch, jit
from twin.mission.guidance import guidance_step
from twin.mission.mission_file import (
    HEADING_SETPOINT,
    PITCH_SETPOINT,
    SEGMENT,
    SEGMENT_COLUMNS,
)
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import array, field, load_f8, load_i8, table_of
from twin.vehicle.laws import LAWS
from twin.vehicle.parts import PARTS

_UNKNOWN = (math.nan,) * 6
"""Result for a type unknown to this process: NaN makes the run fail, and zero would not."""
_MOTION = ("u", "v", "w", "p", "q", "r")


def _dispatch(
    name: str, arguments: tuple[str, ...], kinds: Any, unknown: Any, **options: bool
) -> Any:
    kernel = f"native_{name.partition('_')[2]}"
    return dispatch(
        name, arguments, lambda: kinds.kernels(kernel), unknown, module=__name__, **options
    )


law_wrench = _dispatch(
    "law_wrench", ("values", "density", *_MOTION), LAWS, _UNKNOWN, forceinline=True
)
"""(code, values, density, u, v, w, p, q, r) -> X, Y, Z, K, M, N of the hull."""
law_rate_damping = _dispatch(
    "law_rate_damping", ("values", "timestep", "density", *_MOTION), LAWS, _UNKNOWN[:3],
    forceinline=True,
)  # fmt: skip
"""(code, values, timestep, density, u, v, w, p, q, r) -> step times rate damping."""
law_rotary_damping = _dispatch(
    "law_rotary_damping", ("values", "density", *_MOTION), LAWS, _UNKNOWN, forceinline=True
)
"""(code, values, density, u, v, w, p, q, r) -> pp, pq, qq, pr, qr, rr; NaN for a law without this
kernel."""
part_wrench = _dispatch(
    "part_wrench", ("values", "place", "position", *_MOTION, "density", "depth"), PARTS, _UNKNOWN
)
"""(code, values, place, position, motion, density, depth) -> X, Y, Z, K, M, N of a part."""
part_volume = _dispatch("part_volume", ("values", "position"), PARTS, math.nan)
"""(code, values, position) -> displaced volume [cm3]."""
part_mass = _dispatch("part_mass", ("values", "position"), PARTS, math.nan)
"""(code, values, position) -> point mass [kg]."""
CONTROL_SCHEDULE = b.CONTROL_SCHEDULE


@jit
def run_control(head, start, table, data, time, state):
    """Write `ctrl` if a control period has passed."""
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
    columns = SEGMENT_COLUMNS + 3 * count
    if rows * columns > plan.size:
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
    segments = plan[: rows * columns].reshape((rows, columns))
    guidance_step(
        segments, head.gains, state.guidance, time, -position[2], roll, pitch, heading,
        velocity[3], -velocity[4], -velocity[5], control, state.altitude,
        position[0], -position[1],
    )  # fmt: skip


@jit
def run_log(head, table, model, data, time, state):
    """Start a log row when one is due; complete the previous row with its acceleration.

    Sample k goes to row k modulo the ring, so the ring holds the last `log_ring` samples. The
    numbers are in the order of `block.log_row`.
    """
    nq, nv, nu, ring = int(head.nq), int(head.nv), int(head.nu), int(head.log_ring)
    if ring < 1 or not 0.0 <= state.logged <= head.log_samples:
        return
    width = 17 + nq + nv + 2 * nu
    first = field(table, data, at.D_USERDATA) + 8 * b.STATE_WORDS
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
