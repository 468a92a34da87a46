"""Folds: networks trained without one dive or deployment at a time, each judged on what it lacked.

Beside the networks stand two that need no inputs: the mean over what they were trained on, and the
best constant, which is the mean of what is judged and which nobody can know before.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from learn.data.dataset import TARGETS, MissionSequence, load_missions
from learn.data.labels import LabelConfig
from learn.data.logs import SPEED
from learn.files import read_sealed, write_sealed
from learn.run import Run
from learn.training.fit_config import FitConfig
from learn.training.fitting import TrainingStart, Watch, fit_each
from learn.training.resources import Resources
from twin.cli.console import to_json
from twin.errors import InputError, quoted
from twin.navigation.features import channels_of
from twin.navigation.flight_filter import HULLS
from twin.records.reader import MissionStore

Unit = Literal["dive", "deployment"]
LEAST: dict[Unit, int] = {"dive": 3, "deployment": 2}
"""One to judge, one to validate, one to train; two deployments have dives enough for that."""
METHODS = ("network", "training_mean", "own_mean")


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoldErrors:
    """Sums over the samples of one fold whose velocity is known."""

    samples: int
    squared: Mapping[str, float]
    """[(m/s)^2] by method, of `METHODS`"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fold:
    """One dive or deployment, judged by networks that were trained on the others."""

    name: str
    rows: tuple[int, ...]
    errors: Mapping[str, FoldErrors]
    """By velocity: surge, and sway where it is known"""

    @classmethod
    def of(cls, stored: Mapping[str, Any]) -> Fold:
        """From what `Folds.to_json` makes of it."""
        errors = {target: FoldErrors(**found) for target, found in stored["errors"].items()}
        return cls(name=stored["name"], rows=tuple(stored["rows"]), errors=errors)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Folds:
    """All dives or deployments of a store."""

    unit: Unit
    folds: tuple[Fold, ...]

    def rmse(self, target: str, method: str = "network") -> float:
        """[m/s] over all samples whose velocity is known; NaN without any."""
        known = [fold.errors[target] for fold in self.folds if target in fold.errors]
        return _rmse(known, method)

    def rows(self) -> list[dict[str, object]]:
        """For a table: every fold, and all together."""
        folds = [(fold.name, [fold]) for fold in self.folds]
        rows: list[dict[str, object]] = []
        for name, some in [*folds, ("all", list(self.folds))]:
            row: dict[str, object] = {self.unit: name}
            for target in TARGETS:
                known = [fold.errors[target] for fold in some if target in fold.errors]
                if not known:
                    continue
                row.setdefault("samples", sum(one.samples for one in known))
                for method, title in zip(METHODS, _TITLES, strict=True):
                    row[f"{target}, {title}"] = _rmse(known, method)
            rows.append(row)
        return rows

    def sentence(self) -> str:
        """The result in words."""
        known = [t for t in TARGETS if any(t in fold.errors for fold in self.folds)]
        samples = sum(fold.errors[known[0]].samples for fold in self.folds)
        figures = ", ".join(
            f"{target} {self.rmse(target):.3g} m/s RMSE (mean of the others "
            f"{self.rmse(target, 'training_mean'):.3g}, best constant "
            f"{self.rmse(target, 'own_mean'):.3g})"
            for target in known
        )
        return (
            f"Leave one {self.unit} out: {figures}, over {samples} samples of "
            f"{len(self.folds)} {self.unit}s."
        )

    def to_json(self) -> dict[str, Any]:
        """For programs."""
        rmse = {
            f"{target}_rmse{'' if method == 'network' else '_' + method}": self.rmse(target, method)
            for target in TARGETS
            for method in METHODS
            if any(target in fold.errors for fold in self.folds)
        }
        found: dict[str, Any] = to_json({**rmse, "folds": list(self.folds)})
        return found


_TITLES = ("network", "mean of the others", "best constant")


def _rmse(known: Sequence[FoldErrors], method: str) -> float:
    samples = sum(one.samples for one in known)
    return math.sqrt(sum(one.squared[method] for one in known) / samples) if samples else math.nan


def file_name(unit: Unit) -> str:
    """Where a run keeps its folds."""
    return f"leave-out-each-{unit}.json"


