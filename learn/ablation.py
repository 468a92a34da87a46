"""Ablation: the same networks with one group of inputs less at a time."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any

from learn.evaluate import evaluate
from learn.features import GROUPS
from learn.fit import FitConfig, Watch, fit
from learn.judge import judged_split
from learn.run import ABLATION, Run
from twin.console import to_json


def masked(config: FitConfig) -> dict[str, FitConfig]:
    """Settings without one group each, by the group's name; a group that is all there is stays."""
    found = {}
    for group, names in GROUPS.items():
        left = tuple(name for name in config.features if name not in names)
        if left and left != config.features:
            found[group] = dataclasses.replace(config, features=left)
    return found


def ablate(
    run: Run,
    config: FitConfig,
    *,
    workers: int = 2,
    watch: Watch | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Train a run without each group, in folders of their own inside the run, and judge them.

    What is there already is kept. The figures are written to `ablation.json` and returned.
    """
    split, _ = judged_split(run)
    figures: dict[str, Any] = {}
    for group, settings in masked(config).items():
        say(f"training without {group}")
        part = fit(
            settings, run.path / f"without-{group}", resume=True, workers=workers, watch=watch
        )
        evaluation = evaluate(part.networks(), run.store, split=split, baselines=())
        figures[f"without {group}"] = to_json(evaluation.to_json())
    (run.path / ABLATION).write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return figures
