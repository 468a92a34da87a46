"""Truth: every measured velocity of a real vehicle beside every method that has not seen it.

python -m benchmarks.real_logs.truth      # the table of docs/results/truth.md, by measured.json
python -m benchmarks.figures --take docs/results/truth.md
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from benchmarks.command import markdown
from benchmarks.real_logs import adcp, dvl, left_out, propelled, stated
from benchmarks.real_logs.row import NOT_COMPARED, Row, cell, kept

PAGE = Path(__file__).parents[2] / "docs" / "results" / "truth.md"
OWN, SPEED, SURGE = "its depth rates", "speed by a Doppler log", "surge by a Doppler log"
SETS = {
    dvl.TASK: (SPEED, OWN, "w/sin(pitch + 3 deg), pitch as logged"),
    stated.TASK: (SPEED, OWN, stated.SIMPLE),
    adcp.TASK: ("level speed by a profiler", "its other dives", "factory model"),
    left_out.TASK: ("level speed", f"{OWN}, the other vehicle", "steady flight model"),
    propelled.SURGE: (SURGE, "its other runs", "constant speed"),
    propelled.LEFT_OUT: (SURGE, "other vehicles", "constant speed"),
}
"""Truth, what the methods know, and the simple method among them, by task"""
SEEN = re.compile(r"corrected pitch|pitch \+ [124] deg")
"""Methods of the Slocum's table that its Doppler log tuned or chose"""
BEST = 2
"""Methods of least error that the short table has of each line"""
DEFAULTS = {"twin, pitch as logged", "twin", "twin alone", "twin, flight model", "combination"}
"""Methods that the commands take by themselves"""
AGAIN = {(stated.TASK, "comet2016"), (left_out.TASK, left_out.TOGETHER)}


def table(rows: Sequence[Row], whole: bool = False) -> str:
    """Table in Markdown: a line for each vehicle and what was known, methods by their errors.

    Args:
      whole: every method; else those of least error, the default ones and the simple one.
    """
    lines: dict[tuple[str, str], list[Row]] = {}
    for row in sorted(rows, key=lambda row: row.value):
        if row.unit == "m s-1" and row.kind not in NOT_COMPARED and not SEEN.search(row.method):
            lines.setdefault((row.task, row.data), []).append(row)
    body = []
    for task, name in sorted(
        lines.keys() - AGAIN, key=lambda key: ([*SETS, key[0]].index(key[0]), key[1])
    ):
        if task in SETS:
            truth, known, rival = SETS[task]
            texts = [
                f"{star}{cell(row, [])} {row.method.removesuffix(', pitch as logged')}{star}"
                for rank, row in enumerate(lines[task, name])
                if whole or rank < BEST or row.method in {rival, *DEFAULTS}
                for star in ["*" * (row.method == rival)]
            ]
            samples = lines[task, name][0].samples
            body.append([name, truth, known, "<br>".join(texts), samples])
    return markdown(["vehicle", "truth", "methods know", "cm/s (95 %)", "samples"], body)


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    made = re.sub(r"\| vehicle \| .*\n(?:\|.*\n)*", lambda _: f"{table(kept())}\n", text, count=1)
    PAGE.write_text(made, encoding="utf-8")
