"""Forecast: where and when a glider surfaces next, how surely, and what it costs.

Hindcast: a deployment walked through, each surfacing forecast from what was known before it.

found = hindcast(["real.zarr"])
found.surfacing.mean["forecast"], found.surfacing.mean["persistence"]
"""

from glider_twin_ops.forecast.deployment_hindcast import METHODS as METHODS
from glider_twin_ops.forecast.deployment_hindcast import DeploymentHindcast as DeploymentHindcast
from glider_twin_ops.forecast.deployment_hindcast import Hindcast as Hindcast
from glider_twin_ops.forecast.deployment_hindcast import Scores as Scores
from glider_twin_ops.forecast.deployment_hindcast import hindcast as hindcast
from glider_twin_ops.forecast.deployment_hindcast import scores_of as scores_of
from glider_twin_ops.forecast.known import Known as Known
from glider_twin_ops.forecast.known import aim_of as aim_of
from glider_twin_ops.forecast.known import begun as begun
from glider_twin_ops.forecast.known import known_from_logs as known_from_logs
from glider_twin_ops.forecast.known import known_without_logs as known_without_logs
from glider_twin_ops.forecast.logged_leg import LoggedLeg as LoggedLeg
from glider_twin_ops.forecast.logged_leg import legs_of as legs_of
from glider_twin_ops.forecast.logged_leg import place_at as place_at
from glider_twin_ops.forecast.members import MemberFlight as MemberFlight
from glider_twin_ops.forecast.members import fly_nominal as fly_nominal
from glider_twin_ops.forecast.request import FIELD_ERROR as FIELD_ERROR
from glider_twin_ops.forecast.request import Request as Request
from glider_twin_ops.forecast.request import check_hours as check_hours
from glider_twin_ops.forecast.request import check_members as check_members
from glider_twin_ops.forecast.request import mission_to as mission_to
from glider_twin_ops.forecast.routes import Route as Route
from glider_twin_ops.forecast.routes import RoutePlan as RoutePlan
from glider_twin_ops.forecast.routes import plan_routes as plan_routes
from glider_twin_ops.forecast.surfacing import NINETY as NINETY
from glider_twin_ops.forecast.surfacing import Surfacing as Surfacing
from glider_twin_ops.forecast.surfacing_forecast import Forecast as Forecast
from glider_twin_ops.forecast.surfacing_forecast import NoticeBox as NoticeBox
from glider_twin_ops.forecast.surfacing_forecast import boxes_text as boxes_text
from glider_twin_ops.forecast.surfacing_forecast import forecast as forecast
from glider_twin_ops.forecast.surfacing_forecast import notice_boxes as notice_boxes
from glider_twin_ops.forecast.walk import HindcastSurfacing as HindcastSurfacing
from glider_twin_ops.forecast.walk import Judged as Judged
from glider_twin_ops.forecast.walk import Priors as Priors
from glider_twin_ops.forecast.walk import walk as walk
from twin.navigation import Ellipse as Ellipse
