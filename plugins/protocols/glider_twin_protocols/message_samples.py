"""Message samples: writers of sample recordings, ROS 2 by `rosbags` and ArduPilot's dataflash log.

Writers take times [s unix] and a state by name, in a store's units and axes: depth [m]; pitch,
heading, roll [degree]; yaw_rate [rad/s]; surge, sway [m/s] and rpm of propelled vehicles; latitude,
longitude [degree], NaN without a fix. All but depth, pitch and heading may be missing.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from factory.samples import Array, Flight

# --- ROS 2 --------------------------------------------------------------------------------------


def messages(state: Mapping[str, Array], time: Array, types: Any) -> dict[str, list[Any]]:
    """Make standard ROS 2 messages by topic, in axes forward, left, up and east, north, up.

    Args:
      types: typestore of rosbags.
    """
    nothing = np.zeros(9)
    found: dict[str, list[Any]] = defaultdict(list)

    def new(name: str, **fields: Any) -> Any:
        return types.types[name](**fields)

    def point(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        return new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    for k, moment in enumerate(time.tolist()):
        now = {name: float(values[k]) for name, values in state.items()}
        nanoseconds = round((moment % 1.0) * 1e9)
        stamp = new("builtin_interfaces/msg/Time", sec=int(moment), nanosec=nanoseconds)
        header = new("std_msgs/msg/Header", stamp=stamp, frame_id="base_link")
        found["/imu/data"].append(new(
            "sensor_msgs/msg/Imu", header=header,
            orientation=new("geometry_msgs/msg/Quaternion", **_quaternion(now)),
            orientation_covariance=nothing, angular_velocity_covariance=nothing,
            angular_velocity=point(z=0.0 - now.get("yaw_rate", 0.0)), linear_acceleration=point(),
            linear_acceleration_covariance=np.array([-1.0, *nothing[1:]]),
        ))  # fmt: skip
        pressure = 101_325.0 + 1e4 * 1.0065 * now["depth"]
        found["/pressure"].append(new(
            "sensor_msgs/msg/FluidPressure", header=header, fluid_pressure=pressure, variance=0.0
        ))  # fmt: skip
        if "surge" in now:
            way = point(now["surge"], -now["sway"])
            twist = new("geometry_msgs/msg/Twist", linear=way, angular=point())
            found["/dvl/twist"].append(new(
                "geometry_msgs/msg/TwistWithCovarianceStamped", header=header,
                twist=new("geometry_msgs/msg/TwistWithCovariance", twist=twist,
                          covariance=np.zeros(36)),
            ))  # fmt: skip
            found["/thruster/rpm"].append(new("std_msgs/msg/Float64", data=now["rpm"]))
        if np.isfinite(now.get("latitude", np.nan)):
            found["/gps"].append(new(
                "sensor_msgs/msg/NavSatFix", header=header,
                status=new("sensor_msgs/msg/NavSatStatus", status=0, service=1),
                latitude=now["latitude"], longitude=now["longitude"], altitude=0.0,
                position_covariance=nothing, position_covariance_type=0,
            ))  # fmt: skip
    return found


def _quaternion(now: Mapping[str, float]) -> dict[str, float]:
    roll, pitch = np.radians(now.get("roll", 0.0)), -np.radians(now["pitch"])
    half = [0.5 * angle for angle in (roll, pitch, np.radians(90.0 - now["heading"]))]
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    return {
        "w": cr * cp * cy + sr * sp * sy, "x": sr * cp * cy - cr * sp * sy,
        "y": cr * sp * cy + sr * cp * sy, "z": cr * cp * sy - sr * sp * cy,
    }  # fmt: skip


def write_bag(
    path: Path, state: Mapping[str, Array], time: Array, storage: str = "sqlite3"
) -> Path:
    """Write a rosbag2 folder with storage sqlite3 or mcap."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        for topic, every in messages(state, time, types).items():
            name = every[0].__msgtype__
            connection = writer.add_connection(topic, name, typestore=types)
            for k, message in enumerate(every):
                stamp = message.header.stamp if hasattr(message, "header") else None
                moment = time[k] if stamp is None else float(stamp.sec) + 1e-9 * stamp.nanosec
                data = types.serialize_cdr(message, name)
                writer.write(connection, round(moment * 1e9), data)
    return path


