"""A current that is the same everywhere and always."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from twin.compiled import borrowing
from twin.errors import CurrentError
from twin.water.current import checks
from twin.water.current.axes import Origin
from twin.water.current.base import Current
from twin.water.current.sampler import Floats


@borrowing
def uniform_kernel(program, start, size, t, north, east, depth):  # type: ignore[no-untyped-def]
    """North, east, down."""
    rest = (0.0, 0.0, 0.0)
    return (program[start], program[start + 1], program[start + 2], *rest, *rest, *rest, *rest)


@dataclass(frozen=True, kw_only=True)
class Uniform(Current):
    """Constant velocity of the water in NED."""

    kind: ClassVar[str] = "uniform"
    code: ClassVar[int] = 1
    payload_size: ClassVar[int] = 3
    kernel: ClassVar[Any] = uniform_kernel
    usage: ClassVar[Mapping[str, str]] = {
        "uniform:-0.05,-0.002": "m/s north, east and perhaps down",
        "uniform:speed=0.3,direction=90": "m/s, degrees toward",
    }

    north: float = 0.0
    """[m/s] Toward north."""
    east: float = 0.0
    """[m/s] Toward east."""
    down: float = 0.0
    """[m/s] Toward the bottom."""

    def __post_init__(self) -> None:
        for name in ("north", "east", "down"):
            value = checks.speed(self.kind, name, getattr(self, name))
            object.__setattr__(self, name, value)

    @classmethod
    def parse(cls, rest: str) -> Uniform:
        """From NORTH,EAST[,DOWN], those by name, or speed= and direction=."""
        positional, given = checks.split_settings("uniform", rest)
        values = [checks.number("uniform", f"value {i}", v) for i, v in enumerate(positional, 1)]
        if values and not given and len(values) in (2, 3):
            return cls(north=values[0], east=values[1], down=values[2] if values[2:] else 0.0)
        numbers = {name: checks.number("uniform", name, value) for name, value in given.items()}
        if not values and set(numbers) == {"speed", "direction"}:
            return cls.toward(numbers["speed"], numbers["direction"])
        if not values and numbers and set(numbers) <= {"north", "east", "down"}:
            return cls(**numbers)
        raise CurrentError(
            f"uniform: cannot use {rest!r}; write uniform:NORTH,EAST[,DOWN] in m/s, or"
            " uniform:speed=0.3,direction=90"
        )

    @classmethod
    def toward(cls, speed: float, direction_deg: float) -> Uniform:
        """Horizontal flow of `speed` [m/s] toward the compass direction [degree]."""
        angle = math.radians(direction_deg)
        return cls(north=speed * math.cos(angle), east=speed * math.sin(angle))

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record."""
        return [self.record(self.north, self.east, self.down)]
