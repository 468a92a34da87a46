"""Features: what a network sees, by name, computed from what a vehicle measures or commands.

No feature reads a `true_*` channel. Absolute heading is not a feature: the water does not know
where north is, and a network that sees the heading learns the headings of its training missions.
Absolute depth is one, `depth`, but no default: on few missions it works as a mission's signature.
Where net buoyancy changes with depth (hull compressibility, stratification), `glide_speed` is the
better way to tell the network, since it needs no knowledge of buoyancy.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError, unknown_name
from twin.records.schema import SIMULATED, VARIABLES, WITH_FLOOR

Array = NDArray[np.float64]
Channels = Mapping[str, Array]
"""Signals (time,) of one mission by schema name; angles in degrees as stored."""

SLOW_S = 10.0
"""[s] Window of the slow features: long against sensor noise at 2 Hz, short against the 30-60 s in
which a glider settles."""

FLAT_SINE = 0.15
"""Sine of the pitch (9 degrees) below which `glide_speed` fades to zero instead of growing."""


@dataclasses.dataclass(frozen=True)
class Feature:
    """One input of the networks."""

    name: str
    group: str
    """The mask that switches it off together with its like."""
    channels: tuple[str, ...]
    """Schema variables that it reads."""
    unit: str
    compute: Callable[[Channels, float], Array] = dataclasses.field(repr=False)
    """From channels (time,) and the sample period [s] to values (time,)."""
    odd: bool | None = False
    """Whether it changes its sign when the vehicle is mirrored, port for starboard; None: the
    store's vehicle says."""


def trailing_slope(values: Array, samples: int, period: float) -> Array:
    """Least-squares slope [unit/s] over the last `samples` values; the future is not used.

    Before the first sample the signal is taken as constant, which a launch from rest is.
    Two samples give the backward difference.
    """
    places = np.arange(samples) - (samples - 1) / 2
    weights = places / (places @ places) / period
    padded = np.concatenate([np.full(samples - 1, values[0]), values])
    return np.convolve(padded, weights[::-1], mode="valid")


def trailing_mean(values: Array, samples: int) -> Array:
    """Mean of the last `samples` values, fewer at the start."""
    total = np.concatenate([[0.0], np.cumsum(values - values[0])])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(last - samples, 0)
    return (total[last] - total[first]) / (last - first) + values[0]


def _window(period: float) -> int:
    return max(2, round(SLOW_S / period))


def _turned(degrees: Array) -> Array:
    """Angle [rad] without jumps at 360 degrees."""
    return np.unwrap(np.deg2rad(degrees))


def _glide_speed(depth_rate: Array, pitch: Array) -> Array:
    """Speed [m/s] along the body that explains the depth rate, -z' / sin(pitch), damped when flat.

    The regularised quotient -z' s / (s^2 + FLAT_SINE^2) has no pole at an inflection.
    """
    return _damped_quotient(depth_rate, np.sin(np.deg2rad(pitch)))


def _damped_quotient(depth_rate: Array, sine: Array) -> Array:
    return -depth_rate * sine / (sine**2 + FLAT_SINE**2)


_FORCES = (
    "measured_specific_force_x",
    "measured_specific_force_y",
    "measured_specific_force_z",
)


def _gravity_sine(c: Channels, samples: int) -> Array:
    """Sine of the pitch from the direction of the mean specific force, nose up.

    A glider hardly accelerates, so its accelerometer is an inclinometer without the errors that the
    gyros add to an attitude filter; the bias of the accelerometer is in both.
    """
    x, y, z = (trailing_mean(c[name], samples) for name in _FORCES)
    size = np.sqrt(x**2 + y**2 + z**2)
    return np.divide(x, size, out=np.zeros_like(x), where=size > 0.0)


def _gravity_glide(name: str, *, slow: bool = False) -> Feature:
    def compute(c: Channels, period: float) -> Array:
        samples = _window(period) if slow else 2
        rate = trailing_slope(c["measured_depth"], samples, period)
        return _damped_quotient(rate, _gravity_sine(c, samples))

    return Feature(name, "gravity", (*_FORCES, "measured_depth"), "m s-1", compute)


def _plain(name: str, group: str, channel: str, unit: str, *, odd: bool = False) -> Feature:
    return Feature(name, group, (channel,), unit, lambda c, _: c[channel], odd)


def _of_angle(
    name: str, group: str, channel: str, function: Callable[[Array], Array], *, odd: bool = False
) -> Feature:
    def compute(c: Channels, _: float) -> Array:
        return function(np.deg2rad(c[channel]))

    return Feature(name, group, (channel,), "1", compute, odd)


def _rate(name: str, group: str, channel: str, unit: str, *, slow: bool = False) -> Feature:
    def compute(c: Channels, period: float) -> Array:
        return trailing_slope(c[channel], _window(period) if slow else 2, period)

    return Feature(name, group, (channel,), unit, compute)


