"""What every kind of fault says of itself: what it changes in a vehicle, and since when.

A fault changes numbers of a vehicle as a function of time: its law, volume, mass, parts, losses and
batteries by `change`, what its sensors read by `readings`. Every engine flies the changed numbers;
none knows of faults.

    flown = twin.Scenario(mission=mission, faults=twin.parse_faults("fouling:per_day=0.02,from=3d"))

The registry of faults, and what a kind must have to be one.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
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
"""[s] from one value of what grows to the next: a hundredth of a day changes what a vehicle flies
by less than a sensor tells"""


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
    """What it is, as a pilot says it"""
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
    """By what it shows, in a log"""
    otherwise: ClassVar[str] = ""
    """What else would look like it"""
    find_out: ClassVar[str] = ""
    """What a pilot does to be sure"""

    start: float = 0.0
    """[s] on the scenario's clock from when on; negative: it began before"""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, str):
                continue
            if not math.isfinite(number(value, f"fault {self.kind}: {field.name}")):
                raise InputError(f"fault {self.kind}: {field.name} = {value} must be finite")
        for problem in (*self._size_problems(), *self.problems()):
            raise InputError(f"fault {self.kind}: {problem}")

    def _size_problems(self) -> list[str]:
        """Why there can be no such size."""
        size = abs(self.size) if self.signed else self.size
        if 0.0 < size < self.most or (self.whole and size == self.most):
            return []
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.signed:
            rule = f"must be within {self.most:g}, not 0"
        elif self.whole:
            rule = f"must be above 0 and at most {self.most:g}"
        else:
            rule = f"must lie between 0 and {self.most:g}"
        return [f"{self.size_name} = {self.size:g}{unit} {rule}"]

    # --- what a kind says -----------------------------------------------------------------------

    @classmethod
    def unfit(cls, vehicle: Vehicle) -> str:
        """Why a vehicle cannot have it; empty where it can."""
        return ""

    def problems(self) -> list[str]:
        """What is wrong with its other fields."""
        return []

    def change(self, condition: Condition, size: float) -> Condition:
        """The vehicle with a fault of that size, which is not 0."""
        return condition

    def readings(
        self, signals: Readings, size: Array, period: float, rng: np.random.Generator
    ) -> Readings:
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
        """What a fault of size 1 adds to the channels of health in each dive, (dives,), by
        name; None: flights of the twin with and without it tell.

        Args:
          way: mean velocity through the water by the compass, north and east [m/s], (dives, 2).
        """
        return None

    @property
    def gone(self) -> tuple[str, ...]:
        """Beginnings of the names of a vehicle file's geoms that pictures leave out."""
        return ()

    # --- what all have --------------------------------------------------------------------------

    @property
    def size(self) -> float:
        """Its size, or what is added to it a day, in `unit`."""
        return float(getattr(self, self.size_name))

    def at(self, time: ArrayLike) -> Array:
        """Its size at times [s] on the scenario's clock; 0 before it begins."""
        since = np.asarray(time, float) - self.start
        grown = since / DAY if self.grows else 1.0
        return np.where(since >= 0.0, self.size * grown, 0.0)

    def later(self, seconds: float) -> Fault:
        """The same fault on a clock that begins so much later."""
        return dataclasses.replace(self, start=self.start - seconds)

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
        """What a kind lacks."""
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
    """What later readings depend on"""

    def readings(
        self, signals: Readings, size: Array, period: float, rng: np.random.Generator
    ) -> Readings:
        """See `Fault.readings`, of the stretch that follows the one before."""
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
    """The vehicle over a run: from when on [s] it is how, the first one from the start.

    What grows is a table with a step every `KNOT`.
    """
    times = {0.0}
    for fault in faults:
        begins = max(fault.start, 0.0)
        if fault.grows:
            times.update(begins + KNOT * k for k in range(math.ceil((duration - begins) / KNOT)))
        times.add(begins)
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
    faults: Sequence[Fault],
    signals: Readings,
    time: Array,
    rng: np.random.Generator,
    *,
    period: float,
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
    """Rebuild what `Fault.describe` wrote; raises InputError for an unknown kind or field."""
    kind = FAULTS[str(data.get("kind"))]
    fields = {name: value for name, value in data.items() if name != "kind"}
    known = [field.name for field in dataclasses.fields(kind)]
    for name in fields:
        if name not in known:
            raise InputError(f"fault {kind.kind!r}: {unknown_name('setting', name, known)}")
    return kind(**fields)
