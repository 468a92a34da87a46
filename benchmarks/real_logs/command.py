"""The command: public methods, the twin and networks on real logs with truth."""

from __future__ import annotations

import os
import shlex
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.program import EXIT_OK


@dataclass(frozen=True, kw_only=True)
class RealLogs(JsonOption):
    """Judge the twin and the networks on real logs with truth, public methods on the same samples.

    Nothing is tuned on the dives that it is scored on, except to depth rate where speed is scored.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """holds folders slocum_..., seaglider_..., seaexplorer_... with logs; those there are judged"""
    workers: int | None = None
    """processes [default: the CPUs that this process may use]"""
    out: Path | None = None
    """folder for a page with the tables and charts beside published figures"""
    keep: Path | None = None
    """file for the rows as JSON, from which the tables of docs/results/real_logs.md are made"""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="SECTION...")] = ()
    """judge these sections alone, of speed, surge, left-out and fixes; the other rows of --keep
    stay [default: all]"""
    seed: int = 0
    """of the simulated missions and of the networks"""
    no_networks: bool = False
    """leave the networks out, and with them the simulation that they are trained on"""

    def run(self, console: Console) -> int:
        """Import, identify, train, judge, print."""
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        from benchmarks.real_logs.row import table
        from benchmarks.real_logs.run import SECTIONS, TASKS, run_benchmark
        from learn.files import check_folder
        from twin.errors import InputError, unknown_name

        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers must be at least 1, not {self.workers}")
        for name in self.only:
            if name not in SECTIONS:
                raise InputError(unknown_name("section of --only", name, tuple(SECTIONS)))
        if self.out is not None:
            check_folder(self.out, "--out")
        begin = time.monotonic()
        with console.progress(total=100.0, label="benchmark", unit="%") as progress:
            rows = run_benchmark(
                self.folder,
                workers=self.workers or len(os.sched_getaffinity(0)),
                networks=not self.no_networks,
                seed=self.seed,
                only=self.only or tuple(SECTIONS),
                say=progress.note,
                progress=lambda part: progress.update(100.0 * part),
            )
        seconds = time.monotonic() - begin
        for task in TASKS:
            for unit in dict.fromkeys(row.unit for row in rows if row.task == task):
                chosen = [row for row in rows if row.task == task and row.unit == unit]
                console.table(table(chosen), title=task, digits=3)
                console.say()
        console.say(f"{seconds:.0f} s")
        if self.keep is not None:
            from benchmarks.real_logs.page import keep, kept

            measured = {task for name in self.only or SECTIONS for task in SECTIONS[name]}
            others = kept(self.keep) if self.only and self.keep.exists() else []
            stay = [row for row in others if row.task not in {*measured, "skipped"}]
            keep(sorted([*rows, *stay], key=lambda row: TASKS.index(row.task)), self.keep)
            console.say(f"rows: {self.keep}")
        page = None
        if self.out is not None:
            from benchmarks.real_logs.page import build_page

            lead = f"the logs in {self.folder}"
            command = shlex.join(["python", "-m", "benchmarks.real_logs", *sys.argv[1:]])
            page = build_page(self.out, rows, TASKS, lead=lead, command=command)
            console.say(f"page: {page}")
        console.answer(folder=self.folder, rows=rows, seconds=seconds, page=page)
        return EXIT_OK
