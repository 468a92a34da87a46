"""Info: what a store holds, complete or not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from factory.journal import Journal
from factory.parameters import PARAMETERS
from factory.plan import SPLITS
from factory.stored import StoredRun
from twin.errors import StoreError
from twin.store import UNFINISHED, open_store


@dataclass(frozen=True, kw_only=True)
class Unfinished:
    """A store that a run has begun and not completed."""

    store: Path
    settings: dict[str, Any]
    missions_kept: int


def is_log_store(path: Path) -> bool:
    """True for a store that `factory import` wrote."""
    if not (path / "zarr.json").is_file():
        return False
    return "import_report" in open_store(path).attrs


def unfinished(path: Path) -> Unfinished | None:
    """What an unfinished store holds so far; None when the store is complete or no store."""
    if (path / "zarr.json").is_file() or not (path / UNFINISHED).is_dir():
        return None
    journal = Journal(path)
    return Unfinished(
        store=path, settings=journal.settings(), missions_kept=journal.count_missions()
    )


def drawn_rows(run: StoredRun) -> list[dict[str, object]]:
    """One row for each drawn parameter: its distribution beside what was drawn."""
    rows: list[dict[str, object]] = []
    for name, parameter in PARAMETERS.items():
        if parameter.variable not in run.dataset:
            continue
        values = run.small(parameter.variable).ravel()
        meanings = run.dataset[parameter.variable].attrs.get("flag_meanings")
        row: dict[str, object] = {"parameter": name, "unit": parameter.unit}
        row["distribution"] = run.distributions[name].text()
        if meanings is not None:
            words = str(meanings).split()
            counts = Counter(words[int(value)] for value in values if value >= 0)
            row["drawn"] = ", ".join(f"{counts[word]} {word}" for word in words if counts[word])
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


def split_rows(run: StoredRun) -> list[dict[str, object]]:
    """Missions and hours of each split."""
    hours = run.small("duration") / 3600.0
    return [
        {
            "split": split,
            "missions": run.splits.count(split),
            "hours": float(sum(h for h, s in zip(hours, run.splits, strict=True) if s == split)),
        }
        for split in SPLITS
        if split in run.splits
    ]


def stored_bytes(path: Path) -> int:
    """Size of all files of a store."""
    try:
        return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    except OSError as error:
        raise StoreError(f"cannot read {path}: {error.strerror or error}") from error
