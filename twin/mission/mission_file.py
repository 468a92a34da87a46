"""Mission file: columns of a compiled mission, gains of its loops, guidance's state, and checks.

`Mission.compile` writes the table and the gains, and `twin.mission.guidance` reads them. They are
float64, so that compiled code can read them. Angles are rad, depths m positive down.

Each check of a mission field raises a one-line MissionError that gives the allowed values.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

from twin.errors import MissionError, shown, unknown_name
from twin.numbers import number as as_number
from twin.vehicle.assembly import MOST_FOLLOWERS, MOST_THRUSTERS

# --- table: one row per segment; the last row is the end of the mission -----------------------
KIND = 0  # one of the types below
MIN_DEPTH, MAX_DEPTH = 1, 2  # [m] where a climb and a dive turn
DIVE_PITCH, CLIMB_PITCH = 3, 4  # [rad] signed: nose down is negative
HEADING = 5  # [rad], NaN: the heading at entry
PITCH_LOW, PITCH_HIGH = 6, 7  # travel of the part that controls pitch
TURN_LIMIT = 8  # largest position of the turning part in the heading loop, either side
YO_LIMIT = 9  # NaN: none
DURATION = 10  # [s], NaN: none
UNTIL_DEPTH = 11  # [m], NaN: none
ABORT_DEPTH = 12  # [m], inf: none
SURFACE_DEPTH = 13  # [m] the vehicle counts as surfaced above this depth
DIVE_TURN, CLIMB_TURN = 14, 15  # factor of the heading loop, signed like the turn
MIN_ALTITUDE = 16  # [m] altitude at which a dive turns and a level leg rises, NaN: none
DEPTH, ALTITUDE = 17, 18  # [m] of a level leg or hover; the other one is NaN
LEVEL_PITCH = 19  # [rad] at which a level leg keeps its depth
TURN_RATE = 20  # [rad/s] of the heading setpoint on a level leg, 0: straight
# for dead reckoning, of dive and climb: horizontal speed through the water [m/s], and angle of
# attack [rad]; NaN: propelled, so the speed does not follow from the vertical velocity
DIVE_SPEED, CLIMB_SPEED, DIVE_ATTACK, CLIMB_ATTACK = 21, 22, 23, 24
LEVEL_SPEED, LEVEL_ATTACK = DIVE_SPEED, DIVE_ATTACK
TARGET_NORTH, TARGET_EAST = 25, 26  # [m] of a waypoint
ARRIVAL_RADIUS = 27  # [m]
YO_SPEED = 28  # [m/s] mean horizontal speed through the water of a dive and its climb
SURFACE_AFTER, SURFACE_YOS = 29, 30  # [s] under water, and yos, until it surfaces, NaN: none
STAY = 31  # [s] at the surface for a fix
SURFACE_AT_TARGET = 32  # 1: surfaces on arrival
STEERS_ALWAYS = 33  # 1: updates the course at every tick, 0: at surfacings
SEES_TRUTH = 34  # 1: the true position is known under water, 0: dead-reckoned
USES_CURRENT = 35  # 0: dead reckoning and course ignore the estimated current
FIRST_CURRENT_NORTH, FIRST_CURRENT_EAST = 36, 37  # [m/s] used before the first estimate
# shares of the largest force that a person gives, -1 to 1: ahead, to starboard, down
STICK_SURGE, STICK_SWAY, STICK_HEAVE = 38, 39, 40
SEGMENT_COLUMNS = 41
# Three commands follow, each with a position for every part: for a dive or level leg, for a
# climb, and for a hold, a hover or the surface. A loop starts from its part's position there.
DIVE_COMMAND, CLIMB_COMMAND, REST_COMMAND = 0, 1, 2
LEVEL_COMMAND, LEVEL_TURN = DIVE_COMMAND, DIVE_TURN

SAW_TOOTH, SPIRAL, SURFACE, HOLD, LEVEL, HOVER = 1.0, 2.0, 3.0, 4.0, 7.0, 8.0
WAYPOINT, POSE, STICKS = 9.0, 10.0, 11.0
END_AT_SURFACE, END_HOLDING = 5.0, 6.0  # types of the last row

# --- gains ------------------------------------------------------------------------------------
PITCH_KP, PITCH_KI, PITCH_KD = 0, 1, 2  # position per error [rad], integral [rad s], rate [rad/s]
HEADING_KP, HEADING_KI, HEADING_KD = 3, 4, 5  # units as for pitch
PERIOD = 6  # [s]
PITCH_PART, PITCH_SENSE = 7, 8  # index of the part, -1: none; +1 or -1
TURN_PART = 9  # index of the part, -1: none
DEPTH_KP, DEPTH_KI, DEPTH_KD = 10, 11, 12  # [rad] nose down per depth [m], [m s], [m/s]
TRIM_KP, TRIM_KI, TRIM_KD = 13, 14, 15  # like the pitch loop's, for the trim part in a hover
TRIM_PART, TRIM_SENSE, TRIM_LOW, TRIM_HIGH = 16, 17, 18, 19  # the trim part and its travel
BUOYANCY_KP, BUOYANCY_KI, BUOYANCY_KD = 20, 21, 22  # [cm3] decrease per depth [m], [m s], [m/s]
BUOYANCY_PART, BUOYANCY_LOW, BUOYANCY_HIGH = 23, 24, 25  # index of the pump, and its travel
PITCHES_AT_REST = 26  # 1: a battery controls pitch and needs no flow
COMPASS_OFFSET = 27  # [rad] compass reading minus true heading
FOLLOWERS = 28  # number of parts that follow others
FOLLOWER = 29  # first row: lead, part, weight, lead's rest, lowest and highest position
FOLLOWER_COLUMNS = 6
# [rad] compass errors by the vehicle's own iron: factors of sine and cosine of the heading
IRON_SINE = FOLLOWER + FOLLOWER_COLUMNS * MOST_FOLLOWERS
IRON_COSINE = IRON_SINE + 1
TURNS_BY_ROLL = IRON_COSINE + 1  # 1: a battery hinge controls heading, by rolling
DEPTH_OFFSET = TURNS_BY_ROLL + 1  # [m] depth by the pressure gauge minus true depth
ECHOES_LOST = DEPTH_OFFSET + 1  # fraction of the altimeter's returns that are lost
# P, I, D of horizontal force, vertical force, yaw and level: `Vehicle.station_pid`
STATION_KP = ECHOES_LOST + 1
AUTHORITY = STATION_KP + 12  # [N], [N m] largest force along and moment about each body axis
THRUSTERS = AUTHORITY + 6  # number of thrusters that hold a pose
# each: part, six weights, thrust ahead and astern [N], dead band, curvature
THRUSTER, THRUSTER_COLUMNS = THRUSTERS + 1, 11
GAINS = THRUSTER + THRUSTER_COLUMNS * MOST_THRUSTERS

# --- state: all zeros before the first step ---------------------------------------------------
SEGMENT = 0  # index of the row being flown
PHASE = 1  # one of the phases below
YO_COUNT = 2  # of this segment, in halves; -0.5 in a climb begun before it
SEGMENT_START = 3  # [s]
ARRIVAL = 4  # [s] time of reaching the surface
UNTIL_SIDE = 5  # +1: the segment ends below UNTIL_DEPTH, -1: above it
DIVE_INTEGRAL, CLIMB_INTEGRAL = 6, 7  # of pitch [rad s]
DIVE_TURN_INTEGRAL, CLIMB_TURN_INTEGRAL = 8, 9  # of heading [rad s]
PITCH_SETPOINT = 10  # [rad], NaN: none
HEADING_SETPOINT = 11  # [rad] in [0, 2 pi), NaN: none
DONE = 12  # 1 once all segments are flown, and the surface reached if they end there
ABORTED = 13  # 1 once the abort depth was exceeded
HEADING_ERROR = 14  # [rad] of the last tick, signed by the side of the turn
LEVEL_INTEGRAL, LEVEL_TURN_INTEGRAL = 15, 16  # of pitch and heading on level legs [rad s]
TRIM_INTEGRAL = 17  # of pitch in a hover [rad s]
DEPTH_INTEGRAL, BUOYANCY_INTEGRAL = 18, 19  # of depth [m s]
LAST_DEPTH = 20  # [m] at the last tick
RECKONED_NORTH, RECKONED_EAST = 21, 22  # [m] position by dead reckoning since the last fix
SEEN_NORTH, SEEN_EAST = 23, 24  # [m] position that the course to a waypoint starts from
CURRENT_NORTH, CURRENT_EAST = 25, 26  # [m/s] estimate; 0 before the first
CURRENT_KNOWN = 27  # 1 once the current is estimated
DRIFT_NORTH, DRIFT_EAST = 28, 29  # [m] part of RECKONED by the estimated current, since the fix
LAST_TIME = 30  # [s] of the last tick
LAST_FIX = 31  # [s] time of the last fix, or of the mission's start
FIXED = 32  # 1 while fixes arrive
YOS_UNDER = 33  # yos since the last surfacing, in halves
ARRIVED = 34  # 1 once the waypoint being flown to has been reached
ECHOES_DUE = 35  # accumulates received fractions; at 1 a return is received
ECHO, ECHO_TIME = 36, 37  # [m] altitude of the last return, and its time [s]
REFERENCE_NORTH, REFERENCE_EAST, REFERENCE_DEPTH = 38, 39, 40  # [m] that a pose is held at
LAST_NORTH, LAST_EAST = 41, 42  # [m] position at the last tick
NORTH_INTEGRAL, EAST_INTEGRAL, DOWN_INTEGRAL = 43, 44, 45  # [m s]
ROLL_INTEGRAL, TILT_INTEGRAL, YAW_INTEGRAL = 46, 47, 48  # [rad s], in a held pose
GUIDANCE_STATE = 49

NOT_STARTED, DIVE, CLIMB, SURFACING, AT_SURFACE, HOLDING = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
ON_LEVEL, HOVERING, POSING = 6.0, 7.0, 8.0


MAX_PITCH_DEG = 60.0
"""[deg] Upper limit of pitch; near vertical, heading and roll lose their meaning."""


LARGEST = 1e9
"""Largest magnitude of a number in a mission: 1e9 s are 31 years, and sums stay finite."""


def fail(label: str, field: str, value: object, rule: str) -> NoReturn:
    """Raise the MissionError of every field check."""
    raise MissionError(f"{label}: {field} = {shown(value)} is not possible: give {rule}")


def number(label: str, field: str, value: object) -> float:
    """Convert `value` to a finite float within +-LARGEST; True and "3" are not numbers."""
    try:
        result = as_number(value, field, MissionError)
    except MissionError:
        fail(label, field, value, "a number")
    if not math.isfinite(result):
        fail(label, field, value, "a finite number")
    if abs(result) > LARGEST:
        fail(label, field, value, f"a number of at most {LARGEST:g}")
    return result


def within(
    label: str,
    field: str,
    value: object,
    unit: str,
    low: float,
    high: float = math.inf,
    *,
    open_low: bool = False,
    open_high: bool = False,
) -> None:
    """Check that a value is in [low, high]; a limit that is `open` is itself refused."""
    x = number(label, field, value)
    if (x > low or (x == low and not open_low)) and (x < high or (x == high and not open_high)):
        return
    lower = f"above {low:g}" if open_low else f"at least {low:g}"
    if math.isinf(high):
        rule = lower
    elif open_low or open_high:
        rule = f"{lower} and {'below' if open_high else 'at most'} {high:g}"
    else:
        rule = f"{low:g} to {high:g}"
    fail(label, field, value, f"{rule} {unit}".rstrip())


def pitch(label: str, field: str, value: object) -> None:
    """Check a magnitude of pitch [deg]."""
    within(label, field, value, "deg", 0.0, MAX_PITCH_DEG, open_low=True, open_high=True)


def heading(label: str, field: str, value: object) -> None:
    """Check a true heading [deg] within -360..360."""
    within(label, field, value, "deg", -360.0, 360.0)


def rotation(label: str, field: str, value: object) -> None:
    """Check a battery rotation [deg]; the vehicle may allow less."""
    within(label, field, value, "deg", -180.0, 180.0)


def net_mass(label: str, field: str, value: object) -> None:
    """Check a magnitude of net mass [kg]; the vehicle sets the upper limit."""
    within(label, field, value, "kg", 0.0, open_low=True)


def limit(label: str, field: str, value: object, unit: str) -> None:
    """Check a time, length or count above zero."""
    within(label, field, value, unit, 0.0, open_low=True)


RULES: Mapping[str, Callable[[str, str, object], object]] = {
    **dict.fromkeys(("pitch_deg", "climb_pitch_deg", "max_pitch_deg", "ascent_pitch_deg"), pitch),
    **dict.fromkeys(("net_mass_kg", "climb_net_mass_kg"), net_mass),
    **dict.fromkeys(("rotation_deg", "climb_rotation_deg"), rotation),
    **dict.fromkeys(
        ("duration_s", "stay_s", "surface_after_s"), functools.partial(limit, unit="s")
    ),
    **dict.fromkeys(
        ("length_m", "leg_length_m", "max_depth_m", "min_altitude_m", "arrival_radius_m"),
        functools.partial(limit, unit="m"),
    ),
    **dict.fromkeys(("yos", "surface_after_yos", "turns"), functools.partial(limit, unit="")),
    **dict.fromkeys(
        ("current_north_m_s", "current_east_m_s"),
        functools.partial(within, unit="m/s", low=-5.0, high=5.0),
    ),
    **dict.fromkeys(("heading_deg", "start_heading_deg"), heading),
    **dict.fromkeys(
        ("start_depth_m", "until_depth_m"), functools.partial(within, unit="m", low=0.0)
    ),
    "max_rotation_deg": functools.partial(within, unit="deg", low=0.0, high=90.0, open_low=True),
    "speed_m_s": functools.partial(limit, unit="m/s"),
    "shift_m": number,
    "trim_share": functools.partial(within, unit="", low=0.0, high=1.0),
}
"""Checks of the fields of missions and segments, by field name."""


def fields(checked: Any, label: str, *apart: str) -> None:
    """Check the fields of a dataclass by RULES, except those `apart`; a default None passes."""
    for field in dataclasses.fields(checked):
        value = getattr(checked, field.name)
        absent = value is None and field.default is None
        if field.name in RULES and field.name not in apart and not absent:
            RULES[field.name](label, field.name, value)


def known_keys(label: str, cls: type, data: Mapping[str, Any], also: tuple[str, ...] = ()) -> None:
    """Require that every key of `data` is a field of the dataclass `cls` or in `also`."""
    allowed = [field.name for field in dataclasses.fields(cls)] + list(also)
    for key in data:
        if key not in allowed:
            raise MissionError(f"{label}: {unknown_name('key', str(key), allowed)}")


def required_keys(label: str, cls: type, data: Mapping[str, Any]) -> None:
    """Require that every field of `cls` without a default is in `data`."""
    for field in dataclasses.fields(cls):
        required = (
            field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )
        if required and field.name not in data:
            raise MissionError(f"{label}: {field.name} is missing; it has no default")
