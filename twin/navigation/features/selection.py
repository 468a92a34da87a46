"""Selection: which features a network sees, from names, groups and the sensors that there are.

The features of one mission make a matrix.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError, unknown_name
from twin.navigation.features.base import (
    FEATURES,
    GLIDER_PARTS,
    PART_GROUPS,
    Channels,
    Feature,
    channels_of,
    feature,
    is_part_channel,
)
from twin.navigation.features.sensed import FORCES
from twin.navigation.settings import CTD, sources

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
FLIGHT = "flight"
"""Group that joins the set `full` where a glider's store has what the flight filter reads."""

SENSORS: dict[str, tuple[str, ...]] = {
    "imu": (*(f"measured_{axis}_rate" for axis in ("roll", "pitch", "yaw")), *FORCES),
    "attitude": ("measured_roll", "measured_pitch", "measured_heading"),
    "controls": tuple(
        f"{kind}_{name}" for kind in ("measured", "commanded") for name in GLIDER_PARTS
    ),
}
"""Channels of what a vehicle may lack; a mask of such a name takes out all that reads one."""


def groups() -> dict[str, tuple[str, ...]]:
    """Names of the features of each group."""
    found: dict[str, list[str]] = {}
    for name, one in FEATURES.items():
        found.setdefault(one.group, []).append(name)
    return {group: tuple(names) for group, names in found.items()}


def features_of(sensor: str, features: Iterable[str] | None = None) -> tuple[str, ...]:
    """Features among `features` that read a sensor of `SENSORS`, by its name."""
    channels = set(SENSORS[sensor])
    return tuple(
        name
        for name in (FEATURES if features is None else features)
        if channels & set(sources(feature(name).channels))
        or (sensor == PART_GROUPS["measured"] and is_part_channel(name))
    )


def features_for(parts: Sequence[str]) -> dict[str, Feature]:
    """Every feature that a vehicle with these parts has, by name in the order of networks."""
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
    grouped = {group: tuple(n for n, f in table.items() if f.group == group) for group in groups()}
    known, masks = {**sensors, **single, **grouped}, {**grouped, **single, **sensors}
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


def leave_out(channels: Iterable[str]) -> str:
    """Advice on networks that read none of these channels; empty where none reads one."""
    lost = set(channels)
    readers = [f.name for f in FEATURES.values() if lost & set(sources(f.channels))]
    readers += sorted(filter(is_part_channel, lost - {CTD}))
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
