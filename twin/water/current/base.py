"""The `Current` every kind derives from, sums of currents, and rebuilding from a description."""

from __future__ import annotations

import abc
import inspect
import math
import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
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
from twin.water.current.sampler import Floats

FIRST_FREE_CODE = 65_536
"""Codes below are the package's own; others follow from the kind's name, the same everywhere."""
DAY = 86_400.0
"""[s] of the missions for which examples are tried"""


@dataclass(frozen=True, kw_only=True)
class Current(abc.ABC):
    """A current field V_c(t, north, east, depth) in NED, positive toward north, east and down.

    Directions are compass degrees TOWARD which the water flows (0 north, 90 east).

    A kind is a frozen dataclass of its settings, decorated with `register`, with the names below,
    `records` and one compiled function:

      kernel(program, start, size, t, north, east, depth)
          returns velocity (3) [m/s], local rate dV/dt (3) [m/s2] and gradient (9) [1/s], row by
          row: dVn/dn, dVn/de, dVn/dd, dVe/dn, ...; NED, depth [m] never negative. The payload that
          `records` wrote is program[start:start + size].
      directional(..., r_t, r_north, r_east, r_depth)
          instead of `kernel`, where that takes fewer operations: velocity (3) and its derivative
          (3) along the direction (r_t, r_north, r_east, r_depth).
    """

    kind: ClassVar[str] = ""
    """Name in descriptions and on the command line."""
    code: ClassVar[int | None] = None
    """Number in compiled programs; None: made from the kind's name."""
    payload_size: ClassVar[int | None] = None
    """Numbers in a record; None: it varies, and the compiled function checks `size` itself."""
    kernel: ClassVar[Compiled | None] = None
    """See above."""
    directional: ClassVar[Compiled | None] = None
    """See above."""
    depends_on: ClassVar[tuple[str, ...]] = ("time", "north", "east", "depth")
    """What the velocity of a `directional` kind varies with: only those derivatives are taken."""
    usage: ClassVar[Mapping[str, str]] = {}
    """Example texts for `--current`, each with a few words; FILE stands for a file's name."""
    settings: ClassVar[Mapping[str, str] | None] = None
    """Command-line name and field of each setting; None: every field under its own name."""

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
        """The records, made by `record`, for a mission of `duration_s` [s] from `origin`."""

    @classmethod
    def record(cls, *payload: ArrayLike) -> Floats:
        """One record of this kind: numbers and arrays, flattened in order."""
        cls._check_kind()
        return layout.record(cls.number(), *payload)

    @classmethod
    def number(cls) -> int:
        """The number that stands for it in compiled programs, the same in every process."""
        return FIRST_FREE_CODE + zlib.crc32(cls.kind.encode()) if cls.code is None else cls.code

    @classmethod
    def _check_kind(cls) -> None:
        """Raise CurrentError when this class is not registered."""
        if CURRENTS.get(cls.kind) is not cls:
            raise CurrentError(
                f"{cls.__qualname__} is not a registered kind of current: give it a `kind` of its"
                " own and decorate it with twin.water.current.register"
            )

    def compile(self, duration_s: float, origin: Origin | None = None) -> Floats:
        """The flat float64 program for `sampler.sample`, the same bytes on every call.

        duration_s [s]: mission length; what is drawn or read covers it (later times hold the last
        value). origin: the mission's start, `Origin()` when None. A kind of one's own is compared
        with differences of its velocity, see `probe`. Raises CurrentError.
        """
        self._check_registered()
        if not (math.isfinite(duration_s) and duration_s > 0.0):
            raise CurrentError(f"duration_s must be greater than 0 s, not {duration_s}")
        records = self.records(float(duration_s), origin or Origin())
        program = layout.program(records)
        if not np.isfinite(program).all():
            raise CurrentError(f"{self.kind}: the compiled current holds NaN or infinity")
        for record in records:
            for kind in layout.kinds() if record[0] >= FIRST_FREE_CODE else ():
                if kind.number() == record[0]:
                    probe.check(kind, record, float(duration_s))
        return program

    def _check_registered(self) -> None:
        self._check_kind()

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Current:
        """This current with everything written out that it would take from origin or file.

        A store records `current.pinned(duration_s, origin).describe()`: rebuilt, it compiles to
        the same bytes for the same duration, or raises CurrentError if a file has changed.
        """
        return self

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """Where and when a mission starts that flies in this current: `origin`, but for files that
        say it themselves. Raises CurrentError when such a file cannot be read."""
        return origin

    def check_place(self, latitude_deg: float, longitude_deg: float) -> None:
        """Raise CurrentError when this current says that the mission starts elsewhere [degree]."""
        return  # most kinds say nothing about it

    def check_time(self, time: str) -> None:
        """Raise CurrentError when this current says that the mission starts at another time."""
        return

    def reaching(self, distance_m: float) -> Current:
        """This current, set to be known as far as `distance_m` from the start at any duration."""
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
          function: (t [s], north [m], east [m], depth [m]) since and from the mission's start ->
            velocity north, east and perhaps down [m/s].
          time, depth, north, east: (low, high) of each axis along which the function varies;
            beyond, the values at the ends hold.
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
        """A JSON-able dict that `current_from_dict` turns back into an equal current."""
        return {"kind": self.kind, **{f.name: _plain(getattr(self, f.name)) for f in fields(self)}}

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """The current from `describe()` without its kind; raises CurrentError on unknown names."""
        allowed = [f.name for f in fields(cls)]
        for name in settings:
            if name not in allowed:
                raise CurrentError(unknown_name(f"{cls.kind} setting", name, allowed))
        try:
            return cls(**settings)
        except TypeError as error:
            raise CurrentError(f"{cls.kind}: {error}; settings: {', '.join(allowed)}") from None

    @classmethod
    def setting_fields(cls) -> Mapping[str, str]:
        """Command-line name and field of every setting."""
        return {f.name: f.name for f in fields(cls)} if cls.settings is None else cls.settings

    @classmethod
    def parse(cls, rest: str) -> Current:
        """The current from what follows `KIND:` on the command line, NAME=VALUE between commas.

        Fields that are `int` take whole numbers, `str` any text, others numbers. Raises
        CurrentError naming what is wrong.
        """
        names = cls.setting_fields()
        positional, given = checks.split_settings(cls.kind, rest)
        if positional:
            raise CurrentError(
                f"{cls.kind}: write NAME=VALUE, not {positional[0]!r}; {checks.allowed(names)}"
            )
        known = {f.name: f for f in fields(cls)}
        settings: dict[str, Any] = {}
        for name, value in given.items():
            if name not in names:
                raise CurrentError(unknown_name(f"{cls.kind} setting", name, names))
            field = known[names[name]]
            if field.type in (str, "str"):
                settings[field.name] = value
            elif field.type in (int, "int"):
                settings[field.name] = checks.whole_number(cls.kind, name, value)
            else:
                settings[field.name] = checks.number(cls.kind, name, value)
        for field in known.values():
            if field.default is field.default_factory and field.name not in settings:
                needed = next(name for name, target in names.items() if target == field.name)
                raise CurrentError(f"{cls.kind}: {needed}= is missing; {checks.allowed(names)}")
        return cls(**settings)

    @classmethod
    def flaw(cls, name: str) -> str:
        """What is wrong with a kind.

        Raises:
          CurrentError: a derivative of what its usage shows is not its velocity's (`probe`).
        """
        if not re.fullmatch(r"[a-z][a-z0-9-]*", name) or name in ("none", CurrentSum.kind, TABLE):
            return "its kind must be lower-case letters, digits and hyphens, and not taken"
        if "__dataclass_params__" not in vars(cls):
            return "it is not a dataclass: add @dataclass(frozen=True, kw_only=True)"
        if flaw := cls._flaw_of_functions():
            return flaw
        own = {field.name for field in fields(cls)}
        for field in cls.setting_fields().values():
            if field not in own:
                return unknown_name("field in settings", field, own)
        if not cls.usage or not all(text.startswith(f"{name}:") for text in cls.usage):
            return f"it needs usage: a mapping of texts that begin with {name}: to a few words each"
        for other in () if name in CURRENTS.shipped() else layout.kinds():
            if other.number() == cls.number() and other.kind != name:
                return f"it has the code {cls.number()} of {other.kind!r}; set another `code`"
        return cls._flaw_of_examples() if cls.number() >= FIRST_FREE_CODE else ""

    @classmethod
    def _flaw_of_functions(cls) -> str:
        """What is wrong with the function that flies."""
        for name, count in (("kernel", 7), ("directional", 11)):
            function = getattr(cls, name)
            if function is None:
                continue
            if not isinstance(function, Compiled):
                return f"its {name} is {function!r}; decorate it with twin.compiled.jit"
            taken = len(inspect.signature(function.py_func).parameters)
            if taken != count:
                direction = ", and a direction in t, north, east, depth" if count > 7 else ""
                return (
                    f"its {name} takes {taken} arguments, it must take {count}: program, start,"
                    f" size, t, north, east, depth{direction}"
                )
        if (cls.kernel is None) == (cls.directional is None):
            return (
                "it needs one of kernel and directional, it has"
                f" {'neither' if cls.kernel is None else 'both'}: what flies is compiled, so give"
                " kernel, a function decorated with twin.compiled.jit that returns velocity, local"
                " rate and gradient (3 + 3 + 9 numbers)"
            )
        return ""

    @classmethod
    def _flaw_of_examples(cls) -> str:
        """Compile what `usage` shows, which compares its derivatives with differences.

        Examples that need a file, or are no settings but their form, are compared when they fly.
        """
        for example in cls.usage:
            try:
                current = cls.parse(example.partition(":")[2])
                drawn = [layout.program(current.records(DAY, Origin())) for _ in range(2)]
            except CurrentError:
                continue
            if drawn[0].tobytes() != drawn[1].tobytes():
                return (
                    f"its records() of {example!r} differ from call to call: draw what is random"
                    " from a seed that is a setting, by numpy.random.default_rng(seed)"
                )
            current.compile(DAY)
        return ""

    def __add__(self, other: Current) -> CurrentSum:
        if not isinstance(other, Current):
            return NotImplemented
        return CurrentSum(parts=(*_parts(self), *_parts(other)))


