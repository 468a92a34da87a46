"""Report: one self-contained page per run, its figures as PNG, and the model card."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from learn.report.result_tables import comparison_rows as comparison_rows
    from learn.report.result_tables import dive_rows as dive_rows
    from learn.report.result_tables import judged_missions as judged_missions
    from learn.report.result_tables import summary_rows as summary_rows
    from learn.report.result_tables import tell_report as tell_report
    from learn.report.result_tables import verdicts as verdicts

__getattr__, __dir__ = attach(__name__, places(__name__))
