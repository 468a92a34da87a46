"""Hull laws: how the water's force on a hull is written, one file a kind."""

from twin.vehicle.laws.base import LAWS, HullLaw, register
from twin.vehicle.laws.body_axes import BodyAxes
from twin.vehicle.laws.ellipsoid import Ellipsoids
from twin.vehicle.laws.flow_frame import FlowFrame

__all__ = ["LAWS", "BodyAxes", "Ellipsoids", "FlowFrame", "HullLaw", "register"]
