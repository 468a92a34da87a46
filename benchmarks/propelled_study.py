"""Propelled study, the paper's first: networks trained on a Doppler log, on unseen missions.

    python -m benchmarks.propelled_study TRAIN --test STORE [--seeds 5] [--seconds 120]
        [--network elman] [--hidden 40] [--known-current 0,0] [--smoothing gaussian]
        [--window 128] [--washin 48] [--runs FOLDER] [--workers 2] [--json]

For every seed `learn fit` trains one network for surge and one for sway on the log of TRAIN,
`--seconds` of computing each, three layers of `--hidden` units. `--known-current` is subtracted
from bottom track. Each pair runs free over every mission of STORE. Printed are mean squared errors
against the truth, and dead reckoning with measured attitude, without a Doppler log, in % of the
distance through the water; with them DVL-aided dead reckoning and the true velocities.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
from json import dumps
from pathlib import Path
from typing import Any

import learn
from benchmarks import command
from learn.training.fitting import fit

PAPER = {"surge_mse": 0.0347, "sway_mse": 0.00588}
"""[(m/s)^2] Mean squared errors of the paper's networks for Tethys"""
FIGURES = {
    "surge_mse": "surge MSE [(m/s)^2]",
    "sway_mse": "sway MSE [(m/s)^2]",
    "dr_water_percent_mean": "through the water, mean [%]",
    "dr_water_percent_max": "through the water, worst mission [%]",
    "dr_velocity_percent_mean": "the same with true attitude, mean [%]",
    "from_dvl_percent_mean": "from the DVL-aided track, mean [%]",
    "dvl_surge_mse": "surge from the log's labels, MSE [(m/s)^2]",
    "dvl_sway_mse": "sway from the log's labels, MSE [(m/s)^2]",
}


def judge(run: Any, store: str) -> dict[str, Any]:
    """Figures of one run, of the log and of the true velocities."""
    found = learn.evaluate(run, store, split="all", baselines=("dvl",))
    figures = found.figures
    worst = {
        name: max(s.tracks[track].percent for s in found.evaluation.methods[name].scores)
        for name, track in (("network", "water"), ("floor", "water"), ("dvl", "ground"))
    }
    beside, dvl, floor = figures["against_dvl"], figures["baselines"]["dvl"], figures["floor"]
    return {
        **{name: figures[name] for name in FIGURES if name in figures},
        "dr_water_percent_max": worst["network"],
        "from_dvl_percent_mean": beside["dr_percent_mean"],
        "dvl_surge_mse": beside["surge_mse"],
        "dvl_sway_mse": beside["sway_mse"],
        "missions": figures["missions"],
        "dvl_aided": (dvl["dr_ground_percent_mean"], worst["dvl"]),
        "floor": (floor["dr_water_percent_mean"], worst["floor"]),
        "floor_ground": floor["dr_ground_percent_mean"],
    }


def show(results: list[dict[str, Any]]) -> None:
    """Print each figure's median (lowest to highest) over the seeds, with the comparisons."""
    first = results[0]
    print(f"{first['missions']} missions, {len(results)} seeds: median (lowest to highest)")
    for name, words in FIGURES.items():
        values = [r[name] for r in results]
        low, high = min(values), max(values)
        line = f"{words:42s} {statistics.median(values):.3g} ({low:.3g} to {high:.3g})"
        if name in PAPER:
            line += f"; a tenth of the paper's is {PAPER[name] / 10:.3g}"
        print(line)
    for words, key in (("DVL-aided, over ground [%]", "dvl_aided"), ("true velocities", "floor")):
        print(f"{words:42s} mean {first[key][0]:.3g}, worst mission {first[key][1]:.3g}")
    print(f"{'true velocities, over ground [%]':42s} mean {first['floor_ground']:.3g}")


def main(
    train: command.Positional[str],
    *,
    test: str,
    seeds: int = 5,
    seconds: float = 120.0,
    network: str = "elman",
    hidden: int = 40,
    known_current: str = "0,0",
    smoothing: str = "gaussian",
    window: int | None = None,
    washin: int | None = None,
    runs: Path | None = None,
    workers: int = min(2, len(os.sched_getaffinity(0))),
    json: bool = False,
) -> None:
    """Train and judge every seed, and print the figures.

    Args:
      train: store with a split, whose missions have a Doppler log.
      test: store of unseen missions.
      seconds: computing time of each network.
      network: network type; the paper's by default.
      hidden: units per layer.
      known_current: none, store or NORTH,EAST [m/s].
      window: samples of a training window.
      washin: warm-up samples before it, which are not scored.
      runs: folder that keeps the runs; existing runs are continued.
      json: print every seed as one JSON line.
    """
    os.environ["OMP_NUM_THREADS"] = "1"  # inherited by the workers: one thread each
    results: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as temporary:
        for seed in range(seeds):
            config = learn.fit_settings(
                train, network=network, hidden=hidden, seconds=seconds, window=window,
                washin=washin, members=1, seed=1000 * seed, labels="dvl",
                known_current=known_current, smoothing=smoothing,
            )  # fmt: skip
            folder = (runs or Path(temporary)) / f"seed-{seed}"
            run = fit(config, folder, workers=workers, resume=True)
            if seed == 0:
                print("\n".join(run.label_sentences()), file=sys.stderr)
            results.append({"seed": seed, **judge(run, test)})
            if json:
                print(dumps(results[-1]), flush=True)
            else:
                print(f"{len(results)} of {seeds} seeds", file=sys.stderr)
    if not json:
        show(results)


if __name__ == "__main__":
    sys.exit(command.run(main))
