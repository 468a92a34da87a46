"""Protocols: servers by which ArduPilot or ROS 2 drives a vehicle, and readers of recordings."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from glider_twin_protocols.ardupilot import ArduPilotServer as ArduPilotServer
    from glider_twin_protocols.ardupilot import Channels as Channels
    from glider_twin_protocols.ardupilot import MavlinkTelemetry as MavlinkTelemetry
    from glider_twin_protocols.zenoh_server import ZenohServer as ZenohServer

__getattr__, __dir__ = attach(__name__, places(__name__))
