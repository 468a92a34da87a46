"""Profile: steady currents of depth alone, a uniform velocity or a table over depth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from twin.compiled import borrowing
from twin.errors import CurrentError, unknown_name
from twin.numbers import numbers
from twin.water.current import checks
from twin.water.current.axes import Origin
from twin.water.current.base import Current
from twin.water.current.sampler import Floats, table
from twin.water.table_file import column_numbers, read_table_file


@borrowing
def uniform_kernel(program, start, size, t, north, east, depth):  # type: ignore[no-untyped-def]
    """Payload: velocity north, east, down."""
    rest = (0.0, 0.0, 0.0)
    return (program[start], program[start + 1], program[start + 2], *rest, *rest, *rest, *rest)


@dataclass(frozen=True, kw_only=True)
class Uniform(Current):
    """Constant velocity of the water in NED."""

    kind = "uniform"
    code = 1
    payload_size = 3
    kernel = uniform_kernel
    usage: ClassVar[Mapping[str, str]] = {
        "uniform:-0.05,-0.002": "m/s north, east and perhaps down",
        "uniform:speed=0.3,direction=90": "m/s, degrees toward",
    }

    north: float = 0.0
    """[m/s] Velocity toward north."""
    east: float = 0.0
    """[m/s] Velocity toward east."""
    down: float = 0.0
    """[m/s] Velocity toward the bottom."""

    def __post_init__(self) -> None:
        for name in ("north", "east", "down"):
            value = checks.speed(self.kind, name, getattr(self, name))
            object.__setattr__(self, name, value)

    @classmethod
    def parse(cls, rest: str) -> Uniform:
        """Parse NORTH,EAST[,DOWN], the same by name, or speed= and direction=."""
        positional, given = checks.split_settings("uniform", rest)
        values = [checks.number("uniform", f"value {i}", v) for i, v in enumerate(positional, 1)]
        if not given and len(values) in (2, 3):
            return cls(**dict(zip(("north", "east", "down"), values, strict=False)))
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
        """Make a horizontal flow of `speed` [m/s] toward the compass direction [degree]."""
        angle = math.radians(direction_deg)
        return cls(north=speed * math.cos(angle), east=speed * math.sin(angle))

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make one record."""
        return [self.record(self.north, self.east, self.down)]


COLUMNS = {
    **dict.fromkeys(("depth", "depth_m"), ("depth", 1.0)),
    **dict.fromkeys(("north", "north_m_s", "v"), ("north", 1.0)),
    **dict.fromkeys(("east", "east_m_s", "u"), ("east", 1.0)),
    **dict.fromkeys(("down", "down_m_s"), ("down", 1.0)),
    "w": ("down", -1.0),
}
"""Field and sign by CSV column name (oceanographers' u, v, w are east, north, UP)."""


@borrowing
def column(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Payload: table over depth: n, depths [m] (n), velocity (n, 3)."""
    return table(program, start, size, depth, r_d)


@dataclass(frozen=True, kw_only=True)
class Profile(Current):
    """Velocity linear between tabulated depths, held above the first and below the last."""

    kind = "profile"
    code = 2
    directional = column
    depends_on = ("depth",)
    usage: ClassVar[Mapping[str, str]] = {
        "profile:FILE.csv": "columns depth,north,east[,down] in m and m/s"
    }

    depth: tuple[float, ...]
    """[m] Depths, positive down, strictly increasing, shape (n,)."""
    north: tuple[float, ...]
    """[m/s] Velocities toward north at those depths."""
    east: tuple[float, ...]
    """[m/s] Velocities toward east at those depths."""
    down: tuple[float, ...] = ()
    """[m/s] Velocities toward the bottom at those depths; empty: zero."""

    def __post_init__(self) -> None:
        for name in ("depth", "north", "east", "down"):
            values = numbers(getattr(self, name), f"profile: {name}", CurrentError)
            if values.ndim != 1:
                raise CurrentError(f"profile: {name} must be a list of numbers")
            object.__setattr__(self, name, tuple(values.tolist()))
        if not self.down:
            object.__setattr__(self, "down", (0.0,) * len(self.depth))
        _check_rows(self.kind, {name: getattr(self, name) for name in self.setting_fields()})

    @classmethod
    def parse(cls, rest: str) -> Profile:
        """Parse the name of a CSV file."""
        positional, given = checks.split_settings(cls.kind, rest)
        if len(positional) != 1 or given:
            raise CurrentError(f"profile: give one CSV file, as profile:FILE.csv, not {rest!r}")
        return cls.from_csv(positional[0])

    @classmethod
    def from_csv(cls, path: str | Path) -> Profile:
        """Read a CSV with a header line: depth, north, east and optionally down.

        Columns in m and m/s; u, v, w mean toward east, north and UP. Lines that start with # are
        comments. Raises CurrentError naming file and row.
        """
        path = Path(path)
        frame = read_table_file(path, "current profile", CurrentError)
        names = [str(name).lower() for name in frame.columns]
        if all(map(_is_number, names)):
            raise CurrentError(
                f"{path} begins with numbers: write the header depth,north,east[,down] above them"
            )
        frame.columns = names
        columns: dict[str, Sequence[float]] = {}
        for name in names:
            if name not in COLUMNS:
                raise CurrentError(f"{path}: {unknown_name('column', name, COLUMNS)}")
            field, sign = COLUMNS[name]
            if field in columns or names.count(name) > 1:
                raise CurrentError(f"{path}: two columns for {field}")
            values = column_numbers(frame, name, str(path), CurrentError)
            columns[field] = [sign * value for value in values]
        missing = [name for name in ("depth", "north", "east") if name not in columns]
        if missing:
            raise CurrentError(
                f"{path} has no column {missing[0]}: a profile needs depth,north,east[,down]"
            )
        _check_rows(str(path), columns, list(frame.index))
        return cls(**{name: tuple(values) for name, values in columns.items()})

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make one record."""
        velocity = np.column_stack([self.north, self.east, self.down])
        return [self.record(len(self.depth), self.depth, velocity)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _check_rows(
    source: str, columns: Mapping[str, Sequence[float]], rows: Sequence[int] | None = None
) -> None:
    """Raise CurrentError naming the first bad row; `rows` are line numbers, else counted from 1."""
    depth = columns["depth"]
    velocities = {name: columns[name] for name in ("north", "east", "down") if name in columns}
    if not depth:
        raise CurrentError(f"{source}: a profile needs at least one depth")
    for name, values in velocities.items():
        if len(values) != len(depth):
            raise CurrentError(f"{source}: {len(values)} {name} values for {len(depth)} depths")
    for i, here in enumerate(depth):
        label = f"{source} row {i + 1 if rows is None else rows[i]}"
        if not math.isfinite(here):
            raise CurrentError(f"{label}: depth is {here}; remove or fill the row")
        if here < 0.0:
            raise CurrentError(f"{label}: depth {here:g} m is negative; depth is positive down")
        if i and here <= depth[i - 1]:
            raise CurrentError(
                f"{label}: depth {here:g} m does not increase (row before:"
                f" {depth[i - 1]:g} m); sort the rows by depth and drop repeats"
            )
        for name, values in velocities.items():
            value, at = values[i], f"{label} (depth {here:g} m): {name}"
            if not math.isfinite(value):
                raise CurrentError(f"{at} is {value}; remove or fill the row")
            if abs(value) > checks.FASTEST_CURRENT:
                raise CurrentError(
                    f"{at} is {value:g} m/s, beyond {checks.FASTEST_CURRENT:g} m/s; convert the"
                    " table to m/s"
                )
