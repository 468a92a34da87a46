"""Lanes: compiled flight of many vehicles of one structure at once (the batched engine).

One call flies a block (`twin.fossen.lane_block`) through many steps, with guidance at the control
period and logging at the sample period. Every lane has its own water and its own plan.

Integrator: one evaluation per step. Velocities v advance by Adams and Bashforth's two-step method,
with the damping D of the body's rates implicit relative to the acceleration x of the step before,

    (M + g D) x = F(y) + g D x_before,      v += h (3/2 x - 1/2 x_before).

The method has order 2 for any D. For g = h it is stable at any damping, also where the law damps up
to twice as much as D says. A pose advances by the velocity at the middle of the step, v + h (x -
1/2 x_before) with the old v. For oscillations, such as a hull's heave and pitch at the surface,
that is the leapfrog method, which neither damps nor excites while h omega < 2. Parts move by their
exact solution. The water is looked up every LOOKS steps, with an error that also falls with
the square of the step.
"""

from __future__ import annotations

import math

from twin.compiled import borrowing, elementary
from twin.compiled.portable import call_rate, portable, widest_vectors
from twin.fossen.equations import FASTEST, part_after
from twin.fossen.lane_block import AT, PART, PARTS_AT, POSE_WORDS, STATE_WORDS
from twin.fossen.terms import immersed, rotation
from twin.mission.controller import MEMORY, followed
from twin.mission.guidance import guidance_step
from twin.mission.mission_file import DONE, HEADING_SETPOINT, PITCH_SETPOINT, SEGMENT
from twin.water.current.sampler import sample_gradient
from twin.water.density import density_at, density_slope_at
from twin.water.floor.lookup import floor_depth

_guided, _flow = portable(guidance_step), portable(sample_gradient)
NO_CONTROL, PLAN, SCHEDULE = 0.0, 1.0, 2.0
"""Sources of a lane's commands: none (the parts stay), a plan with guidance, a schedule."""
COUNTS = (
    "ticks", "ended", "failed", "fail_time", "floor_time", "control", "open_ended", "samples",
    "logged", "leg", "leg_time",
)  # fmt: skip
"""State of each lane: control ticks; 1: ended, 2: ended by its samples; 1: failed, and its time;
time at the sea floor, NaN: never; source of commands; 1: ends once its plan is flown; samples of
the run, and samples logged; memory of `followed` (leg, time)."""
TICKS, ENDED, FAILED, FAIL_TIME, FLOOR_TIME, CONTROL, OPEN_ENDED, SAMPLES, LOGGED, LEG = range(
    len(COUNTS) - MEMORY + 1
)
LOOKS = 3
"""Steps between look-ups of the water; a look-up takes the lane's place at the middle step, and the
water is linear about it."""
STATE, RATE, BEFORE, GOING = AT["state"], AT["rate"], AT["before"], AT["going"]
LOOKED, FLOW, DENSITY, DENSITY_SLOPE = AT["looked"], AT["flow"], AT["density"], AT["density_slope"]
TEMPERATURE, TEMPERATURE_SLOPE = AT["temperature"], AT["temperature_slope"]
IMMERSION, LEVER, CURRENT = AT["immersion"], AT["lever"], AT["current"]
WATER, NET_MASS, PATH_RATE = AT["water"], AT["net_mass"], AT["path_rate"]
EULER, LENGTH, DIAMETER, ALIVE = AT["euler"], AT["length"], AT["diameter"], AT["alive"]
WRONG = AT["wrong"]
TIME = AT["time"]
P_NOW, P_COMMAND, P_LOW, P_HIGH, P_LAG, P_RATE, P_ONE_WAY = range(len(PART))


@borrowing(nogil=True)
def _move_parts(b, lanes, parts, h):  # type: ignore[no-untyped-def]
    """Move every part to the end of the step."""
    widest_vectors()
    # each row is a vector of its own, so the compiler knows that indices are not negative
    rows = b.reshape(-1, lanes)[PARTS_AT : PARTS_AT + len(PART) * parts]
    for k in range(parts):
        now, command = rows[k], rows[P_COMMAND * parts + k]
        low, high = rows[P_LOW * parts + k], rows[P_HIGH * parts + k]
        lag, rate = rows[P_LAG * parts + k], rows[P_RATE * parts + k]
        one_way = rows[P_ONE_WAY * parts + k]
        for l in range(lanes):
            now[l] = part_after(now[l], command[l], low[l], high[l], lag[l], rate[l], one_way[l], h)


MANY_AWASH = 0.25
"""Fraction of lanes at the surface; beyond it, all lanes are computed together."""


