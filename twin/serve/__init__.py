"""Serve: one vehicle that others drive: step by step in Python, by ArduPilot or by ROS 2."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.serve.ardupilot import ArduPilotServer as ArduPilotServer
    from twin.serve.ardupilot import Channels as Channels
    from twin.serve.mavlink_telemetry import MavlinkTelemetry as MavlinkTelemetry
    from twin.serve.stepped_vehicle import SteppedVehicle as SteppedVehicle
    from twin.serve.zenoh_server import ZenohServer as ZenohServer

__getattr__, __dir__ = attach(__name__, places(__name__))
