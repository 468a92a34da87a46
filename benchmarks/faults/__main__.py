"""Faults: every file operation of every writer fails once.

    python -m benchmarks.faults [WRITER ...] [--every 1] [--faults KILL ...]
    python -m benchmarks.faults [WRITER ...] --journals FOLDER [--minutes 30]

Each operation on files (create, write, sync, rename, mkdir, unlink, chmod, truncate) meets an I/O
error, a disk that is full from then on, a kill, and a power loss that empties what was not synced.
Printed is, for each writer, how many faults there are, how many were injected, after how many the
old content or the new one was there whole and the next run wrote the new one, and what was lost.
With journals a campaign that was stopped goes on where it was; its order is random, so that what it
has done is a sample.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.faults.campaign import Campaign
from benchmarks.faults.injector import FAULTS, run_injected
from benchmarks.faults.writers import WRITERS
from twin.cli.text_table import format_table

MEMORY = Path("/dev/shm")
"""Where faults are injected if it is there: nothing then waits for a disk."""


def inject(campaign: Campaign) -> dict[str, Any]:
    """What one writer went through, see `benchmarks.faults.campaign.Outcome`."""
    return inject_all([campaign])[0]


def inject_all(campaigns: Sequence[Campaign]) -> list[dict[str, Any]]:
    """What each writer went through, one after the other in one process, which imports once."""
    place = MEMORY if MEMORY.is_dir() else None
    with tempfile.TemporaryDirectory(dir=place) as folder, tempfile.TemporaryDirectory() as made:
        asked = json.dumps([dataclasses.asdict(campaign) for campaign in campaigns])
        ended = run_injected(
            *("-m", "benchmarks.faults.campaign", asked, f"{folder}/work"), folder=Path(made)
        )
    outcomes = [json.loads(line) for line in ended.stdout.splitlines() if line.startswith("{")]
    if ended.returncode:
        writer = campaigns[len(outcomes)].writer
        raise RuntimeError(f"the campaign of {writer} failed:\n{ended.stderr}")
    return [{**found, "trace": ended.stderr} for found in outcomes]


def main() -> int:
    """Print the table; exit code 1 when something was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("writers", nargs="*", choices=[*WRITERS, []], metavar="WRITER")
    parser.add_argument("--every", type=int, default=1, help="take every n-th operation")
    parser.add_argument("--faults", nargs="+", choices=[f.name for f in FAULTS], default=None)
    parser.add_argument("--journals", type=Path, help="folder of what was done, to go on from")
    parser.add_argument("--minutes", type=float, help="time for each writer")
    options = parser.parse_args()
    rows, lost = [], []
    if options.journals:
        options.journals.mkdir(parents=True, exist_ok=True)
    for name in options.writers or WRITERS:
        begun = time.perf_counter()
        campaign = Campaign(
            writer=name,
            every=options.every,
            faults=tuple(options.faults or [fault.name for fault in FAULTS]),
            journal=str(options.journals / f"{name}.jsonl") if options.journals else None,
            seconds=options.minutes and 60.0 * options.minutes,
        )
        found = inject(campaign)
        lost += [f"{name}: {text}" for text in found["lost"]]
        rows.append(
            {
                "writer": name,
                "operations": found["operations"],
                "faults": found["planned"],
                "injected": found["injected"],
                "survived": found["survived"],
                "lost": len(found["lost"]),
                "seconds": time.perf_counter() - begun,
            }
        )
        print(format_table(rows[-1:]), flush=True)
    print(format_table(rows))
    print("\n".join(lost))
    return 1 if lost else 0


if __name__ == "__main__":
    raise SystemExit(main())
