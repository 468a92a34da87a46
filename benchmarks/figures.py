"""Figures of the documentation in docs/results/figures.json, so that a changed digit shows.

    python -m benchmarks.figures vector_env                        # run it, keep what it measures
    python -m benchmarks.figures --fresh vector_env                # and forget all earlier runs
    python -m benchmarks.figures --take docs/results/networks.md   # keep a page's tables, by hand

`<!-- figure: vector_env.steps -->` after a number, or after `A to B`, marks a benchmark's figure:
the lowest and highest of its runs. `<!-- figures: networks.ideal -->` and an empty line before a
table or a paragraph mark other numbers, which come from the command that the page shows there.
"""

from __future__ import annotations

import json
import re
import runpy
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "docs" / "results" / "figures.json"
NUMBER = r"\d{1,3}(?: \d{3})+|\d+(?:\.\d+)?(?:e-?\d+)?"
ONE = re.compile(rf"(?:({NUMBER}) to )?({NUMBER}) ?<!-- figure: ([\w.]+) -->")
MANY = re.compile(r"<!-- figures: ([\w.]+) -->\n\n((?:.+\n)+)")
KEEPING = {"on": False, "fresh": False}
"""State of `measured`: "on", it writes figures; "fresh", it first deletes those of earlier runs"""


def measured(benchmark: str, **figures: float | list[float]) -> None:
    """Keep a benchmark's figures if `python -m benchmarks.figures` runs it.

    A figure's entry has the lowest and the highest of all its runs.
    """
    if not KEEPING["on"]:
        return
    kept = load()
    for name, found in figures.items():
        runs = found if isinstance(found, list) else [found]
        key = f"{benchmark}.{name}"
        if not KEEPING["fresh"] and key in kept["measured"]:
            runs = [*runs, *kept["measured"][key]["runs"]]
        spread = [float(f"{one:.4g}") for one in sorted({min(runs), max(runs)})]
        kept["measured"][key] = {"runs": spread, "date": time.strftime("%Y-%m")}
    save(kept)


def medians(ways: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """Medians of several measurements, taken in turns so that all see the same machine load."""
    found = [{name: measure() for name, measure in ways.items()} for _ in range(rounds)]
    return {name: statistics.median(one[name] for one in found) for name in ways}


def seconds(work: Callable[[], object]) -> float:
    """[s] Duration of a call."""
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def load() -> dict[str, Any]:
    """Read the file: `measured` by benchmarks, `tables` of pages."""
    return dict(json.loads(FILE.read_text(encoding="utf-8")))


def save(kept: dict[str, Any]) -> None:
    """Write the file with one line for every row, for readable diffs."""
    parts = []
    for name, entries in kept.items():
        lines = []
        for key, entry in sorted(entries.items()):
            if "rows" in entry:
                rows = ",\n".join(f"   {json.dumps(row)}" for row in entry["rows"])
                head = f'"page": {json.dumps(entry["page"])}, "date": {json.dumps(entry["date"])}'
                lines.append(f'  {json.dumps(key)}: {{{head}, "rows": [\n{rows}]}}')
            else:
                lines.append(f"  {json.dumps(key)}: {json.dumps(entry)}")
        parts.append(f" {json.dumps(name)}: {{\n" + ",\n".join(lines) + "}")
    FILE.write_text("{\n" + ",\n".join(parts) + "}\n", encoding="utf-8")


def tables(page: str) -> dict[str, list[list[Any]]]:
    """Rows of each marked table or paragraph of a page's text: its first cell, then the numbers."""
    found = MANY.findall(page)
    return {key: [row for row in map(_row, text.splitlines()) if row] for key, text in found}


def _row(line: str) -> list[Any]:
    if line.startswith("|"):
        label, _, line = line.strip("| ").partition(" | ")
        if not line or set(line) <= set("|- "):
            return []
    else:
        label = ""
    line = re.sub(r"`[^`]*`", "", ONE.sub("", line))
    found = re.findall(rf"(?<![\w.])(?:{NUMBER})", line)
    return [label, *map(_number, found)] if found else []


def _number(text: str) -> float:
    return float(text.replace(" ", ""))


def as_printed(text: str, value: float) -> bool:
    """True if `text` is this value, rounded to the digits of `text`.

    >>> as_printed("2.1e-7", 2.13e-7), as_printed("114 000", 113870.0), as_printed("0.74", 0.747)
    (True, True, False)
    """
    mantissa, _, power = text.replace(" ", "").partition("e")
    decimals = len(mantissa.partition(".")[2])
    if power:
        return f"{value:.{decimals}e}" == f"{float(text):.{decimals}e}"
    if not decimals:
        zeros = len(mantissa) - len(mantissa.rstrip("0"))
        decimals = -zeros if zeros > 2 else 0
    return float(mantissa) == round(value, decimals)


def wrong(page: str) -> list[str]:
    """Claims of a page's text that differ from the file or are missing there."""
    kept, told = load(), []
    for low, high, key in ONE.findall(page):
        runs = kept["measured"].get(key, {}).get("runs")
        shown = [low, high] if low else [high]
        if runs is None:
            told.append(f"{key} is not measured")
        elif not (
            as_printed(low, runs[0]) and as_printed(high, runs[-1])
            if low  # a single figure may be any run's
            else runs[0] <= _number(high) <= runs[-1] or any(as_printed(high, one) for one in runs)
        ):
            told.append(f"{key}: {' to '.join(shown)} on the page, {runs} in the file")
    for key, rows in tables(page).items():
        others = kept["tables"].get(key, {}).get("rows")
        if others is None:
            told.append(f"{key} has no rows")
            continue
        told += [f"{key}: {row} on the page only" for row in rows if row not in others]
        told += [f"{key}: {row} in the file only" for row in others if row not in rows]
    return told


def take(page: Path) -> None:
    """Keep the numbers of a page's marked tables."""
    kept, place = load(), page.resolve().relative_to(ROOT).as_posix()
    found = tables(page.read_text(encoding="utf-8"))
    others = {key: one for key, one in kept["tables"].items() if one["page"] != place}
    for key, rows in found.items():
        before = kept["tables"].get(key, {})
        same = before.get("rows") == rows
        date = before["date"] if same else time.strftime("%Y-%m")
        others[key] = {"page": place, "date": date, "rows": rows}
    save({**kept, "tables": others})


if __name__ == "__main__":
    words = sys.argv[1:]
    if words[:1] == ["--take"] and len(words) > 1:
        for one in words[1:]:
            take(Path(one))
        sys.exit()
    from benchmarks import figures  # the module that the benchmark imports

    figures.KEEPING |= {"on": True, "fresh": words[:1] == ["--fresh"]}
    words = words[1:] if figures.KEEPING["fresh"] else words
    if not words:
        sys.exit(__doc__)
    sys.argv = words
    runpy.run_module(f"benchmarks.{words[0]}", run_name="__main__", alter_sys=True)
