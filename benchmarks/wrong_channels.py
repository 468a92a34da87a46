"""Wrong channels on board: which ones the networks report within a minute, in Python and in C.

    python -m benchmarks.wrong_channels RUN [--store STORE] [--onset 1800] [--json]

From the onset on, one channel of the store's longest mission is in the wrong unit (times pi/180,
100 or 0.01), has the wrong sign, or is 10 s late; a depth also jumps by 30 m for a sample. Entries
have the largest change of surge within the minute [m/s], and a word. `reported`: the stated
half-width of surge grew to at least 1.5 times that of the unchanged mission. Otherwise `held`, if
the last good value replaced the channel's; `unmoved`, if surge changed by less than half of the
stated half-width; or `silent`. If C and Python disagree on a word, the command fails.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import command
from learn.data.dataset import Selection
from learn.networks.c_export import FLAGS, c_header, find_compiler
from learn.networks.network_estimator import NetworkVelocity
from learn.run import open_run
from twin.errors import StoreError
from twin.navigation.features import channels_of
from twin.navigation.settings import sources
from twin.records.reader import MissionStore

Rows = NDArray[np.float32]
WINDOW_S, LATE_S, JUMP_M = 60.0, 10.0, 30.0
RAISED, UNMOVED = 1.5, 0.5
DEPTH = "measured_depth"
FACTORS = {"pi/180": np.pi / 180.0, "100": 100.0, "0.01": 0.01, "-1": -1.0}
MAIN = """\
#include "{header}"
#include <stdio.h>

static float given[{samples}][{channels}];

int main(void)
{{
    static glider_state state;
    glider_velocity velocity = {{0.0f, 0.0f, 0.0f, 0.0f}};
    while (fread(given, sizeof given[0], {samples}, stdin) == {samples}) {{
        glider_reset(&state);
        for (int k = 0; k < {samples}; k++) {{
            const float *v = given[k];
            const glider_sample sample = {{{fields}}};
            glider_step(&state, &sample, &velocity);
            const float found[3] = {{velocity.surge, velocity.surge_deviation, (float)state.held}};
            if (k >= {onset})
                fwrite(found, sizeof found, 1, stdout);
        }}
    }}
    return 0;
}}
"""


def faults(rows: Rows, column: int, onset: int, period: float) -> dict[str, Rows]:
    """The minute's samples with a fault in one column, by fault."""
    found = {}
    for name, factor in FACTORS.items():
        found[name] = rows[onset:].copy()
        found[name][:, column] *= np.float32(factor)
    late = round(LATE_S / period)
    found["late"] = rows[onset:].copy()
    found["late"][:, column] = rows[onset - late : len(rows) - late, column]
    return found


def jumped(rows: Rows, column: int, onset: int) -> Rows:
    """The minute's samples with one depth that jumps."""
    found = rows[onset:].copy()
    found[len(found) // 2, column] += JUMP_M
    return found


def by_c(header: str, names: tuple[str, ...], before: Rows, cases: list[Rows]) -> Rows:
    """Surge, its half-width and the number of held channels, (cases, samples, 3), by the C code."""
    with tempfile.TemporaryDirectory() as folder:
        place, program = Path(folder) / "main.c", Path(folder) / "main"
        (Path(folder) / "velocity.h").write_text(header)
        place.write_text(MAIN.format(
            header="velocity.h", samples=len(before) + len(cases[0]), channels=len(names),
            onset=len(before), fields=", ".join(f".{n} = v[{k}]" for k, n in enumerate(names)),
        ))  # fmt: skip
        make = [*find_compiler(), *FLAGS, str(place), "-o", str(program), "-lm"]
        subprocess.run(make, check=True)
        given = b"".join(np.concatenate([before, case]).tobytes() for case in cases)
        done = subprocess.run([program], input=given, capture_output=True, check=True)
    return np.frombuffer(done.stdout, np.float32).reshape(len(cases), -1, 3)


def by_python(
    open_estimator: Callable[[], NetworkVelocity],
    names: tuple[str, ...],
    before: Rows,
    cases: list[Rows],
) -> Rows:
    """Surge, its interval and the channels held, (cases, samples, 3), by Python's estimator."""
    estimator = open_estimator()
    for row in before:
        estimator.step(dict(zip(names, row.tolist(), strict=True)))
    state, found = estimator.state(), []
    for case in cases:
        estimator.restore(state)
        for row in case:
            said = estimator.step(dict(zip(names, row.tolist(), strict=True)))
            found.append((said.surge, estimator.intervals["surge"], len(estimator.held)))
    return np.array(found, np.float32).reshape(len(cases), -1, 3)


def entry(right: Rows, wrong: Rows) -> tuple[str, float]:
    """Word and largest change of surge [m/s] of a case beside the unchanged minute."""
    change = float(np.abs(wrong[:, 0] - right[:, 0]).max())
    if (wrong[:, 1] >= RAISED * right[:, 1]).any():
        return "reported", change
    if wrong[:, 2].mean() > 0.5:
        return "held", change
    return "unmoved" if change < UNMOVED * right[-1, 1] else "silent", change


def main(
    run: command.Positional[str], *, store: str | None = None, onset: float = 1800.0,
    json: bool = False,
) -> None:  # fmt: skip
    """Print the table.

    Args:
      run: folder or name of a run.
      store: store of the mission [default: the run's own].
      onset: [s] time at which the channel goes wrong.
    """
    opened, place = open_run(run), store
    place = opened.store if place is None else place
    with MissionStore(place) as reader:
        vehicle = reader.vehicle
    networks, names = opened.networks(vehicle), sources(channels_of(opened.features))
    with Selection(place, names, period=opened.period) as selection:
        mission = selection.read([int(selection.lengths.argmax())])[0]
    first, window = round(onset / mission.period), round(WINDOW_S / mission.period)
    if mission.samples < first + window:
        raise StoreError(f"store {place}: its longest mission ends before --onset {onset:g} s")
    every = np.stack([mission.signals[name] for name in names], 1).astype(np.float32)
    rows = every[: first + window]
    cases: dict[tuple[str, str], Rows] = {("", ""): rows[first:]}
    for column, name in enumerate(names):
        made = faults(rows, column, first, mission.period)
        cases |= {(name, fault): values for fault, values in made.items()}
    cases[DEPTH, "jump"] = jumped(rows, names.index(DEPTH), first)
    listed = list(cases.values())
    in_c = by_c(c_header(networks, mission.period, vehicle), names, rows[:first], listed)
    in_python = by_python(
        lambda: NetworkVelocity(networks, mission.period, vehicle), names, rows[:first], listed
    )
    lines: dict[str, dict[str, Any]] = {name: {"channel": name} for name in names}
    lines["jump"] = {"channel": f"{DEPTH}, a jump of {JUMP_M:g} m"}
    differ = []
    for k, (name, fault) in enumerate(cases):
        word, change = entry(in_c[0], in_c[k])
        if name and word != entry(in_python[0], in_python[k])[0]:
            differ.append(f"{name} {fault}")
        if fault == "jump":
            lines["jump"]["once"] = f"{word} {change:.2g}"
        elif name:
            lines[name][fault] = f"{word} {change:.2g}"
    table: list[Mapping[str, Any]] = list(lines.values())
    command.say(table, table, json=json)
    if differ:
        raise StoreError(f"C and Python disagree on {', '.join(differ)}")


if __name__ == "__main__":
    sys.exit(command.run(main))