def _angle_rate(
    name: str, group: str, channel: str, *, slow: bool = False, odd: bool = False
) -> Feature:
    def compute(c: Channels, period: float) -> Array:
        return trailing_slope(_turned(c[channel]), _window(period) if slow else 2, period)

    return Feature(name, group, (channel,), "rad s-1", compute, odd)


def _slow_sine(name: str, group: str, channel: str, *, odd: bool = False) -> Feature:
    def compute(c: Channels, period: float) -> Array:
        return trailing_mean(np.sin(np.deg2rad(c[channel])), _window(period))

    return Feature(name, group, (channel,), "1", compute, odd)


def _compute_glide_speed(c: Channels, period: float) -> Array:
    return _glide_speed(trailing_slope(c["measured_depth"], 2, period), c["measured_pitch"])


def _compute_glide_speed_slow(c: Channels, period: float) -> Array:
    samples = _window(period)
    rate = trailing_slope(c["measured_depth"], samples, period)
    return _glide_speed(rate, trailing_mean(c["measured_pitch"], samples))


_GLIDE = ("measured_depth", "measured_pitch")

_TABLE: tuple[Feature, ...] = (
    _of_angle("sin_roll", "attitude", "measured_roll", np.sin, odd=True),
    _of_angle("cos_roll", "attitude", "measured_roll", np.cos),
    _of_angle("sin_pitch", "attitude", "measured_pitch", np.sin),
    _of_angle("cos_pitch", "attitude", "measured_pitch", np.cos),
    _slow_sine("sin_roll_slow", "attitude_slow", "measured_roll", odd=True),
    _slow_sine("sin_pitch_slow", "attitude_slow", "measured_pitch"),
    _angle_rate("roll_change", "attitude_rate", "measured_roll", odd=True),
    _angle_rate("pitch_change", "attitude_rate", "measured_pitch"),
    _angle_rate("heading_change", "attitude_rate", "measured_heading", odd=True),
    _angle_rate("roll_change_slow", "attitude_rate_slow", "measured_roll", slow=True, odd=True),
    _angle_rate("pitch_change_slow", "attitude_rate_slow", "measured_pitch", slow=True),
    _angle_rate(
        "heading_change_slow", "attitude_rate_slow", "measured_heading", slow=True, odd=True
    ),
    _plain("roll_rate", "gyroscope", "measured_roll_rate", "rad s-1", odd=True),
    _plain("pitch_rate", "gyroscope", "measured_pitch_rate", "rad s-1"),
    _plain("yaw_rate", "gyroscope", "measured_yaw_rate", "rad s-1", odd=True),
    _plain("specific_force_x", "accelerometer", "measured_specific_force_x", "m s-2"),
    _plain("specific_force_y", "accelerometer", "measured_specific_force_y", "m s-2", odd=True),
    _plain("specific_force_z", "accelerometer", "measured_specific_force_z", "m s-2"),
    _rate("depth_rate", "depth_rate", "measured_depth", "m s-1"),
    _rate("depth_rate_slow", "depth_rate_slow", "measured_depth", "m s-1", slow=True),
    Feature("glide_speed", "glide_speed", _GLIDE, "m s-1", _compute_glide_speed),
    Feature("glide_speed_slow", "glide_speed_slow", _GLIDE, "m s-1", _compute_glide_speed_slow),
    Feature(
        "gravity_pitch_sine",
        "gravity",
        _FORCES,
        "1",
        lambda c, period: _gravity_sine(c, _window(period)),
    ),
    _gravity_glide("gravity_glide_speed"),
    _gravity_glide("gravity_glide_speed_slow", slow=True),
    _plain("depth", "depth", "measured_depth", "m"),
    _plain("shift", "controls", "measured_shift", "m"),
    _of_angle("sin_rotation", "controls", "measured_rotation", np.sin, odd=True),
    _of_angle("cos_rotation", "controls", "measured_rotation", np.cos),
    _plain("pump", "controls", "measured_pump", "cm3"),
    _rate("shift_change", "control_rate", "measured_shift", "m s-1"),
    _angle_rate("rotation_change", "control_rate", "measured_rotation", odd=True),
    _rate("pump_change", "control_rate", "measured_pump", "cm3 s-1"),
    _plain("shift_command", "commands", "commanded_shift", "m"),
    _of_angle("sin_rotation_command", "commands", "commanded_rotation", np.sin, odd=True),
    _of_angle("cos_rotation_command", "commands", "commanded_rotation", np.cos),
    _plain("pump_command", "commands", "commanded_pump", "cm3"),
)

FEATURES: dict[str, Feature] = {feature.name: feature for feature in _TABLE}
"""Every feature by name."""

GROUPS: dict[str, tuple[str, ...]] = {
    group: tuple(f.name for f in _TABLE if f.group == group)
    for group in dict.fromkeys(f.group for f in _TABLE)
}
"""Names of the features of each group."""

