"""Networks: models that estimate a vehicle's velocity through the water from its sensors."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from learn.networks.onnx_export import TOLERANCE as TOLERANCE
    from learn.networks.shipped_velocities import ShippedNetworks as ShippedNetworks
    from learn.networks.shipped_velocities import write_velocities as write_velocities

__getattr__, __dir__ = attach(__name__, places(__name__))
