"""The registry of mission segments, and what a kind must have to be one."""

from __future__ import annotations

import dataclasses

from twin.errors import MissionError
from twin.mission.segments.base import Segment
from twin.registry import Registry


def _lacks(kind: type[Segment]) -> str:
    """What a kind of segment lacks."""
    if not dataclasses.is_dataclass(kind):
        return "`@dataclass(frozen=True, kw_only=True)`: its fields are the keys of mission files"
    for name in ("row", "expected"):
        if getattr(kind, name) is getattr(Segment, name):
            return f"the method `{name}`"
    return ""


def _check(name: str, kind: object) -> type[Segment]:
    if not (isinstance(kind, type) and issubclass(kind, Segment)):
        raise MissionError(
            f"{kind!r} cannot be registered as a kind of segment: derive it from "
            f"{Segment.__module__}.{Segment.__name__}"
        )
    if kind.kind != name:
        raise MissionError(
            f"kind of segment {name!r}: the class {kind.__name__} calls itself {kind.kind!r}"
        )
    lacks = _lacks(kind)
    if lacks:
        raise MissionError(f"the kind of segment {name!r} is only half there: it lacks {lacks}")
    return kind


SEGMENTS: Registry[type[Segment]] = Registry(
    "kind of segment",
    group="glider_twin.segments",
    shipped={
        "saw-tooth": "twin.mission.segments.saw_tooth:SawTooth",
        "spiral": "twin.mission.segments.spiral:Spiral",
        "surface": "twin.mission.segments.surface:Surface",
        "hold": "twin.mission.segments.hold:Hold",
    },
    check=_check,
    name="kind",
)
"""Every kind of segment, by name."""

register = SEGMENTS.add
"""Add a kind of one's own; usable as a decorator."""
