"""Zenoh server: simulate a vehicle in real time, with ROS 2 messages of state and commands.

Keys, graph tokens and message attachments follow rmw_zenoh: design.md and
rmw_zenoh_cpp/src/detail/{liveliness_utils,attachment_helpers}.cpp of github.com/ros2/rmw_zenoh,
0.2.4 and later (its pull request 601). Keys of zenoh-bridge-ros2dds are the topic's name alone:
zenoh-plugin-ros2dds/src/ros2_utils.rs of github.com/eclipse-zenoh/zenoh-plugin-ros2dds.
Messages are those of `factory export --to mcap`.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import struct
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glider_twin_protocols.ardupilot import own_machine
from glider_twin_protocols.cdr import HEADER, encode
from glider_twin_protocols.ros_topics import Topic, in_si, topics
from twin import Command, SteppedVehicle
from twin.errors import InputError
from twin.geodesy import from_tangent_plane
from twin.physics import declare_parts
from twin.sensors import Imu

Array = NDArray[np.float64]

PORT = 7447
"""TCP port of Zenoh"""
DISTRIBUTION = "ROS2_JAZZY"
"""ROS 2 distribution of the message definitions: the first with rmw_zenoh and type hashes"""
DOMAINS = 232
"""Highest ROS_DOMAIN_ID, docs.ros.org, About Domain ID"""
USER = "twin"
"""User name that goes with the token in Zenoh's user and password"""
NODE = "glider_twin"
QOS = "::,10:,:,:,,"
"""Default quality of service of rmw_zenoh, ten messages deep"""
NUMBER = "std_msgs/msg/Float64"
"""Message type of a command"""
LITTLE, BIG = HEADER[:2], b"\0\0"
"""Byte orders of plain CDR"""


@dataclass
class ServedRos:
    """Counts of a server's frames and commands."""

    frames: int = 0
    commands: int = 0
    refused: int = 0
    """Messages on command topics that are no finite std_msgs/Float64."""
    late: int = 0
    """Frames that began more than one period late; simulated time then lags the clock."""
    lost: int = 0
    """Times that commands ceased, so that the vehicle flew its failsafe."""


@dataclass
class _Wanted:
    """Positions that clients have commanded; Zenoh's threads write them."""

    positions: dict[str, float] = field(default_factory=dict)
    heard: float = -math.inf
    lock: threading.Lock = field(default_factory=threading.Lock)


