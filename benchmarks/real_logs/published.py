"""Published figures: what public methods reach on these deployments, from `published.toml`."""

from __future__ import annotations

import functools
import tomllib
from pathlib import Path
from typing import Any

from benchmarks.real_logs.row import Row

FIGURES = Path(__file__).with_name("published.toml")


@functools.cache
def figures() -> tuple[dict[str, Any], ...]:
    """Every entry of the file."""
    return tuple(tomllib.loads(FIGURES.read_text(encoding="utf-8"))["figure"])


def published_rows(task: str, deployment: str) -> list[Row]:
    """Rows of a task and a deployment, which is known by the beginning of its name."""
    return [
        Row(
            task=task,
            data=deployment,
            method=f"{entry['method']}, on other samples",
            kind="published",
            value=entry["value"],
            unit=entry["unit"],
            note=entry["source"],
        )
        for entry in figures()
        if entry["task"] == task and deployment.lower().startswith(entry["deployment"])
    ]
