"""Forecast: where and when a glider surfaces next, how surely, and what it costs."""

from twin.forecast.known import Known, known_from_logs, known_without_logs
from twin.forecast.request import Request, mission_to
from twin.forecast.surfacing import Surfacing
from twin.forecast.surfacing_forecast import Forecast, forecast
from twin.navigation.dead_reckoning import Ellipse

__all__ = [
    "Ellipse",
    "Forecast",
    "Known",
    "Request",
    "Surfacing",
    "forecast",
    "known_from_logs",
    "known_without_logs",
    "mission_to",
]
