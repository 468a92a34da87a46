"""Selection of features: the shipped features, and the choice of a network's inputs.

A glider hardly accelerates, so its accelerometer is an inclinometer. The accelerometer lacks the
errors that gyros add to an attitude; both have its bias. The flight features are the motion by
the flight filter (`twin.navigation.flight_filter`), with constants estimated during the mission.

Features are selected by names, groups and available sensors. The features of a mission form a
matrix.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError, unknown_name
from twin.navigation.features.base import (
    FEATURES,
    GLIDER_PARTS,
    PART_GROUPS,
    SLOW_S,
    Channels,
    Feature,
    Look,
    Shape,
    Term,
    channels_of,
    feature,
    is_part_channel,
)
from twin.navigation.settings import CTD, sources


def _one(
    name: str, group: str, channel: str, unit: str = "1", shape: Shape = "plain",
    look: Look = "last", seconds: float = 0.0, *, odd: bool = False,
) -> Feature:  # fmt: skip
    term = Term(channel=channel, shape=shape, look=look, seconds=seconds)
    return Feature(name=name, group=group, unit=unit, terms=(term,), odd=odd)


FLAT_SINE = 0.15
"""Sine of the pitch (9 degrees) below which `glide_speed` fades to zero instead of growing."""


def damped_quotient(depth_rate: Any, sine: Any) -> Any:
    """-z' / s without the pole at an inflection: the regularised -z' s / (s^2 + FLAT_SINE^2)."""
    return -depth_rate * sine / (sine**2 + FLAT_SINE**2)


def glide_speed(depth_rate: Any, pitch: Any) -> Any:
    """Speed [m/s] along the body that explains the depth rate [m/s] at this pitch [deg]."""
    return damped_quotient(depth_rate, np.sin(np.deg2rad(pitch)))


C_DAMPED = f"return -rate * sine / (sine * sine + {FLAT_SINE**2!r}f);"
"""`damped_quotient` in C99."""
C_GLIDE = f"""
const float rate = t[0], sine = gt_sine(t[1] * {math.radians(1.0):.9g}f);
{C_DAMPED}
"""
"""`glide_speed` in C99."""


def _glide(name: str, look: Look, seconds: float) -> Feature:
    rate = Term(channel="measured_depth", look="slope", seconds=seconds)
    pitch = Term(channel="measured_pitch", look=look, seconds=seconds)
    return Feature(
        name=name, group=name, unit="m s-1", terms=(rate, pitch), combine=glide_speed, c=C_GLIDE
    )


DEPTH = _one("depth", "depth", "measured_depth", "m")
DEPTH_RATE = _one("depth_rate", "depth_rate", "measured_depth", "m s-1", look="slope")
DEPTH_RATE_SLOW = _one(
    "depth_rate_slow", "depth_rate_slow", "measured_depth", "m s-1", look="slope", seconds=SLOW_S
)
GLIDE_SPEED = _glide("glide_speed", "last", 0.0)
GLIDE_SPEED_SLOW = _glide("glide_speed_slow", "mean", SLOW_S)


FORCES = tuple(f"measured_specific_force_{axis}" for axis in "xyz")


def gravity_sine(x: Any, y: Any, z: Any) -> Any:
    """Sine of the pitch, nose up, from the direction of the specific force; 0 in free fall."""
    size = np.sqrt(x**2 + y**2 + z**2)
    return np.divide(x, size, out=np.zeros_like(size), where=size > 0.0)


def gravity_glide_speed(depth_rate: Any, x: Any, y: Any, z: Any) -> Any:
    """`glide_speed` with the pitch from gravity [m/s]."""
    return damped_quotient(depth_rate, gravity_sine(x, y, z))


C_GRAVITY_SINE = """
const float size = sqrtf(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]);
return size > 0.0f ? t[0] / size : 0.0f;
"""
"""`gravity_sine` in C99."""
C_GRAVITY_GLIDE = f"""
const float size = sqrtf(t[1] * t[1] + t[2] * t[2] + t[3] * t[3]);
const float rate = t[0], sine = size > 0.0f ? t[1] / size : 0.0f;
{C_DAMPED}
"""
"""`gravity_glide_speed` in C99."""


def _mean_force(seconds: float) -> tuple[Term, ...]:
    return tuple(Term(channel=name, look="mean", seconds=seconds) for name in FORCES)


def _gravity_glide(name: str, seconds: float) -> Feature:
    rate = Term(channel="measured_depth", look="slope", seconds=seconds)
    return Feature(
        name=name, group="gravity", unit="m s-1", terms=(rate, *_mean_force(seconds)),
        combine=gravity_glide_speed, c=C_GRAVITY_GLIDE,
    )  # fmt: skip


ROLL_RATE = _one("roll_rate", "gyroscope", "measured_roll_rate", "rad s-1", odd=True)
PITCH_RATE = _one("pitch_rate", "gyroscope", "measured_pitch_rate", "rad s-1")
YAW_RATE = _one("yaw_rate", "gyroscope", "measured_yaw_rate", "rad s-1", odd=True)
SPECIFIC_FORCE_X = _one("specific_force_x", "accelerometer", FORCES[0], "m s-2")
SPECIFIC_FORCE_Y = _one("specific_force_y", "accelerometer", FORCES[1], "m s-2", odd=True)
SPECIFIC_FORCE_Z = _one("specific_force_z", "accelerometer", FORCES[2], "m s-2")
GRAVITY_PITCH_SINE = Feature(
    name="gravity_pitch_sine", group="gravity", unit="1", terms=_mean_force(SLOW_S),
    combine=gravity_sine, c=C_GRAVITY_SINE,
)  # fmt: skip
GRAVITY_GLIDE_SPEED = _gravity_glide("gravity_glide_speed", 0.0)
GRAVITY_GLIDE_SPEED_SLOW = _gravity_glide("gravity_glide_speed_slow", SLOW_S)


def _change(name: str, angle: str, *, slow: bool = False, odd: bool = False) -> Feature:
    seconds = SLOW_S if slow else 0.0
    group = "attitude_rate_slow" if slow else "attitude_rate"
    return _one(name, group, f"measured_{angle}", "rad s-1", "angle", "slope", seconds, odd=odd)


SIN_ROLL = _one("sin_roll", "attitude", "measured_roll", shape="sine", odd=True)
COS_ROLL = _one("cos_roll", "attitude", "measured_roll", shape="cosine")
SIN_PITCH = _one("sin_pitch", "attitude", "measured_pitch", shape="sine")
COS_PITCH = _one("cos_pitch", "attitude", "measured_pitch", shape="cosine")
SIN_ROLL_SLOW = _one(
    "sin_roll_slow", "attitude_slow", "measured_roll", "1", "sine", "mean", SLOW_S, odd=True
)
SIN_PITCH_SLOW = _one(
    "sin_pitch_slow", "attitude_slow", "measured_pitch", "1", "sine", "mean", SLOW_S
)
ROLL_CHANGE = _change("roll_change", "roll", odd=True)
PITCH_CHANGE = _change("pitch_change", "pitch")
HEADING_CHANGE = _change("heading_change", "heading", odd=True)
ROLL_CHANGE_SLOW = _change("roll_change_slow", "roll", slow=True, odd=True)
PITCH_CHANGE_SLOW = _change("pitch_change_slow", "pitch", slow=True)
HEADING_CHANGE_SLOW = _change("heading_change_slow", "heading", slow=True, odd=True)


SHIFT = _one("shift", "controls", "measured_shift", "m")
SIN_ROTATION = _one("sin_rotation", "controls", "measured_rotation", "1", "sine", odd=True)
COS_ROTATION = _one("cos_rotation", "controls", "measured_rotation", "1", "cosine")
PUMP = _one("pump", "controls", "measured_pump", "cm3")
SHIFT_CHANGE = _one("shift_change", "control_rate", "measured_shift", "m s-1", look="slope")
ROTATION_CHANGE = _one(
    "rotation_change", "control_rate", "measured_rotation", "rad s-1", "angle", "slope", odd=True
)
PUMP_CHANGE = _one("pump_change", "control_rate", "measured_pump", "cm3 s-1", look="slope")
SHIFT_COMMAND = _one("shift_command", "commands", "commanded_shift", "m")
SIN_ROTATION_COMMAND = _one(
    "sin_rotation_command", "commands", "commanded_rotation", "1", "sine", odd=True
)
COS_ROTATION_COMMAND = _one("cos_rotation_command", "commands", "commanded_rotation", "1", "cosine")
PUMP_COMMAND = _one("pump_command", "commands", "commanded_pump", "cm3")

FLIGHT_SURGE = _one("flight_surge", "flight", "estimated_surge", "m s-1")
FLIGHT_SWAY = _one("flight_sway", "flight", "estimated_sway", "m s-1", odd=True)
FLIGHT_ATTACK = _one("flight_attack", "flight", "estimated_attack", "rad")
FLIGHT_STEADY = _one("flight_steady", "flight_steady", "estimated_steady", "1")


INPUT_SETS: dict[str, tuple[str, ...]] = {
    "full": (
        *("attitude", "gyroscope", "depth_rate", "depth_rate_slow"),
        *("glide_speed", "gravity", "controls"),
    ),
    "glider": (
        *("attitude", "depth_rate", "depth_rate_slow", "glide_speed", "glide_speed_slow"),
        *("shift", "pump"),
    ),
    "thrusters": ("attitude", "gyroscope", "accelerometer", "depth_rate", "commands"),
}
"""Inputs by name. `full` needs gyroscopes and accelerometers; `glider` needs only what every
glider logs. `thrusters` needs commands, and is `full` of a vehicle whose thrusters hold a pose.
`glide_speed` is the kinematic speed from the depth rate: with it, ten hours of missions train a
surge network to a hundredth of the error without it."""

DEFAULT_GROUPS = INPUT_SETS["full"]
"""Groups of the default inputs."""
FLIGHT = "flight"
"""Group added to the set `full` if a glider's store has all channels of the flight filter."""

