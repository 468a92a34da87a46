"""Learning: networks for a glider's surge and sway, and the dead reckoning that uses them.

    import learn

    run = learn.fit("data/missions.zarr", seconds=60)
    result = learn.evaluate(run, "data/missions.zarr")
    print(result.figures["dr_water_percent_mean"])

Names are imported when they are first used, so that `import learn` costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from learn.api import evaluate, export, fit
    from learn.networks.base import Network
    from learn.networks.config import NetworkConfig
    from learn.networks.prediction import Prediction
    from learn.networks.registry import NETWORKS
    from learn.report.contents import Contents, RunEvaluation
    from learn.report.figures.base import ReportFigure
    from learn.report.figures.registry import REPORT_FIGURES
    from learn.runs.run import Run, newest_run, open_run
    from learn.training.given_settings import fit_settings
    from learn.training.optimisers.base import FullBatchOptimiser, MinibatchOptimiser
    from learn.training.optimisers.registry import OPTIMISERS
    from learn.training.schedule import TrainingConfig
    from learn.training.settings import FitConfig
    from twin.navigation.baselines.base import Baseline, Estimate
    from twin.navigation.baselines.registry import BASELINES

_PLACES = {
    "BASELINES": "twin.navigation.baselines.registry",
    "NETWORKS": "learn.networks.registry",
    "OPTIMISERS": "learn.training.optimisers.registry",
    "REPORT_FIGURES": "learn.report.figures.registry",
    "Baseline": "twin.navigation.baselines.base",
    "Contents": "learn.report.contents",
    "Estimate": "twin.navigation.baselines.base",
    "FitConfig": "learn.training.settings",
    "FullBatchOptimiser": "learn.training.optimisers.base",
    "MinibatchOptimiser": "learn.training.optimisers.base",
    "Network": "learn.networks.base",
    "NetworkConfig": "learn.networks.config",
    "Prediction": "learn.networks.prediction",
    "ReportFigure": "learn.report.figures.base",
    "Run": "learn.runs.run",
    "RunEvaluation": "learn.report.contents",
    "TrainingConfig": "learn.training.schedule",
    "evaluate": "learn.api",
    "export": "learn.api",
    "fit": "learn.api",
    "fit_settings": "learn.training.given_settings",
    "newest_run": "learn.runs.run",
    "open_run": "learn.runs.run",
}
"""Module of every public name."""

__all__ = [
    "BASELINES",
    "NETWORKS",
    "OPTIMISERS",
    "REPORT_FIGURES",
    "Baseline",
    "Contents",
    "Estimate",
    "FitConfig",
    "FullBatchOptimiser",
    "MinibatchOptimiser",
    "Network",
    "NetworkConfig",
    "Prediction",
    "ReportFigure",
    "Run",
    "RunEvaluation",
    "TrainingConfig",
    "evaluate",
    "export",
    "fit",
    "fit_settings",
    "newest_run",
    "open_run",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'learn' has no attribute {name!r}: see dir(learn)")
    from importlib import import_module

    value = getattr(import_module(_PLACES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
