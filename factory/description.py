"""Info: what a store holds, complete or not."""

from __future__ import annotations

import datetime
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from factory.generation.generated_store import GeneratedStore
from factory.generation.job import missions_kept
from factory.generation.target import unfinished_settings
from twin.errors import StoreError
from twin.records.attributes import DURATION, SPLITS
from twin.records.logged import LogStore
from twin.records.presence import is_unfinished
from twin.records.storage.object_storage import files_at
from twin.records.storage.store_path import StorePath


@dataclass(frozen=True, kw_only=True)
class Unfinished:
    """A store that a run has begun and not completed."""

    store: StorePath
    settings: dict[str, Any]
    missions_kept: int


def unfinished(path: StorePath) -> Unfinished | None:
    """What an unfinished store holds so far; None when the store is complete or no store."""
    if not is_unfinished(path):
        return None
    for folder, settings in unfinished_settings(path):
        return Unfinished(store=path, settings=settings, missions_kept=missions_kept(folder))
    raise StoreError(
        f"store {path} was begun by an older glider-twin and is incomplete: `factory generate "
        "--overwrite` starts again"
    )


def drawn_rows(run: GeneratedStore) -> list[dict[str, object]]:
    """One row for each drawn parameter: its distribution beside what was drawn."""
    rows: list[dict[str, object]] = []
    for name, parameter in run.table.items():
        if parameter.variable not in run:
            continue
        values = run.array(parameter.variable).ravel()
        meanings = run.flags(parameter.variable)
        row: dict[str, object] = {"parameter": name, "unit": parameter.unit}
        row["distribution"] = run.distributions[name].text()
        if meanings:
            counts = Counter(meanings[int(value)] for value in values if value >= 0)
            row["drawn"] = ", ".join(
                f"{counts[word]} {word}" for word in meanings.values() if counts[word]
            )
        else:
            finite = values[np.isfinite(values)]
            row |= {
                "n": int(finite.size),
                "least": float(finite.min()),
                "mean": float(finite.mean()),
                "most": float(finite.max()),
            }
        rows.append(row)
    return rows


def split_rows(run: GeneratedStore) -> list[dict[str, object]]:
    """Missions and hours of each split."""
    hours = run.array(DURATION) / 3600.0
    return [
        {
            "split": split,
            "missions": run.splits.count(split),
            "hours": float(sum(h for h, s in zip(hours, run.splits, strict=True) if s == split)),
        }
        for split in SPLITS
        if split in run.splits
    ]


def deployment_rows(logs: LogStore) -> list[dict[str, object]]:
    """Dives, time, place and depth of each deployment."""
    rows: list[dict[str, object]] = []
    for deployment in dict.fromkeys(logs.deployments):
        missions = logs.missions_of(deployment)
        first, last = missions[0], missions[-1]
        begin, end = (
            datetime.datetime.fromtimestamp(float(unix), datetime.UTC)
            for unix in (logs.starts[first], logs.time(last)[-1])
        )
        depths = np.concatenate([logs.signal("measured_depth", k) for k in missions])
        deepest = float(np.nanmax(depths)) if np.isfinite(depths).any() else None
        fixed = [logs.fixes(k)[0] for k in missions if np.isfinite(logs.fixes(k)[0]).all()]
        splits = [logs.splits[k] for k in missions]
        rows.append(
            {
                "deployment": deployment,
                "dives": len(missions),
                "from [UTC]": f"{begin:%Y-%m-%d %H:%M}",
                "to [UTC]": f"{end:%Y-%m-%d %H:%M}",
                "latitude": f"{np.mean([fix[0] for fix in fixed]):.3f}" if fixed else None,
                "longitude": f"{np.mean([fix[1] for fix in fixed]):.3f}" if fixed else None,
                "deepest [m]": deepest,
                " / ".join(SPLITS): "/".join(str(splits.count(name)) for name in SPLITS),
            }
        )
    return rows


def stored_bytes(path: StorePath) -> int:
    """Size of all files of a store."""
    try:
        return files_at(path).stored_bytes()
    except OSError as error:
        raise StoreError(f"cannot read {path}: {error.strerror or error}") from error