@borrowing
def _immerse_lanes(b, lanes, first, last):  # type: ignore[no-untyped-def]
    """Compute the immersion of lanes `first` to `last` - 1, strip by strip."""
    for l in range(first, last):
        at = (STATE + 3) * lanes + l
        turn = rotation(b[at], b[at + lanes], b[at + 2 * lanes], b[at + 3 * lanes])
        depth, length = b[(STATE + 2) * lanes + l], b[LENGTH * lanes + l]
        found = immersed(depth, turn[6], length, b[DIAMETER * lanes + l])
        b[IMMERSION * lanes + l], b[LEVER * lanes + l] = found[0], found[1]


@borrowing(nogil=True)
def _immerse_hulls(b, lanes):  # type: ignore[no-untyped-def]
    """Compute the immersion of every hull."""
    widest_vectors()
    rows = b.reshape(-1, lanes)
    depth, length, diameter = rows[STATE + 2], rows[LENGTH], rows[DIAMETER]
    immersion, lever = rows[IMMERSION], rows[LEVER]
    awash = 0.0
    for l in range(lanes):
        deep = depth[l] - 0.5 * length[l] >= 0.5 * diameter[l]
        immersion[l], lever[l] = 1.0 if deep else 0.0, 0.0
        awash += 0.0 if deep else 1.0
    if awash > MANY_AWASH * lanes:
        _immerse_lanes(b, lanes, 0, lanes)
    elif awash > 0.0:
        for l in range(lanes):
            if immersion[l] == 0.0:
                _immerse_lanes(b, lanes, l, l + 1)


@borrowing(nogil=True)
def _look_up_water(  # type: ignore[no-untyped-def]
    b, lanes, h, counts, programs, program_at, densities, density_from, warmths, warmth_from,
    floors, floor_at,
):  # fmt: skip
    """Look up current and water with their slopes, every LOOKS steps, at the middle of these steps.

    A lane that has reached the sea floor ends.
    """
    for l in range(lanes):
        t = b[TIME * lanes + l]
        step = math.floor(t / h + 0.5)
        if step - LOOKS * math.floor(step / LOOKS) != 0.0:
            continue
        at, way, seen = STATE * lanes + l, RATE * lanes + l, LOOKED * lanes + l
        ahead = 0.5 * (LOOKS - 1) * h
        t += ahead
        if b[seen + 3 * lanes] == t:
            continue
        north, east = b[at] + ahead * b[way], b[at + lanes] + ahead * b[way + lanes]
        depth = b[at + 2 * lanes] + ahead * b[way + 2 * lanes]
        b[seen], b[seen + lanes], b[seen + 2 * lanes] = north, east, depth
        b[seen + 3 * lanes] = t
        first, last = program_at[l], program_at[l + 1]
        if last > first:
            flow = _flow(programs[first:last], t, north, east, depth)
            for k in range(15):
                b[(FLOW + k) * lanes + l] = flow[k]
        first, last = density_from[l], density_from[l + 1]
        if last > first:
            table = densities[first:last]
            b[DENSITY * lanes + l] = density_at(table, depth)
            b[DENSITY_SLOPE * lanes + l] = density_slope_at(table, depth)
        first, last = warmth_from[l], warmth_from[l + 1]
        if last > first:
            table = warmths[first:last]
            b[TEMPERATURE * lanes + l] = density_at(table, depth)
            b[TEMPERATURE_SLOPE * lanes + l] = density_slope_at(table, depth)
        first, last = floor_at[l], floor_at[l + 1]
        if last > first and b[ALIVE * lanes + l] != 0.0:
            altitude = floor_depth(floors[first:last], north, east) - depth
            if altitude < 0.5 * b[DIAMETER * lanes + l]:
                counts[l, FLOOR_TIME], b[ALIVE * lanes + l] = t, 0.0


@borrowing(nogil=True)
def _compute_angles(b, lanes):  # type: ignore[no-untyped-def]
    """Compute roll, pitch, heading [rad] of every lane; heading in [0, 2 pi)."""
    widest_vectors()
    for l in range(lanes):
        at = (STATE + 3) * lanes + l
        r = rotation(b[at], b[at + lanes], b[at + 2 * lanes], b[at + 3 * lanes])
        heading = elementary.atan2(r[3], r[0])
        b[EULER * lanes + l] = elementary.atan2(r[7], r[8])
        b[(EULER + 1) * lanes + l] = elementary.asin(-r[6])
        b[(EULER + 2) * lanes + l] = heading + (2.0 * math.pi if heading < 0.0 else 0.0)


