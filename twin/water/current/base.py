"""Currents: the base class of all types, sums of currents, and their texts and descriptions."""

from __future__ import annotations

import abc
import math
import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from twin.compiled import Compiled
from twin.errors import CurrentError, unknown_name
from twin.plugins import imported
from twin.seams import CURRENTS
from twin.water.current import checks, probe
from twin.water.current import sampler as layout
from twin.water.current.axes import Origin
from twin.water.current.sampler import Floats, kinds

TABLE, TABULATED = "table", "twin.water.current.tabulated"
"""TABLE: type of a tabulated function. TABULATED: its module, which imports this one."""
HELP_COLUMN = 42
"""Column of `current_help` at which explanations begin, behind any shorter example."""
FILE = re.compile(r"\.[A-Za-z]\w*\s*(,|$)|[/\\]")
"""Part of a current's text that shows a file name."""


@dataclass(frozen=True, kw_only=True)
class Current(abc.ABC):
    """A current field V_c(t, north, east, depth) in NED, positive toward north, east and down.

    Directions are compass degrees TOWARD which the water flows (0 north, 90 east).

    A type is a frozen dataclass of its settings, decorated with `register`, with the names below,
    `records` and one compiled function:

      kernel(program, start, size, t, north, east, depth)
          returns velocity (3) [m/s], local rate dV/dt (3) [m/s2] and gradient (9) [1/s], row by
          row: dVn/dn, dVn/de, dVn/dd, dVe/dn, ...; NED, depth [m] never negative. The payload that
          `records` wrote is program[start:start + size].
      directional(..., r_t, r_north, r_east, r_depth)
          may replace `kernel` where it takes fewer operations: velocity (3) and its derivative (3)
          along the direction (r_t, r_north, r_east, r_depth).
    """

    kind: ClassVar[str] = ""
    """Name in descriptions and on the command line."""
    code: ClassVar[int | None] = None
    """Number in compiled programs; None: made from the type's name."""
    payload_size: ClassVar[int | None] = None
    """Length of a record's payload; None: it varies, and the compiled function checks `size`."""
    kernel: ClassVar[Compiled | None] = None
    """Compiled function of velocity, local rate and gradient: see the class."""
    directional: ClassVar[Compiled | None] = None
    """Compiled function of velocity and directional derivative: see the class."""
    depends_on: ClassVar[tuple[str, ...]] = ("time", "north", "east", "depth")
    """Variables that change the velocity of a `directional` type; other derivatives are 0."""
    usage: ClassVar[Mapping[str, str]] = {}
    """Example texts for `--current`, each with a short explanation; FILE stands for a file name."""
    settings: ClassVar[Mapping[str, str] | None] = None
    """Field of each setting by its command-line name; None: names from `checks.setting`, or the
    field's own name."""

    def __post_init__(self) -> None:
        """Check each field that `checks.setting` made; raises CurrentError."""
        for field in fields(self):
            check, value = field.metadata.get("check"), getattr(self, field.name)
            if check is not None and value is not None:
                check(self.kind, field.name, value, field.metadata["unit"])

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        if "velocity" in vars(cls):
            raise CurrentError(
                f"{cls.__qualname__} overrides velocity(), which nothing flies: what flies is"
                " compiled. Tabulate the function with Current.from_function, or give records() and"
                " a kernel, and decorate the class with twin.water.current.register"
            )

    @abc.abstractmethod
    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make the records, by `record`, for a mission of `duration_s` [s] from `origin`."""

    @classmethod
    def record(cls, *payload: ArrayLike) -> Floats:
        """Make one record of this type from numbers and arrays, flattened in order."""
        if CURRENTS.get(cls.kind) is not cls:
            raise CurrentError(
                f"{cls.__qualname__} is not a registered kind of current: give it a `kind` of its"
                " own and decorate it with twin.water.current.register"
            )
        return layout.record(cls.number(), *payload)

    @classmethod
    def number(cls) -> int:
        """Number of the type in compiled programs, equal in every process."""
        if cls.code is not None:
            return cls.code
        return probe.FIRST_FREE_CODE + zlib.crc32(cls.kind.encode())

    def compile(self, duration_s: float, origin: Origin | None = None) -> Floats:
        """Compile to the flat float64 program for `sampler.sample`, the same bytes on every call.

        duration_s [s]: mission length; sampled or loaded values cover it, and the last holds later.
        origin: the mission's start, `Origin()` when None. `probe` compares the derivatives of your
        own types with differences of the velocity. Raises CurrentError.
        """
        if not (math.isfinite(duration_s) and duration_s > 0.0):
            raise CurrentError(f"duration_s must be greater than 0 s, not {duration_s}")
        records = self.records(float(duration_s), origin or Origin())
        program = layout.program(records)
        if not np.isfinite(program).all():
            raise CurrentError(f"{self.kind}: the compiled current holds NaN or infinity")
        for record in records:
            for kind in layout.kinds() if record[0] >= probe.FIRST_FREE_CODE else ():
                if kind.number() == record[0]:
                    probe.check(kind, record, float(duration_s))
        return program

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Current:
        """Return the current with all settings written out that origin or file would supply.

        A store records `current.pinned(duration_s, origin).describe()`: rebuilt, it compiles to
        the same bytes for the same duration, or raises CurrentError if a file has changed.
        """
        return self

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """Start place and time of a mission in this current: `origin`, unless the current's file
        gives them. Raises CurrentError when the file cannot be read."""
        return origin

    def check_place(self, latitude_deg: float, longitude_deg: float) -> None:
        """Raise CurrentError when this current requires another start place [degree]."""
        return  # most types hold at any place

    def check_time(self, time: str) -> None:
        """Raise CurrentError when this current requires another start time."""
        return

    def reaching(self, distance_m: float) -> Current:
        """Return a copy that covers `distance_m` from the start at any duration."""
        return self

    def velocity(
        self,
        t: ArrayLike,
        north: ArrayLike,
        east: ArrayLike,
        depth: ArrayLike,
        origin: Origin | None = None,
    ) -> Floats:
        """Current [m/s] NED at broadcast t [s], north, east, depth [m]; shape (..., 3).

        Compiles on every call: for many calls compile once and use `sampler.sample_track`.
        """
        from twin.water.current.sampler import sample_track

        arrays = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (t, north, east, depth)))
        shape = arrays[0].shape
        flat = [np.ascontiguousarray(x).reshape(-1).copy() for x in arrays]
        latest = float(np.max(flat[0], initial=0.0))
        farthest = float(np.max(np.hypot(flat[1], flat[2]), initial=0.0))
        program = self.reaching(farthest).compile(max(latest, 1.0), origin)
        rest = np.zeros_like(flat[0])
        return sample_track(program, *flat, rest, rest, rest)[:, :3].reshape(*shape, 3)

    @staticmethod
    def from_function(
        function: Callable[[float, float, float, float], Sequence[float]],
        *,
        time: tuple[float, float] | None = None,
        depth: tuple[float, float] | None = None,
        north: tuple[float, float] | None = None,
        east: tuple[float, float] | None = None,
        tolerance: float = 1e-3,
    ) -> Current:
        """Tabulate a plain Python function, with as many nodes as the tolerance needs.

        Args:
          function: (t [s], north [m], east [m], depth [m]) relative to the mission's start ->
            velocity north, east and optionally down [m/s].
          time, depth, north, east: (low, high) of each axis along which the function varies; the
            end values hold beyond the range.
          tolerance: [m/s] largest difference from the function between the nodes.

        Raises:
          CurrentError: the function fails, gives no velocity, varies along an axis without a range,
            or needs more nodes than a store may hold.
        """
        ranges = {"time": time, "depth": depth, "north": north, "east": east}
        given = {name: ends for name, ends in ranges.items() if ends is not None}
        table: Current = imported(f"{TABULATED}:tabulated")(function, given, tolerance)
        return table

    def describe(self) -> dict[str, Any]:
        """Return JSON values that `current_from_dict` turns back into an equal current."""
        return {"kind": self.kind, **{f.name: _json(getattr(self, f.name)) for f in fields(self)}}

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Rebuild from `describe()` without its type; raises CurrentError for unknown names."""
        allowed = [f.name for f in fields(cls)]
        for name in settings:
            if name not in allowed:
                raise CurrentError(unknown_name(f"{cls.kind} setting", name, allowed))
        try:
            return cls(**settings)
        except TypeError as error:
            raise CurrentError(f"{cls.kind}: {error}; {checks.allowed(allowed)}") from None

    @classmethod
    def setting_fields(cls) -> Mapping[str, str]:
        """Field of every setting by its command-line name."""
        if cls.settings is not None:
            return cls.settings
        named = {f.name: f.metadata.get("names", (f.name,)) for f in fields(cls)}
        return {name: field for field, names in named.items() for name in names}

    @classmethod
    def parse(cls, rest: str) -> Current:
        """Parse the command-line text after `KIND:`, NAME=VALUE between commas.

        `int` fields take whole numbers, `str` fields any text, others numbers. Raises CurrentError
        naming the wrong setting.
        """
        names = cls.setting_fields()
        positional, given = checks.split_settings(cls.kind, rest)
        if positional:
            raise CurrentError(
                f"{cls.kind}: write NAME=VALUE, not {positional[0]!r}; {checks.allowed(names)}"
            )
        settings = cls.values_of(given)
        for field in fields(cls):
            if field.default is field.default_factory and field.name not in settings:
                needed = next(name for name, target in names.items() if target == field.name)
                raise CurrentError(f"{cls.kind}: {needed}= is missing; {checks.allowed(names)}")
        return cls(**settings)

    @classmethod
    def values_of(cls, given: Mapping[str, str]) -> dict[str, Any]:
        """Convert texts by command-line name to field values; raises CurrentError."""
        names, types = cls.setting_fields(), {f.name: str(f.type) for f in fields(cls)}
        values: dict[str, Any] = {}
        for name, text in given.items():
            if name not in names:
                raise CurrentError(unknown_name(f"{cls.kind} setting", name, names))
            kind = types[names[name]].removeprefix("<class '").removesuffix("'>")
            read = checks.whole_number if kind == "int" else checks.number
            values[names[name]] = text if kind.startswith("str") else read(cls.kind, name, text)
        return values

    @classmethod
    def flaw(cls, name: str) -> str:
        """Describe a type's fault as `probe.flaw` does; raises CurrentError as it does."""
        return probe.flaw(cls, name)

    def __add__(self, other: Current) -> CurrentSum:
        if not isinstance(other, Current):
            return NotImplemented
        return CurrentSum(parts=(*_parts(self), *_parts(other)))


