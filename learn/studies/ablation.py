"""Ablation: the same networks for a vehicle that lacks one sensor at a time."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from learn.evaluation.evaluation import evaluate
from learn.files import write_sealed
from learn.runs.run import ABLATION, Run
from learn.studies.run_evaluation import evaluation_split
from learn.training.fitting import TrainingStart, Watch, fit_each
from learn.training.resources import Resources
from learn.training.settings import FitConfig
from twin.cli.console import to_json
from twin.navigation.features import SENSORS, features_of


def masked(config: FitConfig) -> dict[str, FitConfig]:
    """Settings without each sensor (`SENSORS`) that the inputs read, by its name."""
    found = {}
    for sensor in SENSORS:
        lost = features_of(sensor, config.features)
        left = tuple(name for name in config.features if name not in lost)
        if left and left != config.features:
            found[sensor] = dataclasses.replace(config, features=left)
    return found


def ablate(
    run: Run,
    config: FitConfig,
    resources: Resources,
    *,
    watch: Watch | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Train a run without each sensor, in folders of their own inside the run, and judge them.

    All are trained side by side; what is there already is kept. The figures are written to
    `ablation.json` and returned.
    """
    split, _ = evaluation_split(run)
    settings = masked(config)
    say(f"training without {', without '.join(settings)}")
    starts = [
        TrainingStart(config=one, folder=run.folder / f"without-{sensor}", resume=True)
        for sensor, one in settings.items()
    ]
    figures: dict[str, Any] = {}
    for sensor, part in zip(settings, fit_each(starts, resources, watch=watch), strict=True):
        evaluation = evaluate(
            part.networks(), run.store, split=split, baselines=(), period=run.period
        )
        figures[f"without {sensor}"] = to_json(evaluation.to_json())
    write_sealed(run.folder / ABLATION, figures)
    return figures
