"""MCAP file: export a store as MCAP files, one per simulated mission or logged deployment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting import Advance, no_progress
from factory.generation import GeneratedStore, StoredFlight
from glider_twin_protocols.cdr import encode
from glider_twin_protocols.ros_topics import Topic, topics
from twin import __version__
from twin.bounded import file_names
from twin.errors import StoreError
from twin.geodesy import from_tangent_plane, offset, position
from twin.records import FIXES, LogStore, MissionStore, sample_coordinates
from twin.records.attributes import COMMENT, HISTORY, PLATFORM, SAMPLE_PERIOD, SOURCE, TITLE
from twin.records.coordinates import (
    DATETIME,
    LATITUDE,
    LONGITUDE,
    NOMINAL,
    START_LATITUDE,
    START_LONGITUDE,
    read_place,
)
from twin.records.schema import MISSION, VARIABLES
from twin.sensors import Imu

if TYPE_CHECKING:
    from mcap.writer import Writer

Array = NDArray[np.float64]

DISTRIBUTION = "ROS2_HUMBLE"
"""ROS 2 distribution whose message definitions are in the files; later distributions have equal
definitions of these messages"""
AT_A_TIME = 8192
"""Largest number of samples that are encoded together, about 30 MB"""
FRAMES = (
    "REP 103: map is east, north, up at the start of the first mission of the file; base_link and "
    "imu_link are forward, left, up; the same with _true are those of the true vehicle"
)
_ENDLESS = "{sec: 9223372036, nsec: 854775807}"
LATCHED = (
    "- {history: 1, depth: 1, reliability: 1, durability: 1, liveliness: 1, "
    f"deadline: {_ENDLESS}, lifespan: {_ENDLESS}, liveliness_lease_duration: {_ENDLESS}, "
    "avoid_ros_namespace_conventions: false}"
)
"""Quality of service of /tf_static in rosbag2's YAML: later subscribers get the last message"""
SIMULATED = "SIMULATED: no vehicle has measured this"


def export_mcap(
    run: MissionStore, missions: Sequence[int], folder: Path, advance: Advance = no_progress
) -> list[Path]:
    """Write the missions as MCAP files with standard ROS 2 messages.

    Raises:
      ModuleNotFoundError: mcap or rosbags is not installed.
      OSError: the disk refuses.
      StoreError: a mission is missing, cannot be read, or has no start time.
    """
    writers = import_module("mcap.writer")
    stores = import_module("rosbags.typesys")
    types = stores.get_typestore(stores.Stores[DISTRIBUTION])
    written = []
    for name, some in files(run, missions):
        path = folder / f"{name}.mcap"
        with path.open("wb") as stream:
            writer = writers.Writer(stream)
            writer.start(profile="ros2", library=f"glider-twin {__version__}")
            bag = _Bag(writer, types)
            origin = None
            for mission in some:
                samples = McapSamples(run, mission, origin)
                if origin is None:
                    origin = samples.origin
                    writer.add_metadata("glider-twin", about(run, some, samples))
                bag.add(samples)
                advance()
            writer.finish()
        written.append(path)
    return written


def files(run: MissionStore, missions: Sequence[int]) -> Iterator[tuple[str, list[int]]]:
    """Names of the files without ending, each with its missions in order of time."""
    if not isinstance(run, LogStore):
        yield from ((f"mission_{mission:06d}", [mission]) for mission in missions)
        return
    wanted = set(missions)
    for deployment, name in file_names(run.deployments, "deployment", "_-.").items():
        some = [mission for mission in run.missions_of(deployment) if mission in wanted]
        if some:
            yield name, some


def about(run: MissionStore, missions: Sequence[int], first: McapSamples) -> dict[str, str]:
    """Metadata of an MCAP file, by name."""
    names = (TITLE, SOURCE, COMMENT, HISTORY, PLATFORM)
    said = {name: str(run.attributes[name]) for name in names if name in run.attributes}
    if not run.logged:
        said["data"] = SIMULATED
    if NOMINAL in first.place:
        said["nominal"] = f"{first.place[NOMINAL]} unknown: the default stands"
    return {
        **said,
        "missions": " ".join(map(str, missions)),
        "vehicle": run.vehicle.name,
        SAMPLE_PERIOD: f"{run.period:g}",
        "frames": FRAMES,
        "map_latitude": f"{first.origin[0]:.9f}",
        "map_longitude": f"{first.origin[1]:.9f}",
    }


