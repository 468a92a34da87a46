"""Recordings of an imaginary vehicle: by the library of ROS 2, and in ArduPilot's format."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from logs import START, Flight
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIVES = 'vehicle = "test vehicle"\nrows = "dives"\n\n[signals]\n'
FIELDS = {"Q": "Q", "B": "B", "f": "f", "c": "h", "C": "H", "L": "i", "I": "I", "H": "H", "n": "4s",
          "b": "b", "N": "16s", "Z": "64s"}  # fmt: skip
"""Letters of ArduPilot's formats that are used here, for `struct`"""


def messages(state: Mapping[str, Array], time: Array, types: Any) -> dict[str, list[Any]]:
    """Standard messages of ROS 2 by topic, of a state in a store's units and axes.

    Args:
      time: [s] unix.
      types: typestore of rosbags.
    """
    kind = types.types
    point, turn = kind["geometry_msgs/msg/Vector3"], kind["geometry_msgs/msg/Quaternion"]
    nothing = np.zeros(9)

    def header(moment: float) -> Any:
        stamp = kind["builtin_interfaces/msg/Time"](
            sec=int(moment), nanosec=round((moment % 1.0) * 1e9)
        )
        return kind["std_msgs/msg/Header"](stamp=stamp, frame_id="base_link")

    found: dict[str, list[Any]] = {"/imu/data": [], "/pressure": []}
    if "surge" in state:
        found |= {"/dvl/twist": [], "/thruster/rpm": []}
    if "latitude" in state:
        found["/gps"] = []
    for k, moment in enumerate(time.tolist()):
        roll = np.radians(state["roll"][k]) if "roll" in state else 0.0
        pitch, yaw = -np.radians(state["pitch"][k]), np.radians(90.0 - state["heading"][k])
        half = [0.5 * angle for angle in (roll, pitch, yaw)]
        (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
        quaternion = turn(
            w=cr * cp * cy + sr * sp * sy, x=sr * cp * cy - cr * sp * sy,
            y=cr * sp * cy + sr * cp * sy, z=cr * cp * sy - sr * sp * cy,
        )  # fmt: skip
        rate = -float(state["yaw_rate"][k]) if "yaw_rate" in state else 0.0
        found["/imu/data"].append(
            kind["sensor_msgs/msg/Imu"](
                header=header(moment), orientation=quaternion,
                orientation_covariance=nothing, angular_velocity=point(x=0.0, y=0.0, z=rate),
                angular_velocity_covariance=nothing,
                linear_acceleration=point(x=0.0, y=0.0, z=0.0),
                linear_acceleration_covariance=np.array([-1.0, *nothing[1:]]),
            )
        )  # fmt: skip
        pressure = 101_325.0 + 1e4 * 1.0065 * float(state["depth"][k])
        found["/pressure"].append(
            kind["sensor_msgs/msg/FluidPressure"](
                header=header(moment), fluid_pressure=pressure, variance=0.0
            )
        )
        if "surge" in state:
            twist = kind["geometry_msgs/msg/Twist"](
                linear=point(x=float(state["surge"][k]), y=-float(state["sway"][k]), z=0.0),
                angular=point(x=0.0, y=0.0, z=0.0),
            )
            with_spread = kind["geometry_msgs/msg/TwistWithCovariance"](
                twist=twist, covariance=np.zeros(36)
            )
            found["/dvl/twist"].append(
                kind["geometry_msgs/msg/TwistWithCovarianceStamped"](
                    header=header(moment), twist=with_spread
                )
            )
            found["/thruster/rpm"].append(kind["std_msgs/msg/Float64"](data=float(state["rpm"][k])))
        if "latitude" in state and np.isfinite(state["latitude"][k]):
            found["/gps"].append(
                kind["sensor_msgs/msg/NavSatFix"](
                    header=header(moment),
                    status=kind["sensor_msgs/msg/NavSatStatus"](status=0, service=1),
                    latitude=float(state["latitude"][k]), longitude=float(state["longitude"][k]),
                    altitude=0.0, position_covariance=nothing, position_covariance_type=0,
                )
            )  # fmt: skip
    return found


def write_bag(
    path: Path, state: Mapping[str, Array], time: Array, storage: str = "sqlite3"
) -> Path:
    """A folder of rosbag2, written by the library `rosbags`."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    found = messages(state, time, types)
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        for topic, every in found.items():
            if not every:
                continue
            name = every[0].__msgtype__
            connection = writer.add_connection(topic, name, typestore=types)
            bare = not hasattr(every[0], "header")
            for k, message in enumerate(every):
                moment = time[k] if bare else _stamp(message)
                data = types.serialize_cdr(message, name)
                writer.write(connection, round(moment * 1e9), data)
    return path


def _stamp(message: Any) -> float:
    return float(message.header.stamp.sec) + 1e-9 * float(message.header.stamp.nanosec)


def dives(flight: Flight) -> tuple[Array, dict[str, Array]]:
    """Times and states of a glider's flight, with fixes where it is at the surface."""
    time = flight.time
    state = flight.state(time)
    latitude, longitude = flight.position(time)
    afloat = state["under"] == 0.0
    return time, {
        **state,
        "latitude": np.where(afloat, latitude, np.nan),
        "longitude": np.where(afloat, longitude, np.nan),
    }


def write_rosbag2(folder: Path, flight: Flight, storage: str = "sqlite3") -> list[Path]:
    """Dives as a recording, with the mapping that says that they are dives."""
    time, state = dives(flight)
    bag = write_bag(folder / "bag", state, time, storage)
    (folder / "mine.toml").write_text(DIVES)
    files = [one.rename(folder / one.name) for one in bag.iterdir()]
    bag.rmdir()
    return [one for one in files if one.suffix in (".db3", ".mcap")]


def write_mcap(folder: Path, flight: Flight) -> list[Path]:
    """The same as one MCAP file."""
    (inside,) = write_rosbag2(folder, flight, "mcap")
    (folder / "metadata.yaml").unlink()
    return [inside.rename(folder / "dives.mcap")]


class Dataflash:
    """Writes ArduPilot's binary log: a format message of each kind, then its messages."""

    def __init__(self) -> None:
        self.data = bytearray()
        self._formats: dict[str, tuple[int, str]] = {}
        self.define("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 0x80, 89)

    def define(
        self, name: str, letters: str, columns: str, number: int = 0, size: int = 0
    ) -> None:  # fmt: skip
        number = number or 0x81 + len(self._formats)
        layout = "<" + "".join(FIELDS.get(letter, "") for letter in letters)
        self._formats[name] = (number, layout)
        self.data += b"\xa3\x95\x80" + struct.pack(
            "<BB4s16s64s", number, size or 3 + struct.calcsize(layout), name.encode(),
            letters.encode(), columns.encode(),
        )  # fmt: skip

    def add(self, name: str, *values: float | bytes) -> None:
        number, layout = self._formats[name]
        self.data += b"\xa3\x95" + bytes([number]) + struct.pack(layout, *values)


WEEK, LEAP = 604_800.0, 18.0
GPS_ZERO = 315_964_800.0
"""[s] unix time of 1980-01-06"""


def write_dataflash(
    path: Path, time: Array, state: Mapping[str, Array], *, clock: bool = True
) -> Path:
    """A log in ArduSub's layout: ATT, CTUN and IMU, two of these; GPS where there is a fix.

    Args:
      clock: whether the vehicle has met a satellite, so that its log has a date.
    """
    log = Dataflash()
    log.define("ATT", "QccccCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    log.define("CTUN", "Qfff", "TimeUS,DAlt,Alt,BAlt")
    log.define("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.define("GPS", "QBBIHLL", "TimeUS,I,Status,GMS,GWk,Lat,Lng")
    log.define("RCOU", "QHH", "TimeUS,C1,C2")
    for k, moment in enumerate(time.tolist()):
        us = round((moment - time[0]) * 1e6) + 1_000_000
        week, rest = divmod(moment - GPS_ZERO + LEAP, WEEK)
        fixed = clock and np.isfinite(state.get("latitude", np.full(len(time), np.nan))[k])
        log.add(
            "GPS", us, 0, 3 if fixed else 1, round(rest * 1e3) if clock else 0,
            int(week) if clock else 0,
            round(1e7 * (state["latitude"][k] if fixed else 0.0)),
            round(1e7 * (state["longitude"][k] if fixed else 0.0)),
        )  # fmt: skip
        pitch, heading = round(100 * state["pitch"][k]), round(100 * state["heading"][k])
        log.add("ATT", us, 0, 0, pitch, pitch, heading, heading)
        log.add("CTUN", us, 0.0, -state["depth"][k], -state["depth"][k])
        for instance in (0, 1):
            log.add("IMU", us, instance, 0.0, 0.0, 0.01 + instance, 0.0, 0.0, -9.81)
        log.add("RCOU", us, 1500, 1500 + k % 7)
    path.write_bytes(bytes(log.data))
    return path


def write_ardusub(folder: Path, flight: Flight) -> list[Path]:
    """Dives as a dataflash log, with the mapping that says that they are dives."""
    time, state = dives(flight)
    (folder / "mine.toml").write_text(DIVES)
    return [write_dataflash(folder / "00000012.BIN", time, state)]


def circles(seconds: float = 300.0, step: float = 0.2) -> tuple[Array, dict[str, Array]]:
    """Times and states of a propelled vehicle that circles at 3 m, slips outwards and rolls."""
    since = np.arange(0.0, seconds, step)
    rate = np.where(since % 100.0 < 50.0, 0.08, -0.02)
    return START + since, {
        "depth": 3.0 + 0.2 * np.sin(0.05 * since), "pitch": 2.0 * np.cos(0.05 * since),
        "roll": 5.0 * np.sin(0.03 * since), "yaw_rate": rate,
        "heading": np.degrees(np.cumsum(rate) * step) % 360.0,
        "surge": 1.5 + 0.05 * np.sin(0.1 * since), "sway": -2.0 * rate,
        "rpm": 600.0 + 30.0 * np.sin(0.02 * since),
    }  # fmt: skip


def topics_of(path: Path) -> set[str]:
    """Names in a recording, by the library of its format."""
    if path.suffix == ".BIN":
        from pymavlink.DFReader import DFReader_binary

        log, found = DFReader_binary(str(path)), set()
        while (message := log.recv_msg()) is not None:
            found.add(message.get_type())
        log.close()
        return found
    from rosbags.highlevel import AnyReader

    whole = path.parent if (path.parent / "metadata.yaml").exists() else path
    with AnyReader([whole]) as reader:
        return {one.topic for one in reader.connections}
