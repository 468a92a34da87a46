"""Learning: networks for a glider's surge and sway, and the dead reckoning that uses them.

    import learn

    run = learn.fit("data/missions.zarr", seconds=60)
    result = learn.evaluate(run, "data/missions.zarr")
    print(result.figures["dr_water_percent_mean"])

Every public name is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from twin.extras import require_factory, require_learning, started_as
from twin.lazy import attach, places

if not started_as("learn"):  # the command line reports a missing package without a traceback
    require_factory()

if TYPE_CHECKING:
    from learn.adaptation import adapt as adapt
    from learn.api import evaluate as evaluate
    from learn.api import export as export
    from learn.api import fit as fit
    from learn.networks.base import Network as Network
    from learn.networks.base import NetworkConfig as NetworkConfig
    from learn.networks.predictor import Prediction as Prediction
    from learn.report.contents import RunEvaluation as RunEvaluation
    from learn.run import Run as Run
    from learn.run import newest_run as newest_run
    from learn.run import open_run as open_run
    from learn.seams import NETWORKS as NETWORKS
    from learn.seams import OPTIMISERS as OPTIMISERS
    from learn.training.fit_config import FitConfig as FitConfig
    from learn.training.fit_config import fit_settings as fit_settings
    from learn.training.optimiser import FullBatchOptimiser as FullBatchOptimiser
    from learn.training.optimiser import MinibatchOptimiser as MinibatchOptimiser
    from learn.training.optimiser import TrainingConfig as TrainingConfig
    from learn.training.settings import FitSettings as FitSettings
    from twin.navigation.estimators.base import Estimate as Estimate

_PLACES = places(__name__)
__all__ = [*_PLACES]
_get, __dir__ = attach(__name__, _PLACES)


def __getattr__(name: str) -> Any:
    if name in _PLACES and not started_as("learn"):
        require_learning()  # the shipped networks alone run without PyTorch
    return _get(name)
