"""Fault: the base class, its registry, and the condition of a vehicle that has some.

A fault changes numbers of a vehicle as a function of time: its law, volume, mass, parts, losses and
batteries by `change`, readings of its sensors by `readings`. Every engine flies the changed
numbers; none knows of faults.

    flown = twin.Scenario(mission=mission, faults=twin.parse_faults("fouling:per_day=0.02,from=3d"))
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from twin import seams
from twin.errors import InputError, unknown_name
from twin.numbers import number
from twin.registry import Registry

if TYPE_CHECKING:
    from twin.vehicle.consumption import Consumption
    from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]
Readings = Mapping[str, Array]

DAY = 86400.0
"""[s]"""
KNOT = 600.0
"""[s] between values of a fault that grows: less growth than a sensor resolves"""
FROM = "from"
"""Names the time at which a fault begins, on the command line"""
UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": DAY}
"""[s] in a unit of time"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Condition:
    """A vehicle as it is at one time."""

    vehicle: Vehicle
    volume: float
    """[m3] that it displaces with its pumps at neutral, at zero pressure"""
    zeros: Mapping[str, float]
    """Position of a part when its encoder says 0, by name, in the part's unit"""
    consumption: Consumption
    packs: float = 1.0
    """Part of its batteries that is connected"""
    iron: tuple[float, float] = (0.0, 0.0)
    """[rad] that guidance's compass reads beyond the true heading, times its sine and cosine"""
    depth_offset: float = 0.0
    """[m] that guidance's depth, by the pressure gauge, is beyond the true one"""
    echoes_lost: float = 0.0
    """Share of the echoes that guidance's altimeter does not hear"""
    taken: float = 0.0
    """[m3] of water inside the hull, whose air it compresses"""

    def replace(self, **changes: Any) -> Condition:
        """A copy with other fields."""
        return dataclasses.replace(self, **changes)

    def with_vehicle(self, **changes: Any) -> Condition:
        """A copy whose vehicle has other numbers, as `Vehicle.replace` takes them."""
        return self.replace(vehicle=self.vehicle.replace(**changes))

    def with_mass(self, kilograms: float, place: Sequence[float], volume: float = 0.0) -> Condition:
        """A copy with a mass more, or less where it is negative, that moves with the hull.

        Args:
          place: of its centre of gravity [m], body FRD about the CB, shape (3,).
          volume: [m3] that it displaces beside the hull.
        """
        vehicle = self.vehicle
        static = vehicle.static_mass + kilograms
        at = np.asarray(place, float)
        cg = (vehicle.static_mass * vehicle.static_cg + kilograms * at) / static
        # parallel axes, about the centre of gravity of the fixed block
        before, own = at - vehicle.static_cg, vehicle.static_mass * kilograms / static
        inertia = vehicle.static_inertia + own * (
            before @ before * np.eye(3) - np.outer(before, before)
        )
        return self.replace(
            vehicle=vehicle.replace(static_mass=static, static_cg=cg, static_inertia=inertia),
            volume=self.volume + volume,
        )

    def with_losses(self, **changes: float) -> Condition:
        """A copy whose drives and electronics take something else."""
        return self.replace(consumption=dataclasses.replace(self.consumption, **changes))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fault:
    """One thing that is wrong with a vehicle, from a time on."""

    kind: ClassVar[str] = ""
    """Name of the kind on the command line and in stores"""
    says: ClassVar[str] = ""
    """Its name in a pilot's words"""
    size_name: ClassVar[str] = ""
    """The field that holds its size"""
    unit: ClassVar[str] = "1"
    """of the size"""
    sizes: ClassVar[tuple[float, float]] = (1.0, 1.0)
    """Smallest and largest size that deployments draw"""
    most: ClassVar[float] = 1.0
    """Largest size that there can be"""
    whole: ClassVar[bool] = True
    """False: the largest itself cannot be, as all blades cannot be gone"""
    grows: ClassVar[bool] = False
    """True: the size is what is added a day"""
    signed: ClassVar[bool] = False
    """True: its size may be negative"""
    source: ClassVar[str] = ""
    """Where its size and its effect are from"""
    shows: ClassVar[str] = ""
    """Its traces in a log"""
    otherwise: ClassVar[str] = ""
    """Other causes that would look like it"""
    find_out: ClassVar[str] = ""
    """A pilot's way to be sure"""

    start: float = 0.0
    """[s] on the scenario's clock from when on; negative: it began before"""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, str):
                continue
            if not math.isfinite(number(value, f"fault {self.kind}: {field.name}")):
                raise InputError(f"fault {self.kind}: {field.name} = {value} must be finite")
        size = abs(self.size) if self.signed else self.size
        problems = self.problems()
        if not (0.0 < size < self.most or (self.whole and size == self.most)):
            unit = "" if self.unit == "1" else f" {self.unit}"
            rule = f"must lie between 0 and {self.most:g}"
            if self.signed:
                rule = f"must be within {self.most:g}, not 0"
            elif self.whole:
                rule = f"must be above 0 and at most {self.most:g}"
            problems = [f"{self.size_name} = {self.size:g}{unit} {rule}"]
        for problem in problems:
            raise InputError(f"fault {self.kind}: {problem}")

    # --- for a kind to give ---------------------------------------------------------------------

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Why a vehicle cannot have it; empty where it can."""
        return ""

    def problems(self) -> list[str]:
        """Problems of its other fields."""
        return []

    def change(self, condition: Condition, size: float) -> Condition:
        """The vehicle with a fault of that size, which is not 0."""
        return condition

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """The measured signals that it changes, by name, each of shape (n,).

        Args:
          signals: as the sensors measured them, and the truth where there is one, shape (n,).
          size: of the fault at each sample, 0 before it began.
          period: [s] between samples.
        """
        return {}

    def begin(self) -> FaultRun:
        """Begin to change readings, a stretch of a mission after the other.

        A kind whose readings depend on earlier samples gives a run that remembers them.
        """
        return FaultRun(self)

    def expected(self, way: Array) -> Mapping[str, Array] | None:
        """Changes of the channels of health by a fault of size 1 in each dive, (dives,), by name;
        None: flights of the twin with and without it tell.

        Args:
          way: mean velocity through the water by the compass, north and east [m/s], (dives, 2).
        """
        return None

    @property
    def gone(self) -> tuple[str, ...]:
        """Beginnings of the names of a vehicle file's geoms that pictures leave out."""
        return ()

    # --- common to all --------------------------------------------------------------------------

    @property
    def size(self) -> float:
        """Its size, or what is added to it a day, in `unit`."""
        return float(getattr(self, self.size_name))

    def at(self, time: ArrayLike) -> Array:
        """Its size at times [s] on the scenario's clock; 0 before it begins."""
        since = np.asarray(time, float) - self.start
        grown = since / DAY if self.grows else 1.0
        return np.where(since >= 0.0, self.size * grown, 0.0)

    @classmethod
    def of_size(cls, size: float, start: float = 0.0, **others: Any) -> Fault:
        """One of a size; `others` are its other fields."""
        return cls(start=start, **{cls.size_name: size, **others})

    def choices(self, vehicle: Vehicle) -> tuple[Mapping[str, Any], ...]:
        """The values of its other fields that a vehicle can have, such as one for each side."""
        return ({},)

    def describe(self) -> dict[str, Any]:
        """A JSON-able dict from which `fault_from_dict` rebuilds it."""
        return {"kind": self.kind, **dataclasses.asdict(self)}

    @classmethod
    def flaw(cls, name: str) -> str:
        """The first thing that a kind lacks."""
        if cls.size_name not in {field.name for field in dataclasses.fields(cls)}:
            return f"it lacks the field {cls.size_name!r} that `size_name` names"
        if cls.change is Fault.change and cls.readings is Fault.readings:
            return "it lacks `change` or `readings`: what it does"
        return ""


