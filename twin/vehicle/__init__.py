"""Vehicle: a hull with its parts, read by name from an MJCF file."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.vehicle.consumption import ENERGY as ENERGY
    from twin.vehicle.consumption import Consumption as Consumption
    from twin.vehicle.dimensions import Dimensions as Dimensions
    from twin.vehicle.presets import shipped_files as shipped_files
    from twin.vehicle.steady_motion import positions_text as positions_text
    from twin.vehicle.steady_motion import trim_positions as trim_positions
    from twin.vehicle.template import vehicle_template as vehicle_template

__getattr__, __dir__ = attach(__name__, places(__name__))
