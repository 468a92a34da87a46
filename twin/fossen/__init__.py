"""Fossen: a second model of a vehicle's motion in six degrees of freedom, which checks the first.

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
