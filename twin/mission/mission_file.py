"""Table: the columns of a compiled mission, the gains of its loops and what guidance remembers.

`Mission.compile` writes the table and the gains, `twin.mission.guidance` flies them; everything is
float64, so that compiled code can read it. Angles are rad, depths m positive down.

Checks of mission fields; each raises a one-line MissionError that says what to give.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

from twin.errors import MissionError, shown, unknown_name
from twin.numbers import number as as_number
from twin.vehicle.assembly import MOST_FOLLOWERS

# --- table: one row per segment; the last row is the end of the mission -----------------------
KIND = 0  # one of the kinds below
MIN_DEPTH, MAX_DEPTH = 1, 2  # [m] where a climb and a dive turn
DIVE_PITCH, CLIMB_PITCH = 3, 4  # [rad] signed: nose down is negative
HEADING = 5  # [rad], NaN: the heading at entry
PITCH_LOW, PITCH_HIGH = 6, 7  # travel of the pitching part
TURN_LIMIT = 8  # largest position of the turning part in the heading loop, either way
YO_LIMIT = 9  # NaN: none
DURATION = 10  # [s], NaN: none
UNTIL_DEPTH = 11  # [m], NaN: none
ABORT_DEPTH = 12  # [m], inf: none
SURFACE_DEPTH = 13  # [m] above this the vehicle counts as surfaced
DIVE_TURN, CLIMB_TURN = 14, 15  # factor of the heading loop, with the sign of the turn
MIN_ALTITUDE = 16  # [m] above the sea floor at which a dive turns and level ways rise, NaN: none
DEPTH, ALTITUDE = 17, 18  # [m] that a level way or a hover holds, NaN: none; one of them
LEVEL_PITCH = 19  # [rad] at which a level way keeps its depth
TURN_RATE = 20  # [rad/s] of the wanted heading on a level way, 0: straight
# horizontal speed through the water of both ways [m/s], and angle of attack [rad], NaN: the
# speed is the propeller's; dead reckoning uses them
DIVE_SPEED, CLIMB_SPEED, DIVE_ATTACK, CLIMB_ATTACK = 21, 22, 23, 24
LEVEL_SPEED, LEVEL_ATTACK = DIVE_SPEED, DIVE_ATTACK
TARGET_NORTH, TARGET_EAST = 25, 26  # [m] of a waypoint
ARRIVAL_RADIUS = 27  # [m]
YO_SPEED = 28  # [m/s] horizontal through the water, mean of a dive and its climb
SURFACE_AFTER, SURFACE_YOS = 29, 30  # [s] under water and yos after which it surfaces, NaN: none
STAY = 31  # [s] at the surface for a fix
SURFACE_AT_TARGET = 32  # 1: it surfaces on arrival
STEERS_ALWAYS = 33  # 1: the course is renewed at every tick, 0: at surfacings
SEES_TRUTH = 34  # 1: the position is known under water, 0: it is dead-reckoned
USES_CURRENT = 35  # 0: dead reckoning and course leave the estimated current out
FIRST_CURRENT_NORTH, FIRST_CURRENT_EAST = 36, 37  # [m/s] believed before the first estimate
SEGMENT_COLUMNS = 38
# then three commands, each of the width of the vehicle: what its parts do in a dive or on a level
# way, in a climb, and in a hold, a hover or at the surface. The loops start from the position of
# their part in it.
DIVE_COMMAND, CLIMB_COMMAND, REST_COMMAND = 0, 1, 2
LEVEL_COMMAND, LEVEL_TURN = DIVE_COMMAND, DIVE_TURN

SAW_TOOTH, SPIRAL, SURFACE, HOLD, LEVEL, HOVER = 1.0, 2.0, 3.0, 4.0, 7.0, 8.0
WAYPOINT = 9.0
END_AT_SURFACE, END_HOLDING = 5.0, 6.0  # kinds of the last row

# --- gains ------------------------------------------------------------------------------------
PITCH_KP, PITCH_KI, PITCH_KD = 0, 1, 2  # position per error [1/rad], [1/(rad s)], [s/rad]
HEADING_KP, HEADING_KI, HEADING_KD = 3, 4, 5  # likewise
PERIOD = 6  # [s]
PITCH_PART, PITCH_SENSE = 7, 8  # place among the parts, -1: none; +1 or -1
TURN_PART = 9  # place among the parts, -1: none
DEPTH_KP, DEPTH_KI, DEPTH_KD = 10, 11, 12  # nose down [rad] per depth [m], [m s], [m/s]
TRIM_KP, TRIM_KI, TRIM_KD = 13, 14, 15  # as the pitch loop's, of what trims in a hover
TRIM_PART, TRIM_SENSE, TRIM_LOW, TRIM_HIGH = 16, 17, 18, 19  # likewise, and its travel
BUOYANCY_KP, BUOYANCY_KI, BUOYANCY_KD = 20, 21, 22  # [cm3] less per depth [m], [m s], [m/s]
BUOYANCY_PART, BUOYANCY_LOW, BUOYANCY_HIGH = 23, 24, 25  # the pump, likewise
PITCHES_AT_REST = 26  # 1: the pitching part is a battery, which needs no flow
COMPASS_OFFSET = 27  # [rad] that the compass reads beyond the true heading
FOLLOWERS = 28  # how many parts go along with others
FOLLOWER = 29  # first of them: lead, part, weight, the lead's rest, lowest and highest position
FOLLOWER_COLUMNS = 6
# [rad] that iron of the vehicle's own adds to the compass, times sine and cosine of the heading
IRON_SINE = FOLLOWER + FOLLOWER_COLUMNS * MOST_FOLLOWERS
IRON_COSINE = IRON_SINE + 1
TURNS_BY_ROLL = IRON_COSINE + 1  # 1: a battery turns it by its roll, dives and climbs apart
DEPTH_OFFSET = TURNS_BY_ROLL + 1  # [m] that the depth by the pressure gauge is beyond the true one
ECHOES_LOST = DEPTH_OFFSET + 1  # share of the altimeter's echoes
GAINS = ECHOES_LOST + 1

# --- state: all zeros before the first step ---------------------------------------------------
SEGMENT = 0  # index of the row being flown
PHASE = 1  # one of the phases below
YO_COUNT = 2  # of this segment, in halves; -0.5 while it finishes a climb it did not begin
SEGMENT_START = 3  # [s]
ARRIVAL = 4  # [s] time of reaching the surface
UNTIL_SIDE = 5  # +1: the segment ends below UNTIL_DEPTH, -1: above it
DIVE_INTEGRAL, CLIMB_INTEGRAL = 6, 7  # of pitch [rad s]
DIVE_TURN_INTEGRAL, CLIMB_TURN_INTEGRAL = 8, 9  # of heading [rad s]
PITCH_SETPOINT = 10  # [rad], NaN: none
HEADING_SETPOINT = 11  # [rad] in [0, 2 pi), NaN: none
DONE = 12  # 1 once the plan is flown, and the surface reached where it ends there
ABORTED = 13  # 1 once the abort depth was exceeded
HEADING_ERROR = 14  # [rad] of the last tick, by the side on which it turns
LEVEL_INTEGRAL, LEVEL_TURN_INTEGRAL = 15, 16  # of pitch and heading on level ways [rad s]
TRIM_INTEGRAL = 17  # of pitch in a hover [rad s]
DEPTH_INTEGRAL, BUOYANCY_INTEGRAL = 18, 19  # of depth [m s]
LAST_DEPTH = 20  # [m] at the last tick
RECKONED_NORTH, RECKONED_EAST = 21, 22  # [m] position by dead reckoning since the last fix
SEEN_NORTH, SEEN_EAST = 23, 24  # [m] position that the course to a waypoint starts from
CURRENT_NORTH, CURRENT_EAST = 25, 26  # [m/s] estimate; 0 before the first
CURRENT_KNOWN = 27  # 1 once there is one
DRIFT_NORTH, DRIFT_EAST = 28, 29  # [m] by the estimate, in RECKONED since the last fix
LAST_TIME = 30  # [s] of the last tick
LAST_FIX = 31  # [s] at the surface, or of the mission's start
FIXED = 32  # 1 while fixes come in
YOS_UNDER = 33  # yos since the last surfacing, in halves
ARRIVED = 34  # 1 once the waypoint being flown to has been reached
ECHOES_DUE = 35  # fraction of the next echo of an altimeter that loses some
ECHO, ECHO_TIME = 36, 37  # [m] altitude by the last echo, and its time [s]
GUIDANCE_STATE = 38

NOT_STARTED, DIVE, CLIMB, SURFACING, AT_SURFACE, HOLDING = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
ON_LEVEL, HOVERING = 6.0, 7.0


MAX_PITCH_DEG = 60.0
"""[deg] pitch below this: heading and roll lose their meaning as the hull stands up."""


LARGEST = 1e9
"""Largest number in a mission, either way: 1e9 s are 31 years, and sums of them stay finite."""


def fail(label: str, field: str, value: object, rule: str) -> NoReturn:
    """Raise the MissionError that every field check raises."""
    raise MissionError(f"{label}: {field} = {shown(value)} is not possible: give {rule}")


def number(label: str, field: str, value: object) -> float:
    """`value` as a finite float of a size that a mission can have; True and "3" are not numbers."""
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
    """Check low <= value <= high, with either end left out where it is open."""
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
    """A pitch magnitude [deg]."""
    within(label, field, value, "deg", 0.0, MAX_PITCH_DEG, open_low=True, open_high=True)


def heading(label: str, field: str, value: object) -> None:
    """A true heading [deg], written either way round."""
    within(label, field, value, "deg", -360.0, 360.0)


def rotation(label: str, field: str, value: object) -> None:
    """A battery rotation [deg]; the vehicle may allow less."""
    within(label, field, value, "deg", -180.0, 180.0)


def net_mass(label: str, field: str, value: object) -> None:
    """A magnitude of net buoyancy mass [kg]; the vehicle bounds it from above."""
    within(label, field, value, "kg", 0.0, open_low=True)


def limit(label: str, field: str, value: object, unit: str) -> None:
    """A time or count above zero."""
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
"""Checks of the fields of missions and segments, by name"""


def fields(checked: Any, label: str, *apart: str) -> None:
    """Check the fields of a dataclass by RULES, but for those `apart`; None may be a default."""
    for field in dataclasses.fields(checked):
        value = getattr(checked, field.name)
        absent = value is None and field.default is None
        if field.name in RULES and field.name not in apart and not absent:
            RULES[field.name](label, field.name, value)


def known_keys(label: str, cls: type, data: Mapping[str, Any], also: tuple[str, ...] = ()) -> None:
    """Every key of `data` is a field of the dataclass `cls` or one of `also`."""
    allowed = [field.name for field in dataclasses.fields(cls)] + list(also)
    for key in data:
        if key not in allowed:
            raise MissionError(f"{label}: {unknown_name('key', str(key), allowed)}")


def required_keys(label: str, cls: type, data: Mapping[str, Any]) -> None:
    """Every field of `cls` without a default is in `data`."""
    for field in dataclasses.fields(cls):
        required = (
            field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )
        if required and field.name not in data:
            raise MissionError(f"{label}: {field.name} is missing; it has no default")
