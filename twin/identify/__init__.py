"""Identification: a real vehicle's parameters from its logs, and its speed by these parameters.

logs = load_logs("real.zarr")
found = identify(logs, load_calibration("graver-2005"))
speed = estimate(logs[0], found.calibration).speed

`check_logs` flies a vehicle file in closed loop on the targets of the real vehicle.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.identify.answer import Identification as Identification
    from twin.identify.answer import IdentifiedParameter as IdentifiedParameter
    from twin.identify.answer import confused as confused
    from twin.identify.answer import provenance_of as provenance_of
    from twin.identify.calibration import Calibration as Calibration
    from twin.identify.calibration import driven as driven
    from twin.identify.calibration import load_calibration as load_calibration
    from twin.identify.comparison import ResidualNoise as ResidualNoise
    from twin.identify.conventions import read_figures as read_figures
    from twin.identify.conventions import write_figures as write_figures
    from twin.identify.driven_fit import UNSURE as UNSURE
    from twin.identify.driven_fit import DrivenErrors as DrivenErrors
    from twin.identify.driven_fit import cruise_of as cruise_of
    from twin.identify.driven_fit import identify_driven as identify_driven
    from twin.identify.driven_fit import judge as judge
    from twin.identify.driven_runs import DrivenRun as DrivenRun
    from twin.identify.driven_runs import load_runs as load_runs
    from twin.identify.fit import ALWAYS as ALWAYS
    from twin.identify.fit import centred as centred
    from twin.identify.fit import identify as identify
    from twin.identify.handling import Handling as Handling
    from twin.identify.handling import handle as handle
    from twin.identify.log_check import LogCheck as LogCheck
    from twin.identify.log_check import PhaseComparison as PhaseComparison
    from twin.identify.log_check import check_logs as check_logs
    from twin.identify.log_figures import Oscillation as Oscillation
    from twin.identify.log_figures import PhaseFigures as PhaseFigures
    from twin.identify.logged_missions import Log as Log
    from twin.identify.logged_missions import gliding as gliding
    from twin.identify.logged_missions import load_logs as load_logs
    from twin.identify.logged_missions import log_of as log_of
    from twin.identify.logged_missions import other_kind as other_kind
    from twin.identify.logged_missions import start_vehicle as start_vehicle
    from twin.identify.proof import driven_failures as driven_failures
    from twin.identify.residuals import FIRST_DEVIATION as FIRST_DEVIATION
    from twin.identify.residuals import DepthRates as DepthRates
    from twin.identify.residuals import DiveResiduals as DiveResiduals
    from twin.identify.residuals import dive_residuals as dive_residuals
    from twin.identify.residuals import noise_of_dives as noise_of_dives
    from twin.identify.rollout import Refinement as Refinement
    from twin.identify.rollout import refine as refine
    from twin.identify.speed import SpeedEstimate as SpeedEstimate
    from twin.identify.speed import density_of as density_of
    from twin.identify.speed import estimate as estimate
    from twin.identify.speed import estimate_speed as estimate_speed
    from twin.identify.speed import horizontal as horizontal
    from twin.identify.speed import motion_of as motion_of
    from twin.identify.translation import AttitudeFlight as AttitudeFlight
    from twin.identify.translation import Translation as Translation
    from twin.identify.translation import fly as fly
    from twin.identify.unknowns import NAMES as NAMES
    from twin.identify.unknowns import SPEED as SPEED
    from twin.identify.unknowns import UnknownParameter as UnknownParameter
    from twin.identify.unknowns import choose as choose
    from twin.identify.unknowns import draw_vehicles as draw_vehicles
    from twin.identify.unknowns import identified as identified
    from twin.identify.unknowns import known_compass as known_compass
    from twin.identify.unknowns import normal_draws as normal_draws
    from twin.identify.unknowns import with_known as with_known
    from twin.identify.vehicle_file import with_consumption as with_consumption
    from twin.identify.vehicle_file import write_consumption as write_consumption
    from twin.identify.vehicle_file import write_vehicle as write_vehicle
    from twin.vehicle.steady_motion import balance as balance

__getattr__, __dir__ = attach(__name__, places(__name__))
