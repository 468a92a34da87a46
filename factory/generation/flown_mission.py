"""Flown mission: what is kept of a mission beside its signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from factory.recipe.sampling import Parameters


@dataclass(frozen=True, kw_only=True)
class FailedAttempt:
    """An attempt that had to be replaced."""

    attempt: int
    reason: str
    time_s: float | None
    """[s] when the simulation left the finite numbers; None: it never started"""


@dataclass(frozen=True, kw_only=True)
class FlownMission:
    """One mission as it was made."""

    mission: int
    attempt: int
    """the attempt that succeeded, from 0"""
    samples: int
    parameters: Parameters
    sensors: Mapping[str, float]
    """the sensors' constants"""
    failures: tuple[FailedAttempt, ...] = ()
