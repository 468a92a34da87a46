"""Health: is something wrong with a vehicle, what, since when, and how sure.

    for one in assess("real.zarr", vehicle="mine.xml"):
        print(one.verdict())

Kinds of faults are in `twin.faults`.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.health.answers import Answers as Answers
    from twin.health.answers import answer_for as answer_for
    from twin.health.assessment import assess as assess
    from twin.health.beliefs import Beliefs as Beliefs
    from twin.health.beliefs import follow_parameters as follow_parameters
    from twin.health.channels import CHANNELS as CHANNELS
    from twin.health.channels import Channel as Channel
    from twin.health.deployment_dives import typical_dive as typical_dive
    from twin.health.deployment_health import DeploymentHealth as DeploymentHealth
    from twin.health.deployment_health import KindVerdict as KindVerdict
    from twin.health.manoeuvres import MostTelling as MostTelling
    from twin.health.manoeuvres import information_of as information_of
    from twin.health.manoeuvres import most_telling as most_telling
    from twin.health.thresholds import threshold_of as threshold_of

__getattr__, __dir__ = attach(__name__, places(__name__))
