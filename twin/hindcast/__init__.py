"""Hindcast: a deployment walked through, each surfacing forecast from what was known before it.

found = hindcast(["real.zarr"], train_fraction=0.4)
found.scores.mean["forecast"], found.scores.mean["persistence"]
"""

from twin.hindcast.deployment_hindcast import DeploymentHindcast, Hindcast, hindcast
from twin.hindcast.forecast_leg import LoggedLeg, legs_of
from twin.hindcast.scores import METHODS, Scores, scores_of
from twin.hindcast.walk import HindcastSurfacing, walk

__all__ = [
    "METHODS",
    "DeploymentHindcast",
    "Hindcast",
    "HindcastSurfacing",
    "LoggedLeg",
    "Scores",
    "hindcast",
    "legs_of",
    "scores_of",
    "walk",
]
