"""Kills: processes of `factory generate` ended, frozen, doubled; stores of other versions read.

    python -m benchmarks.kills [KIND ...] [--kills 100] [--seed 0]

Each kind does its harm at random moments, so often: kills the parent, a worker or a worker of a
dask cluster; freezes workers, a run or a part of a job array and thaws them later; starts two runs
at once; lets the date jump. Then the run is resumed. The store must have, byte for byte, the tree
that an undisturbed process makes, and nothing may lie beside it. Printed are the counts.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.faults.__main__ import MEMORY
from benchmarks.kills.cluster import dask_cluster
from benchmarks.kills.kinds import KINDS, Ground
from benchmarks.kills.versions import check_versions
from twin.cli.text_table import format_table

VERSIONS = "versions"
CLUSTER = "dask-worker"


def harm(ground: Ground, kind: str, times: int) -> dict[str, Any]:
    """Do one kind of harm so often; a row of the table, with what was lost."""
    begun, lost = time.perf_counter(), []
    with contextlib.ExitStack() as stack:
        if kind == CLUSTER:
            ground.dask = stack.enter_context(dask_cluster(2))
        for number in range(times):
            with tempfile.TemporaryDirectory(dir=ground.folder) as folder:
                problem = KINDS[kind](ground, Path(folder) / "missions.zarr")
            if problem is not None:
                lost.append(f"{kind} {number}: {problem}")
    return {
        "kind": kind,
        "done": times,
        "survived": times - len(lost),
        "lost": lost,
        "seconds": time.perf_counter() - begun,
    }


def main() -> int:
    """Print the table; exit code 1 when something was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", choices=[*KINDS, VERSIONS, []], metavar="KIND")
    parser.add_argument("--kills", type=int, default=100, help="of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    options = parser.parse_args()
    rows, lost = [], []
    place = MEMORY if MEMORY.is_dir() else None
    with tempfile.TemporaryDirectory(dir=place) as folder:
        ground = Ground.prepare(Path(folder), options.seed)
        for kind in options.kinds or [*KINDS, VERSIONS]:
            if kind == VERSIONS:
                row = check_versions(Path(folder))
            else:
                row = harm(ground, kind, options.kills)
            lost += row["lost"]
            rows.append({**row, "lost": len(row["lost"])})
            print(format_table(rows[-1:]), flush=True)
    print(format_table(rows))
    print("\n".join(lost))
    return 1 if lost else 0


if __name__ == "__main__":
    raise SystemExit(main())
