"""Checks: the twin against the Fossen model, published figures, and its own cost.

Logs: a vehicle file flown beside the logs of the real vehicle, in closed loop on its targets.
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
