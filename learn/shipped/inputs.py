"""Inputs of the shipped networks: groups of features by sort, and values for missing sensors."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from twin.numbers import Array
from twin.water.density import standard_density

SORTS: Mapping[str, tuple[str, ...]] = {
    "gliders": (
        *("glider", "graver-2005", "rogue", "seaexplorer", "seaglider"),
        *("slocum-200", "slocum-1000", "spray"),
    ),
    "propelled": ("remus", "tethys"),
}
"""Shipped vehicles whose missions train the networks of each sort"""
COMMON = ("attitude", "gyroscope", "depth_rate", "depth_rate_slow")
GROUPS: Mapping[str, tuple[str, ...]] = {
    "gliders": (*COMMON, "glide_speed", "gravity", "flight", "flight_steady"),
    "propelled": (*COMMON, "controls"),
}
"""Groups of features of each sort; of the parts, those that all its vehicles have"""
RATES = ("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate")
FORCES = tuple(f"measured_specific_force_{axis}" for axis in "xyz")
MISSING: Mapping[str, tuple[str, ...]] = {
    "imu": (*RATES, *FORCES), "ctd": ("measured_density",)
}  # fmt: skip
"""Channels that a vehicle may lack, by sensor"""
GRAVITY = 9.81


def substituted(
    signals: Mapping[str, Array], period: float, missing: Collection[str]
) -> dict[str, Array]:
    """Replace channels of MISSING by values computed from attitude and depth.

    Turn rates are backward differences of the attitude. The specific force is that of a vehicle
    without acceleration, the density that of the standard ocean.

    Args:
      signals: channels, each (time,); attitude and depth are needed.
      period: [s] between samples.
      missing: names of the channels to replace.
    """
    roll, pitch, heading = (
        np.deg2rad(signals[f"measured_{angle}"]) for angle in ("roll", "pitch", "heading")
    )
    turns = (np.diff(np.unwrap(a), prepend=a[:1]) / period for a in (roll, pitch, heading))
    roll_rate, pitch_rate, yaw = turns
    level = np.cos(pitch)
    found = {
        RATES[0]: roll_rate - yaw * np.sin(pitch),
        RATES[1]: pitch_rate * np.cos(roll) + yaw * level * np.sin(roll),
        RATES[2]: yaw * level * np.cos(roll) - pitch_rate * np.sin(roll),
        FORCES[0]: GRAVITY * np.sin(pitch),
        FORCES[1]: -GRAVITY * level * np.sin(roll),
        FORCES[2]: -GRAVITY * level * np.cos(roll),
        "measured_density": standard_density(signals["measured_depth"]),
    }
    return {**signals, **{name: found[name] for name in missing}}
