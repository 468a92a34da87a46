"""Fault: the base class, the table of its types, and the condition of a vehicle with faults.

A fault changes numbers of a vehicle as a function of time. `change` changes the hull law, volume,
mass, parts, losses and batteries; `readings` changes the readings of sensors. Every engine flies
the changed vehicle and needs no code for faults.

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
"""[s] Length of a day."""
KNOT = 600.0
"""[s] Time step of a growing fault: the growth in one step is below a sensor's resolution."""
FROM = "from"
"""Command-line name of the time at which a fault begins."""
UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": DAY}
"""[s] Length of each unit of time."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Condition:
    """State of a vehicle with faults at one time."""

    vehicle: Vehicle
    volume: float
    """[m3] Displaced volume with the pumps at neutral, at zero pressure."""
    zeros: Mapping[str, float]
    """Position of a part when its encoder reads 0, by the part's name, in the part's unit."""
    consumption: Consumption
    packs: float = 1.0
    """Fraction of the batteries that is connected."""
    iron: tuple[float, float] = (0.0, 0.0)
    """[rad] Error of guidance's compass: coefficients (sine, cosine) of the true heading."""
    compass_offset: float = 0.0
    """[rad] Error of guidance's compass on every heading: reading minus true heading."""
    depth_offset: float = 0.0
    """[m] Depth of guidance's pressure gauge minus the true depth."""
    echoes_lost: float = 0.0
    """Fraction of the altimeter returns that guidance does not receive."""
    taken: float = 0.0
    """[m3] Water inside the hull, which compresses the air in the hull."""

    def replace(self, **changes: Any) -> Condition:
        """Return a copy with other fields."""
        return dataclasses.replace(self, **changes)

    def with_vehicle(self, **changes: Any) -> Condition:
        """Return a copy whose vehicle has other numbers, as in `Vehicle.replace`."""
        return self.replace(vehicle=self.vehicle.replace(**changes))

    def with_mass(self, kilograms: float, place: Sequence[float], volume: float = 0.0) -> Condition:
        """Return a copy with `kilograms` added to the hull, or removed if negative.

        Args:
          place: centre of gravity of the added mass [m], body FRD about the CB, shape (3,).
          volume: [m3] that the added mass displaces besides the hull.
        """
        vehicle = self.vehicle
        static = vehicle.static_mass + kilograms
        at = np.asarray(place, float)
        cg = (vehicle.static_mass * vehicle.static_cg + kilograms * at) / static
        # parallel-axis theorem, about the centre of gravity of the fixed block
        before, own = at - vehicle.static_cg, vehicle.static_mass * kilograms / static
        inertia = vehicle.static_inertia + own * (
            before @ before * np.eye(3) - np.outer(before, before)
        )
        return self.replace(
            vehicle=vehicle.replace(static_mass=static, static_cg=cg, static_inertia=inertia),
            volume=self.volume + volume,
        )

    def with_losses(self, **changes: float) -> Condition:
        """Return a copy with other losses of drives and electronics."""
        return self.replace(consumption=dataclasses.replace(self.consumption, **changes))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fault:
    """A defect of a vehicle that begins at a given time."""

    kind: ClassVar[str] = ""
    """Name of the type on the command line and in stores."""
    says: ClassVar[str] = ""
    """Name of the fault in a pilot's words."""
    size_name: ClassVar[str] = ""
    """Name of the field that holds the size."""
    unit: ClassVar[str] = "1"
    """Unit of the size."""
    sizes: ClassVar[tuple[float, float]] = (1.0, 1.0)
    """Smallest and largest size in sampled deployments."""
    most: ClassVar[float] = 1.0
    """Largest possible size."""
    whole: ClassVar[bool] = True
    """False: sizes must stay below `most`; for example, a propeller cannot lose all blades."""
    grows: ClassVar[bool] = False
    """True: the size is the growth per day."""
    signed: ClassVar[bool] = False
    """True: the size may be negative."""
    source: ClassVar[str] = ""
    """Source of the size and of the effect."""
    shows: ClassVar[str] = ""
    """Traces of the fault in a log."""
    otherwise: ClassVar[str] = ""
    """Other causes of similar traces."""
    find_out: ClassVar[str] = ""
    """Test by which a pilot can confirm the fault."""

    start: float = 0.0
    """[s] Time on the scenario's clock at which the fault begins; negative: before the start."""

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

    # --- methods of a type ------------------------------------------------------------------------

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Reason why a vehicle cannot have the fault; empty if it can."""
        return ""

    def problems(self) -> list[str]:
        """Problems of the fields other than the size."""
        return []

    def change(self, condition: Condition, size: float) -> Condition:
        """Return the condition with a fault of this size, which is not 0."""
        return condition

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """Measured signals that the fault changes, by name, each of shape (n,).

        Args:
          signals: readings of the sensors, and the truth where there is one, shape (n,).
          size: size of the fault at each sample, 0 before the fault begins.
          period: [s] between samples.
        """
        return {}

    def begin(self) -> FaultRun:
        """Begin a run, which changes the readings of consecutive stretches of a mission.

        If readings depend on earlier samples, the run remembers these samples.
        """
        return FaultRun(self)

    def expected(self, way: Array) -> Mapping[str, Array] | None:
        """Changes of the health channels by a fault of size 1 in each dive, (dives,), by name;
        None: simulate the dives with and without the fault to get them.

        Args:
          way: mean velocity through the water by the compass, north and east [m/s], (dives, 2).
        """
        return None

    @property
    def gone(self) -> tuple[str, ...]:
        """Prefixes of the names of geoms in the vehicle file that pictures leave out."""
        return ()

    # --- methods common to all types --------------------------------------------------------------

    @property
    def size(self) -> float:
        """Size of the fault, or its growth per day, in `unit`."""
        return float(getattr(self, self.size_name))

    def at(self, time: ArrayLike) -> Array:
        """Size at times [s] on the scenario's clock; 0 before the fault begins."""
        since = np.asarray(time, float) - self.start
        grown = since / DAY if self.grows else 1.0
        return np.where(since >= 0.0, self.size * grown, 0.0)

    @classmethod
    def of_size(cls, size: float, start: float = 0.0, **others: Any) -> Fault:
        """Make a fault of this size; `others` are its other fields."""
        return cls(start=start, **{cls.size_name: size, **others})

    def choices(self, vehicle: Vehicle) -> tuple[Mapping[str, Any], ...]:
        """Values of the other fields that a vehicle can have, such as one for each side."""
        return ({},)

    def describe(self) -> dict[str, Any]:
        """Return a dict of JSON values from which `fault_from_dict` rebuilds the fault."""
        return {"kind": self.kind, **dataclasses.asdict(self)}

    @classmethod
    def flaw(cls, name: str) -> str:
        """Describe the first text, size or method that a type lacks; empty if it is complete."""
        if cls.size_name not in {field.name for field in dataclasses.fields(cls)}:
            return f"it lacks the field {cls.size_name!r} that `size_name` names"
        if cls.change is Fault.change and cls.readings is Fault.readings:
            return "it lacks `change` or `readings`: what it does"
        return ""


