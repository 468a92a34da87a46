"""Blade lost: a propeller with a blade less."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

from twin.faults.base import Condition, Fault
from twin.vehicle.parts.propeller import Propeller

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle


@dataclasses.dataclass(frozen=True, kw_only=True)
class BladeLost(Fault):
    """A propeller that lost a blade: thrust and torque of those that are left."""

    kind: ClassVar[str] = "blade_lost"
    says: ClassVar[str] = "a propeller blade is lost"
    size_name: ClassVar[str] = "part"
    sizes: ClassVar[tuple[float, float]] = (0.33, 0.5)
    whole: ClassVar[bool] = False
    source: ClassVar[str] = "one blade of three, or of two"
    shows: ClassVar[str] = "slower at the same rate, with less power"
    otherwise: ClassVar[str] = "growth on the hull, which takes more power, not less"
    find_out: ClassVar[str] = "compare speed and power at the same rate; look at it"

    part: float = 0.33
    """of the blades that is gone"""

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """It needs a propeller that drives it."""
        if isinstance(vehicle.steered("speed"), Propeller):
            return ""
        return "has no propeller that drives it"

    def change(self, condition: Condition, size: float) -> Condition:
        """Thrust, torque and standing drag of the blades that are left."""
        screw = condition.vehicle.steered("speed")
        assert isinstance(screw, Propeller)
        left = 1.0 - size
        names = ("thrust_coefficient", "torque_coefficient", "standing_drag", "standing_torque")
        changes = {name: getattr(screw, name) * left for name in names}
        return condition.with_vehicle(**{screw.name: changes})
