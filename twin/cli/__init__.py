"""The command line: programs, options, text and JSON answers."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.cli.console import Console as Console
    from twin.cli.console import JsonOption as JsonOption
    from twin.cli.durations import Seconds as Seconds
    from twin.cli.endings import Ended as Ended
    from twin.cli.text_table import counted as counted
    from twin.extras import require as require

__getattr__, __dir__ = attach(__name__, places(__name__))