def read_folds(run: Run) -> tuple[Folds, ...]:
    """The studies that a run holds.

    Raises:
      StoreError: a file of them is damaged.
    """
    found = []
    for unit in LEAST:
        path = run.folder / file_name(unit)
        if not path.is_file():
            continue
        command = f"learn fit --name {quoted(run.name)} --resume --leave-out-each-{unit}"
        remedy = f"`{command}` writes it again"
        parts = read_sealed(path, remedy)["folds"]
        found.append(Folds(unit=unit, folds=tuple(map(Fold.of, parts))))
    return tuple(found)


def folds_with_labels(config: FitConfig, unit: Unit) -> dict[str, tuple[int, ...]]:
    """Rows of a store of logs whose surge is known, by dive or by deployment.

    Raises:
      InputError: the store is simulated, or too few have it.
    """
    missions = load_missions(config.store, _known_channels(config), split="all")
    known = [
        m for m in missions if m.row is not None and np.isfinite(config.labels.of(m, "surge")).any()
    ]
    found: dict[str, tuple[int, ...]] = {}
    for mission in known:
        assert mission.row is not None
        name = mission.row.deployment if unit == "deployment" else str(mission.index)
        found[name] = (*found.get(name, ()), mission.index)
    if len(found) < LEAST[unit]:
        what = "truth" if config.labels.source == "truth" else "a velocity of their Doppler log"
        raise InputError(
            f"store {config.store} has {len(found)} {unit}s of real logs with {what}; leaving one "
            f"out needs at least {LEAST[unit]}"
        )
    return found


def leave_out_each(
    run: Run,
    config: FitConfig,
    folds: Mapping[str, Sequence[int]],
    resources: Resources,
    *,
    unit: Unit,
    watch: Watch | None = None,
) -> Folds:
    """Train without each dive or deployment, in folders of their own inside the run, and judge it.

    All are trained side by side; what is there already is kept. The figures are written into
    the run, see `file_name`.

    Args:
      folds: rows of the store by name, see `folds_with_labels`.
    """
    found = []
    every = [*channels_of(config.features), *_known_channels(config)]
    missions = load_missions(
        config.store, every, split="all", period=config.period, spread=HULLS[config.hulls]
    )
    starts = [
        TrainingStart(
            config=dataclasses.replace(config, held_out=tuple(rows)),
            folder=run.folder / f"without-{name}",
            resume=True,
        )
        for name, rows in folds.items()
    ]
    parts = fit_each(starts, resources, watch=watch)
    for (name, rows), part in zip(folds.items(), parts, strict=True):
        networks = part.networks()
        judged = [m for m in missions if m.index in rows]
        others = [m for group in folds.values() for m in missions if m.index in group]
        others = [m for m in others if m.index not in rows]
        errors = {}
        for target in TARGETS:
            truth = _velocities(judged, target, config.labels)
            known = np.isfinite(truth)
            if not known.any():
                continue
            means = [np.asarray(mean, float) for mean, _ in networks[target].predict(judged)]
            trained = float(np.nanmean(_velocities(others, target, config.labels)))
            guesses = (np.concatenate(means), trained, float(truth[known].mean()))
            errors[target] = FoldErrors(
                samples=int(known.sum()),
                squared={
                    method: float(np.square((guess - truth)[known]).sum())
                    for method, guess in zip(METHODS, guesses, strict=True)
                },
            )
        found.append(Fold(name=name, rows=tuple(rows), errors=errors))
    study = Folds(unit=unit, folds=tuple(found))
    write_sealed(run.folder / file_name(unit), study.to_json())
    return study


def _velocities(missions: Sequence[MissionSequence], target: str, labels: LabelConfig) -> Any:
    """What is known of a velocity [m/s] in these rows, one after the other; NaN elsewhere.

    A log that has a speed through the water alone teaches a sway of zero, but is not judged by it.
    """
    values = []
    for m in missions:
        known = labels.source == "dvl" or target == "surge" or TARGETS[target] in m.signals
        values.append(np.asarray(labels.of(m, target)) if known else np.full(m.samples, np.nan))
    return np.concatenate(values).astype(float)


def _known_channels(config: FitConfig) -> list[str]:
    """Channels that velocities are known from; a simulated store has both true ones."""
    if config.labels.source == "dvl":
        return list(config.labels.channels())
    with MissionStore(config.store) as reader:
        names = (*TARGETS.values(), SPEED) if reader.logged else tuple(TARGETS.values())
        found = [name for name in names if name in reader]
    if not found:
        raise InputError(f"store {config.store} has no truth (none of {', '.join(names)})")
    return found