TABLE = "table"
"""Kind of a function's table"""
TABULATED = "twin.water.current.tabulated"
"""Its file, which derives from `Current`"""


@dataclass(frozen=True, kw_only=True)
class CurrentSum(Current):
    """Velocities of several currents added; without parts it is still water."""

    kind: ClassVar[str] = "sum"

    parts: tuple[Current, ...] = ()
    """The currents that are added."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        for part in self.parts:
            if not isinstance(part, Current):
                raise CurrentError(f"sum: a part is {type(part).__name__}, it must be a Current")

    def _check_registered(self) -> None:
        for part in self.parts:
            part._check_registered()

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """The records of all parts."""
        return [r for part in self.parts for r in part.records(duration_s, origin)]

    def pinned(self, duration_s: float, origin: Origin | None = None) -> CurrentSum:
        """Each part pinned."""
        return CurrentSum(parts=tuple(part.pinned(duration_s, origin) for part in self.parts))

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """As the parts say; the first that says anything wins."""
        for part in reversed(self.parts):
            origin = part.begins(duration_s, origin)
        return origin

    def check_place(self, latitude_deg: float, longitude_deg: float) -> None:
        """Each part's check."""
        for part in self.parts:
            part.check_place(latitude_deg, longitude_deg)

    def check_time(self, time: str) -> None:
        """Each part's check."""
        for part in self.parts:
            part.check_time(time)

    def reaching(self, distance_m: float) -> CurrentSum:
        """Each part reaching as far."""
        return CurrentSum(parts=tuple(part.reaching(distance_m) for part in self.parts))

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """From `describe()`, nested parts rebuilt first."""
        parts = settings.get("parts", ())
        return super().from_settings(
            {**settings, "parts": tuple(current_from_dict(part) for part in parts)}
        )


def still_water() -> CurrentSum:
    """No current at all."""
    return CurrentSum()


def current_from_dict(description: Mapping[str, Any]) -> Current:
    """The current that `describe()` described. Raises CurrentError when it cannot be one."""
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
    """The kind of that name; raises CurrentError, which offers what is `also` allowed."""
    if name in CURRENTS:
        kind: type[Current] = CURRENTS[name]
        return kind
    hint = ""
    if name[:1].isdigit() or name[:1] in "+-.":  # velocities alone
        hint = f"; write uniform:{name} for a velocity north, east in m/s"
    raise CurrentError(unknown_name("current", name, [*CURRENTS, *also]) + hint)


def _parts(current: Current) -> tuple[Current, ...]:
    return current.parts if isinstance(current, CurrentSum) else (current,)


def _plain(value: Any) -> Any:
    """JSON types only: tuples become lists, nested currents and records their descriptions."""
    if hasattr(value, "describe"):
        return value.describe()
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value
