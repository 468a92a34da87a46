"""Translation: the velocity of a glider whose attitude is known, from its buoyancy and its drag.

A log says how the glider was turned at every moment; what it does not say is how fast it moved.
With the attitude as input only three equations of the twin remain (Fossen 2011, eq. 6.114):

    (m I + A) dv/dt = -omega x (m I + A) v + F(v) + net mass * g * down,

with v the velocity through the water in body axes, A the translational block of the added mass
and F the force law of docs/physics/equations.md. The steady flight model is what is left when
dv/dt = 0; at an inflection, where the pump passes neutral and nothing is steady, the momentum
carries the glider on for tens of seconds, which is why the speed there needs the equation above.

Surge never falls below zero: a plate at a given attitude can glide backwards in these equations,
which a vehicle's fins would turn round at once.

Not in it: the moments (the attitude is measured), the distance of the centre of gravity from the
centre of buoyancy, the coupling of added mass between translation and rotation.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.compiled import inline, jit
from twin.errors import InputError
from twin.vehicle.laws.flow_frame import K_ALPHA, K_BETA, K_D0, native_wrench
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

LONGEST_STEP = 1.0
"""[s] of one Runge-Kutta step."""
LONGEST_DECAY = 0.7
"""Of one step, in times in which heave settles, the fastest motion: a quarter of where RK4 turns
unstable (2.8). A light vehicle with much lift needs shorter steps than `LONGEST_STEP`."""
MOST_STEPS = 1000
"""Between samples: what needs more has flown off."""
FASTEST = 5.0
"""[m/s] ten times what a buoyancy glider makes: beyond it the integration has failed."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Translation:
    """Velocity through the water, body FRD, each (time,)."""

    surge: Array
    """[m/s]"""
    sway: Array
    """[m/s]"""
    heave: Array
    """[m/s]"""

    @property
    def speed(self) -> Array:
        """[m/s]"""
        return np.sqrt(self.surge**2 + self.sway**2 + self.heave**2)

    @property
    def angle_of_attack(self) -> Array:
        """[rad], atan2(heave, surge)."""
        return np.arctan2(self.heave, self.surge)

    def sink_rate(self, roll: Array, pitch: Array) -> Array:
        """Downward velocity [m/s] through the water at `roll` and `pitch` [rad]."""
        return (
            -np.sin(pitch) * self.surge
            + np.cos(pitch) * np.sin(roll) * self.sway
            + np.cos(pitch) * np.cos(roll) * self.heave
        )


def fly(
    vehicle: Vehicle,
    *,
    period: float,
    net_mass: Array,
    immersion: Array,
    roll: Array,
    pitch: Array,
    rates: Array,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Translation:
    """Velocity through the water of a vehicle with this attitude.

    Args:
      period: [s] between samples.
      net_mass: mass less that of the displaced water, as far as immersed [kg], (time,).
      immersion: part of the hull that the water acts on, 0 to 1, (time,).
      roll, pitch: [rad], (time,).
      rates: roll, pitch and yaw rate, body FRD [rad/s], (3, time).
      start: surge, sway and heave [m/s] at the first sample; at rest by default.

    Raises:
      InputError: the speed leaves every bound: the parameters or the inputs are wrong.
    """
    mass = vehicle.mass * np.eye(3) + vehicle.added_mass[:3, :3]
    coefficients = vehicle.flow_frame.values()
    inputs = np.stack([vehicle.gravity * net_mass, immersion, roll, pitch, *rates], axis=1)
    velocity = _integrate(
        mass, np.linalg.inv(mass), coefficients, inputs, period, np.asarray(start, float)
    )
    if not (np.abs(velocity) < FASTEST).all():
        raise InputError(
            f"vehicle {vehicle.name!r} flies faster than {FASTEST:g} m/s in this log: its drag or "
            "its trim is far off, or the log is in other units"
        )
    return Translation(surge=velocity[:, 0], sway=velocity[:, 1], heave=velocity[:, 2])


@inline
def _acceleration(mass, inverse, c, weight, immersion, roll, pitch, p, q, r, u, v, w):  # type: ignore[no-untyped-def]
    """d(u, v, w)/dt [m/s2] from the weight [N], the attitude and the rates; no allocation."""
    fx, fy, fz, _, _, _ = native_wrench(c, 0.0, u, v, w, 0.0, 0.0, 0.0)
    # momentum, whose turning with the body is a force
    hu = mass[0, 0] * u + mass[0, 1] * v + mass[0, 2] * w
    hv = mass[1, 0] * u + mass[1, 1] * v + mass[1, 2] * w
    hw = mass[2, 0] * u + mass[2, 1] * v + mass[2, 2] * w
    level = weight * np.cos(pitch)
    x = immersion * fx - weight * np.sin(pitch) - (q * hw - r * hv)
    y = immersion * fy + level * np.sin(roll) - (r * hu - p * hw)
    z = immersion * fz + level * np.cos(roll) - (p * hv - q * hu)
    return (
        inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2] * z,
        inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2] * z,
        inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2] * z,
    )


