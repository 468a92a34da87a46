"""Forecast: where and when a glider surfaces next, how surely, and what it costs.

Hindcast: a deployment walked through, each surfacing forecast from what was known before it.

found = hindcast(["real.zarr"])
found.surfacing.mean["forecast"], found.surfacing.mean["persistence"]
"""

from glider_twin_ops.forecast.hindcast import DeploymentHindcast as DeploymentHindcast
from glider_twin_ops.forecast.hindcast import Hindcast as Hindcast
from glider_twin_ops.forecast.hindcast import hindcast as hindcast
from glider_twin_ops.forecast.logged_leg import LoggedLeg as LoggedLeg
from glider_twin_ops.forecast.logged_leg import legs_of as legs_of
from glider_twin_ops.forecast.member_flights import MemberFlight as MemberFlight
from glider_twin_ops.forecast.member_flights import Surfacing as Surfacing
from glider_twin_ops.forecast.member_flights import fly_nominal as fly_nominal
from glider_twin_ops.forecast.request import Known as Known
from glider_twin_ops.forecast.request import Request as Request
from glider_twin_ops.forecast.request import begun as begun
from glider_twin_ops.forecast.request import known_from_logs as known_from_logs
from glider_twin_ops.forecast.request import known_without_logs as known_without_logs
from glider_twin_ops.forecast.request import mission_to as mission_to
from glider_twin_ops.forecast.routes import Route as Route
from glider_twin_ops.forecast.routes import RoutePlan as RoutePlan
from glider_twin_ops.forecast.routes import plan_routes as plan_routes
from glider_twin_ops.forecast.surfacing_forecast import Forecast as Forecast
from glider_twin_ops.forecast.surfacing_forecast import NoticeBox as NoticeBox
from glider_twin_ops.forecast.surfacing_forecast import forecast as forecast
from glider_twin_ops.forecast.surfacing_forecast import notice_boxes as notice_boxes
from glider_twin_ops.forecast.walk import HindcastSurfacing as HindcastSurfacing
from glider_twin_ops.forecast.walk import Judged as Judged
from glider_twin_ops.forecast.walk import Priors as Priors
from glider_twin_ops.forecast.walk import Scores as Scores
from glider_twin_ops.forecast.walk import scores_of as scores_of
from glider_twin_ops.forecast.walk import walk as walk
