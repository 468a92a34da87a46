"""Ocean currents: what they are, and one compiled sampler for all of them.

Build a current (`Uniform`, `Profile`, `Ekman`, `Geostrophic`, `Tide`, `Inertial`, `GaussMarkov`,
`LogLayer`, `Grid`, sums by +, or `parse_current("ekman:tau=0.1,direction=90")`), compile it for a
mission, and read it with `twin.current.sampler.sample`. Importing this package loads neither
numba nor xarray.
"""

from twin.current.base import Current, CurrentSum, current_from_dict, still_water
from twin.current.ekman import Ekman
from twin.current.gauss_markov import GaussMarkov
from twin.current.geostrophic import Geostrophic
from twin.current.grid import Grid
from twin.current.inertial import Inertial
from twin.current.log_layer import LogLayer
from twin.current.origin import Origin
from twin.current.profile import Profile
from twin.current.spec import CURRENT_HELP, parse_current
from twin.current.tide import TidalEllipse, Tide
from twin.current.uniform import Uniform

__all__ = [
    "CURRENT_HELP",
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
    "TidalEllipse",
    "Tide",
    "Uniform",
    "current_from_dict",
    "parse_current",
    "still_water",
]
