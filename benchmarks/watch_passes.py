"""Watch passes: from the arrival of a dive's file to the page, early and late in a deployment.

    python -m benchmarks.watch_passes --dives 5 300

A Seaglider of the tests flies saw-tooth dives to 950 m, three hours each, and its base station's
files but the last lie in the source. A first pass takes them in; then the last file arrives, and a
pass of its own process is timed, with its peak of memory. `replay` makes everything again from the
files, and says whether log, beliefs and events have the same bytes.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

DEPTH = 950.0
"""[m] of the dives"""


def passed(folder: Path, *words: str) -> tuple[float, float, float, dict[str, object]]:
    """Seconds, seconds of processors, peak memory [MB] and answer of a pass in its own process."""
    command = [sys.executable, "-m", "twin", "watch", str(folder), *words, "--json"]
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT, env=os.environ)
    assert process.stdout is not None
    said = process.stdout.read()
    _, code, used = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - begin
    if code:
        raise SystemExit(f"{' '.join(command)} ended with {os.waitstatus_to_exitcode(code)}")
    return seconds, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0, json.loads(said)


def measure(dives: int, place: Path) -> dict[str, object]:
    """Of a deployment of so many dives."""
    from logs import Flight, write_basestation  # type: ignore[import-not-found]

    from factory.watching import WatchedDeployment

    source, later = place / "arrived", place / "later"
    source.mkdir()
    later.mkdir()
    files = write_basestation(later, Flight(dives=dives, depth=DEPTH, step=5.0))
    for path in files[:-1]:
        shutil.move(path, source)
    made = WatchedDeployment(folder=place / "calypso", source=str(source), vehicle="seaglider")
    made.write()
    first, _, _, _ = passed(made.folder, "--once")
    shutil.move(files[-1], source)
    seconds, cpu, memory, answer = passed(made.folder, "--once")
    assert answer["changed"], answer
    replay, _, _, again = passed(made.folder, "--replay")
    return {
        "dives": dives,
        "first pass [s]": round(first, 1),
        "arrival to page [s]": round(seconds, 1),
        "of it on processors [s]": round(cpu, 1),
        "memory [MB]": round(memory),
        "replay [s]": round(replay, 1),
        "same bytes": all(dict(again["same"]).values()),  # type: ignore[call-overload]
    }


def main() -> None:
    """Print a line for each number of dives."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dives", type=int, nargs="+", default=[5, 300])
    for dives in parser.parse_args().dives:
        with tempfile.TemporaryDirectory() as place:
            print(json.dumps(measure(dives, Path(place))), flush=True)


if __name__ == "__main__":
    main()
