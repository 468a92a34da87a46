"""Vehicle parts: pumps, batteries, fins, propellers, thrusters and others that a hull can carry."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.vehicle.parts.base import PARTS as PARTS
    from twin.vehicle.parts.base import Move as Move
    from twin.vehicle.parts.base import Part as Part
    from twin.vehicle.parts.base import Quantity as Quantity
    from twin.vehicle.parts.base import register as register
    from twin.vehicle.parts.battery import BatteryHinge as BatteryHinge
    from twin.vehicle.parts.battery import BatterySlide as BatterySlide
    from twin.vehicle.parts.fin import Fin as Fin
    from twin.vehicle.parts.propeller import Propeller as Propeller
    from twin.vehicle.parts.pump import DropWeight as DropWeight
    from twin.vehicle.parts.pump import Pump as Pump
    from twin.vehicle.parts.thruster import Tether as Tether
    from twin.vehicle.parts.thruster import Thruster as Thruster

_PLACES = places(__name__)
__all__ = [*_PLACES]
__getattr__, __dir__ = attach(__name__, _PLACES)
