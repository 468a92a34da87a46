"""Slurm's sbatch as the tests of docs/howto/cluster.md need it: tasks run here, in turn.

In the environment: SLURM_STATE, a folder; SLURM_LOST, indices of tasks whose node fails the first
time. A job that nobody waits for (not --parsable, a script) runs in the background, as workers do.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from pathlib import Path


def indices(text: str) -> list[int]:
    found: list[int] = []
    for part in text.partition("%")[0].split(","):
        first, _, last = part.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


parser = argparse.ArgumentParser()
parser.add_argument("--parsable", action="store_true")
parser.add_argument("--array", type=indices)
parser.add_argument("--dependency")
parser.add_argument("--cpus-per-task")
parser.add_argument("--mem")
parser.add_argument("--wrap")
parser.add_argument("script", nargs="?")
job = parser.parse_args()

state = Path(os.environ["SLURM_STATE"])
state.mkdir(exist_ok=True)
number = 1 + len(list(state.glob("*.codes")))
print(number if job.parsable else f"Submitted batch job {number}")
command = ["bash", job.script] if job.script else ["sh", "-c", job.wrap]
codes = state / f"{number}.codes"
codes.touch()
if not job.parsable and job.script:
    script = state / f"{number}.sh"  # who submits it may remove it
    script.write_text(Path(job.script).read_text())
    with (state / f"{number}.out").open("w") as said:
        worker = subprocess.Popen(
            ["bash", script], stdout=said, stderr=said, start_new_session=True
        )
    (state / f"{number}.pid").write_text(str(worker.pid))
    raise SystemExit
if job.dependency:
    kind, _, before = job.dependency.partition(":")
    assert kind == "afterok", kind
    if set((state / f"{before}.codes").read_text().split()) != {"0"}:
        raise SystemExit
for index in job.array or [None]:
    task = {}
    if index is not None:
        task = {
            "SLURM_ARRAY_TASK_ID": str(index),
            "SLURM_ARRAY_TASK_COUNT": str(len(job.array)),
            "SLURM_ARRAY_TASK_MIN": str(min(job.array)),
        }
        lost = state / f"lost-{index}"
        if index in indices(os.environ.get("SLURM_LOST") or "0-0") and not lost.exists():
            lost.touch()
            codes.open("a").write("137\n")
            continue
    with (state / f"{number}_{index}.out").open("w") as said:
        done = subprocess.run(command, env={**os.environ, **task}, stdout=said, stderr=said)
    codes.open("a").write(f"{done.returncode}\n")
