"""ROS messages: signals for the fields of standard messages, and columns computed from fields.

Units and axes are those of REP 103: metre, radian, second; the body is forward, left, up, the world
is east, north, up. A pose in a frame with NED in its name is in north, east, down.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing import Signal, Tally, signal_names
from twin.frames import quaternion_to_euler
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]

GROUPS = {"truth": "true", "measured": "measured", "commanded": "commanded"}
"""First word of a signal by the first word of its topic in exported recordings"""
SI = {"degree": "rad", "cm3": "m3", "dbar": "Pa"}
"""Unit of a std_msgs number, if it differs from the store's"""
GAUGE = "fluid_pressure.gauge"
"""Field computed here: a FluidPressure minus the air's pressure, as in stores"""
ANGLES = {"roll": 0, "pitch": 1, "yaw": 2}
_ROUNDED = 0.01
"""[1] Largest difference of a quaternion's length from 1; rounding to three digits gives less"""


def _pose(prefix: str) -> list[tuple[str, str, str, dict[str, Any]]]:
    east = {"zero": "east", "turns": "counterclockwise"}
    return [
        ("depth", f"{prefix}position.z", "m", {"sign": -1.0}),
        ("onboard_north", f"{prefix}position.y", "m", {}),
        ("onboard_east", f"{prefix}position.x", "m", {}),
        ("roll", f"{prefix}orientation.roll", "rad", {}),
        ("pitch", f"{prefix}orientation.pitch", "rad", {}),
        ("heading", f"{prefix}orientation.yaw", "rad", east),
    ]


def _pose_ned(prefix: str) -> list[tuple[str, str, str, dict[str, Any]]]:
    turned = {"onboard_north": f"{prefix}position.x", "onboard_east": f"{prefix}position.y"}
    return [
        (signal, turned.get(signal, field), unit, {"frame": "FRD"})
        for signal, field, unit, _ in _pose(prefix)
    ]


def _twist(prefix: str) -> list[tuple[str, str, str, dict[str, Any]]]:
    axes = dict(zip(("surge", "sway", "heave"), "xyz", strict=True))
    return [
        *((f"dvl_{name}", f"{prefix}linear.{axis}", "m/s", {}) for name, axis in axes.items()),
        ("dvl_mode", "mode", "1", {"held": True}),
        *((name, f"{prefix}linear.{axis}", "m/s", {}) for name, axis in axes.items()),
    ]


_BARE = frozenset(f"std_msgs/msg/{name}" for name in ("Float64", "Float32", "Int32", "UInt8"))
_KINDS: dict[str, list[tuple[str, str, str, dict[str, Any]]]] = {
    "sensor_msgs/msg/Imu": [
        *_pose("")[3:],
        *(
            (f"{name}_rate", f"angular_velocity.{axis}", "rad/s", {})
            for name, axis in (("roll", "x"), ("pitch", "y"), ("yaw", "z"))
        ),
        *((f"specific_force_{a}", f"linear_acceleration.{a}", "m/s2", {}) for a in "xyz"),
    ],
    "nav_msgs/msg/Odometry": _pose("pose.pose."),
    "geometry_msgs/msg/PoseStamped": _pose("pose."),
    "sensor_msgs/msg/FluidPressure": [("pressure", GAUGE, "Pa", {})],
    "sensor_msgs/msg/Temperature": [("temperature", "temperature", "degC", {})],
    "sensor_msgs/msg/NavSatFix": [
        ("gps_latitude", "latitude", "deg", {}),
        ("gps_longitude", "longitude", "deg", {}),
    ],
    "geometry_msgs/msg/TwistWithCovarianceStamped": _twist("twist.twist."),
    "geometry_msgs/msg/TwistStamped": _twist("twist."),
    "geometry_msgs/msg/Vector3Stamped": [
        ("current_north", "vector.y", "m/s", {}),
        ("current_east", "vector.x", "m/s", {}),
        ("current_down", "vector.z", "m/s", {"sign": -1.0}),
    ],
}
"""Fields by message type: signal without its first word, field, unit, and changes to the default
`Signal`. Of two sources of a signal, the type that comes first here is taken."""
_POSES = {"nav_msgs/msg/Odometry": "pose.pose.", "geometry_msgs/msg/PoseStamped": "pose."}
"""Message types with a pose, and the path of the pose in the message"""
_IMU = "sensor_msgs/msg/Imu"
NED = {kind: _pose_ned(prefix) for kind, prefix in _POSES.items()} | {
    _IMU: [(signal, field, unit, {"frame": "FRD"}) for signal, field, unit, _ in _KINDS[_IMU]]
}
"""Fields by message type, for frames in north, east, down"""
NO_MEASUREMENT = frozenset({"orientation_covariance.0", "angular_velocity_covariance.0",
                 "linear_acceleration_covariance.0", "status.status"})  # fmt: skip
"""Fields that are negative if other fields of the message are not measured"""


