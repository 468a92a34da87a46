"""Watch passes: time from a dive's file to the page, and passes that are disturbed.

    python -m benchmarks.watch_passes --dives 5 300
    python -m benchmarks.watch_passes --dives --kills 100 --orders 50
    python -m benchmarks.watch_passes --real ../shared/data/slocum_barnacle_2022/raw --orders 20

A simulated Seaglider makes saw-tooth dives to 950 m, three hours each. All files but the last are
in the source, and a first pass reads them. Then the last file arrives, and a pass in its own
process is timed, with its peak of memory. `replay` makes all results again from the files, and
compares the bytes of log, state estimates and events.

`--kills` kills passes over four shallow dives at random moments, and the next pass continues.
`--orders` lets the files arrive in random orders, with passes in between; half files, files of
wrong content and copies that vanish come before the right ones. The result must always have the
bytes of one pass over all files, and no further files.

`--real` names folders with a Slocum's files, and `--cache` a folder with their lists of sensors.
The files arrive one by one in order of time; the passes after the tenth and the last file are
timed. With `--orders` they then arrive in random orders, with the same disturbances and a misspelt
list of sensors before the right one. The log is compared with that of `factory import`, variable by
variable and attribute by attribute.
"""

from __future__ import annotations

import json
import random
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.backends.backend_agg  # noqa: F401 - what forked passes need is loaded once
import netCDF4  # noqa: F401
import xarray as xr

import twin.physics.lanes  # noqa: F401
from benchmarks import command
from benchmarks.processes import DONE, Ran, done, fork, ran, wait
from factory import samples
from factory.importing import import_logs
from glider_twin_ops.watching import WatchedDeployment, one_pass
from glider_twin_ops.watching.log_of_files import DIGEST, content_of, log_of_files
from glider_twin_ops.watching.watch_pass import PARTS
from twin.records.attributes import HISTORY
from twin.records.store import write_store

DEPTH = 950.0
"""[m] Depth of the dives"""
HARMED = 4
"""Number of dives where passes are killed or files are shuffled"""
FORECAST = "page/forecast.geojson"
PASSES = 5
"""Number of passes while the files of a real deployment arrive"""
LOGS = {f".{a}{b}d" for a in "dmsent" for b in "bc"}
"""Endings of a Slocum's binary files"""
ODD = 0.3
"""Probability of a half and of wrong content before each file that arrives"""


def passed(folder: Path, *words: str) -> tuple[Ran, dict[str, Any]]:
    """Make a pass in its own process: resources used, and its answer."""
    found = ran([sys.executable, "-m", "twin", "watch", str(folder), *words, "--json"])
    return found, json.loads(found.said)


def costs(one: Ran, at: str = "") -> dict[str, object]:
    """Resources of a pass, by name."""
    return {
        f"arrival to page{at} [s]": round(one.wall_s, 1),
        f"of it on processors{at} [s]": round(one.cpu_s, 1),
        f"memory{at} [MB]": round(one.memory / 2**20),
    }


def measure(dives: int, place: Path) -> dict[str, object]:
    """Measure the first pass of a deployment, the pass of its last dive, and a replay."""
    source, later = place / "arrived", place / "later"
    source.mkdir()
    later.mkdir()
    flight = samples.Flight(dives=dives, depth=DEPTH, step=5.0)
    files = samples.write("seaglider", later, flight, layout="basestation")
    for path in files[:-1]:
        shutil.move(path, source)
    made = WatchedDeployment(folder=place / "calypso", source=str(source), vehicle="seaglider")
    made.write()
    first, _ = passed(made.folder, "--once")
    shutil.move(files[-1], source)
    one, answer = passed(made.folder, "--once")
    assert answer["changed"], answer
    replay, again = passed(made.folder, "--replay")
    return {
        "dives": dives, "first pass [s]": round(first.wall_s, 1), **costs(one),
        "replay [s]": round(replay.wall_s, 1), "same bytes": all(again["same"].values()),
    }  # fmt: skip


