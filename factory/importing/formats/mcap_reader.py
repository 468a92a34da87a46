"""Reader of ROS 2 recordings: MCAP files, and what is the same in rosbag2's folders.

Units and axes of standard messages are those of REP 103: metre, radian, second; the body is
forward, left, up, the world is east, north, up. `factory export --to mcap` writes the same. A pose
whose frame has NED in its name is in north, east, down.
"""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import counts_upward
from factory.importing.deployment_log import TRUNCATED, DeploymentLog, each_file
from factory.importing.formats.base import ReadOptions, kinds_by_bytes
from factory.importing.formats.csv.mapping import Mapping, Signal
from factory.importing.formats.csv.mapping_file import signal_names
from factory.importing.formats.mcap_recording import Ros2Recording, is_cut, recorded
from factory.importing.messages import (
    EARLIEST,
    MessageTable,
    log_of_messages,
    mapping_of,
    valued,
    wanted_fields,
    with_standard,
)
from factory.importing.pressures import without_air
from factory.importing.tally import Tally, note_unread
from twin.errors import InputError
from twin.frames import quaternion_to_euler
from twin.records.attributes import SAMPLE_PERIOD
from twin.records.schema import VARIABLES
from twin.vehicle.presets import shipped_files

Array = NDArray[np.float64]

KIND = "recording"
"""What the report calls the files"""
GAP = 60.0
"""[s] A longer hole in all topics ends a row"""
GAUGE = "fluid_pressure.gauge"
"""Field made here: a FluidPressure without the air's part, which stores do not have"""
ANGLES = {"roll": 0, "pitch": 1, "yaw": 2}
GROUPS = {"truth": "true", "measured": "measured", "commanded": "commanded"}
"""First word of our own topics, and of the signals that they become"""
SI = {"degree": "rad", "cm3": "m3", "dbar": "Pa"}
"""Unit of a bare number where it is not the store's"""
OWN = "glider-twin"
"""Name of the metadata that our own files have"""


def read_mcap(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """One log for each file.

    Raises:
      ModuleNotFoundError: rosbags is not installed.
      InputError: damaged, without a message that is known, or not as the mapping says.
    """
    return read_recordings(paths, options, tally)


def read_recordings(
    paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:
    """One log for each MCAP file or folder of rosbag2."""
    import rosbags.highlevel  # noqa: F401  (what is missing is told before any file is blamed)

    return [log for _, log in each_file(paths, lambda path: _log(path, options, tally), tally)]


def _log(path: Path, options: ReadOptions, tally: Tally) -> DeploymentLog:
    said = _metadata(path)
    model = said.get("vehicle") if said.get("vehicle") in shipped_files() else None
    mapping = mapping_of(options, said.get("vehicle", "ROS 2 vehicle"), model, GAP)
    try:
        topics, tables, mapping = _tables(path, mapping, tally)
    except InputError:
        raise
    except Exception as error:  # a damaged file fails anywhere in another's parser
        words = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{path.name} cannot be read as a ROS 2 recording: {words}; `mcap recover` or "
            "`ros2 bag reindex` repairs one that was cut off"
        ) from error
    log = log_of_messages(
        path, path.name.partition(".")[0], topics, tables, mapping, options, tally
    )
    period = float(said[SAMPLE_PERIOD]) if SAMPLE_PERIOD in said else log.period
    return dataclasses.replace(log, period=period, simulated="data" in said)


def _metadata(path: Path) -> dict[str, str]:
    """What a file of ours says of itself; empty of another's."""
    from mcap.reader import make_reader
    from mcap.records import Metadata

    if path.is_dir():
        return {}
    if "mcap" not in kinds_by_bytes(path):
        raise InputError(f"{path.name} is no MCAP file: it does not begin as one")
    try:
        with path.open("rb") as stream:
            whole = () if is_cut(path) else make_reader(stream).iter_metadata()
            cut = (one for one in recorded(path) if isinstance(one, Metadata))
            for one in whole or cut:
                if one.name == OWN:
                    return dict(one.metadata)
    except Exception as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path.name} is damaged: {why}; try `mcap recover`") from error
    return {}


