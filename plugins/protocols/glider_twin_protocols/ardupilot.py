"""ArduPilot: server of the JSON interface for SITL, with servo pulses in and vehicle state out.

The protocol is described in ArduPilot, libraries/SITL/examples/JSON/readme.md. A UDP packet has a
magic number, the frame rate [Hz], a counter and the pulses [us] of 16 or 32 channels. The answer is
a line of JSON with time, gyroscope, accelerometer, position, quaternion and velocity, in axes
north-east-down and forward-starboard-down. Each packet advances the vehicle by one frame.
"""

from __future__ import annotations

import contextlib
import gc
import ipaddress
import json
import math
import socket
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin import Command, SteppedVehicle, Vehicle
from twin.errors import InputError, unknown_name
from twin.frames import euler_to_quaternion
from twin.geodesy import from_tangent_plane

PACKETS = {18458: struct.Struct("<HHI16H"), 29569: struct.Struct("<HHI32H")}
"""Layout of a packet by its magic number"""
PORT = 9002
"""UDP port to which ArduPilot sends its packets"""
MIDDLE, HIGH = 1500.0, 2000.0
"""[us] Pulses for a part's rest and the high end of its travel"""
FULL = 400.0
"""[us] Pulse from the middle at which ArduSub's mixer asks a thruster for full thrust"""
_LEVEL = ((0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1))
FRAMES = {
    "vectored": (*_LEVEL, (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0)),
    "vectored-6dof": (
        *_LEVEL, (1, -1, 0, -1, 0, 0), (-1, -1, 0, -1, 0, 0), (1, 1, 0, -1, 0, 0),
        (-1, 1, 0, -1, 0, 0),
    ),
}  # fmt: skip
"""Factors of roll, pitch, yaw, throttle (up), forward and lateral (to starboard) in the output of
each motor, from motor 1 on: ArduPilot, libraries/AP_Motors/AP_Motors6DOF.cpp, setup_motors"""
LISTENS = 0.5
"""[s] Longest wait for a packet between checks whether to stop"""


@dataclass(frozen=True)
class Channels:
    """Map from servo channels to the vehicle's parts."""

    vehicle: Vehicle
    parts: tuple[str, ...]
    """Names of parts, the first for channel 1."""
    signs: tuple[float, ...] = ()
    """Signs of an ArduSub frame's motors along the axes of their thrusters; empty: no frame"""

    @classmethod
    def of(cls, vehicle: Vehicle, names: Sequence[str] = ()) -> Channels:
        """Channels of the named parts; without names, all parts in the order of the vehicle file.

        Raises:
          InputError: a part is unknown or named twice.
        """
        for name in names:
            if name not in vehicle.part_names:
                what = f"channel: part of vehicle {vehicle.name!r}"
                raise InputError(unknown_name(what, name, vehicle.part_names))
            if list(names).count(name) > 1:
                raise InputError(f"channel: the part {name!r} has two channels; give it one")
        return cls(vehicle, tuple(names) or tuple(vehicle.part_names))

    @classmethod
    def of_frame(cls, vehicle: Vehicle, frame: str) -> Channels:
        """Channels of an ArduSub frame's motors, with every MOTx_DIRECTION at its default of 1.

        A motor is the thruster whose forces and moments have the signs of the motor's factors,
        or all of the other signs: its axis is then reversed.

        Raises:
          InputError: the frame is unknown, or the vehicle's thrusters are not those of the frame.
        """
        if frame not in FRAMES:
            raise InputError(unknown_name("frame", frame, FRAMES))
        names = [part.name for part in vehicle.parts if part.kind == "thruster"]
        pushes = []
        for name in names:
            axis, place = (np.asarray(getattr(vehicle.part(name), k)) for k in ("axis", "position"))
            pushes.append([*np.cross(place, axis), -axis[2], axis[0], axis[1]])
        parts, signs = [], []
        for k, factors in enumerate(FRAMES[frame], 1):
            used = np.flatnonzero(factors)
            ways = np.array(pushes).reshape(-1, 6)[:, used] * np.array(factors)[used]
            ahead, astern = (ways > 1e-6).all(axis=1), (ways < -1e-6).all(axis=1)
            found = np.flatnonzero(ahead | astern)
            if len(found) != 1 or len(names) != len(FRAMES[frame]):
                raise InputError(
                    f"frame {frame}: motor {k} of {len(FRAMES[frame])} is no one of the vehicle's "
                    f"{len(names)} thrusters ({', '.join(names) or 'none'}); give --channels"
                )
            parts.append(names[found[0]])
            signs.append(1.0 if ahead[found[0]] else -1.0)
        return cls(vehicle, tuple(parts), tuple(signs))

    def command(self, pulses: Sequence[int]) -> Command:
        """Command of part positions: 1500 us is rest, 1000 and 2000 us are the ends of the travel;
        1100 and 1900 us in a frame. A pulse of 0 means no pulse, and is rest."""
        positions = {}
        half = FULL if self.signs else HIGH - MIDDLE
        signs = self.signs or (1.0,) * len(self.parts)
        for name, pulse, sign in zip(self.parts, pulses, signs, strict=False):
            part = self.vehicle.part(name)
            if pulse == 0:
                positions[name] = part.rest
                continue
            way = sign * min(max((float(pulse) - MIDDLE) / half, -1.0), 1.0)
            end = part.high if way > 0.0 else part.low
            positions[name] = part.rest + abs(way) * (end - part.rest)
        return Command(**positions)