@borrowing(nogil=True)
def _guide_lanes(  # type: ignore[no-untyped-def]
    b, lanes, t, parts, counts, plans, plan_rows, periods, gains, guided, wanted, floors, floor_at,
    follows, follow_at,
):  # fmt: skip
    """Guide each lane whose control period has passed; returns the time of the next tick."""
    _compute_angles(b, lanes)
    for l in range(lanes):
        mine = counts[l]
        period = periods[l]
        tolerance = 1e-6 * period
        if mine[CONTROL] == NO_CONTROL or b[ALIVE * lanes + l] == 0.0:
            continue
        if t < mine[TICKS] * period - tolerance:
            continue
        mine[TICKS] += 1.0
        command = wanted[l]
        if mine[CONTROL] == SCHEDULE:
            k = 0
            while k + 1 < plan_rows[l] and t >= plans[l, k + 1, 0] - tolerance:
                k += 1
            for i in range(parts):
                command[i] = plans[l, k, 1 + i]
        else:
            at = STATE * lanes + l
            north, east, depth = b[at], b[at + lanes], b[at + 2 * lanes]
            altitude = math.inf
            if floor_at[l + 1] > floor_at[l]:
                altitude = floor_depth(floors[floor_at[l] : floor_at[l + 1]], north, east) - depth
            _guided(
                plans[l, : plan_rows[l]], gains[l], guided[l], t, depth,
                b[EULER * lanes + l], b[(EULER + 1) * lanes + l], b[(EULER + 2) * lanes + l],
                b[at + 10 * lanes], b[at + 11 * lanes], b[at + 12 * lanes],
                command, altitude, north, east,
            )  # fmt: skip
            if follow_at[l + 1] > follow_at[l] and guided[l, DONE] == 0.0:
                table = follows[follow_at[l] : follow_at[l + 1]]
                command[int(table[0])] = followed(table, mine[LEG:], t, guided[l, SEGMENT])
        for i in range(parts):
            b[(PARTS_AT + P_COMMAND * parts + i) * lanes + l] = command[i]
    due = math.inf
    for l in range(lanes):
        if counts[l, CONTROL] != NO_CONTROL:
            due = min(due, counts[l, TICKS] * periods[l] - 1e-6 * periods[l])
    return due


@borrowing(nogil=True)
def _log(b, lanes, t, parts, joints, counts, guided, log, sample):  # type: ignore[no-untyped-def]
    """Write one row of each lane's log, with the numbers of the MuJoCo twin's log in their order.

    Axes are MuJoCo's: z up, hull forward, port, up; positions first, then velocities.
    """
    nj = joints.size
    for l in range(lanes):
        if b[ALIVE * lanes + l] == 0.0 or counts[l, ENDED] != 0.0:
            continue
        row = log[l, sample]
        y, f = STATE * lanes + l, RATE * lanes + l
        w, x, yy, z = b[y + 3 * lanes], b[y + 4 * lanes], b[y + 5 * lanes], b[y + 6 * lanes]
        row[0] = t
        row[1], row[2], row[3] = b[y], -b[y + lanes], -b[y + 2 * lanes]
        row[4], row[5], row[6], row[7] = w, x, -yy, -z
        v = 8 + nj
        row[v], row[v + 1], row[v + 2] = b[f], -b[f + lanes], -b[f + 2 * lanes]
        row[v + 3], row[v + 4], row[v + 5] = (
            b[y + 10 * lanes], -b[y + 11 * lanes], -b[y + 12 * lanes]
        )  # fmt: skip
        a = v + 6 + nj
        for i in range(parts):
            place = (PARTS_AT + i) * lanes + l
            row[a + i] = b[place + P_NOW * parts * lanes]
            row[a + parts + i] = b[place + P_COMMAND * parts * lanes]
        for j in range(nj):
            place = (PARTS_AT + joints[j]) * lanes + l
            now, command = b[place + P_NOW * parts * lanes], b[place + P_COMMAND * parts * lanes]
            low, high = b[place + P_LOW * parts * lanes], b[place + P_HIGH * parts * lanes]
            rate = b[place + P_RATE * parts * lanes]
            gap = min(max(command, low), high) - now
            row[8 + j] = now
            row[v + 6 + j] = min(max(gap / b[place + P_LAG * parts * lanes], -rate), rate)
        k = a + 2 * parts
        for i in range(3):
            row[k + i] = b[(CURRENT + i) * lanes + l]
        row[k + 3], row[k + 4] = b[WATER * lanes + l], b[IMMERSION * lanes + l]
        row[k + 5], row[k + 6] = b[NET_MASS * lanes + l], 0.0
        row[k + 7], row[k + 8] = guided[l, PITCH_SETPOINT], guided[l, HEADING_SETPOINT]
        row[k + 9] = guided[l, SEGMENT]
        # d(velocity over ground)/dt = R (dv_r/dt + omega x v_r) + dV_c/dt along the path
        turn = rotation(w, x, yy, z)
        u, vv, ww = b[y + 7 * lanes], b[y + 8 * lanes], b[y + 9 * lanes]
        p, q, r = b[y + 10 * lanes], b[y + 11 * lanes], b[y + 12 * lanes]
        ax = b[f + 7 * lanes] + (q * ww - r * vv)
        ay = b[f + 8 * lanes] + (r * u - p * ww)
        az = b[f + 9 * lanes] + (p * vv - q * u)
        for i in range(3):
            sign = 1.0 if i == 0 else -1.0
            along = turn[3 * i] * ax + turn[3 * i + 1] * ay + turn[3 * i + 2] * az
            row[k + 10 + i] = sign * (along + b[(PATH_RATE + i) * lanes + l])
            row[k + 13 + i] = sign * b[f + (10 + i) * lanes]
        counts[l, LOGGED] += 1.0
        if counts[l, LOGGED] >= counts[l, SAMPLES]:
            counts[l, ENDED], b[ALIVE * lanes + l] = 2.0, 0.0


