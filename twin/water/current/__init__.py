"""Ocean currents: one file a kind, and one compiled sampler for all of them.

Build a current (`Uniform`, `Profile`, `Ekman`, `Geostrophic`, `Tide`, `Inertial`, `GaussMarkov`,
`Series`, `LogLayer`, `Grid`, sums by +, or `parse_current("ekman:tau=0.1,direction=90")`), compile
it for a mission, and read it with `twin.water.current.sampler.sample`. A kind of one's own is a
subclass of `Current` with a compiled kernel, decorated with `register`. Importing this
package loads neither numba nor xarray.
"""

from twin.water.current.axes import Origin
from twin.water.current.base import Current, CurrentSum, current_from_dict, still_water
from twin.water.current.current_text import current_help, parse_current
from twin.water.current.ekman import Ekman
from twin.water.current.gauss_markov import GaussMarkov
from twin.water.current.geostrophic import Geostrophic
from twin.water.current.grid import Grid
from twin.water.current.inertial import Inertial
from twin.water.current.log_layer import LogLayer
from twin.water.current.profile import Profile
from twin.water.current.register import register
from twin.water.current.series import Series
from twin.water.current.tide import TidalEllipse, Tide
from twin.water.current.uniform import Uniform

__all__ = [
    "Current",
    "CurrentSum",
    "Ekman",
    "GaussMarkov",
    "Geostrophic",
    "Grid",
    "Inertial",
    "LogLayer",
    "Origin",
    "Profile",
    "Series",
    "TidalEllipse",
    "Tide",
    "Uniform",
    "current_from_dict",
    "current_help",
    "parse_current",
    "register",
    "still_water",
]
