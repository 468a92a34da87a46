"""Hindcast: a deployment walked through, each surfacing forecast from what was known before it.

found = hindcast(["real.zarr"], train_fraction=0.4)
found.scores.mean["forecast"], found.scores.mean["persistence"]
"""

from twin.hindcast.hindcast import DeploymentHindcast, Hindcast, hindcast
from twin.hindcast.legs import LoggedLeg, legs_of
from twin.hindcast.scores import METHODS, Scores, scores_of
from twin.hindcast.walk import Surfacing, walk

__all__ = [
    "METHODS",
    "DeploymentHindcast",
    "Hindcast",
    "LoggedLeg",
    "Scores",
    "Surfacing",
    "hindcast",
    "legs_of",
    "scores_of",
    "walk",
]
