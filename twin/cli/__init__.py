"""Command line: programs, options, text and JSON answers."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.cli.console import Console as Console
    from twin.cli.console import JsonOption as JsonOption
    from twin.cli.console import one_line as one_line
    from twin.cli.options import Hours as Hours
    from twin.cli.options import Seconds as Seconds
    from twin.cli.program import Ended as Ended
    from twin.cli.program import describe_error as describe_error
    from twin.cli.program import interruption as interruption
    from twin.cli.text_table import counted as counted
    from twin.cli.text_table import format_number as format_number
    from twin.cli.text_table import format_table as format_table
    from twin.cli.text_table import printable as printable
    from twin.extras import require as require

__getattr__, __dir__ = attach(__name__, places(__name__))
