"""Ocean currents: types of current, and one compiled sampler for all.

Build a current (`Uniform`, `Profile`, `Ekman`, `Geostrophic`, `Tide`, `Inertial`, `GaussMarkov`,
`Series`, `LogLayer`, `Grid`, sums by +, or `parse_current("ekman:tau=0.1,direction=90")`), compile
it for a mission, and read it with `twin.water.current.sampler.sample`. Your own type is a
subclass of `Current` with a compiled kernel, decorated with `register`. Importing this
package loads neither numba nor xarray.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places
from twin.seams import CURRENTS as CURRENTS

register = CURRENTS.add
"""Register your own type of current and test its examples (`probe`); usable as a decorator."""

if TYPE_CHECKING:
    from twin.water.current.axes import Origin as Origin
    from twin.water.current.base import Current as Current
    from twin.water.current.base import CurrentSum as CurrentSum
    from twin.water.current.base import check_field as check_field
    from twin.water.current.base import current_from_dict as current_from_dict
    from twin.water.current.base import current_help as current_help
    from twin.water.current.base import parse_current as parse_current
    from twin.water.current.base import parse_field as parse_field
    from twin.water.current.base import still_water as still_water
    from twin.water.current.grid import Grid as Grid
    from twin.water.current.layers import Ekman as Ekman
    from twin.water.current.layers import Geostrophic as Geostrophic
    from twin.water.current.layers import LogLayer as LogLayer
    from twin.water.current.profile import Profile as Profile
    from twin.water.current.profile import Uniform as Uniform
    from twin.water.current.sampler import sample_track as sample_track
    from twin.water.current.series import GaussMarkov as GaussMarkov
    from twin.water.current.series import Series as Series
    from twin.water.current.tide import Inertial as Inertial
    from twin.water.current.tide import TidalEllipse as TidalEllipse
    from twin.water.current.tide import Tide as Tide

__getattr__, _ = attach(__name__, places(__name__))
