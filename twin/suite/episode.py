"""Episode: what a task draws before an episode begins."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from twin.physics.start import Start
from twin.water.current.base import Current


@dataclasses.dataclass(frozen=True, kw_only=True)
class Episode:
    """One draw of a task."""

    start: Start
    """Where and how the vehicle begins."""
    goal: Mapping[str, Any]
    """What to reach, by the names of `GliderTask.goals`."""
    current: Current | None = None
    """A steady current that belongs to the task; None: it brings none."""
