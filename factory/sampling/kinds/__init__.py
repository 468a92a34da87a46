"""Kinds of mission segments that the factory draws: one file a kind, and a registry.

A kind says which vehicles fly it, which parameters it uses, how long it lasts at least, and which
segment of `twin.mission` guidance is given. `register` adds one of one's own.
"""

from __future__ import annotations

from factory.sampling.kinds.base import MISSION_KINDS, MissionKind, kinds_for, register

__all__ = ["MISSION_KINDS", "MissionKind", "kinds_for", "register"]
