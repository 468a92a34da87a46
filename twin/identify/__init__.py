"""Identification: the parameters of a real vehicle from its own logs, and its speed from them.

logs = load_logs("real.zarr")
found = identify(logs, load_calibration("graver-2005"))
speed = estimate(logs[0], found.calibration).speed
"""

from twin.identify.answer import Identification, IdentifiedParameter
from twin.identify.calibration import Calibration, load_calibration
from twin.identify.dive_residuals import DiveResiduals, dive_residuals, noise_of_dives
from twin.identify.fit import identify
from twin.identify.logged import Log, load_logs
from twin.identify.speed import SpeedEstimate, density_of, estimate, estimate_speed, motion_of
from twin.identify.translation import Translation, fly

__all__ = [
    "Calibration",
    "DiveResiduals",
    "Identification",
    "IdentifiedParameter",
    "Log",
    "SpeedEstimate",
    "Translation",
    "density_of",
    "dive_residuals",
    "estimate",
    "estimate_speed",
    "fly",
    "identify",
    "load_calibration",
    "load_logs",
    "motion_of",
    "noise_of_dives",
]
