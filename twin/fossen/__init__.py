"""An independent 6-DOF glider model after Fossen: an independent check of the MuJoCo twin.

It shares the vehicle's parameters and the current sampler with the twin, and no equation.
"""

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