def killed(times: int, seed: int, place: Path) -> dict[str, object]:
    """Kill passes at random moments, and let the next one go on."""
    names = (*PARTS, FORECAST, "what lies beside them")
    draw = random.Random(seed)
    files = _files(place)
    every = _deployment(place / "undisturbed", files)
    begin = time.perf_counter()
    assert done(partial(_pass, every))
    seconds = time.perf_counter() - begin
    wanted, ended = _bytes(every), 0
    lost: list[str] = []
    before = [_deployment(place / f"before{known}", files[:known]) for known in range(len(files))]
    assert all(done(partial(_pass, made)) for made in before[1:])
    for number in range(times):
        known = draw.randrange(len(files))
        made = place / f"{number}" / before[known].name
        shutil.copytree(before[known].parent, made.parent)
        for path in files[known:]:
            shutil.copy(path, made.parent / "arrived")
        process = fork(partial(_pass, made))
        time.sleep(draw.uniform(0.0, seconds))
        ended += wait(process, kill=True) == DONE
        if not done(partial(_pass, made)):
            lost.append(f"{number}: the next pass failed")
        elif (found := _bytes(made)) != wanted:
            pairs = zip(names, found, wanted, strict=True)
            lost.append(f"{number}: {[name for name, one, right in pairs if one != right]}")
        shutil.rmtree(made.parent)
    same = times - len(lost)
    return {"kills": times, "same bytes": same, "had ended before": ended, "others": lost}


def arrive(
    files: list[Path], source: Path, draw: random.Random, counts: Counter[str],
    between: Callable[[int], object],
) -> None:  # fmt: skip
    """Let files arrive in a random order, some after half files, wrong contents or other copies.
    `between` is called before each right file with the number of files before it."""
    for k, path in enumerate(draw.sample(files, len(files))):
        content, odd = path.read_bytes(), draw.random()
        if odd < ODD:
            counts["halves"] += 1
            (source / path.name).write_bytes(content[: draw.randrange(len(content))])
        elif odd < 2.0 * ODD:
            counts["wrong"] += 1
            (source / path.name).write_bytes(draw.choice(files).read_bytes()[:-64])
        elif odd < 2.5 * ODD:
            counts["gone"] += 1
            (source / f"b{path.name}").write_bytes(content[:-7])
        between(k)
        (source / f"b{path.name}").unlink(missing_ok=True)
        shutil.copy(path, source)


def ordered(times: int, seed: int, place: Path) -> dict[str, object]:
    """Let files of a Seaglider arrive in random orders: passes end in the bytes of one pass."""
    files, counts = _files(place), Counter[str]()
    every = _deployment(place / "at-once", files)
    assert done(partial(_pass, every))
    found = []
    for number in range(times):
        draw = random.Random(f"{seed} {number}")
        made = _deployment(place / f"{number}", [])

        def between(_: int, made: Path = made, draw: random.Random = draw) -> None:
            if draw.random() < ODD:
                counts["passes"] += done(partial(log_seconds, made))

        arrive(files, made.parent / "arrived", draw, counts, between)
        assert done(partial(_pass, made))
        found.append(_bytes(made))
        shutil.rmtree(made.parent)
    return {"orders": times, "as all at once": found.count(_bytes(every)), **counts}


def real_passes(folder: Path, cache: Path | None, place: Path) -> dict[str, object]:
    """Time the passes at the tenth and at the last file of a real deployment."""
    source, made, files = _real(folder, cache, place)
    found: dict[str, object] = {"folder": folder.parent.name, "files": len(files)}
    for word, number in (("10th", min(10, len(files))), ("last", len(files))):
        for path in files[: number - 1]:
            shutil.copy(path, source)
        log_seconds(made)
        shutil.copy(files[number - 1], source)
        one, _ = passed(made, "--once")
        found |= costs(one, f" at the {word}")
        found[f"log at the {word} on processors [s]"] = round(log_seconds(made, again=True), 2)
    found["nothing new [s]"] = round(log_seconds(made), 2)
    return found


