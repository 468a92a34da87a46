"""Soak: how the factory holds when it runs for days. Does memory, the number of open files or the
time for an hour grow? How often does an attempt fail?

    python -m benchmarks.soak --hours 100000 --each 1000 --out soak.jsonl     # resumable
    python -m benchmarks.soak --out soak.jsonl --report                       # of what is there
    python -m benchmarks.soak --plan                                          # a million missions

One process makes store after store, a new seed for each, with preset `field`; `factory verify`
reads each one, and then it is removed. Every store leaves a line in the file of --out, where a
stopped soak goes on. A slope is given as the change from the first hour to the last, in % of the
mean, with its interval of 95 %.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.watched import Use, Watched
from factory.generation.generation import Summary, generate
from factory.sampling.recipe import make_recipe
from twin.cli.text_table import format_table
from twin.records.storage.stored_files import LocalFiles

LOOK_S = 5.0
"""[s] between two looks at the processes"""
HOUR_BINS = 20
"""Pieces into which a store's hours are cut for its slopes"""
MISSIONS = 1_000_000
"""Of the plan"""
CORE_HOUR_PRICE = 0.04
"""[USD] of a core for an hour at large public clouds, rounded, 2026"""
GB_MONTH_PRICE = 0.023
"""[USD] of 1 GB of object storage for a month, rounded, 2026"""
CORES = (1, 64, 1000)


class Looks:
    """What a store's making took by the hours done."""

    def __init__(self) -> None:
        self.hours, self.rows = 0.0, list[tuple[float, Use]]()

    def flown(self, hours: float, again: int) -> None:
        """A mission is done."""
        self.hours += hours

    def see(self, use: Use) -> None:
        """A look at the processes."""
        self.rows.append((self.hours, use))


def verify(store: Path) -> dict[str, float]:
    """`factory verify` in a process of its own: time [s] and peak memory [bytes]."""
    begun = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "factory", "verify", str(store)], stdout=subprocess.DEVNULL
    )
    watched = Watched(process.pid)
    watched.start()
    status = process.wait()
    watched.running = False
    return {
        "verified": float(status == 0),
        "verify_s": time.perf_counter() - begun,
        "verify_memory": float(watched.peak),
    }


def one_store(seed: int, hours: float, preset: str, folder: Path) -> dict[str, Any]:
    """Make, verify and remove a store; its line."""
    looks = Looks()
    watched = Watched(os.getpid(), looks.see, LOOK_S)
    watched.start()
    before = os.times()
    summary = generate(
        make_recipe(preset=preset, hours=hours, seed=seed),
        folder / f"{seed}.zarr",
        watch=looks.flown,
    )
    after = os.times()
    watched.running = False
    watched.join()
    assert isinstance(summary.store, Path)
    files = sum(1 for _ in LocalFiles(summary.store).sizes())
    cpu = sum(after[:4]) - sum(before[:4])
    line = _line(seed, preset, summary, looks, cpu) | {"files": files} | verify(summary.store)
    for path in (*folder.glob(f"{seed}.zarr*"),):
        LocalFiles(path).remove_all() if path.is_dir() else path.unlink()
    return line


def _line(seed: int, preset: str, made: Summary, looks: Looks, cpu: float) -> dict[str, Any]:
    return {
        "seed": seed, "preset": preset, "hours": made.hours, "missions": made.missions,
        "failed": made.failed, "wall_s": made.wall_s, "cpu_s": cpu, "bytes": made.stored_bytes,
        "memory": max((use.memory for _, use in looks.rows), default=0),
        "open_files": max((use.files for _, use in looks.rows), default=0),
        "looks": _thinned(looks),
    }  # fmt: skip


def _thinned(looks: Looks) -> list[dict[str, float]]:
    """A row for each piece of the hours: memory [bytes], open files, CPU time [s] of an hour."""
    rows = [(hours, use) for hours, use in looks.rows if hours > 0.0]
    if len(rows) < 2 * HOUR_BINS:
        return []
    found = []
    for piece in np.array_split(np.arange(len(rows)), HOUR_BINS):
        first, last = rows[max(piece[0] - 1, 0)], rows[piece[-1]]
        done = last[0] - first[0]
        if done > 0.0:
            found.append({
                "hours": last[0],
                "memory": float(np.mean([rows[i][1].memory for i in piece])),
                "open_files": float(max(rows[i][1].files for i in piece)),
                "cpu_s_per_hour": (last[1].cpu_s - first[1].cpu_s) / done,
            })  # fmt: skip
    return found


def soak(hours: float, each: float, preset: str, out: Path) -> None:
    """Make stores until those of `out` have `hours` together."""
    with tempfile.TemporaryDirectory(dir=out.resolve().parent, prefix=".soak-") as folder:
        while True:
            lines = read(out)
            done = sum(line["hours"] for line in lines)
            if done >= hours:
                return
            seed = 1 + max((line["seed"] for line in lines), default=0)
            line = one_store(seed, min(each, hours - done), preset, Path(folder))
            with out.open("a") as file:
                file.write(json.dumps(line) + "\n")
            print(f"{done + line['hours']:,.0f} of {hours:,.0f} h", flush=True)