@dataclasses.dataclass(eq=False)
class FaultRun:
    """Run of a fault through one mission, in consecutive stretches of samples."""

    fault: Fault
    carried: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    """State on which later readings depend."""

    def readings(self, signals: Readings, size: Array, period: float, rng: Generator) -> Readings:
        """Change the readings of the next stretch; see `Fault.readings`."""
        return self.fault.readings(signals, size, period, rng)


FAULTS: Registry[type[Fault]] = seams.FAULTS
"""All types of fault by name."""

register = FAULTS.add
"""Register your own type of fault; usable as a decorator."""


def faults_of(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the types of fault that a vehicle can have."""
    return tuple(name for name, kind in FAULTS.items() if not kind.unfit(vehicle))


def check_fits(fault: Fault, vehicle: Vehicle) -> None:
    """Raise InputError if a vehicle cannot have a fault."""
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
    """Conditions of a vehicle over a run: pairs of a time [s] and the condition from then on.

    The first time is 0. A growing fault has a step every `KNOT`.
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
    """Condition of a vehicle at one time [s]."""
    found = healthy
    for fault in faults:
        # the size stays constant until the next step: use the size in the middle of the step
        size = float(fault.at(time + 0.5 * KNOT if fault.grows and time >= fault.start else time))
        if size:
            found = fault.change(found, size)
    return found


def read_by(
    faults: Sequence[Fault], signals: Readings, time: Array, rng: Generator, *, period: float
) -> dict[str, Array]:
    """Change measured signals as faulty sensors do; returns the changed signals by name.

    Args:
      signals: signals of one run, (n,). time: [s] on the clock of the faults, shape (n,).
      period: [s] between samples.
    """
    found: dict[str, Array] = {}
    for fault in faults:
        size = fault.at(time)
        if size.any():
            found |= fault.readings({**signals, **found}, size, period, rng)
    return found


def fault_from_dict(data: Mapping[str, Any]) -> Fault:
    """Rebuild a fault from `Fault.describe`; raises InputError for an unknown type or field."""
    kind = FAULTS[str(data.get("kind"))]
    fields = {name: value for name, value in data.items() if name != "kind"}
    known = [field.name for field in dataclasses.fields(kind)]
    for name in fields:
        if name not in known:
            raise InputError(f"fault {kind.kind!r}: {unknown_name('setting', name, known)}")
    return kind(**fields)


def parse_faults(words: str | Sequence[str]) -> tuple[Fault, ...]:
    """Parse faults in words such as `fouling:per_day=0.02,from=3d` or `wing_lost:side=port`.

    Settings are the type's fields; `from` is a time with its unit (s, min, h, d), 0 by default.

    Raises:
      InputError: a type or setting is unknown, or a value is impossible.
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
