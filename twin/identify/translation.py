"""Translation: velocity of a glider whose attitude is known, from its buoyancy and its drag.

A log has the glider's attitude at every moment, and not its velocity. With the attitude as input
three equations of the twin remain (Fossen 2011, eq. 6.114):

    (m I + A) dv/dt = -omega x (m I + A) v + F(v) + net mass * g * down,

with v the velocity through the water in body axes, A the translational block of the added mass
and F the force law of docs/physics/equations.md. With dv/dt = 0 this is the steady flight model. At
an inflection, where the pump passes neutral, nothing is steady: the momentum carries the glider on
for tens of seconds, and the speed there needs the equation above.

Surge is kept at zero or above: in these equations a plate at a given attitude can glide backwards,
while the fins of a vehicle would turn it round at once.

The equations leave out the moments (the attitude is measured), the distance of the centre of
gravity from the centre of buoyancy, and the added mass that couples translation and rotation.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from twin.compiled import jit
from twin.compiled.elementary import scalar, sincos
from twin.errors import InputError
from twin.numbers import Array, processors
from twin.vehicle.laws.flow_frame import K_ALPHA, K_BETA, K_D0, fossen_wrench
from twin.vehicle.vehicle import Vehicle

Velocity = tuple[float, float, float]
"""Surge, sway and heave [m/s]"""

ABREAST = 8
"""Flights that one loop integrates side by side: their steps fill the vector registers."""
LONGEST_STEP = 1.0
"""[s] Longest Runge-Kutta step"""
LONGEST_DECAY = 0.7
"""Longest step as a fraction of the decay time of heave, the fastest motion: a quarter of RK4's
stability limit (2.8). A light vehicle with much lift needs shorter steps than `LONGEST_STEP`."""
MOST_STEPS = 1000
"""Largest number of steps between samples: a motion that needs more has diverged."""
FASTEST = 5.0
"""[m/s] Ten times a buoyancy glider's speed: beyond it the integration has failed."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Translation:
    """Velocity through the water, body FRD, each (time,)."""

    surge: Array
    """[m/s] Forward"""
    sway: Array
    """[m/s] To starboard"""
    heave: Array
    """[m/s] Downward"""

    @property
    def speed(self) -> Array:
        """[m/s] Speed through the water."""
        return np.sqrt(self.surge**2 + self.sway**2 + self.heave**2)

    @property
    def angle_of_attack(self) -> Array:
        """[rad] Angle of attack, atan2(heave, surge)."""
        return np.arctan2(self.heave, self.surge)

    def level(self, roll: Array, pitch: Array) -> tuple[Array, Array]:
        """Horizontal velocity [m/s] along the heading and to starboard at `roll`, `pitch` [rad]."""
        across = self.sway * np.sin(roll) + self.heave * np.cos(roll)
        starboard = self.sway * np.cos(roll) - self.heave * np.sin(roll)
        return self.surge * np.cos(pitch) + across * np.sin(pitch), starboard

    def sink_rate(self, roll: Array, pitch: Array) -> Array:
        """Downward velocity [m/s] through the water at `roll` and `pitch` [rad]."""
        return (
            -np.sin(pitch) * self.surge
            + np.cos(pitch) * np.sin(roll) * self.sway
            + np.cos(pitch) * np.cos(roll) * self.heave
        )


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class AttitudeFlight:
    """A vehicle with its attitude and its weight in water over time."""

    vehicle: Vehicle
    period: float
    """[s] Time between samples"""
    net_mass: Array
    """[kg] Mass minus that of the water displaced by the immersed volume, (time,)"""
    immersion: Array
    """[1] Wetted fraction of the hull, 0 to 1, (time,)"""
    roll: Array
    """[rad] Roll, (time,)"""
    pitch: Array
    """[rad] Pitch, (time,)"""
    rates: Array
    """[rad/s] Roll, pitch and yaw rate, body FRD, (3, time)"""
    start: Velocity = (0.0, 0.0, 0.0)
    """[m/s] Velocity at the first sample; at rest by default"""

    def __len__(self) -> int:
        return len(self.pitch)


