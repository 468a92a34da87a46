"""Fossen: a second model of a vehicle's motion in six degrees of freedom, which checks the first.

The model shares the vehicle's parameters and the current sampler with the twin, but no equation.
"""

from typing import TYPE_CHECKING

from twin.fossen.model import DEFAULT_DT as DEFAULT_DT
from twin.fossen.model import FossenModel as FossenModel
from twin.fossen.model import FossenState as FossenState
from twin.fossen.model import FossenTrajectory as FossenTrajectory
from twin.fossen.steady import SteadyMotion as SteadyMotion
from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.fossen.lane_block import LANES as LANES

__getattr__, _ = attach(__name__, places(__name__))
