"""Sea floor: flat, rough, an array of depths, or a bathymetry file about the mission's start.

The hull collides with a floor, altimeter and Doppler log measure it, and dives that have a
`min_altitude_m` turn above it.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.water.floor.base import FlatFloor as FlatFloor
    from twin.water.floor.base import Floor as Floor
    from twin.water.floor.base import GridFloor as GridFloor
    from twin.water.floor.base import RoughFloor as RoughFloor
    from twin.water.floor.bathymetry import Bathymetry as Bathymetry
    from twin.water.floor.bathymetry import floor_from_dict as floor_from_dict
    from twin.water.floor.bathymetry import parse_floor as parse_floor

__getattr__, __dir__ = attach(__name__, places(__name__))
