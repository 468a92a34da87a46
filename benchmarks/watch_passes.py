"""Watch passes: from the arrival of a dive's file to the page, early and late in a deployment.

    python -m benchmarks.watch_passes --dives 5 300
    python -m benchmarks.watch_passes --dives --kills 100 --orders 50
    python -m benchmarks.watch_passes --real ../shared/data/slocum_barnacle_2022/raw --orders 20

A Seaglider of the tests flies saw-tooth dives to 950 m, three hours each, and its base station's
files but the last lie in the source. A first pass takes them in; then the last file arrives, and a
pass of its own process is timed, with its peak of memory. `replay` makes everything again from the
files, and says whether log, beliefs and events have the same bytes.

`--kills` ends passes over four shallow dives at random moments and lets the next one go on;
`--orders` lets the files arrive in random orders, with copies, halves and files of wrong content
before the right ones, and passes in between. Each must end in the bytes that one pass over all
files makes, with nothing beside them.

`--real` names folders with a Slocum's files, and `--cache` one with their lists of sensors. Their
files arrive one by one, in order of time, and the passes at the tenth and at the last are timed;
then, with `--orders`, in random orders, with halves, wrong contents, files that go away again and a
misspelt list of sensors before the right one. The log is compared with that of `factory import`,
variable by variable and attribute by attribute.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

DEPTH = 950.0
"""[m] of the dives"""
HARMED = 4
"""Dives of the deployments that are killed or shuffled"""
FORECAST = "page/forecast.geojson"
PASSES = 5
"""Passes while the files of a real deployment arrive"""
LOGS = {f".{a}{b}d" for a in "dmsent" for b in "bc"}
"""Endings of a Slocum's binary files"""
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
    from factory import samples
    from glider_twin_ops.watching import WatchedDeployment

    source, later = place / "arrived", place / "later"
    source.mkdir()
    later.mkdir()
    flight = samples.Flight(dives=dives, depth=DEPTH, step=5.0)
    files = samples.write("seaglider", later, flight, layout="basestation")
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
    from benchmarks.histories import DONE, fork, wait
    from glider_twin_ops.watching.watch_pass import PARTS

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
        ended += wait(process, kill=True) == DONE
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
    from benchmarks.histories import DONE, fork, wait

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


def real_passes(folder: Path, cache: Path | None, place: Path) -> dict[str, object]:
    """Time the passes at the tenth and at the last file of a real deployment."""
    source, made, files = _real(folder, cache, place)
    found: dict[str, object] = {"folder": folder.parent.name, "files": len(files)}
    for word, number in (("10th", min(10, len(files))), ("last", len(files))):
        for path in files[: number - 1]:
            shutil.copy(path, source)
        log_seconds(made)
        shutil.copy(files[number - 1], source)
        seconds, cpu, memory, _ = passed(made, "--once")
        found[f"arrival to page at the {word} [s]"] = round(seconds, 1)
        found[f"of it on processors at the {word} [s]"] = round(cpu, 1)
        found[f"log at the {word} on processors [s]"] = round(log_seconds(made, again=True), 2)
        found[f"memory at the {word} [MB]"] = round(memory)
    found["nothing new [s]"] = round(log_seconds(made), 2)
    return found


def log_seconds(folder: Path, *, again: bool = False) -> float:
    """[s] of this process until the log is up to date, or made again."""
    from glider_twin_ops.watching import WatchedDeployment
    from glider_twin_ops.watching.log_of_files import log_of_files

    deployment = WatchedDeployment.read(folder)
    begin = time.process_time()
    log_of_files(deployment, folder, again=again)
    return time.process_time() - begin


def real_orders(
    times: int, seed: int, folder: Path, cache: Path | None, place: Path
) -> dict[str, object]:
    """Let files of a real deployment arrive in random orders, some harmed, and compare the logs."""
    from factory.importing import import_logs
    from twin.records.store import write_store

    _, _, files = _real(folder, cache, place / "import")
    dataset, _ = import_logs("slocum", [folder], cache=cache)
    wanted = _stored(write_store(dataset, place / "import.zarr"))
    begin, counts = time.perf_counter(), dict.fromkeys(("halves", "wrong", "gone", "passes"), 0)
    others: list[str] = []
    for number in range(times):
        draw = random.Random(f"{seed} {number}")
        source, made, _ = _real(folder, cache, place / f"{number}")
        lists = sorted([*source.glob("*.cac"), *(made.parent / "lists").glob("*.cac")])
        right = {path: path.read_bytes() for path in lists}
        for path in lists:
            path.write_bytes(right[path].replace(b" m_p", b" m_q").replace(b" sci_w", b" sci_v"))
        between = {*draw.sample(range(len(files)), min(PASSES, len(files)))}
        corrected = draw.choice([*between])
        for k, path in enumerate(draw.sample(files, len(files))):
            content, odd = path.read_bytes(), draw.random()
            if odd < ODD:
                (source / path.name).write_bytes(content[: draw.randrange(len(content))])
            elif odd < 2.0 * ODD:
                (source / path.name).write_bytes(draw.choice(files).read_bytes())
            elif odd < 2.5 * ODD:
                (source / f"b{path.name}").write_bytes(content[:-7])
            counts["halves"] += odd < ODD
            counts["wrong"] += ODD <= odd < 2.0 * ODD
            counts["gone"] += 2.0 * ODD <= odd < 2.5 * ODD
            if k in between:
                counts["passes"] += 1
                log_seconds(made)
            if k == corrected:
                for one in lists:
                    one.write_bytes(right[one])
            (source / f"b{path.name}").unlink(missing_ok=True)
            shutil.copy(path, source)
        log_seconds(made)
        found = _stored(made / "log.zarr")
        if not found.identical(wanted):
            others.append(f"{number}: {_first_difference(found, wanted)}")
        shutil.rmtree(made.parent)
    return {
        "folder": folder.parent.name, "files": len(files), "dives": wanted.sizes["mission"],
        "orders": times, "identical to the import": times - len(others), "others": others,
        **counts, "minutes": round((time.perf_counter() - begin) / 60.0, 1),
    }  # fmt: skip


