"""Noticed: what a pilot must know of, one JSON object a line, in `events.jsonl`.

A function of the files and the settings, as the beliefs are: an alarm has the times of its dives,
not that of the pass which found it. What is no longer so, such as a file that has been sent again,
is no longer there.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from glider_twin_ops.health import DeploymentHealth
from glider_twin_ops.watching.log_of_files import LogOfFiles
from twin.records import whole_file
from twin.show.dates import moment_of

EVENTS = "events.jsonl"


def noticed(log: LogOfFiles, health: DeploymentHealth | None) -> list[dict[str, Any]]:
    """Files that cannot be read or end too early, and an alarm with what it may be instead."""
    found: list[dict[str, Any]] = [
        {"event": "unreadable file", "says": said} for said in log.unreadable
    ]
    found += [{"event": "short file", "says": said} for said in log.short]
    if log.missing:
        found.append({"event": "nothing to import", "says": log.missing})
    if health is not None and health.alarm:
        first = health.kinds[0]
        noticed_at = health.dives.index(health.noticed_dive)
        found.append(
            {
                "event": "alarm",
                "kind": first.kind,
                "says": first.says,
                "since_dive": health.since_dive,
                "noticed_dive": health.noticed_dive,
                "noticed": f"{moment_of(float(health.time[noticed_at])):%Y-%m-%dT%H:%MZ}",
                "probability": round(health.probability, 6),
                "size": round(first.size, 6),
                "size_deviation": round(first.size_deviation, 6),
                "unit": first.unit,
                "dives": list(first.dives),
                "channels": list(first.channels),
                "also": list(first.also),
                "otherwise": first.otherwise,
                "find_out": first.find_out,
            }
        )
    return found


def write_events(events: Sequence[dict[str, Any]], folder: Path) -> Path:
    """Write `folder/events.jsonl`, empty where nothing was noticed.

    Raises:
      WriteError: the disk refuses.
    """
    path = folder / EVENTS
    text = "".join(json.dumps(event, sort_keys=True) + "\n" for event in events)
    with whole_file(path) as place:
        place.write_text(text, encoding="utf-8")
    return path