def _tables(
    path: Path, mapping: Mapping, tally: Tally
) -> tuple[list[str], dict[str, MessageTable], Mapping]:  # fmt: skip
    recording = Ros2Recording(path)
    if recording.cut and not recording.channels:
        raise InputError(f"{path.name} is cut off before its first whole chunk: it holds nothing")
    for name in recording.cut:
        tally.add("note", name, 1, f"{TRUNCATED}it lacks its end; what is before is read")
    every = {one.topic: one for one in recording.channels}
    readable = {topic: one for topic, one in every.items() if not one.unread}
    for topic in sorted(set(every) - set(readable)):
        tally.add("left out", topic, 1, f"{path.name}: {every[topic].unread}")
    kinds = {topic: one.kind for topic, one in readable.items()}
    frames = _frames(recording, [topic for topic, kind in kinds.items() if kind in _NED])
    sources = _standard(kinds, frames, tally)
    wanted = _fields_of_all(mapping, sources)
    used = [topic for topic in readable if _merged(topic) in wanted]
    note_unread(KIND, kinds, used, tally)
    times: dict[str, list[float]] = {}
    rows: dict[str, list[tuple[Any, ...]]] = {}
    raw = {topic: sorted({r for f in fs for r in _raw(f)}) for topic, fs in wanted.items()}
    taken: dict[str, Callable[[Any], tuple[Any, ...]]] = {}
    broken: dict[str, list[str]] = {}
    for channel, moment, data in recording.messages(used):
        topic = _merged(channel.topic)
        try:
            message: Any = channel.decode(data)
        except Exception as error:  # whatever a decoder raises of damaged bytes
            broken.setdefault(channel.topic, []).append(" ".join(str(error).split())[:120])
            continue
        if channel.topic not in taken:
            taken[channel.topic] = _getter(
                [f for f in raw[topic] if _has(message, f) or f == "mode"], channel.topic
            )
            raw[topic] = [f for f in raw[topic] if _has(message, f) or f == "mode"]
        times.setdefault(topic, []).append(_moment(message, moment))
        rows.setdefault(topic, []).append(taken[channel.topic](message))
    for topic, whys in broken.items():
        tally.add("removed", topic, len(whys), f"{path.name}: messages that no {kinds[topic]} are: "
                  f"{whys[0]}")  # fmt: skip
    tables = {}
    for topic, some in rows.items():
        values = np.array(some, float).reshape(len(some), -1)
        found = dict(zip(raw[topic], values.T, strict=True))
        _unit_quaternions(found, topic, tally)
        columns = {f: _column(f, found) for f in wanted[topic] if set(_raw(f)) <= set(found) | _NO}
        if GAUGE in columns:
            moments, unit = np.array(times[topic]), _unit_of(f"{topic} {GAUGE}", mapping)
            columns[GAUGE] = without_air(moments, columns[GAUGE], unit, topic, tally)
        tables[topic] = MessageTable(np.array(times[topic]), columns)
    mapping = with_standard(mapping, valued(sources, tables, tally), tally)
    _ask_ned(mapping, tables, frames, tally)
    return sorted(every), tables, mapping


