"""A current that depends on depth alone, given as a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from twin.compiled import borrowing
from twin.errors import CurrentError, unknown_name
from twin.numbers import numbers
from twin.water.current import checks
from twin.water.current.axes import Origin
from twin.water.current.base import Current
from twin.water.current.interpolation import table
from twin.water.current.sampler import Floats
from twin.water.table_file import column_numbers, read_table_file

COLUMNS = {
    "depth": ("depth", 1.0),
    "depth_m": ("depth", 1.0),
    "north": ("north", 1.0),
    "north_m_s": ("north", 1.0),
    "v": ("north", 1.0),
    "east": ("east", 1.0),
    "east_m_s": ("east", 1.0),
    "u": ("east", 1.0),
    "down": ("down", 1.0),
    "down_m_s": ("down", 1.0),
    "w": ("down", -1.0),
}
"""CSV column names: our field and its sign (oceanographers' u, v, w are east, north, UP)."""


@borrowing
def column(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Table over depth: n, depths [m] (n), velocity (n, 3)."""
    return table(program, start, size, depth, r_d)


@dataclass(frozen=True, kw_only=True)
class Profile(Current):
    """Velocity linear between tabulated depths, held above the first and below the last."""

    kind: ClassVar[str] = "profile"
    code: ClassVar[int] = 2
    directional: ClassVar[Any] = column
    depends_on: ClassVar[tuple[str, ...]] = ("depth",)
    usage: ClassVar[Mapping[str, str]] = {
        "profile:FILE.csv": "columns depth,north,east[,down] in m and m/s"
    }

    depth: tuple[float, ...]
    """[m] Depths, positive down, strictly increasing, shape (n,)."""
    north: tuple[float, ...]
    """[m/s] Toward north at those depths."""
    east: tuple[float, ...]
    """[m/s] Toward east at those depths."""
    down: tuple[float, ...] = ()
    """[m/s] Toward the bottom at those depths; empty means none."""

    def __post_init__(self) -> None:
        for name in ("depth", "north", "east", "down"):
            values = numbers(getattr(self, name), f"profile: {name}", CurrentError)
            if values.ndim != 1:
                raise CurrentError(f"profile: {name} must be a list of numbers")
            object.__setattr__(self, name, tuple(values.tolist()))
        if not self.down:
            object.__setattr__(self, "down", (0.0,) * len(self.depth))
        check_rows(self.kind, self.depth, self.north, self.east, self.down)

    @classmethod
    def parse(cls, rest: str) -> Profile:
        """From the name of a CSV file."""
        positional, given = checks.split_settings(cls.kind, rest)
        if len(positional) != 1 or given:
            raise CurrentError(f"profile: give one CSV file, as profile:FILE.csv, not {rest!r}")
        return cls.from_csv(positional[0])

    @classmethod
    def from_csv(cls, path: str | Path) -> Profile:
        """Read a CSV with a header line: depth, north, east and optionally down.

        Columns in m and m/s; u, v, w are understood as toward east, north and UP. Lines that
        start with # are comments. Raises CurrentError naming file and row.
        """
        path = Path(path)
        frame = read_table_file(path, "current profile", CurrentError)
        names = [str(name).lower() for name in frame.columns]
        if all(map(_is_number, names)):
            raise CurrentError(
                f"{path} begins with numbers: write the header depth,north,east[,down] above them"
            )
        frame.columns = names
        columns: dict[str, list[float]] = {}
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
        columns.setdefault("down", [0.0] * len(frame))
        check_rows(
            str(path), columns["depth"], columns["north"], columns["east"], columns["down"],
            list(frame.index),
        )  # fmt: skip
        return cls(**{name: tuple(values) for name, values in columns.items()})

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record."""
        velocity = np.column_stack([self.north, self.east, self.down])
        return [self.record(len(self.depth), self.depth, velocity)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def check_rows(
    source: str,
    depth: Sequence[float],
    north: Sequence[float],
    east: Sequence[float],
    down: Sequence[float],
    rows: Sequence[int] | None = None,
) -> None:
    """Raise CurrentError naming the first bad row; `rows` are line numbers, else counted from 1."""
    n = len(depth)
    if n == 0:
        raise CurrentError(f"{source}: a profile needs at least one depth")
    for name, values in (("north", north), ("east", east), ("down", down)):
        if len(values) != n:
            raise CurrentError(f"{source}: {len(values)} {name} values for {n} depths")
    for i in range(n):
        row = rows[i] if rows is not None else i + 1
        if not math.isfinite(depth[i]):
            raise CurrentError(f"{source} row {row}: depth is {depth[i]}; remove or fill the row")
        if depth[i] < 0.0:
            raise CurrentError(
                f"{source} row {row}: depth {depth[i]:g} m is negative; depth is positive down"
            )
        if i and depth[i] <= depth[i - 1]:
            raise CurrentError(
                f"{source} row {row}: depth {depth[i]:g} m does not increase (row before:"
                f" {depth[i - 1]:g} m); sort the rows by depth and drop repeats"
            )
        for name, value in (("north", north[i]), ("east", east[i]), ("down", down[i])):
            if not math.isfinite(value):
                raise CurrentError(
                    f"{source} row {row} (depth {depth[i]:g} m): {name} is {value};"
                    " remove or fill the row"
                )
            if abs(value) > checks.FASTEST_CURRENT:
                raise CurrentError(
                    f"{source} row {row} (depth {depth[i]:g} m): {name} is {value:g} m/s, beyond"
                    f" {checks.FASTEST_CURRENT:g} m/s; convert the table to m/s"
                )
