"""The benchmark's command.

    python -m benchmarks.dead_reckoning --tier family [--methods ema,EKF] [--method MINE.py]
        [--predictions FILE.nc] [--folder WORK] [--seed 0] [--seconds 60] [--full] [--json]

One seed and at most 60 s of training a method; `--full` takes five seeds. Stores and runs are made
once in the folder: remove it after a change of the code that trains. `--predictions` scores a file
alone: neither torch nor a training is needed for it.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.dead_reckoning.rivals import chosen
from benchmarks.dead_reckoning.scoring import read_predictions, score
from benchmarks.dead_reckoning.tiers import DIVES, TIERS
from twin.cli.text_table import format_table
from twin.errors import TwinError

SEEDS = 5
"""Of --full"""


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tier", choices=tuple(TIERS), default="family")
    parser.add_argument("--methods", default="", help="names, parted by commas; all without it")
    parser.add_argument("--method", type=Path, help="a Python file with predict()")
    parser.add_argument("--predictions", type=Path, help="score this file alone, .nc or .csv")
    parser.add_argument("--folder", type=Path, default=Path("data/dead_reckoning"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--full", action="store_true", help=f"{SEEDS} seeds of training")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    try:
        return _run(options)
    except TwinError as error:
        print(f"dead_reckoning: error: {error}", file=sys.stderr)
        return 2


def _run(options: argparse.Namespace) -> int:
    tier = TIERS[options.tier]
    train, test = tier.make(options.folder / options.tier)
    methods: dict[str, Any] = {}
    if options.predictions is not None:
        said = read_predictions(options.predictions)
        methods[options.predictions.stem] = {
            "labels": "as its authors say", "dives": score(test, tier.dives, said)
        }  # fmt: skip
    else:
        seeds = range(options.seed, options.seed + (SEEDS if options.full else 1))
        for name, rival in chosen(options.methods, options.method).items():
            print(f"{name} ...", file=sys.stderr)
            each = [
                score(test, tier.dives, rival.predict(train, test, seed, options.seconds))
                for seed in seeds
            ]
            methods[name] = {"labels": rival.labels, "dives": _mean(each)}
    if options.json:
        print(json.dumps({"tier": options.tier, "methods": methods}))
        return 0
    rows = [
        {"method": name, "labels": found["labels"], "dives": dives,
         "dead reckoning, %": f"{one['dr_velocity_percent']:.3f}",
         "95 %": f"{one['low']:.3f} to {one['high']:.3f}", "surge MSE": f"{one['surge_mse']:.2e}",
         "worse": f"{one['worse']:.0f}",
         "within": f"{100.0 * one['within']:.0f} %" if "within" in one else ""}
        for name, found in methods.items()
        for dives, one in found["dives"].items()
        if dives == "0" or found["labels"] != "none"
    ]  # fmt: skip
    print(format_table(rows))
    count = next(iter(methods.values()))["dives"]["0"]["missions"]
    print(f"{count:.0f} missions, scored behind {tier.dives} dives; true attitude")
    return 0


def _mean(each: list[dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    """Means over the seeds; the interval spans theirs."""
    found = {}
    for key in map(str, DIVES):
        rows = [one[key] for one in each]
        mean = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
        mean |= {"low": min(r["low"] for r in rows), "high": max(r["high"] for r in rows)}
        found[key] = mean
    return found


if __name__ == "__main__":
    raise SystemExit(main())