SENSORS: dict[str, tuple[str, ...]] = {
    "imu": (*(f"measured_{axis}_rate" for axis in ("roll", "pitch", "yaw")), *FORCES),
    "attitude": ("measured_roll", "measured_pitch", "measured_heading"),
    "controls": tuple(
        f"{kind}_{name}" for kind in ("measured", "commanded") for name in GLIDER_PARTS
    ),
}
"""Channels of sensors that a vehicle may lack; a mask of that name removes all their features."""


def groups() -> dict[str, tuple[str, ...]]:
    """Names of the features of each group."""
    found: dict[str, list[str]] = {}
    for name, one in FEATURES.items():
        found.setdefault(one.group, []).append(name)
    return {group: tuple(names) for group, names in found.items()}


def features_of(sensor: str, features: Iterable[str] | None = None) -> tuple[str, ...]:
    """Features among `features` that read a sensor of `SENSORS`, given by name."""
    channels = set(SENSORS[sensor])
    return tuple(
        name
        for name in (FEATURES if features is None else features)
        if channels & set(sources(feature(name).channels))
        or (sensor == PART_GROUPS["measured"] and is_part_channel(name))
    )


def features_for(parts: Sequence[str]) -> dict[str, Feature]:
    """All features of a vehicle with these parts, by name in the order of networks."""
    lacking = {name for name in GLIDER_PARTS if name not in parts}
    gone = {f"{kind}_{name}" for kind in PART_GROUPS for name in lacking}
    found = {name: f for name, f in FEATURES.items() if not gone & set(sources(f.channels))}
    for kind in PART_GROUPS:
        for part in parts:
            if part not in GLIDER_PARTS:
                found[f"{kind}_{part}"] = feature(f"{kind}_{part}")
    return found