def read(out: Path) -> list[dict[str, Any]]:
    """The lines of a soak; none where it has not begun."""
    return [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []


def slope(x: Sequence[float], y: Sequence[float]) -> str:
    """Change of `y` over the range of `x`, in % of its mean, with 95 % interval."""
    if len(x) < 3:
        return "too few"
    away = np.asarray(x) - np.mean(x)
    per_unit = float(away @ np.asarray(y)) / float(away @ away)
    left = np.asarray(y) - np.mean(y) - per_unit * away
    error = float(np.sqrt(left @ left / (len(x) - 2) / (away @ away)))
    factor = 100.0 * (max(x) - min(x)) / float(np.mean(y))
    half = float(stats.t.ppf(0.975, len(x) - 2)) * error * factor
    return f"{per_unit * factor:+.1f} +- {half:.1f} %"


def report(lines: Sequence[dict[str, Any]]) -> None:
    """Print what was found."""
    if not lines:
        raise SystemExit("nothing was flown yet: give --hours")
    hours = [line["hours"] for line in lines]
    total, missions = sum(hours), sum(line["missions"] for line in lines)
    failed = sum(line["failed"] for line in lines)
    tried = missions + failed
    low, high = stats.binomtest(failed, tried).proportion_ci(0.95, "exact")
    done = np.cumsum(hours).tolist()
    cpu = [line["cpu_s"] / line["hours"] for line in lines]
    wall = sum(line["wall_s"] for line in lines)
    memory = max(line["memory"] for line in lines)
    size = sum(line["bytes"] for line in lines)
    rows: list[dict[str, object]] = [
        {"what": "simulated", "found": f"{total:,.0f} h, {missions:,} missions, "
            f"{len(lines)} stores"},
        {"what": "times real time, elapsed", "found": f"{3600 * total / wall:,.0f}"},
        {"what": "times real time per CPU", "found": f"{3600 / float(np.mean(cpu)):,.0f}"},
        {"what": "failed attempts", "found": f"{failed} of {tried:,}: {100 * failed / tried:.3g} % "
            f"({100 * low:.2g} to {100 * high:.2g} %)"},
        {"what": "stores that factory verify finds sound",
            "found": f"{sum(line['verified'] for line in lines):.0f} of {len(lines)}"},
        {"what": "peak memory", "found": f"{memory / 1e6:.0f} MB"},
        {"what": "peak memory of factory verify",
            "found": f"{max(line['verify_memory'] for line in lines) / 1e6:.0f} MB"},
        {"what": "size of an hour", "found": f"{size / total / 1e6:.2f} MB"},
        {"what": "files in a store", "found": f"{max(line['files'] for line in lines)}"},
        {"what": "open files at most", "found": f"{max(line['open_files'] for line in lines)}"},
        {"what": "CPU time of an hour, first store to last", "found": slope(done, cpu)},
        {"what": "memory, first store to last",
            "found": slope(done, [line["memory"] for line in lines])},
        {"what": "open files, first store to last",
            "found": slope(done, [line["open_files"] for line in lines])},
    ]  # fmt: skip
    longest = max(lines, key=lambda line: line["hours"])
    if longest["looks"]:
        looks = longest["looks"]
        at = [look["hours"] for look in looks]
        for what, key in (("memory", "memory"), ("CPU time of an hour", "cpu_s_per_hour")):
            found = slope(at, [look[key] for look in looks])
            rows.append({"what": f"{what}, within {longest['hours']:,.0f} h", "found": found})
    print(format_table(rows))


def plan(lines: Sequence[dict[str, Any]]) -> None:
    """Print what a million missions take, by the constants that the soak measured."""
    if not lines:
        raise SystemExit("--plan needs the lines of a soak: give --out")
    hours = sum(line["hours"] for line in lines)
    cpu = sum(line["cpu_s"] for line in lines) / hours
    size = sum(line["bytes"] for line in lines) / hours
    total = MISSIONS * hours / sum(line["missions"] for line in lines)
    rows: list[dict[str, object]] = [
        {
            "cores": cores, "days": total * cpu / cores / 86400.0,
            "USD to fly": round(total * cpu / 3600.0 * CORE_HOUR_PRICE),
            "TB": size * total / 1e12,
            "USD a month to keep": round(size * total / 1e9 * GB_MONTH_PRICE),
            "new data [MB/s]": size / cpu * cores / 1e6,
        }
        for cores in CORES
    ]  # fmt: skip
    print(f"{MISSIONS:,} missions of preset {lines[-1]['preset']}, {total:,.0f} h")
    print(format_table(rows))


def main() -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--hours", type=float, help="[h] to fly in all")
    parser.add_argument("--each", type=float, default=1000.0, help="[h] of a store")
    parser.add_argument("--preset", default="field")
    parser.add_argument("--out", type=Path, default=Path("soak.jsonl"))
    parser.add_argument("--report", action="store_true", help="only print what is there")
    parser.add_argument("--plan", action="store_true", help="a million missions by its constants")
    given = parser.parse_args()
    if given.hours and not given.report and not given.plan:
        soak(given.hours, given.each, given.preset, given.out)
    (plan if given.plan else report)(read(given.out))
    return 0


if __name__ == "__main__":
    sys.exit(main())
