"""First try: `learn fit` from the shipped networks on ten hours, beside methods without training.

    python -m benchmarks.first_try [--vehicles glider slocum-200 seaglider spray] [--seeds 1]
        [--heavy] [--seconds 30] [--preset field] [--folder WORK] [--json]

Each vehicle flies ten hours and 66 unseen missions of a preset; `--heavy` also 66 missions with
40 % more drag. Networks are judged zero-shot (as shipped) and after a fit. The figure is the track
error at a mission's end with true attitude, in % of its path. A ratio is to the best rival of the
same knowledge, on the same missions, with a bootstrap over missions (95 %), pooled over seeds.
Stores, runs and scores stay in the folder: a stopped run goes on. Remove it after a change.
"""

from __future__ import annotations

import functools
import json as files
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import command
from benchmarks.dead_reckoning.scoring import interval
from twin.numbers import Array

RIVALS = ("pitch_plus_alpha", "steady_flight", "ekf", "flight_filter")
HEAVY = {"vehicle.k_d0": "1.4", "vehicle.k_d": "1.4"}
MISSIONS, HOURS = 66, 10.0
NETWORKS = {"shipped": "zero-shot", "fitted": "after the fit"}


def store(path: Path, count: int | None, **settings: Any) -> Path:
    """Store of at least `count` missions, or of HOURS; it is flown if it is missing."""
    from factory.generation.generation import generate
    from factory.sampling.recipe import make_recipe
    from learn.data.further import longer

    recipe = make_recipe(hours=HOURS, **settings)
    if count is not None:
        recipe = longer(recipe, count, seed=recipe.seed)
    generate(recipe, path, resume=True, history="first try")
    return path


def kept(path: Path, make: Callable[[], Mapping[str, Any]]) -> dict[str, Any]:
    """Content of a JSON file, which is made if it is missing."""
    if not path.is_file():
        path.write_text(files.dumps(make()))
    return dict(files.loads(path.read_text()))


def judged(networks: Any, test: Path, period: float, rivals: tuple[str, ...]) -> dict[str, Any]:
    """Error [%] of each mission by method, and the mean squared error of the networks' surge."""
    from learn.evaluation.evaluation import evaluate

    found = evaluate(networks, test, split="all", baselines=rivals, period=period).methods
    answer: dict[str, Any] = {
        name: [one.tracks["velocity"].percent for one in method.scores][:MISSIONS]
        for name, method in found.items()
        if name != "floor"
    }
    return {**answer, "surge_mse": found["network"].figures["surge_mse"]}


def vehicle_scores(
    vehicle: str, seed: int, folder: Path, preset: str, seconds: float, tests: tuple[str, ...]
) -> dict[str, dict[str, list[float]]]:
    """Errors [%] of all methods by test, and the seconds of processor that the fit took."""
    from learn.api import fit
    from learn.run import open_run
    from learn.shipped import shipped_run
    from twin.records.reader import MissionStore

    common = {"vehicle": vehicle, "preset": preset}
    own = store(folder / f"{vehicle}-{preset}-{seed}.zarr", None, seed=7100 + seed, **common)
    with MissionStore(own) as reader:
        start, _ = shipped_run(reader.vehicle, reader.period)
        known = reader.vehicle
    place = folder / "runs" / f"{vehicle}-{preset}-{seed}-{seconds:g}s"

    def train() -> dict[str, Any]:
        begun = time.process_time()
        fit(own, folder=place, resume=True, start=start.folder, seconds=seconds, seed=seed,
            workers=1, report=False, say=lambda text: print(text, file=sys.stderr))  # fmt: skip
        return {"seconds": time.process_time() - begun}

    cost = kept(folder / f"{place.name}.json", train)
    run = open_run(place)
    answer: dict[str, Any] = {"fit": cost}
    for test in tests:
        changes = HEAVY if test == "heavy" else {}
        unseen = store(folder / f"{vehicle}-{preset}-{test}-{seed}.zarr", MISSIONS,
                       seed=8100 + seed, changes=changes, **common)  # fmt: skip
        name = f"{vehicle}-{preset}-{test}-{seed}"
        judge = functools.partial(judged, test=unseen, period=run.period)
        zero = kept(
            folder / f"{name}-shipped.json",
            functools.partial(judge, start.networks(known), rivals=RIVALS),
        )
        after = kept(
            folder / f"{name}-fitted-{seconds:g}s.json",
            functools.partial(judge, run.networks(known), rivals=()),
        )
        answer[test] = {**{n: v for n, v in zero.items() if n in RIVALS},
                        "shipped": zero["network"], "fitted": after["network"]}  # fmt: skip
    return answer


def row(vehicle: str, test: str, each: Mapping[str, Array]) -> dict[str, Any]:
    """Table row: best rival, and each network's error and ratio with its interval."""
    means = {name: float(values.mean()) for name, values in each.items()}
    rivals = [name for name in RIVALS if name in means]
    line: dict[str, Any] = {"vehicle": vehicle, "missions": test}
    line |= {name: round(means[name], 3) for name in rivals}
    best = min(rivals, key=lambda name: means[name]) if rivals else None
    for name, title in NETWORKS.items():
        line[title] = round(means[name], 3)
        if best is not None:
            low, high = interval(each[name], each[best])
            line[f"{title} / best"] = f"{means[name] / means[best]:.2f} ({low:.2f} to {high:.2f})"
    return line


def main(
    *,
    vehicles: tuple[str, ...] = ("glider", "slocum-200", "seaglider", "spray"),
    seeds: int = 1,
    heavy: bool = False,
    seconds: float = 30.0,
    preset: str = "field",
    folder: Path = Path("data/first_try"),
    json: bool = False,
) -> None:
    """Print errors and ratios.

    Args:
      seeds: numbers of training stores, fits and unseen stores per vehicle.
      heavy: also judge on hulls with 40 % more drag.
      seconds: training time of each network.
    """
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    lines = []
    tests = ("unseen", *(["heavy"] if heavy else []))
    for vehicle in vehicles:
        found = [vehicle_scores(vehicle, s, folder, preset, seconds, tests) for s in range(seeds)]
        for test in tests:
            each = {
                name: np.concatenate([one[test][name] for one in found]) for name in found[0][test]
            }
            lines.append(row(vehicle, test, each))
            lines[-1]["fit [s]"] = round(
                float(np.mean([one["fit"]["seconds"] for one in found])), 1
            )
            print(files.dumps(lines[-1]), file=sys.stderr, flush=True)
    command.say(lines, lines, json=json)


if __name__ == "__main__":
    sys.exit(command.run(main))