class ZenohServer:
    """Server that publishes one vehicle and takes commands; a context manager for its session."""

    def __init__(
        self,
        flown: SteppedVehicle,
        start: tuple[float, float],
        *,
        host: str = "127.0.0.1",
        port: int = PORT,
        router: str | None = None,
        token: str | None = None,
        domain: int = 0,
        bridge: bool = False,
        rate: float | None = None,
        silence: float = 2.0,
        telemetry: Callable[[SteppedVehicle], None] | None = None,
    ) -> None:
        """Open the session.

        Args:
          flown: vehicle to drive.
          start: [degree] latitude and longitude of the flight's start.
          host, port: TCP address to which Zenoh's clients connect.
          router: connect to this router instead of listening, such as tcp/127.0.0.1:7447.
          token: password of the user `twin`, which clients must give; with a router, the server
            gives it to the router.
          domain: ROS_DOMAIN_ID.
          bridge: use the keys of zenoh-bridge-ros2dds instead of rmw_zenoh's.
          rate: [Hz] rate of frames; None: one frame per control period.
          silence: [s] time without a command after which the clients are lost.
          telemetry: called after each frame.

        Raises:
          ModuleNotFoundError: eclipse-zenoh or rosbags is not installed.
          InputError: a token is missing for a host that other machines can reach, a number is out
            of range, or Zenoh refuses.
        """
        for name, value in (("silence", silence), ("rate", 1.0 if rate is None else rate)):
            if not 0.0 < value < math.inf:
                raise InputError(f"{name} must be above 0, not {value:g}")
        if not 0 <= domain <= DOMAINS:
            raise InputError(f"domain: ROS_DOMAIN_ID is 0 to {DOMAINS}, not {domain}")
        if router is None and token is None and not own_machine(host):
            raise InputError(
                f"{host} can be reached by other machines: give a token, --token-file FILE, that "
                "Zenoh's clients name as the password of the user twin"
            )
        zenoh = import_module("zenoh")
        stores = import_module("rosbags.typesys")
        self._types = stores.get_typestore(stores.Stores[DISTRIBUTION])
        self.flown, self.port, self.silence = flown, port, silence
        self.period = flown.vehicle.control_period if rate is None else 1.0 / rate
        self.served = ServedRos()
        self._samples = LiveSamples(flown, start)
        self._telemetry, self._domain, self._bridge = telemetry, domain, bridge
        self._wanted = _Wanted()
        self._publishers: dict[str, tuple[Any, bytes]] = {}
        self._kept: list[Any] = []
        where = f"[{host}]" if ":" in host else host
        self._session = _opened(zenoh, router or f"tcp/{where}:{port}", router is not None, token)
        try:
            self._listen()
        except BaseException:
            self._session.close()
            raise

    def _listen(self) -> None:
        """Subscribe to the command topics, and announce node and subscribers to ROS."""
        if not self._bridge:
            self._announce("NN", 0)
        for number, part in enumerate(self.flown.vehicle.parts, 1):
            name = f"/commanded/{part.name}"
            _, factor = in_si(name[1:].replace("/", "_"))
            key = self._key(name, NUMBER, "*")
            take = _taker(self._wanted, self.served, part.name, factor * part.quantity.scale)
            self._kept.append(self._session.declare_subscriber(key, take))
            if not self._bridge:
                self._announce("MS", number, name, NUMBER)

    def __enter__(self) -> ZenohServer:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def run(self, until: Callable[[], bool] = lambda: False) -> ServedRos:
        """Serve until the flight ends or `until` is True; returns the counts.

        Until the first command, the vehicle stays at its start and is published. From then on it
        is simulated in real time with the newest command of each part; other parts rest.
        """
        due, moment, flying, lost = time.monotonic(), time.time_ns(), False, False
        while not self.flown.ended and not until():
            time.sleep(max(0.0, due - time.monotonic()))
            with self._wanted.lock:
                positions, heard = dict(self._wanted.positions), self._wanted.heard
            flying = flying or bool(positions)
            if flying:
                silent = time.monotonic() - heard >= self.silence
                if silent and not lost:
                    self.served.lost += 1
                    with self._wanted.lock:
                        if self._wanted.heard == heard:
                            self._wanted.positions.clear()
                lost = silent
                before = self.flown.time
                self.flown.step(self._command(positions, lost), self.period)
                moment += round(1e9 * (self.flown.time - before))
            else:
                moment = time.time_ns()
            self._publish(moment)
            self.served.frames += 1
            if self._telemetry is not None:
                self._telemetry(self.flown)
            due += self.period
            if time.monotonic() > due + self.period:
                self.served.late += 1
                due = time.monotonic()
        return self.served

    def _command(self, positions: dict[str, float], lost: bool) -> Command:
        if lost:
            return self.flown.failsafe()
        parts = {part.name: part for part in self.flown.vehicle.parts}
        ends = {name: (parts[name].low, parts[name].high) for name in positions}
        return Command(**{n: min(max(x, ends[n][0]), ends[n][1]) for n, x in positions.items()})

    def _publish(self, moment: int) -> None:
        """Publish the present state.

        Args:
          moment: [ns] unix time of the messages.
        """
        self._samples.take(moment)
        for topic in topics(self._samples):
            if not topic.known.all():
                continue
            if topic.name not in self._publishers:
                self._publishers[topic.name] = self._publisher(topic)
            publisher, identity = self._publishers[topic.name]
            data = encode(self._types, topic.type, topic.values, 1).tobytes()
            attached = struct.pack("<qqB", self.served.frames + 1, moment, len(identity)) + identity
            publisher.put(data, attachment=attached)

    def _publisher(self, topic: Topic) -> tuple[Any, bytes]:
        """Publisher of a topic, and the 16 bytes by which rmw_zenoh distinguishes publishers."""
        kind = topic.type
        publisher = self._session.declare_publisher(self._key(topic.name, kind, self._hash(kind)))
        number = len(self.flown.vehicle.parts) + 1 + len(self._publishers)
        if not self._bridge:
            self._announce("MP", number, topic.name, kind)
        said = f"{self._session.info.zid()}/{topic.name}"
        return publisher, hashlib.blake2b(said.encode(), digest_size=16).digest()

    def _key(self, name: str, kind: str, hashed: str) -> str:
        plain = name.strip("/")
        return plain if self._bridge else f"{self._domain}/{plain}/{_dds(kind)}/{hashed}"

    def _hash(self, kind: str) -> str:
        return str(self._types.hash_rihs01(kind))

    def _announce(self, entity: str, number: int, name: str = "", kind: str = "") -> None:
        """Announce the node, or a topic's publisher or subscriber, to the ROS graph."""
        words = ["@ros2_lv", self._domain, self._session.info.zid(), 0, number, entity, "%", "%"]
        words.append(NODE)
        if name:
            words += [name.replace("/", "%"), _dds(kind), self._hash(kind), QOS]
        key = "/".join(map(str, words))
        self._kept.append(self._session.liveliness().declare_token(key))


