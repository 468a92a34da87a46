"""Watch passes: from the arrival of a dive's file to the page, early and late in a deployment.

    python -m benchmarks.watch_passes --dives 5 300
    python -m benchmarks.watch_passes --dives --kills 100 --orders 50

A Seaglider of the tests flies saw-tooth dives to 950 m, three hours each, and its base station's
files but the last lie in the source. A first pass takes them in; then the last file arrives, and a
pass of its own process is timed, with its peak of memory. `replay` makes everything again from the
files, and says whether log, beliefs and events have the same bytes.

`--kills` ends passes over four shallow dives at random moments and lets the next one go on;
`--orders` lets the files arrive in random orders, with copies, halves and files of wrong content
before the right ones, and passes in between. Each must end in the bytes that one pass over all
files makes, with nothing beside them.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

DEPTH = 950.0
"""[m] of the dives"""
HARMED = 4
"""Dives of the deployments that are killed or shuffled"""
FORECAST = "page/forecast.geojson"
ODD = 0.3
"""Probability of a half, of a file of wrong content and of a copy, of each file that arrives"""


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


def kills(times: int, seed: int, place: Path) -> dict[str, object]:
    """Kill passes at random moments, and let the next one go on."""
    from benchmarks.kills.processes import DONE, fork, send, wait
    from factory.watching.watch_pass import PARTS

    names = (*PARTS, FORECAST, "what lies beside them")
    draw = random.Random(seed)
    files = _files(place)
    every = _deployment(place / "undisturbed", files)
    begin = time.perf_counter()
    assert wait(fork(lambda: _pass(every))) == DONE
    seconds = time.perf_counter() - begin
    wanted, ended = _bytes(every), 0
    lost: list[str] = []
    before = [_deployment(place / f"before{known}", files[:known]) for known in range(len(files))]
    for made in before[1:]:
        assert wait(fork(lambda made=made: _pass(made))) == DONE  # type: ignore[misc]
    for number in range(times):
        known = draw.randrange(len(files))
        made = place / f"{number}" / before[known].name
        shutil.copytree(before[known].parent, made.parent)
        for path in files[known:]:
            shutil.copy(path, made.parent / "arrived")
        process = fork(lambda made=made: _pass(made))  # type: ignore[misc]
        time.sleep(draw.uniform(0.0, seconds))
        send(process, signal.SIGKILL)
        ended += wait(process) == DONE
        code = wait(fork(lambda made=made: _pass(made)))  # type: ignore[misc]
        if code != DONE:
            lost.append(f"{number}: the next pass ended with {code}")
        elif (found := _bytes(made)) != wanted:
            pairs = zip(names, json.loads(found), json.loads(wanted), strict=True)
            other = [name for name, one, right in pairs if one != right]
            lost.append(f"{number}: {other or found}")
        shutil.rmtree(made.parent)
    same = times - len(lost)
    return {"kills": times, "same bytes": same, "had ended before": ended, "others": lost}


def orders(times: int, seed: int, place: Path) -> dict[str, object]:
    """Let files arrive in random orders, some twice, by halves, or with wrong content first."""
    from benchmarks.kills.processes import DONE, fork, wait

    files = _files(place)
    every = _deployment(place / "at-once", files)
    assert wait(fork(lambda: _pass(every))) == DONE
    wanted = _bytes(every)
    hashes: dict[str, int] = {}
    halves = wrong = copies = passes = 0
    for number in range(times):
        draw = random.Random(f"{seed} {number}")
        made = _deployment(place / f"{number}", [])
        source = made.parent / "arrived"
        for path in draw.sample(files, len(files)):
            content = path.read_bytes()
            for odd, what in ((draw.random() < ODD, "half"), (draw.random() < ODD, "wrong")):
                if not odd:
                    continue
                other = draw.choice(files).read_bytes()
                cut = draw.randrange(len(content))
                said = content[:cut] if what == "half" else other[: len(other) - 64]
                (source / path.name).write_bytes(said)
                halves, wrong = halves + (what == "half"), wrong + (what == "wrong")
                passes += _between(made)
            if draw.random() < ODD:
                copies += 1
                shutil.copy(path, source / f"copy of {path.name}")
            shutil.copy(path, source)
            if draw.random() < ODD:
                passes += _between(made)
        assert wait(fork(lambda made=made: _pass(made))) == DONE  # type: ignore[misc]
        found = _bytes(made)
        hashes[found] = hashes.get(found, 0) + 1
        shutil.rmtree(made.parent)
    return {
        "orders": times, "hashes": len(hashes), "as all at once": hashes.get(wanted, 0),
        "halves": halves, "wrong": wrong, "copies": copies, "passes between": passes,
    }  # fmt: skip


def _files(place: Path) -> list[Path]:
    import matplotlib.backends.backend_agg  # noqa: F401 - what forked passes need is loaded once
    import netCDF4  # noqa: F401
    import xarray  # noqa: F401
    from logs import Flight, write_basestation

    import factory.watching.watch_pass  # noqa: F401
    import twin.physics.lanes  # noqa: F401

    later = place / "later"
    later.mkdir(parents=True)
    return list(write_basestation(later, Flight(dives=HARMED)))


def _deployment(place: Path, files: list[Path]) -> Path:
    from factory.watching import WatchedDeployment

    source = place / "arrived"
    source.mkdir(parents=True)
    for path in files:
        shutil.copy(path, source)
    made = WatchedDeployment(
        folder=place / "calypso", source="../arrived", vehicle="seaglider", members=10, hours=2.0
    )
    made.write()
    return made.folder


def _pass(folder: Path) -> None:
    from factory.watching import WatchedDeployment, one_pass

    one_pass(WatchedDeployment.read(folder))


def _between(folder: Path) -> bool:
    """The part of a pass that files in any order could harm."""
    from benchmarks.kills.processes import DONE, fork, wait
    from factory.watching import WatchedDeployment
    from factory.watching.log_of_files import log_of_files

    made = WatchedDeployment.read(folder)
    return wait(fork(lambda: log_of_files(made, folder))) == DONE


def _bytes(folder: Path) -> str:
    """Of log, beliefs, events and the page's figures; what lies beside them, too."""
    from factory.watching.watch_pass import PARTS, _content

    beside = sorted(path.name for path in folder.iterdir() if "writing" in path.name)
    parts = [_content(folder / name) for name in (*PARTS, FORECAST)]
    return json.dumps([*parts, beside])


def main() -> None:
    """Print a line for each number of dives, for the kills and for the orders."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dives", type=int, nargs="*", default=[5, 300])
    parser.add_argument("--kills", type=int, default=0, help="of passes")
    parser.add_argument("--orders", type=int, default=0, help="of arrival")
    parser.add_argument("--seed", type=int, default=0, help="of kills and orders")
    options = parser.parse_args()
    for dives in options.dives:
        with tempfile.TemporaryDirectory() as place:
            print(json.dumps(measure(dives, Path(place))), flush=True)
    for harm, times in ((kills, options.kills), (orders, options.orders)):
        with tempfile.TemporaryDirectory() as place:
            if times:
                print(json.dumps(harm(times, options.seed, Path(place))), flush=True)


if __name__ == "__main__":
    main()
