"""Pitch: the moments that set a glider's pitch, and a first guess of its trim from a log.

At rest about the pitch axis the moments of weight, of the pumped volume and of the water balance
(body axes forward-starboard-down about the centre of buoyancy, Fossen 2011, section 4.1):

    righting * tan(pitch) + first + - density * pumped volume * pump_position
        = pitch moment of the water / (g cos(pitch)),

with `first` the first moment of the masses along the hull [kg m], which the battery's position
moves, and `righting` that below the centre of buoyancy. Vehicle files put the pump at the centre
of buoyancy. A pump in the nose, as a Slocum's, turns the glider as a battery would that moves aft
by density * volume * pump_position / battery mass: so it enters here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.identify.calibration import Calibration
from twin.identify.logged import Log
from twin.identify.speed import motion_of, steady_parts
from twin.identify.unknowns import Parameter
from twin.vehicle.vehicle import CUBIC_CM

Array = NDArray[np.float64]

MILLI = 1e-3
MOMENT_NOISE = 0.05
"""[kg m] that the balance is off, mostly by the water's moment: 7 deg of pitch where the centre of
gravity lies 6 mm low in 65 kg."""
INDEPENDENT = 300.0
"""[s] of steady flight that count as one observation."""
LEAST_SHARE = 0.2
"""Of the nominal righting arm: with less it would not glide stably."""


def righting_arm(calibration: Calibration) -> float:
    """Depth of the centre of gravity below the centre of buoyancy [m]."""
    v = calibration.vehicle
    below = v.static_mass * v.static_cg[2] + v.battery.mass * v.battery.eccentricity
    return float(below / v.mass)


def with_righting_arm(calibration: Calibration, arm: float) -> Calibration:
    """The hull's centre of gravity moved so that the whole has this righting arm [m]."""
    v = calibration.vehicle
    cg = v.static_cg.copy()
    cg[2] = (arm * v.mass - v.battery.mass * v.battery.eccentricity) / v.static_mass
    return calibration.replace(vehicle=v.replace(static_cg=cg))


PITCHING = (
    Parameter(
        name="shift_offset",
        unit="mm",
        meaning="battery position less the vehicle file's, at encoder zero",
        spread=10.0,  # encoders are zeroed in the workshop, the centre of gravity is trimmed at sea
        get=lambda c: c.vehicle.battery.neutral_x / MILLI,
        set=lambda c, x: c.replace(vehicle=c.vehicle.replace(battery={"neutral_x": MILLI * x})),
    ),
    Parameter(
        name="righting_arm",
        unit="mm",
        meaning="centre of gravity below the centre of buoyancy",
        spread=0.4,  # trimmed with lead: 3 to 8 mm
        logarithmic=True,
        get=lambda c: righting_arm(c) / MILLI,
        set=lambda c, x: with_righting_arm(c, MILLI * x),
    ),
    Parameter(
        name="pump_position",
        unit="m",
        meaning="pumped volume forward of the centre of buoyancy",
        spread=0.5,  # nose of a Slocum 0.6 m forward, bladder of a Seaglider as far aft
        get=lambda c: c.pump_position,
        set=lambda c, x: c.replace(pump_position=x),
    ),
)
"""What a twin needs to pitch as the log does, estimated in `twin.identify.rollout`."""


def battery_shift(calibration: Calibration, shift: Array, pump: Array) -> Array:
    """Battery position [m] that turns the vehicle file's glider as `shift` [m] and a `pump` [cm3]
    at its true place turn the log's, (time,) each."""
    vehicle = calibration.vehicle
    lever = calibration.pump_position * CUBIC_CM * vehicle.reference_density
    return shift - lever * pump / vehicle.battery.mass


def balanced(logs: Sequence[Log], calibration: Calibration) -> Calibration:
    """Battery zero, righting arm and pump position that balance the steady parts of the logs.

    Linear least squares with what is known beforehand; the water's moment is that of the flight
    model. Where rollouts start from: they refine it with the moments of motion.
    """
    vehicle = calibration.vehicle
    rows, right = [], []
    for log in logs:
        steady = log.use & steady_parts(log)
        if log.shift is None or not steady.any():
            continue
        motion = motion_of(log, calibration)
        pitch = calibration.true_pitch(log.pitch)
        constant, slope, _ = vehicle.flow_frame.pitch_moment
        moment = (constant + slope * motion.angle_of_attack) * motion.speed**2
        fixed = vehicle.static_mass * vehicle.static_cg[0] + vehicle.battery.mass * log.shift
        weight = np.sqrt(log.period / INDEPENDENT) / MOMENT_NOISE
        columns = [
            np.full_like(pitch, vehicle.battery.mass),
            np.tan(pitch) * vehicle.mass,
            -CUBIC_CM * vehicle.reference_density * log.pump,
        ]
        rows.append(weight * np.stack(columns, axis=1)[steady])
        right.append(weight * (moment / (vehicle.gravity * np.cos(pitch)) - fixed)[steady])
    if not rows:
        return calibration
    known = np.array([MILLI * PITCHING[0].get(calibration), righting_arm(calibration), 0.0])
    spread = np.array(
        [MILLI * PITCHING[0].spread, PITCHING[1].spread * known[1], PITCHING[2].spread]
    )
    matrix = np.concatenate([*rows, np.diag(1.0 / spread)])
    found, *_ = np.linalg.lstsq(matrix, np.concatenate([*right, known / spread]), rcond=None)
    arm = max(float(found[1]), LEAST_SHARE * known[1])
    out = calibration.replace(vehicle=vehicle.replace(battery={"neutral_x": float(found[0])}))
    return with_righting_arm(out, arm).replace(pump_position=float(found[2]))