@jit
def _rate(mass, inverse, c, inputs, row, part, u, v, w):  # type: ignore[no-untyped-def]
    """`_acceleration` with the inputs at `part` of the way from sample `row` to the next."""
    a, b = inputs[row], inputs[row + 1]
    return _acceleration(
        mass,
        inverse,
        c,
        a[0] + part * (b[0] - a[0]),
        a[1] + part * (b[1] - a[1]),
        a[2] + part * (b[2] - a[2]),
        a[3] + part * (b[3] - a[3]),
        a[4] + part * (b[4] - a[4]),
        a[5] + part * (b[5] - a[5]),
        a[6] + part * (b[6] - a[6]),
        u,
        v,
        w,
    )


@jit
def _integrate(mass, inverse, c, inputs, period, start):  # type: ignore[no-untyped-def]
    """Classical RK4 with the inputs linear between samples; velocities (time, 3) from `start`."""
    samples = inputs.shape[0]
    out = np.zeros((samples, 3))
    # rate at which the force of an angle of attack or sideslip dies out, over speed [1/m]
    settling = max(
        (c[K_D0] + c[K_ALPHA]) * inverse[2, 2], (c[K_D0] + abs(c[K_BETA])) * inverse[1, 1]
    )
    u, v, w = start[0], start[1], start[2]
    out[0, 0], out[0, 1], out[0, 2] = u, v, w
    for row in range(samples - 1):
        speed = np.sqrt(u * u + v * v + w * w)
        shortest = min(LONGEST_STEP, LONGEST_DECAY / max(settling * speed, 1e-12))
        steps = max(1, min(MOST_STEPS, int(np.ceil(period / shortest - 1e-9))))
        h = period / steps
        for step in range(steps):
            t0, t1, t2 = step / steps, (step + 0.5) / steps, (step + 1.0) / steps
            a, b = 0.5 * h, h / 6.0
            u1, v1, w1 = _rate(mass, inverse, c, inputs, row, t0, u, v, w)
            u2, v2, w2 = _rate(
                mass, inverse, c, inputs, row, t1, u + a * u1, v + a * v1, w + a * w1
            )
            u3, v3, w3 = _rate(
                mass, inverse, c, inputs, row, t1, u + a * u2, v + a * v2, w + a * w2
            )
            u4, v4, w4 = _rate(
                mass, inverse, c, inputs, row, t2, u + h * u3, v + h * v3, w + h * w3
            )
            u = max(u + b * (u1 + 2.0 * u2 + 2.0 * u3 + u4), 0.0)
            v += b * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
            w += b * (w1 + 2.0 * w2 + 2.0 * w3 + w4)
        out[row + 1, 0], out[row + 1, 1], out[row + 1, 2] = u, v, w
    return out