@borrowing(nogil=True)
def _advance(b, lanes, h):  # type: ignore[no-untyped-def]
    """Advance the lanes that fly to the end of the step, by the rates now and one step before."""
    widest_vectors()
    for k in range(POSE_WORDS):
        at, going = (STATE + k) * lanes, (GOING + k if k < 3 else RATE + k) * lanes
        for l in range(lanes):
            here = b[at + l]
            there = here + h * b[going + l]
            b[at + l] = there if b[ALIVE * lanes + l] != 0.0 else here
    for k in range(POSE_WORDS, STATE_WORDS):
        at, now, before = (STATE + k) * lanes, (RATE + k) * lanes, (BEFORE + k - POSE_WORDS) * lanes
        for l in range(lanes):
            here, rate = b[at + l], b[now + l]
            there = here + h * (1.5 * rate - 0.5 * b[before + l])
            b[at + l] = there if b[ALIVE * lanes + l] != 0.0 else here
            b[before + l] = rate
    for l in range(lanes):
        i = (STATE + 3) * lanes + l
        w, x, y, z = b[i], b[i + lanes], b[i + 2 * lanes], b[i + 3 * lanes]
        scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
        b[i], b[i + lanes] = w * scale, x * scale
        b[i + 2 * lanes], b[i + 3 * lanes] = y * scale, z * scale


@borrowing(nogil=True)
def _end_unstable(b, lanes, h, counts):  # type: ignore[no-untyped-def]
    """End lanes whose state is not finite, faster than FASTEST or above one radian per step."""
    widest_vectors()
    wrong = 0.0
    for l in range(lanes):
        i = (STATE + 7) * lanes + l
        u, v, w = b[i], b[i + lanes], b[i + 2 * lanes]
        p, q, r = b[i + 3 * lanes], b[i + 4 * lanes], b[i + 5 * lanes]
        ok = (u * u + v * v + w * w <= FASTEST * FASTEST) and (
            (p * p + q * q + r * r) * h * h <= 1.0
        )
        b[WRONG * lanes + l] = 0.0 if ok else 1.0
    for l in range(lanes):
        wrong = max(wrong, b[WRONG * lanes + l])
    if wrong == 0.0:
        return
    for l in range(lanes):
        if b[WRONG * lanes + l] != 0.0 and b[ALIVE * lanes + l] != 0.0:
            counts[l, FAILED], counts[l, FAIL_TIME] = 1.0, b[TIME * lanes + l] + h
            b[ALIVE * lanes + l] = 0.0


@borrowing(nogil=True)
def _living_lanes(b, lanes):  # type: ignore[no-untyped-def]
    """Number of lanes that still fly."""
    alive = 0
    for l in range(lanes):
        if b[ALIVE * lanes + l] != 0.0:
            alive += 1
    return alive