def _real(folder: Path, cache: Path | None, place: Path) -> tuple[Path, Path, list[Path]]:
    """An empty source with lists of sensors, its deployment, and the logs in order of time."""
    from glider_twin_ops.watching import WatchedDeployment

    source, lists = place / "arrived", place / "lists"
    source.mkdir(parents=True)
    lists.mkdir()
    every = [path for path in folder.iterdir() if path.is_file()]
    for path in every if cache is None else cache.iterdir():
        if path.suffix.lower() == ".cac":
            shutil.copy(path, source if cache is None else lists)
    made = WatchedDeployment(
        folder=place / "calypso", source=str(source), kind="slocum",
        cache="" if cache is None else str(lists),
    )  # fmt: skip
    made.write()
    logs = [path for path in every if path.suffix.lower() in LOGS]
    return source, made.folder, sorted(logs, key=_by_numbers)


def _by_numbers(path: Path) -> list[tuple[int, str]]:
    words = re.split(r"(\d+)", path.stem)
    return [(int(word), "") if word.isdigit() else (0, word) for word in words]


def _stored(path: Path) -> Any:
    """A log less what says when and from which files' digest it was made."""
    import xarray as xr

    from glider_twin_ops.watching.log_of_files import DIGEST
    from twin.records.attributes import HISTORY

    found = xr.open_zarr(path, decode_times=False).load()
    found.attrs = {k: v for k, v in found.attrs.items() if k not in (HISTORY, DIGEST)}
    return found


def _first_difference(found: Any, wanted: Any) -> str:
    import xarray as xr

    try:
        xr.testing.assert_identical(found, wanted)
    except AssertionError as error:
        return str(error)[:600]
    return ""


def _files(place: Path) -> list[Path]:
    import matplotlib.backends.backend_agg  # noqa: F401 - what forked passes need is loaded once
    import netCDF4  # noqa: F401
    import xarray  # noqa: F401

    import glider_twin_ops.watching.watch_pass  # noqa: F401
    import twin.physics.lanes  # noqa: F401
    from factory import samples

    later = place / "later"
    return samples.write("seaglider", later, samples.Flight(dives=HARMED), layout="basestation")


def _deployment(place: Path, files: list[Path]) -> Path:
    from glider_twin_ops.watching import WatchedDeployment

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
    from glider_twin_ops.watching import WatchedDeployment, one_pass

    one_pass(WatchedDeployment.read(folder))


def _between(folder: Path) -> bool:
    """The part of a pass that files in any order could harm."""
    from benchmarks.histories import DONE, fork, wait
    from glider_twin_ops.watching import WatchedDeployment
    from glider_twin_ops.watching.log_of_files import log_of_files

    made = WatchedDeployment.read(folder)
    return wait(fork(lambda: log_of_files(made, folder))) == DONE


def _bytes(folder: Path) -> str:
    """Of log, beliefs, events and the page's figures; what lies beside them, too."""
    from glider_twin_ops.watching.log_of_files import content_of
    from glider_twin_ops.watching.watch_pass import PARTS

    beside = sorted(path.name for path in folder.iterdir() if "writing" in path.name)
    parts = [content_of(folder / name) for name in (*PARTS, FORECAST)]
    return json.dumps([*parts, beside])


def main() -> None:
    """Print a line for each number of dives, for the kills and for the orders."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dives", type=int, nargs="*", default=[5, 300])
    parser.add_argument("--kills", type=int, default=0, help="of passes")
    parser.add_argument("--orders", type=int, default=0, help="of arrival")
    parser.add_argument("--real", type=Path, nargs="*", default=[], help="a Slocum's files")
    parser.add_argument("--cache", type=Path, help="their lists of sensors")
    parser.add_argument("--seed", type=int, default=0, help="of kills and orders")
    options = parser.parse_args()
    for folder in options.real:
        with tempfile.TemporaryDirectory() as place:
            print(json.dumps(real_passes(folder, options.cache, Path(place))), flush=True)
        with tempfile.TemporaryDirectory() as place:
            given = options.orders, options.seed, folder, options.cache, Path(place)
            print(json.dumps(real_orders(*given)), flush=True)
    if options.real:
        return
    for dives in options.dives:
        with tempfile.TemporaryDirectory() as place:
            print(json.dumps(measure(dives, Path(place))), flush=True)
    for harm, times in ((kills, options.kills), (orders, options.orders)):
        with tempfile.TemporaryDirectory() as place:
            if times:
                print(json.dumps(harm(times, options.seed, Path(place))), flush=True)


if __name__ == "__main__":
    main()
