"""Forecast: where and when a glider surfaces next, how surely, and what it costs.

Hindcast: a deployment walked through, each surfacing forecast from what was known before it.

found = hindcast(["real.zarr"])
found.surfacing.mean["forecast"], found.surfacing.mean["persistence"]
"""

from twin.forecast.deployment_hindcast import DeploymentHindcast as DeploymentHindcast
from twin.forecast.deployment_hindcast import Hindcast as Hindcast
from twin.forecast.deployment_hindcast import hindcast as hindcast
from twin.forecast.known import Known as Known
from twin.forecast.known import aim_of as aim_of
from twin.forecast.known import begun as begun
from twin.forecast.known import known_from_logs as known_from_logs
from twin.forecast.known import known_without_logs as known_without_logs
from twin.forecast.members import MemberFlight as MemberFlight
from twin.forecast.members import fly_nominal as fly_nominal
from twin.forecast.notice_box import NoticeBox as NoticeBox
from twin.forecast.notice_box import boxes_text as boxes_text
from twin.forecast.notice_box import notice_boxes as notice_boxes
from twin.forecast.request import FIELD_ERROR as FIELD_ERROR
from twin.forecast.request import Request as Request
from twin.forecast.request import check_hours as check_hours
from twin.forecast.request import check_members as check_members
from twin.forecast.request import mission_to as mission_to
from twin.forecast.routes import Route as Route
from twin.forecast.routes import RoutePlan as RoutePlan
from twin.forecast.routes import plan_routes as plan_routes
from twin.forecast.scores import METHODS as METHODS
from twin.forecast.scores import Scores as Scores
from twin.forecast.scores import scores_of as scores_of
from twin.forecast.surfacing import NINETY as NINETY
from twin.forecast.surfacing import Surfacing as Surfacing
from twin.forecast.surfacing_forecast import Forecast as Forecast
from twin.forecast.surfacing_forecast import forecast as forecast
from twin.forecast.walk import HindcastSurfacing as HindcastSurfacing
from twin.forecast.walk import Judged as Judged
from twin.forecast.walk import Priors as Priors
from twin.forecast.walk import walk as walk
from twin.logs.logged_leg import LoggedLeg as LoggedLeg
from twin.logs.logged_leg import legs_of as legs_of
from twin.navigation.dead_reckoning import Ellipse as Ellipse
