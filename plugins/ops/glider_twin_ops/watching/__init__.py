"""Watching: keep the folder of a deployment at sea up to date, one pass after another.

deployment = WatchedDeployment.read("calypso")
one_pass(deployment)
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from glider_twin_ops.watching.deployment_folder import WatchedDeployment as WatchedDeployment
    from glider_twin_ops.watching.learning_dives import MostTelling as MostTelling
    from glider_twin_ops.watching.learning_dives import information_of as information_of
    from glider_twin_ops.watching.learning_dives import most_telling as most_telling
    from glider_twin_ops.watching.learning_dives import propose_learning as propose_learning
    from glider_twin_ops.watching.sources import SOURCES as SOURCES
    from glider_twin_ops.watching.sources import Source as Source
    from glider_twin_ops.watching.sources import SurfaceDialogue as SurfaceDialogue
    from glider_twin_ops.watching.watch_pass import Passed as Passed
    from glider_twin_ops.watching.watch_pass import one_pass as one_pass

__getattr__, __dir__ = attach(__name__, places(__name__))
