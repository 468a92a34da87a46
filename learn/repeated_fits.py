"""Repeated fits: the same networks trained with other seeds, or without one sensor at a time."""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Callable, Mapping
from typing import Any

from learn.files import read_sealed, write_sealed
from learn.run import ABLATION, SEEDS, Run
from learn.run_evaluation import evaluation_split, judge
from learn.training.fit_config import FitConfig
from learn.training.fitting import TrainingStart, Watch, fit_each
from learn.training.resources import Resources
from twin.cli.console import to_json
from twin.errors import quoted
from twin.navigation.features import SENSORS, features_of

FIGURES = {
    "surge_mse": "surge MSE [(m/s)²]",
    "sway_mse": "sway MSE [(m/s)²]",
    "dr_water_percent_mean": "through the water [%]",
    "dr_ground_percent_mean": "over ground [%]",
}
"""What is compared, with its title in a table"""


@dataclasses.dataclass(frozen=True)
class Seeds:
    """Figures of runs that differ by their seed alone."""

    figures: Mapping[int, Mapping[str, float | None]]
    """Of `FIGURES`, by seed; None where missions do not define one"""

    def spread(self, name: str) -> tuple[float, float] | None:
        """Mean and standard deviation of a figure over the seeds; None where it is not known."""
        values = [v for found in self.figures.values() if (v := found[name]) is not None]
        if len(values) < 2:
            return None
        return statistics.fmean(values), statistics.stdev(values)

    def rows(self) -> list[dict[str, object]]:
        """For a table: every seed, then mean and standard deviation."""
        shown = [name for name in FIGURES if self.spread(name) is not None]
        rows: list[dict[str, object]] = [
            {"seed": str(seed), **{FIGURES[name]: found[name] for name in shown}}
            for seed, found in self.figures.items()
        ]
        for k, title in enumerate(("mean", "standard deviation")):
            row: dict[str, object] = {"seed": title}
            for name in shown:
                both = self.spread(name)
                assert both is not None
                row[FIGURES[name]] = both[k]
            rows.append(row)
        return rows

    def to_json(self) -> dict[str, Any]:
        """For programs."""
        spreads = {name: self.spread(name) for name in FIGURES}
        found: dict[str, Any] = to_json(
            {
                "seeds": {str(seed): dict(figures) for seed, figures in self.figures.items()},
                "mean": {name: both[0] for name, both in spreads.items() if both},
                "standard_deviation": {name: both[1] for name, both in spreads.items() if both},
            }
        )
        return found


def other_seeds(config: FitConfig, count: int) -> dict[int, FitConfig]:
    """Settings of the runs beside the first one, by seed; no two networks share one."""
    step = len(config.jobs())
    seeds = [config.training.seed + k * step for k in range(1, count)]
    return {
        seed: dataclasses.replace(config, training=dataclasses.replace(config.training, seed=seed))
        for seed in seeds
    }


def train_seeds(
    run: Run,
    config: FitConfig,
    count: int,
    resources: Resources,
    *,
    watch: Watch | None = None,
) -> Seeds:
    """Train a run with other seeds, in folders of their own inside it, and judge all of them.

    All are trained side by side; what is there already is kept. The figures are written to
    `seeds.json` and returned.

    Args:
      count: runs, the one that is there included.
    """
    split, _ = evaluation_split(run)
    others = other_seeds(config, count)
    starts = [
        TrainingStart(config=one, folder=run.folder / f"seed-{seed}", resume=True)
        for seed, one in others.items()
    ]
    runs = [run, *fit_each(starts, resources, watch=watch)]
    figures = {}
    for seed, one in zip([config.training.seed, *others], runs, strict=True):
        found = judge(one, split).to_json()
        figures[seed] = {name: found[name] for name in FIGURES}
    study = Seeds(figures)
    write_sealed(run.folder / SEEDS, study.to_json())
    return study


def read_seeds(run: Run) -> Seeds | None:
    """The study that a run holds; None without one.

    Raises:
      StoreError: its file is damaged.
    """
    path = run.folder / SEEDS
    if not path.is_file():
        return None
    remedy = f"`learn fit --name {quoted(run.name)} --resume --seeds N` writes it again"
    return Seeds({int(k): v for k, v in read_sealed(path, remedy)["seeds"].items()})


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
        figures[f"without {sensor}"] = to_json(judge(part, split).to_json())
    write_sealed(run.folder / ABLATION, figures)
    return figures
