"""Wall time of `--help`, interpreter start included, compared with the interpreter alone.

Usage: python -m benchmarks.cli_startup [RUNS]
"""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path
from statistics import median

from benchmarks import command
from benchmarks.figures import measured, seconds
from factory.__main__ import PROGRAM as FACTORY
from learn.__main__ import PROGRAM as LEARN
from twin.__main__ import PROGRAM as TWIN
from twin.cli.text_table import format_table

LIMIT_S = 0.3
"""[s] Longest acceptable time for a help text."""


def main(runs: command.Positional[int] = 10) -> int:
    """Print the table, with exit code 1 if a median exceeds the limit."""
    folder = Path(sys.executable).parent
    commands = {"python -c pass": [sys.executable, "-c", "pass"]}
    for program in (TWIN, FACTORY, LEARN):
        script = str(folder / program.name)
        commands[f"{program.name} --help"] = [script, "--help"]
        for one in program.commands:
            commands[f"{program.name} {one.name} --help"] = [script, one.name, "--help"]
    rows = []
    for name, words in commands.items():
        run = partial(subprocess.run, words, stdout=subprocess.DEVNULL, check=True)
        run()  # fills the file caches
        times = [seconds(run) for _ in range(runs)]
        rows.append({"command": name, "median s": median(times), "worst s": max(times)})
    print(format_table(rows, digits=3))
    python, *helps = (1e3 * float(row["median s"]) for row in rows)
    measured("cli_startup", interpreter=python, help=helps)
    slow = any(float(row["median s"]) > LIMIT_S for row in rows)
    print(f"limit {LIMIT_S} s: {'missed' if slow else 'kept'} (median of {runs} runs)")
    return int(slow)


if __name__ == "__main__":
    sys.exit(command.run(main))