def select_features(
    chosen: Iterable[str] = DEFAULT_GROUPS,
    without: Iterable[str] = (),
    parts: Sequence[str] = GLIDER_PARTS,
) -> tuple[str, ...]:
    """Select features by names of features or groups, in the table's order.

    A group holds the features that the vehicle has: `controls` are the readings of its parts.

    Args:
      chosen: features, groups and `imu` to use.
      without: features, groups and sensors (see `SENSORS`) to leave out, e.g. `imu` for a vehicle
        that logs neither gyroscopes nor accelerometers.
      parts: names of the vehicle's parts, a glider's by default.

    Raises:
      InputError: an unknown name, a feature of a part that the vehicle lacks, or nothing is left.
    """
    table = features_for(parts)

    def names(entries: Iterable[str], known: Mapping[str, Iterable[str]]) -> set[str]:
        found: set[str] = set()
        for entry in entries:
            if entry in FEATURES and entry not in table:
                raise InputError(
                    f"feature {entry!r} reads {', '.join(FEATURES[entry].channels)}, which the "
                    f"store's vehicle has not (its parts: {', '.join(parts)}); choose --inputs "
                    "full, or other --features"
                )
            if entry not in known:
                raise InputError(unknown_name("feature or feature group", entry, known))
            found.update(known[entry])
        return found

    sensors = {name: features_of(name, table) for name in SENSORS}
    single = {name: (name,) for name in table}
    grouped = {group: tuple(n for n, f in table.items() if f.group == group) for group in groups()}
    known, masks = {**sensors, **single, **grouped}, {**grouped, **single, **sensors}
    left = names(chosen, known) - names(without, masks)
    if not left:
        raise InputError("no input feature is left; choose more features or mask fewer")
    return tuple(name for name in table if name in left)