INPUT_SETS: dict[str, tuple[str, ...]] = {
    "full": (
        *("attitude", "gyroscope", "depth_rate", "depth_rate_slow"),
        *("glide_speed", "gravity", "controls"),
    ),
    "glider": (
        *("attitude", "depth_rate", "depth_rate_slow", "glide_speed", "glide_speed_slow"),
        *("shift", "pump"),
    ),
}
"""Inputs by name. `full` needs gyroscopes and accelerometers; `glider` is what every glider's log
has. With `glide_speed`, the kinematic speed of the depth rate, ten hours of missions train a surge
network a hundred times better than without."""

DEFAULT_GROUPS = INPUT_SETS["full"]
"""Groups of the default inputs."""


GLIDER_PARTS = ("shift", "rotation", "pump")
"""Parts whose features are in the table. Those of other parts have the names of their channels:
`measured_rudder` in the group `controls`, `commanded_rudder` in `commands`."""
_PART_GROUPS = {"measured": "controls", "commanded": "commands"}

SENSORS: dict[str, tuple[str, ...]] = {
    "imu": (*(f"measured_{axis}_rate" for axis in ("roll", "pitch", "yaw")), *_FORCES),
    "attitude": ("measured_roll", "measured_pitch", "measured_heading"),
    "controls": tuple(
        f"{kind}_{name}" for kind in ("measured", "commanded") for name in GLIDER_PARTS
    ),
}
"""Channels of what a vehicle may lack; a mask of such a name takes out all that reads one."""


def feature(name: str) -> Feature:
    """The feature of that name, of the table or of a vehicle's part.

    Raises:
      InputError: there is none; the nearest is offered.
    """
    if name in FEATURES:
        return FEATURES[name]
    if not is_part_channel(name):
        raise InputError(unknown_name("feature", name, FEATURES))
    unit = VARIABLES[name].units if name in VARIABLES else ""
    return dataclasses.replace(
        _plain(name, _PART_GROUPS[name.partition("_")[0]], name, unit), odd=None
    )


def is_known(name: str) -> bool:
    """Whether `feature` knows it."""
    return name in FEATURES or is_part_channel(name)


def is_part_channel(name: str) -> bool:
    """Whether it is the reading or the command of a part that the table does not know."""
    kind, _, part = name.partition("_")
    return kind in _PART_GROUPS and bool(part) and name not in (*SIMULATED, *WITH_FLOOR)


def features_of(sensor: str, features: Iterable[str] = tuple(FEATURES)) -> tuple[str, ...]:
    """Those of `features` that read a sensor of `SENSORS`, by the sensor's name."""
    channels = set(SENSORS[sensor])
    return tuple(
        name
        for name in features
        if channels & set(feature(name).channels)
        or (sensor == _PART_GROUPS["measured"] and is_part_channel(name))
    )


def features_for(parts: Sequence[str]) -> dict[str, Feature]:
    """Every feature that a vehicle with these parts has, by name in the order of networks."""
    lacking = {name for name in GLIDER_PARTS if name not in parts}
    gone = {f"{kind}_{name}" for kind in _PART_GROUPS for name in lacking}
    found = {name: f for name, f in FEATURES.items() if not gone & set(f.channels)}
    for kind in _PART_GROUPS:
        for part in parts:
            if part not in GLIDER_PARTS:
                found[f"{kind}_{part}"] = feature(f"{kind}_{part}")
    return found


def select_features(
    chosen: Iterable[str] = DEFAULT_GROUPS,
    without: Iterable[str] = (),
    parts: Sequence[str] = GLIDER_PARTS,
) -> tuple[str, ...]:
    """Names of features from names of features or groups, in the table's order.

    A group holds what the vehicle has of it: `controls` are the readings of its parts.

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
    groups = {
        group: tuple(name for name, f in table.items() if f.group == group) for group in GROUPS
    }
    known, masks = {**sensors, **single, **groups}, {**groups, **single, **sensors}
    left = names(chosen, known) - names(without, masks)
    if not left:
        raise InputError("no input feature is left; choose more features or mask fewer")
    return tuple(name for name in table if name in left)


def mirror_signs(
    features: Iterable[str], parts: Mapping[str, float | None] | None = None
) -> NDArray[np.float32]:
    """-1 for features that the mirror port to starboard turns round, 1 for the others.

    Args:
      parts: what the mirror makes of the position of each part of the vehicle: 1, -1, or None for
        one whose mirror image the vehicle has not.

    Raises:
      InputError: a part's mirror image is not known.
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


def channels_of(features: Iterable[str]) -> tuple[str, ...]:
    """Schema variables that these features read, each once."""
    return tuple(dict.fromkeys(c for name in features for c in feature(name).channels))


def leave_out(channels: Iterable[str]) -> str:
    """What to type so that networks read none of these channels; empty where none does."""
    lost = set(channels)
    readers = [f.name for f in FEATURES.values() if lost & set(f.channels)]
    readers += sorted(filter(is_part_channel, lost))
    if not readers:
        return ""
    return f", or train without what reads it: `learn fit --without {' '.join(readers)}`"


def feature_matrix(
    signals: Channels, features: Sequence[str], period: float, mission: int
) -> NDArray[np.float32]:
    """Features (time, features) of one mission, in their own units.

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
