"""MAVLink telemetry of a stepped vehicle, for ground stations such as QGroundControl."""

from __future__ import annotations

import math

import numpy as np

from twin.errors import InputError
from twin.geodesy import from_tangent_plane
from twin.serve.stepped_vehicle import SteppedVehicle

RATE = 4.0
"""[Hz] of attitude and position, in the vehicle's time"""
SURFACE = 1013.25
"""[hPa] of the air"""
HPA_PER_METRE = 100.52
"""[hPa/m] sea water of 1025 kg/m3 at 9.807 m/s2"""


class MavlinkTelemetry:
    """Sends heartbeat, attitude, position and pressure; reads nothing."""

    def __init__(self, address: str, start: tuple[float, float]) -> None:
        """Open the connection.

        Args:
          address: as of pymavlink, such as udpout:127.0.0.1:14550.
          start: latitude and longitude [degree] of the flight's start.

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
        """Send what is due."""
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
