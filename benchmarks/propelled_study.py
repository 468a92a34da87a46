"""The paper's first study: networks that learn from a Doppler log, on missions they never saw.

    python -m benchmarks.propelled_study TRAIN --test STORE [--seeds 5] [--seconds 120]
        [--network elman] [--hidden 40] [--known-current 0,0] [--smoothing gaussian]
        [--window 128] [--washin 48] [--runs FOLDER] [--workers 2] [--json]

For every seed `learn fit` trains one network for surge and one for sway on what the log of TRAIN
measured, `--seconds` of computing each, three layers of `--hidden` units. Bottom track counts less
`--known-current`. Each pair runs free over every mission of STORE. Printed are mean squared errors
against the truth and dead reckoning with measured attitude, without a Doppler log, in % of the
distance through the water; beside them DVL-aided dead reckoning and the true velocities.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

PAPER = {"surge_mse": 0.0347, "sway_mse": 0.00588}
"""[(m/s)^2] of the paper's networks for Tethys"""
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
    """The figures of one run, and those of the log and of the true velocities."""
    import learn

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


def study(options: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    """Train and judge every seed."""
    import learn
    from learn.training.fitting import fit

    results = []
    for seed in range(options.seeds):
        config = learn.fit_settings(
            options.train,
            network=options.network,
            hidden=options.hidden,
            seconds=options.seconds,
            window=options.window,
            washin=options.washin,
            members=1,
            seed=1000 * seed,
            labels="dvl",
            known_current=options.known_current,
            smoothing=options.smoothing,
        )
        run = fit(config, folder / f"seed-{seed}", workers=options.workers, resume=True)
        if seed == 0:
            print("\n".join(run.label_sentences()), file=sys.stderr)
        results.append({"seed": seed, **judge(run, options.test)})
        if options.json:
            print(json.dumps(results[-1]), flush=True)
        else:
            print(f"{len(results)} of {options.seeds} seeds", file=sys.stderr)
    return results


def show(results: list[dict[str, Any]]) -> None:
    """Each figure's median (lowest to highest) over the seeds, and what stands beside."""
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


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("train", help="store with a split, whose missions have a Doppler log")
    parser.add_argument("--test", required=True, help="store of unseen missions")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument(
        "--seconds", type=float, default=120.0, help="[s] of computing of each network"
    )
    parser.add_argument("--network", default="elman", help="kind; the paper's by default")
    parser.add_argument("--hidden", type=int, default=40, help="units per layer")
    parser.add_argument("--known-current", default="0,0", help="none, store or NORTH,EAST [m/s]")
    parser.add_argument("--smoothing", default="gaussian")
    parser.add_argument("--window", type=int, help="samples of a training piece")
    parser.add_argument("--washin", type=int, help="samples before it that are not scored")
    parser.add_argument("--runs", type=Path, help="keep the runs here; goes on with what is there")
    parser.add_argument("--workers", type=int, default=min(2, len(os.sched_getaffinity(0))))
    parser.add_argument("--json", action="store_true", help="every seed as one JSON line")
    options = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"  # inherited by the workers: one thread each
    with tempfile.TemporaryDirectory() as temporary:
        results = study(options, options.runs or Path(temporary))
    if not options.json:
        show(results)


if __name__ == "__main__":
    main()
