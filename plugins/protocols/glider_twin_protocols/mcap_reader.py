"""MCAP reader: ROS 2 recordings as MCAP files, including exported ones, or as rosbag2 folders."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing import (
    TRUNCATED,
    DeploymentLog,
    Mapping,
    ReadOptions,
    Signal,
    Tally,
    WrongFormat,
    counts_upward,
    each_file,
    kinds_by_bytes,
    note_unread,
    without_air,
)
from factory.importing.messages import (
    EARLIEST,
    MessageTable,
    log_of_messages,
    mapping_of,
    valued,
    wanted_fields,
    with_standard,
)
from glider_twin_protocols.mcap_recording import SAID, Ros2Recording, is_cut, recorded
from glider_twin_protocols.ros_messages import (
    GAUGE,
    NED,
    NO_MEASUREMENT,
    column_of,
    merged_topic,
    raw_fields,
    standard_signals,
    unit_quaternions,
)
from twin.errors import InputError
from twin.records.attributes import SAMPLE_PERIOD
from twin.vehicle import shipped_files

Array = NDArray[np.float64]

KIND = "recording"
"""Noun for a file in the import report"""
GAP = 60.0
"""[s] Gap in all topics above which a new row begins"""
OWN = "glider-twin"
"""Name of the metadata in files that `factory export` wrote"""


def read_mcap(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Read one log from each MCAP file, or folder of rosbag2.

    Raises:
      ModuleNotFoundError: rosbags is not installed.
      InputError: a file is damaged, has no known message, or contradicts the mapping.
    """
    import rosbags.highlevel  # noqa: F401  (a missing package must not look like a bad file)

    return [log for _, log in each_file(paths, lambda path: _log(path, options, tally), tally)]


def _log(path: Path, options: ReadOptions, tally: Tally) -> DeploymentLog:
    said = _metadata(path)
    model = said.get("vehicle") if said.get("vehicle") in shipped_files() else None
    mapping = mapping_of(options, said.get("vehicle", "ROS 2 vehicle"), model, GAP)
    try:
        topics, tables, mapping = _tables(path, mapping, tally)
    except InputError:
        raise
    except Exception as error:  # a damaged file can raise anything in the libraries' parsers
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
    """Metadata of a file that `factory export` wrote; empty for other files."""
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
    frames = _frames(recording, [topic for topic, kind in kinds.items() if kind in NED])
    sources = standard_signals(kinds, frames, tally)
    wanted = _fields_of_all(mapping, sources)
    used = [topic for topic in readable if merged_topic(topic) in wanted]
    note_unread(KIND, kinds, used, tally)
    times: dict[str, list[float]] = {}
    rows: dict[str, list[tuple[Any, ...]]] = {}
    raw = {topic: sorted({r for f in fs for r in raw_fields(f)}) for topic, fs in wanted.items()}
    taken: dict[str, Callable[[Any], tuple[Any, ...]]] = {}
    broken: dict[str, list[str]] = {}
    for channel, moment, data in recording.messages(used):
        topic = merged_topic(channel.topic)
        try:
            message: Any = channel.decode(data)
        except Exception as error:  # a decoder can raise anything on damaged bytes
            broken.setdefault(channel.topic, []).append(" ".join(str(error).split())[:120])
            continue
        if channel.topic not in taken:
            raw[topic] = [f for f in raw[topic] if _has(message, f) or f == "mode"]
            taken[channel.topic] = _getter(raw[topic], channel.topic)
        times.setdefault(topic, []).append(_moment(message, moment))
        rows.setdefault(topic, []).append(taken[channel.topic](message))
    for topic, whys in broken.items():
        why = f"{path.name}: messages that no {kinds[topic]} are: {whys[0]}"
        tally.add("removed", topic, len(whys), why)
    tables = {}
    units = {signal.column: signal.unit for signal in reversed(list(mapping.signals.values()))}
    for topic, some in rows.items():
        values = np.array(some, float).reshape(len(some), -1)
        found = dict(zip(raw[topic], values.T, strict=True))
        unit_quaternions(found, topic, tally)
        there = set(found) | NO_MEASUREMENT
        columns = {f: column_of(f, found) for f in wanted[topic] if set(raw_fields(f)) <= there}
        moments = np.array(times[topic])
        if GAUGE in columns:  # unit of the user's mapping, or else of the standard message
            unit = units.get(f"{topic} {GAUGE}", "Pa")
            columns[GAUGE] = without_air(moments, columns[GAUGE], unit, topic, tally)
        tables[topic] = MessageTable(moments, columns)
    mapping = with_standard(mapping, valued(sources, tables, tally), tally)
    _ask_ned(mapping, tables, frames, tally)
    return sorted(every), tables, mapping


def _frames(recording: Ros2Recording, topics: Sequence[str]) -> dict[str, tuple[str, str]]:
    """World and body frame of each topic of poses or attitudes, from its first message; a topic
    that cannot be decoded is left out."""
    found: dict[str, tuple[str, str]] = {}
    for topic in topics:
        with contextlib.suppress(Exception):  # the loop over all messages reports such a topic
            channel, _, data = next(recording.messages([topic]))
            message: Any = channel.decode(data)
            found[topic] = (
                str(message.header.frame_id), str(getattr(message, "child_frame_id", ""))
            )  # fmt: skip
    return found


def _ask_ned(
    mapping: Mapping,
    tables: dict[str, MessageTable],
    frames: dict[str, tuple[str, str]],
    tally: Tally,
) -> None:
    """Mark a pose as suspect if its z is positive under water and its frame is not named NED."""
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
            np.isfinite(values),
        )


def _fields_of_all(mapping: Mapping, sources: dict[str, list[Signal]]) -> dict[str, list[str]]:
    """Fields of the mapping, and of all sources of the signals that it does not map, by topic."""
    found = wanted_fields(mapping)
    for k in range(max(map(len, sources.values()), default=0)):
        standard = {name: several[k] for name, several in sources.items() if k < len(several)}
        for topic, fields in wanted_fields(with_standard(mapping, standard, Tally())).items():
            known = found.setdefault(topic, [])
            known += [field for field in fields if field not in known]
    return found


def _moment(message: Any, logged: int) -> float:
    """[s] Unix time of a message: its stamp, or the time of logging if it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None and stamp.sec > EARLIEST:
        return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
    return logged * 1e-9


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
    """Make a function that reads a message's fields faster than `_value`; `mode` is the topic's."""
    mode = 2.0 if topic.rpartition("/")[2] == "water" else 1.0

    def one(field: str) -> Callable[[Any], Any]:
        if field == "mode":
            return lambda _: mode
        if any(word.isdigit() for word in field.split(".")):
            return lambda message: _value(message, field)
        return attrgetter(field)

    takers = [one(field) for field in fields]
    return lambda message: tuple(take(message) for take in takers)


def read_rosbag2(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Read one log from each folder, all its files together.

    Raises:
      ModuleNotFoundError: rosbags is not installed.
      WrongFormat: an MCAP file is alone, without metadata.yaml.
      InputError: another file lacks its metadata.yaml; or as in `read_mcap`.
    """
    lost = [path for path in paths if not (path.parent / SAID).is_file()]
    if lost and lost[0].suffix.lower() == ".mcap":
        raise WrongFormat(lost[0], (), kind="mcap")
    if lost:
        raise InputError(
            f"{lost[0].name} has no {SAID} beside it, which names its topics: `ros2 bag reindex` "
            "makes it"
        )
    folders = dict.fromkeys(path.resolve().parent for path in paths)
    return read_mcap(list(folders), options, tally)
