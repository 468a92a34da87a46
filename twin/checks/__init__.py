"""Checks: the twin against the Fossen model, published figures and real logs, and its own cost.

Against logs a vehicle file is flown in closed loop on the targets of the real vehicle.
"""

from twin.checks.log_comparison import check_logs
from twin.checks.log_figures import PhaseFigures
from twin.checks.log_result import LogCheck, PhaseComparison
from twin.checks.log_turns import Oscillation

__all__ = [
    "LogCheck",
    "Oscillation",
    "PhaseComparison",
    "PhaseFigures",
    "check_logs",
]