def _taker(wanted: _Wanted, served: ServedRos, part: str, factor: float) -> Callable[[Any], None]:
    """Make the callback for a part's commands; a message has the position times `factor`."""

    def take(sample: Any) -> None:
        data = bytes(sample.payload)
        order = {LITTLE: "<d", BIG: ">d"}.get(data[:2])
        value = math.nan
        if order is not None and len(data) == len(HEADER) + 8:
            (value,) = struct.unpack(order, data[len(HEADER) :])
        with wanted.lock:
            if not math.isfinite(value):
                served.refused += 1
                return
            served.commands += 1
            wanted.positions[part] = value / factor
            wanted.heard = time.monotonic()

    return take


def _dds(kind: str) -> str:
    """DDS name of a type: std_msgs/msg/Float64 becomes std_msgs::msg::dds_::Float64_."""
    package, folder, name = kind.split("/")
    return f"{package}::{folder}::dds_::{name}_"


def _opened(zenoh: Any, endpoint: str, router: bool, token: str | None) -> Any:
    """Open a Zenoh session that connects by the endpoint alone, without multicast."""
    settings: dict[str, Any] = {
        "mode": "client" if router else "peer",
        "scouting/multicast/enabled": False,
        "connect/endpoints" if router else "listen/endpoints": [endpoint],
        "connect/timeout_ms": 5000,
    }
    users = None
    if token is not None:
        settings["transport/auth/usrpwd/user"] = USER
        settings["transport/auth/usrpwd/password"] = token
        if not router:
            number, users = tempfile.mkstemp(prefix="twin-serve-")  # only its owner may read it
            os.write(number, f"{USER}:{token}\n".encode())
            os.close(number)
            settings["transport/auth/usrpwd/dictionary_file"] = users
    config = zenoh.Config()
    try:
        for name, value in settings.items():
            config.insert_json5(name, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        what = "connect to the router" if router else "serve on"
        raise InputError(f"cannot {what} {endpoint}: {str(error).split(' at /')[0]}") from error
    finally:
        if users is not None:
            Path(users).unlink()


@dataclasses.dataclass
class LiveSamples:
    """The vehicle's present sample, as `ros_topics.Samples`.

    The sample has true signals only: clients publish the topics of commands.
    """

    flown: SteppedVehicle
    start: tuple[float, float]
    """[degree] Latitude and longitude of the flight's start, the origin of `map`"""
    gps_deviation: float | None = None
    imu: Imu | None = None
    logged: bool = False
    count: int = 1

    def __post_init__(self) -> None:
        declare_parts(self.flown.vehicle)
        self.imu_position = self.flown.vehicle.imu_position
        self.period = self.flown.timestep
        self.names: list[str] = []
        self.take(0)

    def take(self, moment: int) -> None:
        """Take a sample of the vehicle's state.

        Args:
          moment: [ns] unix time of the sample.
        """
        now = self.flown.state()
        self._now = {name: value for name, value in now.items() if name.startswith("true_")}
        self.names = list(self._now)
        self.time: NDArray[np.int64] = np.array([moment])
        north, east = self.signal("true_north"), self.signal("true_east")
        self.latitude, self.longitude = from_tangent_plane(north, east, *self.start)

    def signal(self, name: str) -> Array:
        """Signal in the store's unit, (1,)."""
        return np.array([self._now[name]])

    def track(self) -> tuple[Array, Array]:
        """[m] North and east from the start."""
        return self.signal("true_north"), self.signal("true_east")

    def fixes(self) -> tuple[Array, Array]:
        """True position: the sample has no GPS fixes."""
        return self.latitude, self.longitude
