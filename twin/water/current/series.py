"""A current that is the same everywhere and changes with time, given as values at equal steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from twin.errors import CurrentError, unknown_name
from twin.numbers import numbers
from twin.water.current import checks
from twin.water.current.axes import Origin
from twin.water.current.base import Current
from twin.water.current.gauss_markov import smooth_series
from twin.water.current.sampler import Floats


@dataclass(frozen=True, kw_only=True)
class Series(Current):
    """A smooth curve through velocities at equal steps from the start; held after the last.

    The slope at a value is that of its neighbours (Catmull and Rom 1974).
    """

    kind: ClassVar[str] = "series"
    code: ClassVar[int] = 10
    directional: ClassVar[Any] = smooth_series
    depends_on: ClassVar[tuple[str, ...]] = ("time",)
    usage: ClassVar[Mapping[str, str]] = {
        "series:interval=3600,north=0.1/0.2/0.1,east=0/0/0.05": "m/s, so many seconds apart"
    }

    interval: float
    """[s] between two values."""
    north: tuple[float, ...]
    """[m/s] Toward north."""
    east: tuple[float, ...]
    """[m/s] Toward east."""

    def __post_init__(self) -> None:
        interval = checks.finite(self.kind, "interval", self.interval, "s")
        if not interval > 0.0:
            raise CurrentError(f"series: interval must be greater than 0 s, not {interval:g}")
        for name in ("north", "east"):
            values = numbers(getattr(self, name), f"series: {name}", CurrentError)
            if values.ndim != 1 or not values.size:
                raise CurrentError(f"series: {name} must be a list of at least one number")
            checked = tuple(checks.speed(self.kind, name, value) for value in values.tolist())
            object.__setattr__(self, name, checked)
        if len(self.north) != len(self.east):
            raise CurrentError(
                f"series: north has {len(self.north)} values and east {len(self.east)}: give as "
                "many of both"
            )

    @classmethod
    def parse(cls, rest: str) -> Series:
        """From interval=, and north= and east= with / between the values."""
        positional, given = checks.split_settings(cls.kind, rest)
        if positional:
            raise CurrentError(f"series: write NAME=VALUE, not {positional[0]!r}")
        allowed = ("interval", "north", "east")
        settings: dict[str, Any] = {}
        for name, value in given.items():
            if name not in allowed:
                raise CurrentError(unknown_name("series setting", name, allowed))
            words = value.split("/") if name != "interval" else [value]
            found = [checks.number(cls.kind, name, word) for word in words]
            settings[name] = found[0] if name == "interval" else tuple(found)
        for name in allowed:
            if name not in settings:
                raise CurrentError(f"series: {name}= is missing; settings: {', '.join(allowed)}")
        return cls(**settings)

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One record: the values as far as the mission reaches."""
        count = min(len(self.north), math.ceil(duration_s / self.interval) + 3)
        velocity = np.zeros((count, 3))
        velocity[:, 0], velocity[:, 1] = self.north[:count], self.east[:count]
        return [self.record(self.interval, velocity)]
