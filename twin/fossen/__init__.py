"""An independent 6-DOF glider model after Fossen: the judge of the MuJoCo twin.

It shares the vehicle's parameters and the current sampler with the twin, and no equation.
"""

import twin.water.current.sampler
from twin.compiled.cache import cached_by_content

# The sampler is not this package's and was imported above, to be cached in its own place. The
# compiled functions of this package call each other across files, which numba's own test for
# stale code does not see; the folder of this cache is named by the contents instead.
with cached_by_content():
    import twin.fossen.equations  # noqa: F401

from twin.fossen.model import DEFAULT_DT, FossenModel
from twin.fossen.state import FossenState, FossenTrajectory
from twin.fossen.steady import SteadyMotion

__all__ = [
    "DEFAULT_DT",
    "FossenModel",
    "FossenState",
    "FossenTrajectory",
    "SteadyMotion",
]