def _frames(recording: Ros2Recording, topics: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Frames of the world and of the body that poses and attitudes are in, by topic, as the first
    messages say; nothing of topics that cannot be decoded."""
    found: dict[str, tuple[str, str]] = {}
    for topic in topics:
        with contextlib.suppress(Exception):  # the loop over all messages names such a topic
            channel, _, data = next(recording.messages([topic]))
            message: Any = channel.decode(data)
            found[topic] = (
                str(message.header.frame_id), str(getattr(message, "child_frame_id", ""))
            )  # fmt: skip
    return found


def _is_ned(frames: tuple[str, str]) -> bool:
    """Whether the name of a frame says that it is north, east, down."""
    return any(re.search(r"(^|[^a-z])ned([^a-z]|$)", name.lower()) for name in frames)


def _ask_ned(
    mapping: Mapping,
    tables: dict[str, MessageTable],
    frames: dict[str, tuple[str, str]],
    tally: Tally,
) -> None:
    """Mark a pose as suspect whose z is positive under water in a frame that does not say so."""
    signal = mapping.signals.get("measured_depth")
    topic, _, field = (signal.column if signal else "").partition(" ")
    if signal is None or signal.sign > 0.0 or topic not in frames or topic not in tables:
        return
    values = tables[topic].columns.get(field)
    if values is not None and counts_upward(-values):
        tally.doubt(
            topic,
            f"{field} is positive under water: NED? Its frame {frames[topic][0]!r} does not say "
            "so: z is turned, north, east and angles are taken as ENU's and FLU's; say in a "
            "--mapping what they are (docs/howto/import_messages.md)",
            int(np.isfinite(values).sum()),
        )


def _fields_of_all(mapping: Mapping, sources: dict[str, list[Signal]]) -> dict[str, list[str]]:
    """The fields of a mapping and of every source of the signals that it does not map, by topic."""
    found = wanted_fields(mapping)
    for k in range(max(map(len, sources.values()), default=0)):
        standard = {name: several[k] for name, several in sources.items() if k < len(several)}
        for topic, fields in wanted_fields(with_standard(mapping, standard, Tally())).items():
            known = found.setdefault(topic, [])
            known += [field for field in fields if field not in known]
    return found


def _unit_of(column: str, mapping: Mapping) -> str:
    """Unit of a pressure by the user's mapping, else by the standard message."""
    said = [one.unit for one in mapping.signals.values() if one.column == column]
    return said[0] if said else "Pa"


def _moment(message: Any, logged: int) -> float:
    """[s] when a message was true: its stamp, or when it was logged where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None and stamp.sec > EARLIEST:
        return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
    return logged * 1e-9


def _merged(topic: str) -> str:
    """The two references of a Doppler log are one topic; what a message is against is its mode."""
    head, _, last = topic.rpartition("/")
    return head if head.endswith("dvl") and last in ("bottom", "water") else topic


def _standard(
    kinds: dict[str, str], frames: dict[str, tuple[str, str]], tally: Tally
) -> dict[str, list[Signal]]:
    """Signals of the standard messages of a recording, each with its sources, the best first."""
    found: dict[str, list[Signal]] = {}
    rank = list(_KINDS)
    known = set(signal_names())
    for topic in sorted(kinds, key=lambda t: (not _ours(t), _rank(kinds[t], rank), t)):
        ned = _is_ned(frames.get(topic, ("", "")))
        if ned:
            why = f"frame {', '.join(filter(None, frames[topic]))}: north, east, down"
            tally.add("note", topic, 1, why)
        for name, signal in _signals(topic, kinds[topic], ned):
            if name in known:
                found.setdefault(name, []).append(signal)
    return found


def _rank(kind: str, rank: list[str]) -> int:
    return rank.index(kind) if kind in rank else len(rank)


def _ours(topic: str) -> bool:
    return topic.split("/")[1:2] != [] and topic.split("/")[1] in GROUPS


def _signals(topic: str, kind: str, ned: bool) -> Iterator[tuple[str, Signal]]:
    """What the fields of a standard message are.

    Args:
      ned: whether its frames are north, east, down and forward, starboard, down.
    """
    group = GROUPS.get(topic.split("/")[1] if topic.startswith("/") else "", "measured")
    name = _merged(topic)
    if kind in _BARE:
        rest = topic.rpartition("/")[2]
        signal = f"{group}_{rest}"
        if _ours(topic) and signal in VARIABLES and signal in signal_names():
            units = VARIABLES[signal].units
            yield signal, Signal(column=f"{name} data", unit=SI.get(units, units), frame="FRD")
        return
    for signal, field, unit, changes in (_NED if ned else _KINDS).get(kind, ()):
        if kind.startswith("geometry_msgs/msg/Twist"):
            through = topic == "/truth/velocity_through_water"
            if through == signal.startswith("dvl") or not (through or "dvl" in topic.lower()):
                continue
        if signal == "current_north" and not topic.endswith("/current"):
            return
        if kind == "sensor_msgs/msg/NavSatFix":
            if group == "true":
                return  # a store makes the true track of its own start
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
    turned = {"onboard_north": "x", "onboard_east": "y"}
    return [
        (
            signal,
            f"{prefix}position.{turned[signal]}" if signal in turned else field,
            unit,
            {"frame": "FRD"},
        )
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
"""What fields of standard messages are: signal without its first word, field, unit, and how it
differs. Of two sources of a signal the earlier kind is taken."""
_POSES = {"nav_msgs/msg/Odometry": "pose.pose.", "geometry_msgs/msg/PoseStamped": "pose."}
"""Messages of a pose in a frame that they name, and where it is in them"""
_IMU = "sensor_msgs/msg/Imu"
_NED = {kind: _pose_ned(prefix) for kind, prefix in _POSES.items()} | {
    _IMU: [(signal, field, unit, {"frame": "FRD"}) for signal, field, unit, _ in _KINDS[_IMU]]
}
"""What the same fields are in frames that are north, east, down"""
_NO = frozenset({"orientation_covariance.0", "angular_velocity_covariance.0",
                 "linear_acceleration_covariance.0", "status.status"})  # fmt: skip
"""Fields that say that others are no measurement, where a message has them"""


def _raw(field: str) -> tuple[str, ...]:
    """The fields of a message that a column is made of."""
    prefix, _, last = field.rpartition(".")
    if prefix.endswith("orientation") and last in ANGLES:
        raw = tuple(f"{prefix}.{axis}" for axis in "wxyz")
        return (*raw, "orientation_covariance.0") if prefix == "orientation" else raw
    if field == GAUGE:
        return ("fluid_pressure",)
    if prefix in ("angular_velocity", "linear_acceleration"):
        return (field, f"{prefix}_covariance.0")
    return (field, "status.status") if field in ("latitude", "longitude") else (field,)


def _unit_quaternions(found: dict[str, Array], topic: str, tally: Tally) -> None:
    """Attitudes of length 1 in place; those of another length are none, and are counted."""
    for prefix in [name.removesuffix(".w") for name in found if name.endswith("orientation.w")]:
        names = [f"{prefix}.{axis}" for axis in "wxyz"]
        if not set(names) <= set(found):
            continue
        length = np.sqrt(np.sum([found[name] ** 2 for name in names], axis=0))
        bad = ~(np.abs(length - 1.0) <= _ROUNDED)
        said = bad & (found.get(f"{prefix}_covariance.0", length) >= 0.0)  # -1: none, by the rules
        tally.add("removed", topic, int(said.sum()), "no attitude: a quaternion not of length 1")
        for name in names:
            found[name] = np.where(bad, np.nan, found[name] / np.where(bad, 1.0, length))


_ROUNDED = 0.01
"""Rounding to three digits takes a quaternion less away from length 1"""


def _column(field: str, found: dict[str, Array]) -> Array:
    """A column from the fields of its messages."""
    raw = _raw(field)
    if raw[0].endswith("orientation.w"):
        values = quaternion_to_euler(np.stack([found[name] for name in raw[:4]], axis=-1))
        column = values[ANGLES[field.rpartition(".")[2]]]
    else:
        column = found[raw[0]]
    for name in _NO & set(raw) & set(found):
        low = found[name] < 0.0  # -1: no such measurement, or no fix
        column = np.where(low, np.nan, column)
    return column


def _has(message: Any, field: str) -> bool:
    try:
        float(_value(message, field))
    except (AttributeError, IndexError, TypeError, ValueError):
        return False
    return True


def _value(message: Any, field: str) -> Any:
    for word in field.split("."):
        message = message[int(word)] if word.isdigit() else getattr(message, word)
    return message


def _getter(fields: Sequence[str], topic: str) -> Callable[[Any], tuple[Any, ...]]:
    """Takes the fields of a message, as `_value` does and quicker; `mode` is the topic's own."""
    mode = 2.0 if topic.rpartition("/")[2] == "water" else 1.0

    def one(field: str) -> Callable[[Any], Any]:
        if field == "mode":
            return lambda _: mode
        if any(word.isdigit() for word in field.split(".")):
            return lambda message: _value(message, field)
        return attrgetter(field)

    takers = [one(field) for field in fields]
    return lambda message: tuple(take(message) for take in takers)
