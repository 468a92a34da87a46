"""Unknowns of a turn: the coefficients that are fitted, as numbers of the vehicle's own size."""

from __future__ import annotations

import math

from twin.identify.calibration import Calibration
from twin.identify.lateral import turning_part
from twin.identify.pitch import righting_arm, with_righting_arm
from twin.identify.unknowns import Parameter
from twin.vehicle.parts import BatteryHinge, Fin


def _with_law(calibration: Calibration, **changes: object) -> Calibration:
    return calibration.replace(vehicle=calibration.vehicle.replace(**changes))


def munk_moment(calibration: Calibration) -> float:
    """[kg] that the hull's own yaw moment of sideslip has, over u v: Y_A - X_A."""
    added = calibration.vehicle.added_mass
    return float(max(added[1, 1] - added[0, 0], 1e-3 * calibration.vehicle.mass))


def _side_scale(calibration: Calibration) -> float:
    """[kg/rad] roll moment of a side force half a diameter off the axis."""
    vehicle = calibration.vehicle
    return abs(vehicle.flow_frame.side_force[0]) * 0.5 * vehicle.hull_diameter


def _set_part(calibration: Calibration, **changes: float) -> Calibration:
    part = turning_part(calibration.vehicle)
    assert part is not None
    return _with_law(calibration, **{part.name: changes})


def _with_authority(calibration: Calibration, value: float) -> Calibration:
    """The battery hung lower or higher, the righting arm of the whole kept."""
    arm = righting_arm(calibration)
    vehicle = calibration.vehicle
    eccentricity = value * vehicle.mass * arm / vehicle.battery.mass
    moved = calibration.replace(vehicle=vehicle.replace(battery={"eccentricity": eccentricity}))
    return with_righting_arm(moved, arm)


TURNING = (
    Parameter(
        name="side_force",
        unit="kg m-1 rad-1",
        meaning="side force of sideslip, -K_beta",
        spread=0.4,  # hulls with and without a large fin
        logarithmic=True,
        get=lambda c: -c.vehicle.flow_frame.side_force[0],
        set=lambda c, x: _with_law(c, side_force=(-x,)),
    ),
    Parameter(
        name="yaw_moment",
        unit="1",
        meaning="yaw moment of sideslip, K_MY, over the Munk moment: above 1 the fin wins",
        spread=0.5,
        get=lambda c: c.vehicle.flow_frame.yaw_moment[0] / munk_moment(c),
        set=lambda c, x: _with_law(
            c, yaw_moment=(x * munk_moment(c), c.vehicle.flow_frame.yaw_moment[1])
        ),
    ),
    Parameter(
        name="yaw_moment_lift",
        unit="rad-1",
        meaning="part of the yaw moment of sideslip that is odd in lift, over the Munk moment",
        spread=4.0,  # 0.2 of the Munk moment at 3 deg
        get=lambda c: c.vehicle.flow_frame.yaw_moment_lift[0] / munk_moment(c),
        set=lambda c, x: _with_law(c, yaw_moment_lift=(x * munk_moment(c),)),
    ),
    Parameter(
        name="yaw_damping",
        unit="kg s rad-1",
        meaning="yaw moment of yaw rate, -K_r",
        spread=0.6,
        logarithmic=True,
        get=lambda c: -c.vehicle.flow_frame.yaw_moment[1],
        set=lambda c, x: _with_law(c, yaw_moment=(c.vehicle.flow_frame.yaw_moment[0], -x)),
    ),
    Parameter(
        name="roll_moment",
        unit="1",
        meaning="roll moment of sideslip, K_MR, over that of its side force half a diameter up",
        spread=3.0,
        get=lambda c: c.vehicle.flow_frame.roll_moment[0] / _side_scale(c),
        set=lambda c, x: _with_law(
            c, roll_moment=(x * _side_scale(c), c.vehicle.flow_frame.roll_moment[1])
        ),
    ),
    Parameter(
        name="roll_moment_lift",
        unit="rad-1",
        meaning="part of the roll moment of sideslip that is odd in lift, over the same",
        spread=10.0,
        get=lambda c: c.vehicle.flow_frame.roll_moment_lift[0] / _side_scale(c),
        set=lambda c, x: _with_law(c, roll_moment_lift=(x * _side_scale(c),)),
    ),
    Parameter(
        name="roll_authority",
        unit="1",
        meaning="first moment of the turning battery over that which rights the vehicle",
        spread=0.7,
        logarithmic=True,
        channel="rotation",
        get=lambda c: (
            c.vehicle.battery.mass
            * c.vehicle.battery.eccentricity
            / (c.vehicle.mass * righting_arm(c))
        ),
        set=_with_authority,
    ),
    Parameter(
        name="rudder",
        unit="rad-1",
        meaning="lift slope of the rudder",
        spread=0.5,
        logarithmic=True,
        channel="fin",
        get=lambda c: getattr(turning_part(c.vehicle), "lift_slope", math.nan),
        set=lambda c, x: _set_part(c, lift_slope=x),
    ),
)
"""What a twin needs to turn as the log does."""

BIASES = ("yaw_bias", "roll_offset")
"""Fitted beside them and not flown: the asymmetry that turns a vehicle at no roll and no rudder
(as the sideslip [rad] of the same yaw moment on the bare hull), and the roll sensor's zero."""
BIAS_SPREADS = (math.radians(3.0), math.radians(5.0))


def channel_of(calibration: Calibration) -> str | None:
    """The log's channel of the turning part: "rotation", "fin", or None."""
    part = turning_part(calibration.vehicle)
    if isinstance(part, BatteryHinge):
        return "rotation"
    return "fin" if isinstance(part, Fin) else None
