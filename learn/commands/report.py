"""`learn report`: judge the networks of a run, and write its page, card and list of checksums."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from learn import newest_run, open_run
from twin.cli.console import Console, JsonOption
from twin.cli.program import EXIT_OK


@dataclass(frozen=True, kw_only=True)
class Report(JsonOption):
    """Judge the networks of a trained run on its store, and write its page, as `learn fit` does.

    Example:

        learn report demo
    """

    run_folder: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")] = None
    """folder or name of the run [default: the newest in runs/]"""

    def run(self, console: Console) -> int:
        """Judge and report."""
        from learn.finishing import finish
        from learn.report import tell_report

        run = newest_run() if self.run_folder is None else open_run(self.run_folder)
        tell_report(
            console, finish(run, history=shlex.join(["learn", *sys.argv[1:]]), say=console.note)
        )
        return EXIT_OK
