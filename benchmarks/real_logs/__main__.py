"""Real logs: the twin and the networks compared with public methods, on real logs with truth.

    python -m benchmarks.real_logs FOLDER [--json] [--no-networks] [--only SECTION ...]

from the root of the repository. FOLDER holds folders slocum_..., seaglider_..., seaexplorer_...,
auv_... with logs (`benchmarks.real_logs.source`); all that are there are scored. No method is tuned
on the dives that it is scored on, except on their depth rate if speed is scored.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import asdict
from math import isfinite
from pathlib import Path

from benchmarks import command
from twin.errors import InputError, unknown_name

os.environ.setdefault("OMP_NUM_THREADS", "1")

from benchmarks.real_logs import run
from benchmarks.real_logs.row import keep as write
from benchmarks.real_logs.row import kept, table


def main(
    folder: command.Positional[Path],
    *,
    workers: int = len(os.sched_getaffinity(0)),
    keep: Path | None = None,
    only: tuple[str, ...] = tuple(run.SECTIONS),
    seed: int = 0,
    no_networks: bool = False,
    work: Path | None = None,
    json: bool = False,
) -> None:
    """Import, identify, train, score and print.

    Args:
      workers: number of processes.
      keep: JSON file for the rows, from which the tables of docs/results/real_logs.md are made.
      only: run these sections only; the other rows of --keep stay.
      seed: seed of the simulated missions and of the networks.
      no_networks: leave out the networks and the simulation that they are trained on.
      work: folder that keeps the folds of the propelled section, which a later call reads.
    """
    for name in only:
        if name not in run.SECTIONS:
            raise InputError(unknown_name("section of --only", name, tuple(run.SECTIONS)))
    begin = time.monotonic()
    rows = run.run_benchmark(
        folder, workers=workers, networks=not no_networks, seed=seed, only=only,
        place=work,
        say=lambda text: print(text, file=sys.stderr, flush=True),
    )  # fmt: skip
    seconds = time.monotonic() - begin
    tables = [(row.task, row.unit) for row in rows]
    shown = [[r for r in rows if (r.task, r.unit) == one] for one in dict.fromkeys(tables)]
    plain = [
        {k: None if isinstance(v, float) and not isfinite(v) else v for k, v in asdict(r).items()}
        for r in rows
    ]
    answer = {"folder": str(folder), "rows": plain, "seconds": seconds}
    lines = [[{"task": one[0].task, **line} for line in table(one)] for one in shown]
    command.say(answer, *lines, json=json, digits=3)
    if keep is not None:
        measured = {task for name in only for task in run.SECTIONS[name]}
        measured |= {row.task for row in rows}  # skipped folders, where they were read
        others = kept(keep) if only != tuple(run.SECTIONS) and keep.exists() else []
        stay = [row for row in others if row.task not in measured]
        write(sorted([*rows, *stay], key=lambda row: run.TASKS.index(row.task)), keep)


if __name__ == "__main__":
    sys.exit(command.run(main))