def fly(flights: Sequence[AttitudeFlight]) -> list[Translation]:
    """Velocity through the water of each flight.

    A flight has the same bits whatever flies beside it.

    Raises:
      InputError: a speed is above FASTEST, as with wrong parameters or inputs.
    """
    order = sorted(range(len(flights)), key=lambda k: len(flights[k]))
    blocks = [order[k : k + ABREAST] for k in range(0, len(order), ABREAST)]
    found: dict[int, Array] = {}
    with concurrent.futures.ThreadPoolExecutor(processors()) as pool:
        for block, flown in zip(
            blocks, pool.map(_flown, ([flights[k] for k in block] for block in blocks)), strict=True
        ):
            found |= zip(block, flown, strict=True)
    for k, one in enumerate(flights):
        if not (np.abs(found[k]) < FASTEST).all():
            raise InputError(
                f"vehicle {one.vehicle.name!r} flies faster than {FASTEST:g} m/s in this log: its "
                "drag or its trim is far off, or the log is in other units"
            )
    velocities = (found[k] for k in range(len(flights)))
    return [Translation(surge=v[:, 0], sway=v[:, 1], heave=v[:, 2]) for v in velocities]


def _flown(flights: Sequence[AttitudeFlight]) -> list[Array]:
    """Velocities [m/s] of up to `ABREAST` flights, (time, 3) each."""
    longest = max(map(len, flights))
    inputs = np.zeros((longest, INPUTS, ABREAST))
    block = np.zeros((ROWS, ABREAST))
    for lane in range(ABREAST):
        one = flights[min(lane, len(flights) - 1)]  # empty lanes repeat the last
        mass = one.vehicle.mass * np.eye(3) + one.vehicle.added_mass[:3, :3]
        values = one.vehicle.flow_frame.values()
        given = (one.vehicle.gravity * one.net_mass, one.immersion, one.roll, one.pitch, *one.rates)
        for k, series in enumerate(given):
            inputs[: len(one), k, lane] = series
            inputs[len(one) :, k, lane] = series[-1]
        block[MASS : MASS + NINE, lane] = mass.ravel()
        block[INVERSE : INVERSE + NINE, lane] = np.linalg.inv(mass).ravel()
        block[LAW : LAW + len(values), lane] = values
        block[STATE : STATE + 3, lane] = one.start
        block[PERIOD, lane] = one.period
    found = _integrate(block.ravel(), inputs)
    return [found[: len(one), :, lane] for lane, one in enumerate(flights)]


# --- compiled: a block has rows of ABREAST numbers, one for each flight of the batch -------------

NINE = 9
INPUTS = 7
"""Number of inputs: weight [N], immersion, roll, pitch [rad], roll, pitch and yaw rate [rad/s]"""
BEFORE, AFTER, MASS, INVERSE, LAW = 0, NINE, 2 * NINE, 3 * NINE, 4 * NINE
STATE = LAW + 3 * NINE
PERIOD, STEP, STEPS, SETTLING = range(STATE + 3, STATE + 7)
"""Rows. PERIOD: time between samples [s]. STEP: [s]. STEPS: number of steps. SETTLING: [1/m] decay
rate of heave or sway divided by speed"""
ROWS = SETTLING + 1


@scalar
def _nine(block: Any, row: int, lane: int) -> Any:
    """Numbers of nine rows of one flight."""
    k = row * ABREAST + lane
    return (
        block[k],
        block[k + ABREAST],
        block[k + 2 * ABREAST],
        block[k + 3 * ABREAST],
        block[k + 4 * ABREAST],
        block[k + 5 * ABREAST],
        block[k + 6 * ABREAST],
        block[k + 7 * ABREAST],
        block[k + 8 * ABREAST],
    )


@scalar
def _acceleration(mass, inverse, law, before, after, part, u, v, w):  # type: ignore[no-untyped-def]
    """d(u, v, w)/dt [m/s2], inputs interpolated at the fraction `part` between two samples."""
    weight = before[0] + part * (after[0] - before[0])
    immersion = before[1] + part * (after[1] - before[1])
    sin_roll, cos_roll = sincos(before[2] + part * (after[2] - before[2]))
    sin_pitch, cos_pitch = sincos(before[3] + part * (after[3] - before[3]))
    p = before[4] + part * (after[4] - before[4])
    q = before[5] + part * (after[5] - before[5])
    r = before[6] + part * (after[6] - before[6])
    fx, fy, fz, _, _, _ = fossen_wrench(law, 0.0, u, v, w, 0.0, 0.0, 0.0)
    # the body's axes turn: the rotation of the momentum acts like a force
    hu = mass[0] * u + mass[1] * v + mass[2] * w
    hv = mass[3] * u + mass[4] * v + mass[5] * w
    hw = mass[6] * u + mass[7] * v + mass[8] * w
    level = weight * cos_pitch
    x = immersion * fx - weight * sin_pitch - (q * hw - r * hv)
    y = immersion * fy + level * sin_roll - (r * hu - p * hw)
    z = immersion * fz + level * cos_roll - (p * hv - q * hu)
    return (
        inverse[0] * x + inverse[1] * y + inverse[2] * z,
        inverse[3] * x + inverse[4] * y + inverse[5] * z,
        inverse[6] * x + inverse[7] * y + inverse[8] * z,
    )


