"""Forecast: where and when a glider surfaces next, how surely, and what it costs.

Hindcast: a deployment walked through, each surfacing forecast from what was known before it.

found = hindcast(["real.zarr"])
found.surfacing.mean["forecast"], found.surfacing.mean["persistence"]
"""

from twin.forecast.deployment_hindcast import DeploymentHindcast, Hindcast, hindcast
from twin.forecast.known import Known, known_from_logs, known_without_logs
from twin.forecast.request import Request, mission_to
from twin.forecast.scores import METHODS, Scores, scores_of
from twin.forecast.surfacing import Surfacing
from twin.forecast.surfacing_forecast import Forecast, forecast
from twin.forecast.walk import HindcastSurfacing, Judged, Priors, walk
from twin.logs.logged_leg import LoggedLeg, legs_of
from twin.navigation.dead_reckoning import Ellipse

__all__ = [
    "METHODS",
    "DeploymentHindcast",
    "Ellipse",
    "Forecast",
    "Hindcast",
    "HindcastSurfacing",
    "Judged",
    "Known",
    "LoggedLeg",
    "Priors",
    "Request",
    "Scores",
    "Surfacing",
    "forecast",
    "hindcast",
    "known_from_logs",
    "known_without_logs",
    "legs_of",
    "mission_to",
    "scores_of",
    "walk",
]
