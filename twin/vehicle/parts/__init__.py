"""Vehicle parts: what a hull can carry, one file a kind."""

from twin.vehicle.parts.base import PARTS, Move, Part, Quantity, register
from twin.vehicle.parts.battery import BatteryHinge, BatterySlide
from twin.vehicle.parts.fin import Fin
from twin.vehicle.parts.propeller import Propeller
from twin.vehicle.parts.pump import DropWeight, Pump

__all__ = [
    "PARTS",
    "BatteryHinge",
    "BatterySlide",
    "DropWeight",
    "Fin",
    "Move",
    "Part",
    "Propeller",
    "Pump",
    "Quantity",
    "register",
]