def write_rosbag2(folder: Path, flight: Flight, storage: str = "sqlite3") -> list[Path]:
    """Write dives as a rosbag2 recording."""
    time, state = flight.with_fixes()
    bag = write_bag(folder / "bag", state, time, storage)
    files = [one.rename(folder / one.name) for one in bag.iterdir()]
    bag.rmdir()
    return [one for one in files if one.suffix in (".db3", ".mcap")]


def write_mcap(folder: Path, flight: Flight) -> list[Path]:
    """Write dives as one MCAP file."""
    (inside,) = write_rosbag2(folder, flight, "mcap")
    (folder / "metadata.yaml").unlink()
    return [inside.rename(folder / "dives.mcap")]


ROSBAG2 = {"sqlite3": write_rosbag2}
MCAP = {"mcap": write_mcap}

# --- ArduSub ------------------------------------------------------------------------------------

FIELDS = {"Q": "Q", "B": "B", "f": "f", "c": "h", "C": "H", "L": "i", "I": "I", "H": "H",
          "b": "b", "n": "4s", "N": "16s", "Z": "64s"}  # fmt: skip
"""Letters for `struct` by ArduPilot's letters for field types."""
WEEK, LEAP = 604_800.0, 18.0
"""[s] WEEK: a week. LEAP: leap seconds between GPS time and UTC."""
GPS_ZERO = 315_964_800.0
"""[s] Unix time of GPS time zero, 1980-01-06."""


class Dataflash:
    """Writer of ArduPilot's binary log: format messages that define types, and messages."""

    def __init__(self) -> None:
        self.data = bytearray()
        self._formats: dict[str, tuple[int, str]] = {}
        self.define("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 0x80, 89)

    def define(
        self, name: str, letters: str, columns: str, number: int = 0, size: int = 0
    ) -> None:  # fmt: skip
        """Add a format message; 0 takes the next free `number`, and the fields' `size` [byte]."""
        number = number or 0x81 + len(self._formats)
        layout = "<" + "".join(FIELDS[letter] for letter in letters)
        self._formats[name] = (number, layout)
        self.data += b"\xa3\x95\x80" + struct.pack(
            "<BB4s16s64s", number, size or 3 + struct.calcsize(layout), name.encode(),
            letters.encode(), columns.encode(),
        )  # fmt: skip

    def add(self, name: str, *values: float | bytes) -> None:
        """Add a message of a defined format."""
        number, layout = self._formats[name]
        self.data += b"\xa3\x95" + bytes([number]) + struct.pack(layout, *values)


def write_dataflash(
    path: Path, time: Array, state: Mapping[str, Array], *, clock: bool = True
) -> Path:
    """Write a log in ArduSub's layout: GPS, ATT, CTUN, RCOU and two instances of IMU.

    Args:
      clock: the vehicle has had a GPS fix, so that its log has dates.
    """
    log = Dataflash()
    log.define("ATT", "QccccCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    log.define("CTUN", "Qfff", "TimeUS,DAlt,Alt,BAlt")
    log.define("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.define("GPS", "QBBIHLL", "TimeUS,I,Status,GMS,GWk,Lat,Lng")
    log.define("RCOU", "QHH", "TimeUS,C1,C2")
    lost = np.full(len(time), np.nan)
    for k, moment in enumerate(time.tolist()):
        us = round((moment - time[0]) * 1e6) + 1_000_000
        week, rest = divmod(moment - GPS_ZERO + LEAP, WEEK)
        fixed = clock and np.isfinite(state.get("latitude", lost)[k])
        place = [round(1e7 * state[n][k]) if fixed else 0 for n in ("latitude", "longitude")]
        date = (round(rest * 1e3), int(week)) if clock else (0, 0)
        log.add("GPS", us, 0, 3 if fixed else 1, *date, *place)
        pitch, heading = round(100 * state["pitch"][k]), round(100 * state["heading"][k])
        log.add("ATT", us, 0, 0, pitch, pitch, heading, heading)
        log.add("CTUN", us, 0.0, -state["depth"][k], -state["depth"][k])
        for instance in (0, 1):
            log.add("IMU", us, instance, 0.0, 0.0, 0.01 + instance, 0.0, 0.0, -9.81)
        log.add("RCOU", us, 1500, 1500 + k % 7)
    path.write_bytes(bytes(log.data))
    return path


def write_ardusub(folder: Path, flight: Flight) -> list[Path]:
    """Write dives as a dataflash log."""
    return [write_dataflash(folder / "00000012.BIN", *flight.with_fixes())]


ARDUSUB = {"dataflash": write_ardusub}
