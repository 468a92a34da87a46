"""Flown mission: what is kept about one besides its signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from factory.recipe.distribution import Value
from factory.recipe.sampling import Parameters


@dataclass(frozen=True, kw_only=True)
class FailedAttempt:
    """An attempt that had to be replaced."""

    attempt: int
    reason: str
    time_s: float | None
    """[s] when the simulation left the finite numbers; None: it never started"""
    values: Mapping[str, Value]
    segments: tuple[Mapping[str, Value], ...]
    """As in `Parameters`"""


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

    def to_json(self) -> dict[str, Any]:
        """JSON types; floats keep every bit."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> FlownMission:
        """The inverse of `to_json`."""
        parameters = data["parameters"]
        return cls(
            mission=data["mission"],
            attempt=data["attempt"],
            samples=data["samples"],
            parameters=Parameters(**{**parameters, "segments": tuple(parameters["segments"])}),
            sensors=data["sensors"],
            failures=tuple(
                FailedAttempt(**{**failure, "segments": tuple(failure["segments"])})
                for failure in data["failures"]
            ),
        )