def log_seconds(folder: Path, *, again: bool = False) -> float:
    """CPU time [s] until the log is up to date, or made again."""
    deployment = WatchedDeployment.read(folder)
    begin = time.process_time()
    log_of_files(deployment, folder, again=again)
    return time.process_time() - begin


def real_orders(
    times: int, seed: int, folder: Path, cache: Path | None, place: Path
) -> dict[str, object]:
    """Let files of a real deployment arrive in random orders, some harmed, and compare the logs."""
    _, _, files = _real(folder, cache, place / "import")
    dataset, _ = import_logs("slocum", [folder], cache=cache)
    wanted = _stored(write_store(dataset, place / "import.zarr"))
    begin, counts = time.perf_counter(), Counter[str]()
    others: list[str] = []
    for number in range(times):
        draw = random.Random(f"{seed} {number}")
        source, made, _ = _real(folder, cache, place / f"{number}")
        lists = sorted([*source.glob("*.cac"), *(made.parent / "lists").glob("*.cac")])
        right = {path: path.read_bytes() for path in lists}
        for path in lists:
            path.write_bytes(right[path].replace(b" m_p", b" m_q").replace(b" sci_w", b" sci_v"))
        passes = {*draw.sample(range(len(files)), min(PASSES, len(files)))}
        corrected = draw.choice([*passes])

        def between(
            k: int, made: Path = made, passes: set[int] = passes, corrected: int = corrected,
            right: dict[Path, bytes] = right,
        ) -> None:  # fmt: skip
            if k in passes:
                counts["passes"] += 1
                log_seconds(made)
            if k == corrected:
                for one, content in right.items():
                    one.write_bytes(content)

        arrive(files, source, draw, counts, between)
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
    """Make a source with lists of sensors only, its deployment, and the logs in order of time."""
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


def _stored(path: Path) -> xr.Dataset:
    """Read a log without its history and the digest of its files."""
    found = xr.open_zarr(path, decode_times=False).load()
    found.attrs = {k: v for k, v in found.attrs.items() if k not in (HISTORY, DIGEST)}
    return found


def _first_difference(found: xr.Dataset, wanted: xr.Dataset) -> str:
    try:
        xr.testing.assert_identical(found, wanted)
    except AssertionError as error:
        return str(error)[:600]
    return ""


def _files(place: Path) -> list[Path]:
    later = place / "later"
    return samples.write("seaglider", later, samples.Flight(dives=HARMED), layout="basestation")


def _deployment(place: Path, files: list[Path]) -> Path:
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
    one_pass(WatchedDeployment.read(folder))


def _bytes(folder: Path) -> list[Any]:
    """Content hashes of log, beliefs, events and forecast, and names of leftovers beside them."""
    beside = sorted(path.name for path in folder.iterdir() if "writing" in path.name)
    return [*(content_of(folder / name) for name in (*PARTS, FORECAST)), beside]


def main(
    *,
    dives: tuple[int, ...] = (5, 300),
    kills: int = 0,
    orders: int = 0,
    real: tuple[Path, ...] = (),
    cache: Path | None = None,
    seed: int = 0,
) -> None:
    """Print a line for each number of dives, for the kills and for the orders.

    Args:
      kills: of passes.
      orders: of arrival.
      real: a Slocum's files.
      cache: their lists of sensors.
      seed: of kills and orders.
    """
    jobs: list[Callable[[Path], object]] = []
    for folder in real:
        jobs += [
            partial(real_passes, folder, cache),
            partial(real_orders, orders, seed, folder, cache),
        ]
    if not real:
        jobs += [partial(measure, one) for one in dives]
        jobs += [partial(harm, n, seed) for harm, n in ((killed, kills), (ordered, orders)) if n]
    for job in jobs:
        with tempfile.TemporaryDirectory() as place:
            print(json.dumps(job(Path(place))), flush=True)


if __name__ == "__main__":
    sys.exit(command.run(main))