@dataclasses.dataclass(eq=False)
class FaultRun:
    """A fault at work in one mission, a stretch of samples after the other."""

    fault: Fault
    carried: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    """State on which later readings depend"""

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """See `Fault.readings`, for the stretch after the last one."""
        return self.fault.readings(signals, size, period, rng)


FAULTS: Registry[type[Fault]] = seams.FAULTS
"""Every kind of fault by name."""

register = FAULTS.add
"""Add a kind of one's own; usable as a decorator."""


def faults_of(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the kinds that a vehicle can have."""
    return tuple(name for name, kind in FAULTS.items() if not kind.unfit(vehicle))


def check_fits(fault: Fault, vehicle: Vehicle) -> None:
    """Raise InputError where a vehicle cannot have a fault."""
    reason = type(fault).unfit(vehicle)
    if reason:
        known = ", ".join(faults_of(vehicle)) or "none"
        raise InputError(
            f"fault {fault.kind}: vehicle {vehicle.name!r} {reason}; "
            f"faults that it can have: {known}"
        )


def conditions(
    faults: Sequence[Fault], healthy: Condition, duration: float
) -> tuple[tuple[float, Condition], ...]:
    """The vehicle over a run, as pairs of time [s] and the condition from then on, the first at 0.

    A fault that grows has a step every `KNOT`.
    """
    times = {0.0}
    for fault in faults:
        begins = max(fault.start, 0.0)
        steps = math.ceil((duration - begins) / KNOT) if fault.grows else 0
        times |= {begins, *(begins + KNOT * k for k in range(steps))}
    return tuple(
        (time, condition_at(faults, healthy, time)) for time in sorted(times) if time < duration
    )


def condition_at(faults: Sequence[Fault], healthy: Condition, time: float) -> Condition:
    """The vehicle as it is at one time [s]."""
    found = healthy
    for fault in faults:
        # half a knot on: a table's step stands for the time until the next
        size = float(fault.at(time + 0.5 * KNOT if fault.grows and time >= fault.start else time))
        if size:
            found = fault.change(found, size)
    return found


def read_by(
    faults: Sequence[Fault], signals: Readings, time: Array, rng: Generator, *, period: float
) -> dict[str, Array]:
    """Measured signals as faulty sensors give them: those that change, by name.

    Args:
      signals: of one run, shape (n,). time: [s] on the clock of the faults, shape (n,).
      period: [s] between samples.
    """
    found: dict[str, Array] = {}
    for fault in faults:
        size = fault.at(time)
        if size.any():
            found |= fault.readings({**signals, **found}, size, period, rng)
    return found


def fault_from_dict(data: Mapping[str, Any]) -> Fault:
    """Rebuild a fault from `Fault.describe`; raises InputError for an unknown kind or field."""
    kind = FAULTS[str(data.get("kind"))]
    fields = {name: value for name, value in data.items() if name != "kind"}
    known = [field.name for field in dataclasses.fields(kind)]
    for name in fields:
        if name not in known:
            raise InputError(f"fault {kind.kind!r}: {unknown_name('setting', name, known)}")
    return kind(**fields)


def parse_faults(words: str | Sequence[str]) -> tuple[Fault, ...]:
    """Parse faults in words such as `fouling:per_day=0.02,from=3d` or `wing_lost:side=port`.

    Settings are the kind's fields; `from` is a time with its unit (s, min, h, d), 0 by default.

    Raises:
      InputError: an unknown kind or setting, or a value that cannot be.
    """
    return tuple(_parse(word) for word in ([words] if isinstance(words, str) else words))


def _parse(word: str) -> Fault:
    name, _, rest = word.strip().partition(":")
    kind = FAULTS[name.strip()]
    fields = {f.name: f for f in dataclasses.fields(kind) if f.name != "start"}
    known = [*fields, FROM]
    settings: dict[str, float | str] = {}
    for item in filter(None, (part.strip() for part in rest.split(","))):
        key, sign, value = (text.strip() for text in item.partition("="))
        if not sign:
            raise InputError(
                f"fault {word!r}: {item!r} must be NAME=VALUE, with NAME of {', '.join(known)}"
            )
        if key not in known:
            raise InputError(f"fault {name!r}: {unknown_name('setting', key, known)}")
        if key == FROM:
            settings["start"] = _seconds(word, value)
        elif fields[key].type in ("str", str):
            settings[key] = value
        else:
            settings[key] = _number(word, key, value)
    return kind(**settings)  # type: ignore[arg-type]


def _number(word: str, key: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise InputError(f"fault {word!r}: {key}={value} must be a number") from None


def _seconds(word: str, value: str) -> float:
    digits = value.rstrip("abcdefghijklmnopqrstuvwxyz").strip()
    unit = value[len(digits) :].strip() or "s"
    if unit not in UNITS:
        raise InputError(f"fault {word!r}: {unknown_name('unit of time', unit, UNITS)}")
    return _number(word, FROM, digits) * UNITS[unit]
