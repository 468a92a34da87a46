"""Camera labels: errors of networks that learned from a camera, beside the truth and a Doppler log.

    python -m benchmarks.camera_labels FOLDER [--hours 2] [--seeds 5] [--epochs 12]

One store of an ROV in still water trains all: `factory generate --preset rov --labels camera`. The
Doppler log is the one of the preset; only its water lock gives labels, for about half of the time.
Each seed trains the same networks three times, and each is judged by the truth of missions that
none has seen. What is in FOLDER is not made again, so the command goes on after an interruption.
The intervals are bootstrapped over the missions, seeds together.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import factory
import learn
from benchmarks import command
from twin.records import MissionStore

Array = NDArray[np.float64]
SOURCES: dict[str, dict[str, str]] = {
    "truth": {},
    "camera": {"labels": "camera", "known_current": "0,0"},
    "dvl": {"labels": "dvl"},
}
"""Settings of `learn fit` for each source of labels"""
DRAWS = 2000


def errors(run: learn.Run, store: Path) -> dict[str, list[list[float]]]:
    """Sum of squared errors and number of samples of each mission, by target."""
    found: dict[str, list[list[float]]] = {"surge": [], "sway": []}
    with MissionStore(store) as reader:
        for one in run.predict(store):
            for target, sums in found.items():
                true = reader.dataset[f"true_{target}"][one.mission].values[: len(one.time)]
                away = getattr(one, target) - true
                sums.append([float(np.nansum(away**2)), int(np.isfinite(away).sum())])
    return found


def rms(sums: Array) -> float:
    """[m/s] Root mean square of squared errors and counts, (..., 2)."""
    return float(np.sqrt(sums[..., 0].sum() / sums[..., 1].sum()))


def rows(results: dict[str, Any], seeds: int) -> list[dict[str, Any]]:
    """Table: error by source and target, and its ratio to the error of the truth's networks."""
    rng = np.random.default_rng(0)
    found = []
    for target in ("surge", "sway"):
        every = {
            name: np.array([results[f"{name}-{k}"][target] for k in range(seeds)])
            for name in SOURCES
        }
        for name, sums in every.items():
            draws = rng.integers(sums.shape[1], size=(DRAWS, sums.shape[1]))
            ratios = [rms(sums[:, one]) / rms(every["truth"][:, one]) for one in draws]
            low, high = np.quantile(ratios, (0.025, 0.975))
            each = [rms(one) for one in sums]
            found.append({
                "target": target, "labels": name, "RMSE m/s": rms(sums),
                "seeds": f"{min(each):.4f} to {max(each):.4f}",
                "over truth's": f"{rms(sums) / rms(every['truth']):.3f} ({low:.3f} to {high:.3f})",
            })  # fmt: skip
    return found


def main(
    folder: command.Positional[Path],
    hours: float = 2.0,
    unseen_hours: float = 1.0,
    seeds: int = 5,
    epochs: int = 12,
    json_: bool = False,
) -> None:
    """Train, judge, print.

    Args:
      folder: stores, runs and results.
      hours: [h] missions for training and validation.
      unseen_hours: [h] missions that judge.
      seeds: number of trainings of each source.
      epochs: passes over the training missions.
      json_: print JSON.
    """
    folder.mkdir(parents=True, exist_ok=True)
    common: dict[str, Any] = {"preset": "rov", "vehicle": "bluerov2", "resume": True, "workers": 1}
    still = {"current.speed": 0.0}
    train, unseen, kept = folder / "train.zarr", folder / "unseen.zarr", folder / "results.json"
    factory.generate(
        train, hours=hours, seed=11, changes=still, sensors="survey-field+camera", **common
    )
    factory.generate(unseen, hours=unseen_hours, seed=12, changes=still, **common)
    results: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() else {}
    done = 0
    for seed in range(seeds):
        for name, labels in SOURCES.items():
            key = f"{name}-{seed}"
            if key not in results:
                run = learn.fit(
                    train, folder=folder / key, resume=True, report=False, members=1, mirror=False,
                    seed=seed, epochs=epochs, **labels,
                )  # fmt: skip
                results[key] = errors(run, unseen)
                kept.write_text(json.dumps(results))
            print(key, {t: rms(np.array(v)) for t, v in results[key].items()}, flush=True)
        done = seed + 1
        command.say(results, rows(results, done), json=json_)


if __name__ == "__main__":
    sys.exit(command.run(main))
