"""The benchmark's command.

    python -m benchmarks.dead_reckoning --tier family [--methods ema,EKF] [--method MINE.py]
        [--predictions FILE.nc [--labels dvl] [--name NAME]] [--folder WORK] [--logs LOGS]
        [--seed 0] [--seconds 60] [--full] [--test-seed N] [--make [test]]
        [--keep [RESULTS] --who NAME] [--json]

Each method has one seed and at most 60 s of training; `--full` takes five seeds. Stores and runs
stay in the folder: remove it after a change of the code that trains. `--predictions` scores a file
only, without torch or training.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import command
from benchmarks.dead_reckoning import public_logs, results
from benchmarks.dead_reckoning.predictions import LABELS, Predicted, checked, read_predictions
from benchmarks.dead_reckoning.rivals import RIVALS, chosen
from benchmarks.dead_reckoning.scoring import score
from benchmarks.dead_reckoning.tiers import TIERS, Tier
from twin.errors import InputError, TwinError
from twin.records.reader import MissionStore

SEEDS = 5
"""Number of seeds with --full"""
PUBLIC = "public"
Figures = dict[str, dict[str, float]]


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--tier", choices=(*TIERS, PUBLIC), default="family")
    add("--methods", default="", help="names, parted by commas; all, unless --method is given")
    add("--method", type=Path, help="a Python file with predict(), alone or beside --methods")
    add("--predictions", type=Path,
        help="score this file alone; of tier public a folder with one a deployment")  # fmt: skip
    add("--folder", type=Path, default=Path("data/dead_reckoning"))
    add("--logs", type=Path, default=Path("data/public_logs"))
    add("--seed", type=int, default=0)
    add("--seconds", type=float, default=60.0)
    add("--full", action="store_true", help=f"{SEEDS} seeds of training")
    add("--keep", type=Path, nargs="?", const=results.FOLDER,
        help="write the figures into the method's file of results")  # fmt: skip
    add("--make", choices=("all", "test"), nargs="?", const="all",
        help="make the stores, or those of the test alone, and end")  # fmt: skip
    add("--test-seed", type=int, help="other test missions, which nobody has seen")
    add("--labels", choices=LABELS, default="none", help="what --predictions adapted on")
    add("--name", default="", help="of the method of --predictions")
    add("--who", default="", help="whose method it is, for --keep")
    add("--json", action="store_true")
    try:
        return _run(parser.parse_args())
    except (TwinError, OSError) as error:
        print(f"dead_reckoning: error: {error}", file=sys.stderr)
        return 2


def _run(options: argparse.Namespace) -> int:
    if options.keep is not None and not options.who:
        raise InputError("--keep needs --who NAME: a file of results says whose method it is")
    if options.who and options.keep is None:
        raise InputError("--who is for --keep")
    if options.predictions is not None and (options.method or options.methods):
        raise InputError("--predictions is scored alone: leave --method and --methods out")
    if options.keep is not None and options.test_seed is not None:
        raise InputError("--keep is for the tier's own test missions: leave --test-seed out")
    if options.tier == PUBLIC and options.test_seed is not None:
        raise InputError("tier public has no other test missions: leave --test-seed out")
    if options.make:
        for train, test in _stores(options, ("train", "test")[options.make == "test" :]):
            print(f"predict {test}" if options.make == "test" else f"train on {train}, {test}")
        return 0
    methods = _methods(options)
    if not methods:
        raise InputError(f"no method can be judged in tier {options.tier}")
    others = [] if options.tier == PUBLIC else _tier(options).others(_folder(options))
    for line in others:
        print(f"not comparable with published figures: {line}", file=sys.stderr)
    if options.keep is not None:
        if others:
            raise InputError("figures of other stores than the published ones are not kept")
        how = shlex.join(["python", "-m", "benchmarks.dead_reckoning", *sys.argv[1:]])
        own, code = options.method, results.commit()
        for name, found in methods.items():
            if own is None or name == own.stem:
                results.keep(
                    options.keep, name, options.tier, found, who=options.who, how=how, code=code
                )
    told = {"tier": options.tier, "methods": methods}
    command.say(told, results.rows(methods), json=options.json)
    if options.json:
        return 0
    count = next(iter(methods.values()))["dives"]["0"]["missions"]
    if options.tier == PUBLIC:
        print(f"{count:.0f} dives, depth and attitude as logged, pitch as the owner corrects it")
    else:
        behind = TIERS[options.tier].dives
        print(f"{count:.0f} missions, scored behind {behind} dives; true attitude")
    return 0


def _methods(options: argparse.Namespace) -> dict[str, Any]:
    """Figures by method: of the chosen methods, or of a file of predictions."""
    if options.predictions is not None:
        name = options.name or options.predictions.stem
        if name in RIVALS:
            raise InputError(f"{name} is the name of a rival: give your method's by --name")
        found = _judged(options, ("test",), lambda _, test: _read(options, test))
        for _, test in _stores(options, ()):
            print(f"scored as predictions of {test}", file=sys.stderr)
        return {name: {"labels": options.labels, "seeds": 1, "dives": found}}
    methods: dict[str, Any] = {}
    seeds = range(options.seed, options.seed + (SEEDS if options.full else 1))
    for name, rival in chosen(options.methods, options.method).items():
        print(f"{name} ...", file=sys.stderr)
        parts = ("train", "test") if rival.trained else ("test",)
        try:
            each = [
                _judged(options, parts, lambda *stores, r=rival, s=seed, n=name: checked(
                    r.predict(*stores, s, options.seconds), n
                ))
                for seed in (seeds if rival.trained else seeds[:1])
            ]  # fmt: skip
        except TwinError as error:
            if options.methods or options.method:
                raise
            print(f"  left out: {error}", file=sys.stderr)
            continue
        methods[name] = {"labels": rival.labels, "seeds": len(each), "dives": _mean(each)}
    return methods


def _tier(options: argparse.Namespace) -> Tier:
    tier = TIERS[options.tier]
    return tier if options.test_seed is None else tier.of_seed(options.test_seed)


def _folder(options: argparse.Namespace) -> Path:
    """Folder of the stores; each seed of the test has its own, with a training store."""
    folder: Path = options.folder / options.tier
    return folder if options.test_seed is None else folder / f"test-{options.test_seed}"


def _stores(options: argparse.Namespace, parts: Sequence[str]) -> list[tuple[Path, Path]]:
    """Stores of training and test; the stores of `parts` are made if they are missing."""
    if options.tier == PUBLIC:
        work = options.folder / PUBLIC
        return [one.make(options.logs, work, parts) for one in public_logs.deployments()]
    tier, folder = _tier(options), _folder(options)
    train, _ = tier.make(options.folder / options.tier, [p for p in parts if p == "train"])
    _, test = tier.make(folder, [p for p in parts if p == "test"])
    return [(train, test)]


def _judged(
    options: argparse.Namespace, parts: Sequence[str], predict: Callable[[Path, Path], Predicted]
) -> Figures:
    """Score what `predict` returns for a training and a test store: figures by dives adapted on."""
    stores = _stores(options, parts)
    if options.tier != PUBLIC:
        return score(stores[0][1], TIERS[options.tier].dives, predict(*stores[0]))
    return public_logs.figures(
        {
            one.name: public_logs.dive_errors(one, options.logs, test, predict(train, test)[0])
            for one, (train, test) in zip(public_logs.deployments(), stores, strict=True)
        }
    )


def _read(options: argparse.Namespace, test: Path) -> Predicted:
    """Read the predictions for a test store from a file."""
    path: Path = options.predictions
    with MissionStore(test) as reader:
        period = reader.period
    if options.tier != PUBLIC:
        return read_predictions(path, period)
    name = test.parent.name
    if not path.is_dir():
        raise InputError(f"--predictions {path}: give a folder with {name}.nc or {name}.csv")
    own = next((f for f in (path / f"{name}.nc", path / f"{name}.csv") if f.exists()), None)
    if own is None:
        raise InputError(f"{path} has no {name}.nc or {name}.csv")
    return read_predictions(own, period)


def _mean(each: list[Figures]) -> Figures:
    """Mean, lowest and highest figure of the seeds; the interval holds all their intervals."""
    found = {}
    for key in each[0]:
        rows = [one[key] for one in each]
        mean = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
        mean |= {"low": min(r["low"] for r in rows), "high": max(r["high"] for r in rows)}
        if len(rows) > 1:
            percent = [row["dr_velocity_percent"] for row in rows]
            mean |= {"least": min(percent), "most": max(percent)}
        found[key] = mean
    return found


if __name__ == "__main__":
    raise SystemExit(main())
