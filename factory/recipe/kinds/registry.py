"""The registry of the kinds of segments that the factory draws."""

from __future__ import annotations

from factory.recipe.kinds.base import MissionKind
from twin.errors import InputError
from twin.registry import Registry, instance_of
from twin.vehicle.vehicle import Vehicle

GROUP = "glider_twin.mission_kinds"
"""Entry points of installed distributions: NAME = "module:OBJECT"."""
NOUN = "kind of mission"
_is_kind = instance_of(NOUN, MissionKind)


def _complete(name: str, kind: object) -> MissionKind:
    """The kind; raises InputError when it is only half there."""
    found = _is_kind(name, kind)
    for method in ("fits", "shortest_time", "segment"):
        if getattr(type(found), method) is getattr(MissionKind, method):
            raise InputError(f"{NOUN} {name!r} is only half there: it lacks the method {method!r}")
    return found


MISSION_KINDS: Registry[MissionKind] = Registry(
    NOUN,
    group=GROUP,
    shipped={
        "saw-tooth": "factory.recipe.kinds.saw_tooth:SAW_TOOTH",
        "spiral": "factory.recipe.kinds.spiral:SPIRAL",
        "surface": "factory.recipe.kinds.surface:SURFACE",
        "transect": "factory.recipe.kinds.transect:TRANSECT",
        "circle": "factory.recipe.kinds.circle:CIRCLE",
        "lawn-mower": "factory.recipe.kinds.lawn_mower:LAWN_MOWER",
    },
    check=_complete,
)
"""Every kind by name."""

register = MISSION_KINDS.add
"""Add a kind of one's own."""


def kinds_for(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the kinds that a vehicle can fly; stores keep their positions."""
    return tuple(name for name, kind in MISSION_KINDS.items() if kind.fits(vehicle))