@jit(nogil=True)
def _step(block, number):  # type: ignore[no-untyped-def]
    """Make Runge-Kutta step `number` between two samples; flights with fewer steps wait."""
    for lane in range(ABREAST):
        before, after = _nine(block, BEFORE, lane), _nine(block, AFTER, lane)
        mass, inverse = _nine(block, MASS, lane), _nine(block, INVERSE, lane)
        law = _nine(block, LAW, lane)
        law = law + _nine(block, LAW + NINE, lane) + _nine(block, LAW + 2 * NINE, lane)
        u = block[STATE * ABREAST + lane]
        v = block[(STATE + 1) * ABREAST + lane]
        w = block[(STATE + 2) * ABREAST + lane]
        h, steps = block[STEP * ABREAST + lane], block[STEPS * ABREAST + lane]
        t0, t1, t2 = number / steps, (number + 0.5) / steps, (number + 1.0) / steps
        a, b = 0.5 * h, h / 6.0
        u1, v1, w1 = _acceleration(mass, inverse, law, before, after, t0, u, v, w)
        u2, v2, w2 = _acceleration(
            mass, inverse, law, before, after, t1, u + a * u1, v + a * v1, w + a * w1
        )
        u3, v3, w3 = _acceleration(
            mass, inverse, law, before, after, t1, u + a * u2, v + a * v2, w + a * w2
        )
        u4, v4, w4 = _acceleration(
            mass, inverse, law, before, after, t2, u + h * u3, v + h * v3, w + h * w3
        )
        moving = number < steps
        surge = max(u + b * (u1 + 2.0 * u2 + 2.0 * u3 + u4), 0.0)
        sway = v + b * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
        heave = w + b * (w1 + 2.0 * w2 + 2.0 * w3 + w4)
        block[STATE * ABREAST + lane] = surge if moving else u
        block[(STATE + 1) * ABREAST + lane] = sway if moving else v
        block[(STATE + 2) * ABREAST + lane] = heave if moving else w


@jit(nogil=True)
def _integrate(block, inputs):  # type: ignore[no-untyped-def]
    """Integrate velocities (time, 3, flight); inputs are interpolated linearly in time."""
    samples = inputs.shape[0]
    out = np.zeros((samples, 3, ABREAST))
    for lane in range(ABREAST):
        law, inverse = _nine(block, LAW, lane), _nine(block, INVERSE, lane)
        block[SETTLING * ABREAST + lane] = max(
            (law[K_D0] + law[K_ALPHA]) * inverse[8], (law[K_D0] + abs(law[K_BETA])) * inverse[4]
        )
        for k in range(3):
            out[0, k, lane] = block[(STATE + k) * ABREAST + lane]
    for row in range(samples - 1):
        most = 1.0
        for lane in range(ABREAST):
            speed2 = 0.0
            for k in range(3):
                speed2 += block[(STATE + k) * ABREAST + lane] ** 2
            settling = block[SETTLING * ABREAST + lane] * math.sqrt(speed2)
            period = block[PERIOD * ABREAST + lane]
            shortest = min(LONGEST_STEP, LONGEST_DECAY / max(settling, 1e-12))
            steps = max(1.0, min(float(MOST_STEPS), math.ceil(period / shortest - 1e-9)))
            block[STEPS * ABREAST + lane], block[STEP * ABREAST + lane] = steps, period / steps
            most = max(most, steps)
            for k in range(INPUTS):
                block[(BEFORE + k) * ABREAST + lane] = inputs[row, k, lane]
                block[(AFTER + k) * ABREAST + lane] = inputs[row + 1, k, lane]
        for number in range(int(most)):
            _step(block, float(number))
        for lane in range(ABREAST):
            for k in range(3):
                out[row + 1, k, lane] = block[(STATE + k) * ABREAST + lane]
    return out
