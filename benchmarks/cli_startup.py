"""Wall time of `--help`, interpreter start included, beside the interpreter alone.

Usage: python -m benchmarks.cli_startup [RUNS]
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.figures import measured
from factory.__main__ import PROGRAM as FACTORY
from learn.__main__ import PROGRAM as LEARN
from twin.__main__ import PROGRAM as TWIN
from twin.cli.text_table import format_table

LIMIT_S = 0.3
"""What a person may have to wait for a help text."""


def wall_times(command: list[str], runs: int) -> list[float]:
    """Seconds of each run of a command, output thrown away."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        times.append(time.perf_counter() - start)
    return times


def main(runs: int) -> int:
    """Print the table; 1 when a median is over the limit."""
    folder = Path(sys.executable).parent
    commands = {"python -c pass": [sys.executable, "-c", "pass"]}
    for program in (TWIN, FACTORY, LEARN):
        script = str(folder / program.name)
        commands[f"{program.name} --help"] = [script, "--help"]
        for command in program.commands:
            words = [script, command.name, "--help"]
            commands[f"{program.name} {command.name} --help"] = words
    rows = []
    slow = False
    for name, words in commands.items():
        subprocess.run(words, stdout=subprocess.DEVNULL, check=True)  # fills the caches
        times = wall_times(words, runs)
        median = statistics.median(times)
        slow |= median > LIMIT_S
        rows.append({"command": name, "median s": median, "worst s": max(times)})
    print(format_table(rows, digits=3))
    python, *helps = (1e3 * float(row["median s"]) for row in rows)
    measured("cli_startup", interpreter=python, help=helps)
    print(f"limit {LIMIT_S} s: {'missed' if slow else 'kept'} (median of {runs} runs)")
    return int(slow)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 10))
