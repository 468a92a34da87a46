"""Hull laws: formulas for the force and moment of the water on a bare hull."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.vehicle.laws.base import LAWS as LAWS
    from twin.vehicle.laws.base import HullLaw as HullLaw
    from twin.vehicle.laws.base import register as register
    from twin.vehicle.laws.body_axes import BodyAxes as BodyAxes
    from twin.vehicle.laws.ellipsoid import Ellipsoids as Ellipsoids
    from twin.vehicle.laws.flow_frame import FlowFrame as FlowFrame

_PLACES = places(__name__)
__all__ = [*_PLACES]
__getattr__, __dir__ = attach(__name__, _PLACES)
