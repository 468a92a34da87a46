"""Vehicle parts: what a hull can carry, one file a kind."""

from twin.vehicle.parts.base import PARTS, Part, Quantity, register
from twin.vehicle.parts.battery_hinge import BatteryHinge
from twin.vehicle.parts.battery_slide import BatterySlide
from twin.vehicle.parts.drop_weight import DropWeight
from twin.vehicle.parts.fin import Fin
from twin.vehicle.parts.propeller import Propeller
from twin.vehicle.parts.pump import Pump

__all__ = [
    "PARTS",
    "BatteryHinge",
    "BatterySlide",
    "DropWeight",
    "Fin",
    "Part",
    "Propeller",
    "Pump",
    "Quantity",
    "register",
]