@dataclass
class Served:
    """Counts of a server's packets and frames."""

    frames: int = 0
    repeated: int = 0
    """Packets whose frame was simulated before; they only get the same answer again."""
    skipped: int = 0
    """Frames whose packets never came."""
    refused: int = 0
    """Packets that are invalid or not of the client that drives."""
    restarts: int = 0
    lost: int = 0
    """Times that the client fell silent, so that the vehicle flew its failsafe."""


class ArduPilotServer:
    """Server of one client at a time; a context manager that holds the socket."""

    def __init__(
        self,
        flown: SteppedVehicle,
        channels: Channels,
        *,
        host: str = "127.0.0.1",
        port: int = PORT,
        silence: float = 2.0,
        exposed_to: Sequence[str] = (),
        telemetry: Callable[[SteppedVehicle], None] | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Bind the socket.

        Args:
          flown: vehicle to drive.
          channels: map from channels to the vehicle's parts.
          host, port: address to receive packets on; port 0 takes a free one.
          silence: [s] time without a packet after which the client is lost: the vehicle then flies
            its failsafe in real time until a client comes back.
          exposed_to: addresses and networks of the clients that may drive; required for a host that
            other machines can reach. The protocol has no token, so a client with a forged address
            is accepted too.
          telemetry: called after each frame.
          tell: called with a line for each client that is refused.

        Raises:
          InputError: `exposed_to` is missing for a host that other machines can reach, or given for
            one that they cannot; an address is invalid; or the port is taken.
        """
        self._allowed = [_network(word) for word in exposed_to]
        if not self._allowed and not own_machine(host):
            raise InputError(
                f"{host} can be reached by other machines, and the protocol has no field for a "
                "token: serve on 127.0.0.1, or name who may drive, --exposed-to ADDRESS, on a "
                "network that you trust"
            )
        if self._allowed and own_machine(host):
            raise InputError(
                f"--exposed-to is for other machines, which do not reach {host}: give --host too, "
                "such as 0.0.0.0, or leave it out"
            )
        if not silence > 0.0:
            raise InputError(f"silence must be above 0 s, not {silence:g}")
        self.flown, self.channels, self.silence = flown, channels, silence
        self.served = Served()
        self._telemetry, self._tell = telemetry, tell
        self._refused: set[tuple[str, int]] = set()
        self._client: tuple[str, int] | None = None
        self._frame, self._answer, self._heard = -1, b"", 0.0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise InputError(f"cannot serve on {host}:{port}: {error.strerror}") from error

    def __enter__(self) -> ArduPilotServer:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the socket."""
        host, port = self._socket.getsockname()
        return str(host), int(port)

    def run(self, until: Callable[[], bool] = lambda: False) -> Served:
        """Serve until the flight ends or `until` is True; returns the counts.

        Meanwhile Python's garbage collector skips all older objects: a full collection takes longer
        than an answer.
        """
        gc.collect()
        gc.freeze()
        try:
            return self._serve(until)
        finally:
            gc.unfreeze()

    def _serve(self, until: Callable[[], bool]) -> Served:
        while not self.flown.ended and not until():
            self._socket.settimeout(min(self.silence, LISTENS))
            try:
                data, sender = self._socket.recvfrom(1024)
            except TimeoutError:
                silent = time.monotonic() - self._heard >= self.silence
                if self._client is not None and silent:
                    self._fly_failsafe(until)
                continue
            self._take(data, sender)
        return self.served

    def _take(self, data: bytes, sender: tuple[str, int]) -> None:
        """Simulate the frame of a packet and send the answer."""
        packet = _unpack(data)
        driver = self._client or sender
        why = ""
        if not self._may_drive(sender):
            why = "its address is not among those of --exposed-to"
        elif driver != sender:
            why = "{}:{} drives, until it is silent for {:g} s".format(*driver, self.silence)
        if packet is None or why:
            self.served.refused += 1
            if packet is not None and sender not in self._refused:
                self._refused.add(sender)
                self._tell("{}:{} is refused: {}".format(*sender, why))
            return
        rate, frame, pulses = packet
        self._client, self._heard = sender, time.monotonic()
        last = self._frame
        if frame == last:
            self.served.repeated += 1
        else:
            if frame < last:  # ArduPilot was restarted
                self.flown.reset()
                self.served.restarts += 1
            elif last >= 0:
                self.served.skipped += frame - last - 1
            self._frame = frame
            self.flown.step(self.channels.command(pulses), 1.0 / rate)
            self._answer = answer(self.flown)
            self.served.frames += 1
        with contextlib.suppress(ConnectionError):  # the client may have gone
            self._socket.sendto(self._answer, sender)
        if self._telemetry is not None and frame != last:  # after the answer, not to delay it
            self._telemetry(self.flown)

    def _may_drive(self, sender: tuple[str, int]) -> bool:
        """True for a sender on this machine, or in `exposed_to`."""
        address = ipaddress.ip_address(sender[0])
        return address.is_loopback or any(address in one for one in self._allowed)

    def _fly_failsafe(self, until: Callable[[], bool]) -> None:
        """Fly the failsafe in real time, after the client is lost, until a packet comes."""
        self.served.lost += 1
        self._client = None
        command, begun, first = self.flown.failsafe(), time.monotonic(), self.flown.time
        while not self.flown.ended and not until():
            self.flown.step(command)
            if self._telemetry is not None:
                self._telemetry(self.flown)
            ahead = (self.flown.time - first) - (time.monotonic() - begun)
            self._socket.settimeout(max(ahead, 1e-3))
            try:
                data, sender = self._socket.recvfrom(1024)
            except TimeoutError:
                continue
            self._take(data, sender)
            if self._client is not None:
                return


def own_machine(host: str) -> bool:
    """True for a host that only this machine can reach."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _network(word: str) -> ipaddress.IPv4Network:
    try:
        return ipaddress.IPv4Network(word.strip(), strict=False)
    except ValueError as error:
        raise InputError(
            f"--exposed-to {word!r} is no address or network, such as 192.168.1.20 or "
            "192.168.1.0/24"
        ) from error


def _unpack(data: bytes) -> tuple[float, int, tuple[int, ...]] | None:
    """Frame rate [Hz], counter and pulses [us] of a packet; None for an invalid packet."""
    if len(data) < 2:
        return None
    layout = PACKETS.get(int.from_bytes(data[:2], "little"))
    if layout is None or len(data) != layout.size:
        return None
    _, rate, frame, *pulses = layout.unpack(data)
    return (float(rate), frame, tuple(pulses)) if rate > 0 else None


def answer(flown: SteppedVehicle) -> bytes:
    """Answer to a packet: the vehicle's state as a line of JSON."""
    now = flown.state()
    angles = (math.radians(now[f"true_{name}"]) for name in ("roll", "pitch", "heading"))
    fields = {
        "timestamp": flown.time,
        "imu": {
            "gyro": [now[f"true_{name}_rate"] for name in ("roll", "pitch", "yaw")],
            "accel_body": [now[f"true_specific_force_{axis}"] for axis in "xyz"],
        },
        "position": [now["true_north"], now["true_east"], now["true_depth"]],
        "quaternion": euler_to_quaternion(*angles).tolist(),
        "velocity": [now[f"true_velocity_{axis}"] for axis in ("north", "east", "down")],
    }
    altitude = now.get("true_altitude", math.inf)
    if math.isfinite(altitude):
        fields["rng_1"] = altitude
    return b"\n" + json.dumps(fields, separators=(",", ":")).encode() + b"\n"


RATE = 4.0
"""[Hz] Rate of attitude and position messages, in simulated time"""
SURFACE = 1013.25
"""[hPa] Air pressure at the surface"""
HPA_PER_METRE = 100.52
"""[hPa/m] Pressure gradient of sea water of 1025 kg/m3 at 9.807 m/s2"""


class MavlinkTelemetry:
    """Sender of heartbeat, attitude, position and pressure; incoming messages are not read."""

    def __init__(self, address: str, start: tuple[float, float]) -> None:
        """Open the connection.

        Args:
          address: address in pymavlink's form, such as udpout:127.0.0.1:14550.
          start: [degree] latitude and longitude of the flight's start.

        Raises:
          ModuleNotFoundError: pymavlink is not installed.
          InputError: pymavlink cannot open the address.
        """
        from pymavlink import mavutil

        self._words = mavutil.mavlink
        try:
            self._link = mavutil.mavlink_connection(address, source_system=1)
        except Exception as error:
            raise InputError(
                f"--mavlink {address}: {error}; give an address such as udpout:127.0.0.1:14550"
            ) from error
        self._start = start
        self._beat = self._sent = -1

    def close(self) -> None:
        """Close the connection."""
        self._link.close()

    def __call__(self, flown: SteppedVehicle) -> None:
        """Send the messages that are due."""
        words, send = self._words, self._link.mav
        beat, due = (math.floor(rate * flown.time + 1e-6) for rate in (1.0, RATE))
        if beat != self._beat:  # also after a reset
            self._beat = beat
            send.heartbeat_send(
                words.MAV_TYPE_SUBMARINE, words.MAV_AUTOPILOT_GENERIC,
                words.MAV_MODE_FLAG_SAFETY_ARMED, 0, words.MAV_STATE_ACTIVE,
            )  # fmt: skip
        if due == self._sent:
            return
        self._sent = due
        now, ms = flown.state(), round(1e3 * flown.time)
        angles = [math.radians(now[f"true_{name}"]) for name in ("roll", "pitch", "heading")]
        angles[2] = math.remainder(angles[2], 2.0 * math.pi)
        rates = [now[f"true_{name}_rate"] for name in ("roll", "pitch", "yaw")]
        north, east, depth = (now[f"true_{name}"] for name in ("north", "east", "depth"))
        speed = [now[f"true_velocity_{axis}"] for axis in ("north", "east", "down")]
        latitude, longitude = from_tangent_plane(np.array(north), np.array(east), *self._start)
        send.attitude_send(ms, *angles, *rates)
        send.local_position_ned_send(ms, north, east, depth, *speed)
        send.global_position_int_send(
            ms, round(1e7 * float(latitude)), round(1e7 * float(longitude)), round(-1e3 * depth),
            round(-1e3 * depth), *(round(1e2 * one) for one in speed),
            round(1e2 * now["true_heading"]) % 36000,
        )  # fmt: skip
        send.scaled_pressure2_send(ms, SURFACE + HPA_PER_METRE * max(depth, 0.0), 0.0, 0)
