"""Watching: a deployment at sea as a folder that is brought up to date, pass by pass.

deployment = WatchedDeployment.read("calypso")
one_pass(deployment)
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from factory.watching.deployment_folder import AUTO as AUTO
    from factory.watching.deployment_folder import WatchedDeployment as WatchedDeployment
    from factory.watching.learning_dives import propose_learning as propose_learning
    from factory.watching.morning_page import summary as summary
    from factory.watching.sources.arrived_files import kind_of as kind_of
    from factory.watching.sources.base import SOURCES as SOURCES
    from factory.watching.sources.base import Source as Source
    from factory.watching.sources.base import SurfaceDialogue as SurfaceDialogue
    from factory.watching.watch_pass import Passed as Passed
    from factory.watching.watch_pass import alone as alone
    from factory.watching.watch_pass import one_pass as one_pass

__getattr__, __dir__ = attach(__name__, places(__name__))