class _Bag:
    """Writer of messages to an open file, with the file's channels by topic."""

    def __init__(self, writer: Writer, types: Any) -> None:
        self._writer, self._types = writer, types
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[int, int] = {}

    def add(self, samples: McapSamples) -> None:
        """Write the messages of a mission in order of time."""
        found = [topic for topic in topics(samples) if topic.known.any()]
        channels = [self._channel(topic) for topic in found]
        for first in range(0, samples.count, AT_A_TIME):
            block = slice(first, min(first + AT_A_TIME, samples.count))
            tables = [self._encoded(topic, block) for topic in found]
            places = [np.flatnonzero(topic.known[block]) for topic in found]
            which = np.repeat(np.arange(len(found)), [len(place) for place in places])
            rows = np.concatenate([np.arange(len(place)) for place in places])
            moments = samples.time[block][np.concatenate(places)]
            order = np.lexsort((which, moments))
            for k, row, moment in zip(
                which[order].tolist(), rows[order].tolist(), moments[order].tolist(), strict=True
            ):
                data, size = tables[k]
                self._message(channels[k], moment, data[row * size : (row + 1) * size])

    def _message(self, channel: int, moment: int, data: bytes) -> None:
        number = self._counts.get(channel, 0)
        self._counts[channel] = number + 1
        self._writer.add_message(
            channel, log_time=moment, publish_time=moment, sequence=number, data=data
        )

    def _encoded(self, topic: Topic, block: slice) -> tuple[bytes, int]:
        """Encoded messages of a block of samples, end to end, and the size [byte] of one."""
        known = topic.known[block]
        table = encode(self._types, topic.type, _rows(topic.values, block, known), int(known.sum()))
        return table.tobytes(), table.shape[1]

    def _channel(self, topic: Topic) -> int:
        if topic.name not in self._channels:
            said = {
                "signals": " ".join(topic.signals),
                "units": topic.units,
                "description": _description(topic),
                "offered_qos_profiles": LATCHED if topic.name == "/tf_static" else "",
            }
            self._channels[topic.name] = self._writer.register_channel(
                topic=topic.name, message_encoding="cdr", schema_id=self._schema(topic.type),
                metadata={name: text for name, text in said.items() if text},
            )  # fmt: skip
        return self._channels[topic.name]

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            text, _ = self._types.generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
        return self._schemas[kind]


def _description(topic: Topic) -> str:
    """Description of a topic with a single number; empty for other topics."""
    if not topic.units or len(topic.signals) != 1:
        return ""
    entry = VARIABLES[topic.signals[0]]
    return f"{entry.long_name}; {entry.comment}" if entry.comment else entry.long_name


def _rows(values: Any, block: slice, known: NDArray[np.bool_]) -> Any:
    """Fields of a block of samples, those with a message only."""
    if isinstance(values, np.ndarray):
        return values[block][known]
    if isinstance(values, Mapping):
        return {name: _rows(value, block, known) for name, value in values.items()}
    if isinstance(values, list):
        return [_rows(value, block, known) for value in values]
    return values


NANOSECONDS = 1_000_000
"""[ns] A millisecond"""


class McapSamples:
    """Signals, times and positions of a mission in a store, as `ros_topics.Samples`.

    Raises:
      StoreError: the store is damaged, or has no start time of the mission.
    """

    def __init__(self, run: MissionStore, mission: int, origin: tuple[float, float] | None) -> None:
        """Read times and positions; signals are read on request.

        Args:
          origin: [degree] latitude and longitude of the frame `map`; None: the mission's start.
        """
        self.run, self.mission = run, mission
        self.count = int(run.samples[mission])
        self.names = run.signals()
        self.logged, self.period = run.logged, run.period
        self.imu_position = run.vehicle.imu_position
        self.gps_deviation: float | None = None
        if isinstance(run, GeneratedStore):
            self.gps_deviation = run.sensor_constants(mission).get("gps_sigma") or None
        imu = run.suite.get("imu") if isinstance(run, GeneratedStore | StoredFlight) else None
        self.imu = imu if isinstance(imu, Imu) else None
        where = sample_coordinates(run, mission)
        moments = where[DATETIME].astype("datetime64[ms]")
        if np.isnat(moments).any():
            raise StoreError(
                f"store {run.path} lacks the start time of mission {mission}, and messages have "
                "dates: make it again with a start time"
            )
        self.time: NDArray[np.int64] = moments.astype(np.int64) * NANOSECONDS
        """[ns] Unix time of each sample"""
        self.latitude, self.longitude = where[LATITUDE], where[LONGITUDE]
        self.place = read_place(run.dataset.isel({MISSION: mission}))
        start = (self.place.get(START_LATITUDE, np.nan), self.place.get(START_LONGITUDE, np.nan))
        self.start = float(start[0]), float(start[1])
        self.origin = self.start if origin is None else origin
        self._read: dict[str, Array] = {}

    def signal(self, name: str) -> Array:
        """Signal in the store's unit, (samples,)."""
        if name not in self._read:
            row = self.run.row(name, self.mission)[: self.count]
            self._read[name] = row.astype(float)
        return self._read[name]

    def track(self) -> tuple[Array, Array]:
        """[m] North and east of the store's positions from the origin of `map`.

        Distances are along the meridian and the parallel, as for all logs.
        """
        return offset(self.latitude, self.longitude, *self.origin)

    def fixes(self) -> tuple[Array, Array]:
        """[degree] Latitude and longitude of the GPS fixes, (samples,); NaN without a fix."""
        degrees = position if self.run.logged else from_tangent_plane
        north, east = (self.signal(name) for name in FIXES)
        return degrees(north, east, *self.start)