@borrowing(nogil=True)
def fly(  # type: ignore[no-untyped-def]
    b, lanes, address, rate, parts, joints, h, first, last, per_sample, per_look,
    counts, plans, plan_rows, periods, gains, guided, wanted, programs, program_at,
    densities, density_at_, warmths, warmth_at, floors, floor_at,
    follows, follow_at, log, first_sample,
):  # fmt: skip
    """Fly a block from step `first` to before step `last`; returns how many lanes still fly.

    Args:
      b: the block of `lanes` lanes; `address` is the address of its first number.
      rate: address of the structure's function.
      parts: number of a vehicle's parts. joints: parts that move a joint, in the log's order.
      h: [s] step. per_sample: steps between samples. per_look: steps between checks of whether a
        plan is done.
      counts: (lanes, len(COUNTS)). plans: (lanes, rows, columns), with `plan_rows` of each lane.
      periods: [s] of control. gains, guided, wanted: (lanes, ...): gains and state of guidance,
        and the commands of the last tick.
      programs, program_at: compiled currents behind each other, and where each begins; likewise
        densities, water temperatures, sea floors and followed positions.
      log: (lanes, samples, width) from sample `first_sample` on.
    """
    due = 0.0
    for step in range(first, last):
        t = step * h
        for l in range(lanes):
            b[TIME * lanes + l] = t
        if step % per_look == 0 and step > 0:
            for l in range(lanes):
                done = counts[l, OPEN_ENDED] != 0.0 and guided[l, DONE] != 0.0
                if done and b[ALIVE * lanes + l] != 0.0:
                    counts[l, ENDED], b[ALIVE * lanes + l] = 1.0, 0.0
        if step % per_sample == 0 and _living_lanes(b, lanes) == 0:
            return 0
        if t >= due:
            due = _guide_lanes(
                b, lanes, t, parts, counts, plans, plan_rows, periods, gains, guided, wanted,
                floors, floor_at, follows, follow_at,
            )  # fmt: skip
        _look_up_water(
            b, lanes, h, counts, programs, program_at, densities, density_at_, warmths, warmth_at,
            floors, floor_at,
        )  # fmt: skip
        _immerse_hulls(b, lanes)
        if step == 0:  # no step before: use the rate at the start
            call_rate(rate, address, 0.0)
            for i in range((STATE_WORDS - POSE_WORDS) * lanes):
                b[BEFORE * lanes + i] = b[(RATE + POSE_WORDS) * lanes + i]
        call_rate(rate, address, h)
        if step % per_sample == 0:
            _log(b, lanes, t, parts, joints, counts, guided, log, step // per_sample - first_sample)
        _advance(b, lanes, h)
        _move_parts(b, lanes, parts, h)
        _end_unstable(b, lanes, h, counts)
    return _living_lanes(b, lanes)


@borrowing(nogil=True)
def go_on(  # type: ignore[no-untyped-def]
    blocks, lanes, address, rate, parts, h, steps, fresh, counts, programs, program_at, densities,
    density_at_, warmths, warmth_at, floors, floor_at,
):  # fmt: skip
    """Advance blocks by `steps` steps under the commands in their rows.

    Does the same as `fly` between two samples; at the end, rates, water and angles are computed
    for the new states.

    Args:
      blocks: (blocks, numbers) of one structure; `address` is that of the first number.
      rate, parts, h: as in `fly`. steps: 0 only begins.
      fresh: (blocks, lanes) True for a new start, which has no step before.
      counts: (blocks, lanes, len(COUNTS)).
      programs, program_at, ...: of all lanes, as in `fly`.
    """
    for k in range(len(blocks)):
        b, own, at = blocks[k], counts[k], address + 8 * k * blocks.shape[1]
        programs_of = program_at[k * lanes : (k + 1) * lanes + 1]
        densities_of = density_at_[k * lanes : (k + 1) * lanes + 1]
        warmths_of = warmth_at[k * lanes : (k + 1) * lanes + 1]
        for step in range(-1, steps):
            if step == -1:
                if not fresh[k].any():
                    continue
            else:
                _advance(b, lanes, h)
                _move_parts(b, lanes, parts, h)
                _end_unstable(b, lanes, h, own)
                for l in range(lanes):
                    b[TIME * lanes + l] = (math.floor(b[TIME * lanes + l] / h + 0.5) + 1.0) * h
            _look_up_water(
                b, lanes, h, own, programs, programs_of, densities, densities_of, warmths,
                warmths_of, floors, floor_at[k * lanes : (k + 1) * lanes + 1],
            )  # fmt: skip
            _immerse_hulls(b, lanes)
            if step == -1:
                call_rate(rate, at, 0.0)
                for i in range(STATE_WORDS - POSE_WORDS):
                    for l in range(lanes):
                        if fresh[k, l]:
                            b[(BEFORE + i) * lanes + l] = b[(RATE + POSE_WORDS + i) * lanes + l]
            call_rate(rate, at, h)
        _compute_angles(b, lanes)
