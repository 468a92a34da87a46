"""Logs of an imaginary LAUV: packets by `imcpy`, which has DUNE's own code, and by the description
of IMC alone where that code cannot write them (the other byte order, unknown messages)."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from logs import Flight
from message_logs import DIVES, dives
from numpy.typing import NDArray

from twin.geodesy import from_tangent_plane, to_tangent_plane

Array = NDArray[np.float64]

OWN, OTHER = 30, 31
"""Addresses of the vehicle and of another one"""
ENTITIES = {
    1: "Navigation", 2: "AHRS", 3: "Depth Sensor", 4: "DVL", 5: "GPS", 6: "Motor", 7: "Servos",
    8: "CTD", 9: "Main Board", 10: "Batteries",
}  # fmt: skip
ORIGINS = (49.5, -58.0), (49.5003, -57.999)
"""[degree] latitude, longitude of the origins of the vehicle's own state, one after the other"""
DECLINATION = -0.05
"""[rad]"""


def message(kind: str, moment: float, entity: int, system: int = OWN, **fields: Any) -> bytes:
    """A packet, written by DUNE's code."""
    import imcpy

    one = imcpy.Factory.produce(kind)
    one.timestamp, one.src, one.src_ent = moment, system, entity
    for field, value in fields.items():
        setattr(one, field, value)
    return bytes(imcpy.Packet.serialize(one))


def entities(moment: float, system: int = OWN) -> bytes:
    """What a system calls its entities, as DUNE writes it when a log begins."""
    return b"".join(
        message("EntityInfo", moment, k, system, id=k, label=label, component="test")
        for k, label in ENTITIES.items()
    )


def packets(time: Array, state: Mapping[str, Array], title: str = "") -> list[bytes]:
    """The packets of each moment, of a state in a store's units and axes; the names first."""
    start = float(time[0])
    first = entities(start)
    if title:
        first += message("LoggingControl", start, 1, op=_operation("STARTED"), name=title)
    found = [first]
    north, east = track_of(time, state)
    latitudes, longitudes = from_tangent_plane(north, east, *ORIGINS[0])
    for k, moment in enumerate(time.tolist()):

        def value(name: str, k: int = k) -> float:
            return float(state[name][k]) if name in state else 0.0

        roll, pitch = np.radians(value("roll")), np.radians(value("pitch"))
        heading = float(np.angle(np.exp(1j * np.radians(value("heading")))))
        origin = ORIGINS[k >= len(time) // 2]  # it moves when the vehicle has gone far
        x, y = to_tangent_plane(latitudes[k], longitudes[k], *origin)
        some = [
            message("EstimatedState", moment, 1, lat=np.radians(origin[0]),
                    lon=np.radians(origin[1]), x=x, y=y, z=0.0, phi=roll, theta=pitch, psi=heading,
                    p=0.001, q=0.002, r=0.003, depth=value("depth"), alt=-1.0),
            message("EulerAngles", moment, 2, phi=roll + 0.1, theta=pitch + 0.1,
                    psi=heading - DECLINATION, psi_magnetic=heading - DECLINATION),
            message("AngularVelocity", moment, 2, x=0.01, y=-0.02, z=value("yaw_rate")),
            message("Acceleration", moment, 2, x=0.1, y=-0.2, z=-9.8),
            message("Depth", moment, 3, value=value("depth")),
            message("Pressure", moment, 3, value=100.0 * value("depth") * 1.0065),
            message("Temperature", moment, 9, value=45.0),
        ]  # fmt: skip
        if "surge" in state:
            some += _driven(moment, k, value)
        if "latitude" in state:
            there = bool(np.isfinite(state["latitude"][k]))
            place = (value("latitude"), value("longitude")) if there else (0.0, 0.0)
            some.append(
                message("GpsFix", moment, 5, validity=0x0007 if there else 0x0003,
                        lat=np.radians(place[0]), lon=np.radians(place[1]), satellites=8)
            )  # fmt: skip
        found.append(b"".join(some))
    return found


def track_of(time: Array, state: Mapping[str, Array]) -> tuple[Array, Array]:
    """North and east [m] of the vehicle's own track: where its velocity brings it."""
    if "surge" not in state:
        return state["north"], state["east"]
    heading = np.radians(state["heading"])
    cosine, sine = np.cos(heading), np.sin(heading)
    north = state["surge"] * cosine - state["sway"] * sine
    east = state["surge"] * sine + state["sway"] * cosine
    step = np.diff(time, prepend=time[0])
    return np.cumsum(north * step), np.cumsum(east * step)


def _driven(moment: float, k: int, value: Any) -> list[bytes]:
    """What a Doppler log, a motor, four servos, a CTD and two voltmeters say."""
    lock = k % 50 < 40  # of every 50 pings the last ten see no bottom, five of these only water
    water = {"validity": 7 if k % 50 < 45 else 0, "x": value("surge") + 0.1, "y": 0.02, "z": -0.03}
    ground = {"validity": 7 if lock else 0, "x": value("surge"), "y": value("sway"), "z": 0.01}
    servos = [0.10, -0.05, -0.07, 0.14]
    return [
        message("GroundVelocity", moment, 4, **ground),
        message("WaterVelocity", moment + 0.01, 4, **water),
        message("Rpm", moment, 6, value=round(value("rpm"))),
        *(message("ServoPosition", moment, 7, id=i, value=a) for i, a in enumerate(servos)),
        *(message("SetServoPosition", moment, 1, id=i, value=2 * a) for i, a in enumerate(servos)),
        message("SetThrusterActuation", moment, 1, id=0, value=0.4),
        message("Temperature", moment, 8, value=14.0), message("Salinity", moment, 8, value=35.0),
        message("Conductivity", moment, 8, value=4.2),
        message("Voltage", moment, 9, value=12.0), message("Voltage", moment, 10, value=25.5),
        message("Current", moment, 10, value=3.5),
    ]  # fmt: skip


def _operation(name: str) -> Any:
    import imcpy

    return getattr(imcpy.LoggingControl.ControlOperationEnum, name)


def write_lsf(folder: Path, flight: Flight) -> list[Path]:
    """Dives as DUNE's log, with the mapping that says that they are dives."""
    time, state = dives(flight)
    (folder / "mine.toml").write_text(DIVES)
    path = folder / "Data.lsf"
    path.write_bytes(b"".join(packets(time, state)))
    return [path]


def topics_of_lsf(path: Path) -> set[str]:
    """Names in a log, by the reader of `imcpy`: the message and who sent it."""
    from imcpy.lsf import LSFReader

    found = set()
    for one in LSFReader.read(path.read_bytes(), use_index=False):
        label = ENTITIES[one.src_ent].replace(" ", "_")
        found.add(one.msg_name if one.msg_name == "EntityInfo" else f"{one.msg_name}/{label}")
    return found


def checksum(data: bytes) -> int:
    """CRC-16-IBM: polynomial 0x8005, reflected, from 0."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value


def described(
    order: str, number: int, layout: str, *values: float, moment: float, entity: int
) -> bytes:  # fmt: skip
    """A packet by the description of IMC (IMC.xml, 5.4): header, payload, sum.

    Args:
      order: < or >.
      layout: of the payload, for `struct`.
    """
    payload = struct.pack(order + layout, *values)
    header = struct.pack(
        f"{order}HHHdHBHB", 0xFE54, number, len(payload), moment, OWN, entity, 0xFFFF, 0xFF
    )
    return header + payload + struct.pack(f"{order}H", checksum(header + payload))