def without_image(features: Iterable[str], parts: Mapping[str, float | None]) -> tuple[str, ...]:
    """Features whose part has no mirror image by itself; `parts` as in `mirror_signs`."""
    odd_by_part = (name for name in features if feature(name).odd is None)
    return tuple(name for name in odd_by_part if parts.get(name.partition("_")[2]) is None)


def mirror_signs(
    features: Iterable[str], parts: Mapping[str, float | None] | None = None
) -> NDArray[np.float32]:
    """Signs under the mirror port to starboard: -1 for features that change sign, else 1.

    Args:
      parts: factor of the mirror on each part's position: 1, -1, or None for a part without a
        mirror image.

    Raises:
      InputError: a part's mirror image is unknown.
    """
    signs = []
    for name in features:
        odd = feature(name).odd
        if odd is None:
            sign = (parts or {}).get(name.partition("_")[2])
            if sign is None:
                raise InputError(
                    f"feature {name!r}: the vehicle has no mirror image of this part, so that its "
                    "missions cannot be mirrored; train with --no-mirror"
                )
            odd = sign < 0.0
        signs.append(-1.0 if odd else 1.0)
    return np.array(signs, np.float32)


def leave_out(channels: Iterable[str]) -> str:
    """Advice to train without these channels, for errors; empty if no feature reads any."""
    lost = set(channels)
    readers = [f.name for f in FEATURES.values() if lost & set(sources(f.channels))]
    readers += sorted(filter(is_part_channel, lost - {CTD}))
    if not readers:
        return ""
    return f", or train without what reads it: `learn fit --without {' '.join(readers)}`"


def feature_matrix(
    signals: Channels, features: Sequence[str], period: float, mission: int
) -> NDArray[np.float32]:
    """Compute the features (time, features) of one mission, in their own units.

    Raises:
      StoreError: a channel is missing or holds a value that is not finite; the mission, the
        channel and the first such sample are named.
    """
    for channel in channels_of(features):
        if channel not in signals:
            raise StoreError(f"mission {mission} has no channel {channel}")
        bad = np.flatnonzero(~np.isfinite(signals[channel]))
        if bad.size:
            raise StoreError(
                f"channel {channel} of mission {mission} is not finite at {bad.size} samples, "
                f"first at {bad[0] * period:.1f} s; repair the store{leave_out([channel])}"
            )
    columns = [feature(name).compute(signals, period) for name in features]
    return np.stack(columns, axis=1).astype(np.float32)
