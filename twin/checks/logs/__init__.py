"""Logs: a vehicle file flown beside the logs of the real vehicle, in closed loop on its targets.

found = check_logs("real.zarr", "mine.xml")
found.phases["climb"].twin.depth_rate
"""

from twin.checks.logs.comparison import check_logs
from twin.checks.logs.figures import PhaseFigures
from twin.checks.logs.oscillation import Oscillation
from twin.checks.logs.result import LogCheck, PhaseComparison

__all__ = ["LogCheck", "Oscillation", "PhaseComparison", "PhaseFigures", "check_logs"]
