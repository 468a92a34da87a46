"""Health: whether a vehicle has a fault, which one, since which dive, and how probable it is.

    for one in assess("real.zarr", vehicle="mine.xml"):
        print(one.verdict())

Kinds of faults are in `twin.faults`.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from glider_twin_ops.health.answers import Answers as Answers
    from glider_twin_ops.health.answers import Beliefs as Beliefs
    from glider_twin_ops.health.answers import answer_for as answer_for
    from glider_twin_ops.health.answers import follow_parameters as follow_parameters
    from glider_twin_ops.health.assessment import DeploymentHealth as DeploymentHealth
    from glider_twin_ops.health.assessment import KindVerdict as KindVerdict
    from glider_twin_ops.health.assessment import assess as assess
    from glider_twin_ops.health.channels import CHANNELS as CHANNELS
    from glider_twin_ops.health.channels import Channel as Channel
    from glider_twin_ops.health.deployment_dives import typical_dive as typical_dive
    from glider_twin_ops.health.fault_detector import FaultDetector as FaultDetector

__getattr__, __dir__ = attach(__name__, places(__name__))