def standard_signals(
    kinds: dict[str, str], frames: dict[str, tuple[str, str]], tally: Tally
) -> dict[str, list[Signal]]:
    """Sources of each signal in a recording's standard messages, the best source first."""
    found: dict[str, list[Signal]] = {}
    rank = {kind: k for k, kind in enumerate(_KINDS)}
    known = set(signal_names())
    for topic in sorted(kinds, key=lambda t: (not _ours(t), rank.get(kinds[t], len(rank)), t)):
        ned = _is_ned(frames.get(topic, ("", "")))
        if ned:
            why = f"frame {', '.join(filter(None, frames[topic]))}: north, east, down"
            tally.add("note", topic, 1, why)
        for name, signal in _signals(topic, kinds[topic], ned):
            if name in known:
                found.setdefault(name, []).append(signal)
    return found


def _ours(topic: str) -> bool:
    return topic.partition("/")[2].partition("/")[0] in GROUPS


def _is_ned(frames: tuple[str, str]) -> bool:
    """True if a frame's name contains NED."""
    return any(re.search(r"(^|[^a-z])ned([^a-z]|$)", name.lower()) for name in frames)


def merged_topic(topic: str) -> str:
    """Common topic of a Doppler log's bottom and water velocities; other topics stay unchanged."""
    head, _, last = topic.rpartition("/")
    return head if head.endswith("dvl") and last in ("bottom", "water") else topic


def _signals(topic: str, kind: str, ned: bool) -> Iterator[tuple[str, Signal]]:
    """Signals of a standard message's fields, with their names.

    Args:
      ned: the frames are north, east, down and forward, starboard, down.
    """
    group = GROUPS.get(topic.split("/")[1] if topic.startswith("/") else "", "measured")
    name = merged_topic(topic)
    if kind in _BARE:
        rest = topic.rpartition("/")[2]
        signal = f"{group}_{rest}"
        if _ours(topic) and signal in VARIABLES and signal in signal_names():
            units = VARIABLES[signal].units
            yield signal, Signal(column=f"{name} data", unit=SI.get(units, units), frame="FRD")
        return
    for signal, field, unit, changes in (NED if ned else _KINDS).get(kind, ()):
        if kind.startswith("geometry_msgs/msg/Twist"):
            through = topic == "/truth/velocity_through_water"
            if through == signal.startswith("dvl") or not (through or "dvl" in topic.lower()):
                continue
        if signal == "current_north" and not topic.endswith("/current"):
            return
        if kind == "sensor_msgs/msg/NavSatFix":
            if group == "true":
                return  # the true track follows from true north and east
            if topic == "/measured/track":
                signal = signal.removeprefix("gps_")
            yield signal, Signal(column=f"{name} {field}", unit=unit)
        elif signal.startswith("onboard"):
            if group == "measured":
                yield signal, Signal(column=f"{name} {field}", unit=unit)
        else:
            yield (
                f"{group}_{signal}",
                Signal(column=f"{name} {field}", unit=unit, **{"frame": "FLU", **changes}),
            )


def raw_fields(field: str) -> tuple[str, ...]:
    """Fields of a message from which a column is computed."""
    prefix, _, last = field.rpartition(".")
    if prefix.endswith("orientation") and last in ANGLES:
        raw = tuple(f"{prefix}.{axis}" for axis in "wxyz")
        return (*raw, "orientation_covariance.0") if prefix == "orientation" else raw
    if field == GAUGE:
        return ("fluid_pressure",)
    if prefix in ("angular_velocity", "linear_acceleration"):
        return (field, f"{prefix}_covariance.0")
    return (field, "status.status") if field in ("latitude", "longitude") else (field,)


def column_of(field: str, found: dict[str, Array]) -> Array:
    """Compute a column from its messages' fields."""
    raw = raw_fields(field)
    if raw[0].endswith("orientation.w"):
        values = quaternion_to_euler(np.stack([found[name] for name in raw[:4]], axis=-1))
        column = values[ANGLES[field.rpartition(".")[2]]]
    else:
        column = found[raw[0]]
    for name in NO_MEASUREMENT & set(raw) & set(found):
        low = found[name] < 0.0  # -1: no such measurement, or no fix
        column = np.where(low, np.nan, column)
    return column


def unit_quaternions(found: dict[str, Array], topic: str, tally: Tally) -> None:
    """Normalise quaternions in place; quaternions of another length become NaN and are reported."""
    for prefix in [name.removesuffix(".w") for name in found if name.endswith("orientation.w")]:
        names = [f"{prefix}.{axis}" for axis in "wxyz"]
        if not set(names) <= set(found):
            continue
        length = np.sqrt(np.sum([found[name] ** 2 for name in names], axis=0))
        bad = ~(np.abs(length - 1.0) <= _ROUNDED)
        said = bad & (found.get(f"{prefix}_covariance.0", length) >= 0.0)  # -1: not measured
        tally.add("removed", topic, said, "no attitude: a quaternion not of length 1")
        for name in names:
            found[name] = np.where(bad, np.nan, found[name] / np.where(bad, 1.0, length))