@dataclass(frozen=True, kw_only=True)
class CurrentSum(Current):
    """Sum of the velocities of several currents; still water without any."""

    kind: ClassVar[str] = "sum"

    parts: tuple[Current, ...] = ()
    """Currents that are added."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        for part in self.parts:
            if not isinstance(part, Current):
                raise CurrentError(f"sum: a part is {type(part).__name__}, it must be a Current")

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Collect the records of all currents."""
        return [r for part in self.parts for r in part.records(duration_s, origin)]

    def pinned(self, duration_s: float, origin: Origin | None = None) -> CurrentSum:
        """Return the sum with each current pinned."""
        return CurrentSum(parts=tuple(part.pinned(duration_s, origin) for part in self.parts))

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """Start place and time; the first current that has a start of its own decides."""
        for part in reversed(self.parts):
            origin = part.begins(duration_s, origin)
        return origin

    def check_place(self, latitude_deg: float, longitude_deg: float) -> None:
        """Check the place with each current."""
        for part in self.parts:
            part.check_place(latitude_deg, longitude_deg)

    def check_time(self, time: str) -> None:
        """Check the time with each current."""
        for part in self.parts:
            part.check_time(time)

    def reaching(self, distance_m: float) -> CurrentSum:
        """Return the sum with each current covering `distance_m`."""
        return CurrentSum(parts=tuple(part.reaching(distance_m) for part in self.parts))

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Rebuild the sum from `describe()`, nested currents first."""
        parts = settings.get("parts", ())
        return super().from_settings(
            {**settings, "parts": tuple(current_from_dict(part) for part in parts)}
        )


def still_water() -> CurrentSum:
    """Make a current of zero everywhere."""
    return CurrentSum()


def current_from_dict(description: Mapping[str, Any]) -> Current:
    """Rebuild the current from its `describe()`; raises CurrentError for a wrong description."""
    if not isinstance(description, Mapping) or "kind" not in description:
        known = sorted([*CURRENTS, CurrentSum.kind, TABLE])
        raise CurrentError(f"a current's description needs 'kind' (one of {', '.join(known)})")
    settings = {name: value for name, value in description.items() if name != "kind"}
    name = str(description["kind"])
    if name == CurrentSum.kind:
        return CurrentSum.from_settings(settings)
    if name == TABLE:
        table: Current = imported(f"{TABULATED}:Tabulated").from_settings(settings)
        return table
    return kind_named(name, CurrentSum.kind).from_settings(settings)


def kind_named(name: str, *also: str) -> type[Current]:
    """Return the type of this name; raises CurrentError, which also offers the names in `also`."""
    if name in CURRENTS:
        kind: type[Current] = CURRENTS[name]
        return kind
    hint = ""
    if name[:1].isdigit() or name[:1] in "+-.":  # a velocity without a type
        hint = f"; write uniform:{name} for a velocity north, east in m/s"
    raise CurrentError(unknown_name("current", name, [*CURRENTS, *also]) + hint)


def _parts(current: Current) -> tuple[Current, ...]:
    return current.parts if isinstance(current, CurrentSum) else (current,)


def _json(value: Any) -> Any:
    """Convert to JSON types: tuples to lists, nested currents and records to descriptions."""
    if hasattr(value, "describe"):
        return value.describe()
    if isinstance(value, (tuple, list)):
        return [_json(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def current_help() -> str:
    """Help text of `--current`: one example per line, from every type registered so far."""
    lines = [("none", "still water")]
    for kind in kinds():
        lines.extend(kind.usage.items())
    return "\n".join(
        [
            *(f"{text:{HELP_COLUMN - 2}}  {words}" for text, words in lines),
            "Directions are toward, clockwise from north. Add currents with +.",
        ]
    )


def parse_current(text: str) -> Current:
    """Parse the text of `--current`; `current_help` lists the forms.

    Speeds in m/s, angles in degrees toward. Raises CurrentError naming the wrong part.
    """
    # a + belongs to a number (1e+3), a path or a time zone unless a type follows it
    pieces = re.split(r"\+(?=\s*(?:[A-Za-z][\w-]*\s*:|none\b))", text.strip())
    currents = [_parse_one(piece.strip()) for piece in pieces]
    if len(currents) == 1:
        return currents[0]
    return CurrentSum(parts=tuple(part for current in currents for part in _parts(current)))


def parse_field(text: str) -> Current:
    """Parse the current of a forecast: a text of `parse_current`, or the path of a gridded file."""
    if Path(text).exists():
        return parse_current(f"grid:{text}")
    if FILE.search(text) and ":" not in text:
        raise CurrentError(
            f"no file {text!r} with a forecast of the current: a file is a path, or "
            f"grid:{text},SETTINGS; `--current` of `twin simulate --help` lists other kinds"
        )
    return parse_current(text)


def check_field(text: str) -> None:
    """Check the text of `parse_field`, but open no file; raises CurrentError."""
    if not FILE.search(text):  # no file name
        parse_current(text)
        return
    for name in re.findall(r"(?:^|\+)\s*([A-Za-z][\w-]*)\s*:", text):
        kind_named(name.lower().replace("_", "-"), "none")


def _parse_one(text: str) -> Current:
    name, colon, rest = text.partition(":")
    name = name.strip().lower().replace("_", "-")
    if name == "none":
        if rest.strip():
            raise CurrentError(f"current 'none' takes no settings, not {rest!r}")
        return still_water()
    kind = kind_named(name, "none")
    if not colon or not rest.strip():
        example = next(iter(kind.usage))
        raise CurrentError(f"current {name!r} needs settings, e.g. {example}")
    return kind.parse(rest)
