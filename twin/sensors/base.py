"""Base: the class of every sensor, and the registry of the sensors that a suite can hold.

A sensor is one file with one frozen dataclass: its fields are the settings, its class attributes
say what it reads, writes and draws, and `measure` is its model. `register` makes it known; then
suites, stores, limits, figures and tables take it from there.

A sensor that can also measure sample by sample, in a simulation that it steers, gives `begin`
instead: a run, which measures one stretch of a mission after the other, all of it at once or a
sample at a time, to the same readings.

`register` refuses an incomplete sensor.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin import seams
from twin.errors import InputError
from twin.records.schema import VARIABLES, Variable, declare
from twin.registry import Registry
from twin.sensors.checks import Drawn, Signals

if TYPE_CHECKING:
    from twin.water.density import DensityProfile


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings:
    """Where a mission takes place, beside what its truth says."""

    latitude: float = 36.8
    """[deg]"""
    longitude: float = -121.8
    """[deg] for the composition of the salt; the default is that of `twin.water.density`"""
    density: DensityProfile | None = None
    """None: constant, the default profile"""
    bottom_depth: ArrayLike | None = None
    """[m] a number or one per sample; None: out of reach of every instrument"""
    floor: NDArray[np.float64] | None = None
    """the compiled sea floor; None: flat at the bottom's depth under each sample"""
    current: NDArray[np.float64] | None = None
    """the compiled current field; None: the vehicle's own current holds at every depth"""


NOWHERE = Surroundings()
"""The defaults of all of them"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Outset:
    """What a sensor knows of a mission before its first sample."""

    samples: int
    """of the mission at most, n; random numbers are drawn for so many"""
    signals: Iterable[str]
    """names of what the vehicle has"""
    dt: float
    """[s] between samples"""
    drawn: Drawn
    """the constants of the mission, of all sensors"""
    rng: np.random.Generator
    """the sensor's own stream"""
    surroundings: Surroundings = NOWHERE


class SensorRun:
    """A sensor at work in one mission, a stretch of samples after the other."""

    delay = 0
    """Samples that have to be known beyond those that are measured, as when readings are means over
    an interval around the sample."""
    carried: NDArray[np.float64] = np.zeros(0)
    """What later readings depend on, beside the signals and what `begin` drew."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """Readings of the samples first to last - 1, of shape (last - first,), by channel.

        Args:
          signals: arrays of the whole mission, shape (n,), known up to sample last - 1 + `delay`.
          first: where the stretch before ended, 0 at first.
        """
        raise NotImplementedError

    def finish(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """`measure` for the last stretch of a mission that ended after `last` samples."""
        return self.measure(signals, first, last)

    def state(self) -> dict[str, NDArray[Any]]:
        """What later readings depend on, as arrays by name."""
        return {"carried": self.carried.copy()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from where `state` was called."""
        self.carried = np.array(state["carried"], np.float64)


class Sensor:
    """One device of a vehicle; subclasses are frozen dataclasses whose fields all have defaults."""

    name: ClassVar[str]
    """What suites, stores and the command line call it; also the name of its random streams"""
    reads: ClassVar[tuple[str, ...]] = ()
    """Signals that `measure` needs: true_*, commanded_*, or measured_* of other sensors"""
    reads_if_there: ClassVar[tuple[str, ...]] = ()
    """Signals that `measure` uses where the vehicle has them"""
    writes: ClassVar[tuple[Variable, ...]] = ()
    """What it measures: names, units, meanings and limits"""
    draws: ClassVar[Mapping[str, str]] = {}
    """Units of the constants that a mission draws, by name, in the order of `draw`"""
    ideal_is_truth: ClassVar[bool] = False
    """True: with the settings of `ideal` it passes the arrays of the truth on as they are"""

    unset: ClassVar[Mapping[str, Any]] = {}
    """What a setting is in stores that were made before it existed, by name"""

    @classmethod
    def ideal(cls) -> Self:
        """The sensor without errors."""
        raise NotImplementedError

    def inputs(self, signals: Iterable[str]) -> tuple[str, ...]:
        """The signals that `measure` reads of a vehicle that has `signals`."""
        there = set(signals)
        return (*self.reads, *(name for name in self.reads_if_there if name in there))

    def channels(self, signals: Iterable[str]) -> tuple[Variable, ...]:
        """What `measure` writes for a vehicle that has `signals`."""
        return self.writes

    def draw_normal(self, rng: np.random.Generator, spread: Sequence[float]) -> dict[str, float]:
        """A normal number of mean 0 for each of `draws`, with these standard deviations."""
        unit = rng.standard_normal(len(spread))
        return {
            name: float(std * unit[i])
            for i, (name, std) in enumerate(zip(self.draws, spread, strict=True))
        }

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """The constants of one mission, by name as in `draws`."""
        return {}

    def begin(self, outset: Outset) -> SensorRun:
        """Begin to measure one mission, sample by sample or all at once.

        Raises:
          InputError: it measures whole missions only.
        """
        raise InputError(
            f"sensor {self.name!r} measures whole missions only, and here one is measured sample "
            "by sample: give it a method `begin` (docs/reference/sensors.md), or leave it out "
            "of the suite"
        )

    def measure(
        self,
        signals: Signals,
        *,
        dt: float,
        drawn: Drawn,
        rng: np.random.Generator,
        surroundings: Surroundings = NOWHERE,
    ) -> dict[str, NDArray[Any]]:
        """Measure one mission: what `begin` gives, over all samples at once.

        Args:
          signals: what `inputs` names, arrays of shape (n,) every `dt` [s], not to be changed.
          drawn: the constants of the mission, of all sensors.
          rng: the sensor's own stream.

        Returns:
          An array of shape (n,) for each of `channels`, in its unit.
        """
        n = len(signals[self.inputs(signals)[0]])
        run = self.begin(
            Outset(
                samples=n, signals=signals, dt=dt, drawn=drawn, rng=rng, surroundings=surroundings
            )
        )
        return run.measure(signals, 0, n)

    @classmethod
    def observed(cls, name: str, signals: Signals) -> NDArray[Any] | None:
        """The true signal behind `measured_NAME`, for figures; None when there is none."""
        return signals.get(f"true_{name}")

    @classmethod
    def flaw(cls, name: str) -> str:
        """What is wrong with a kind; the variables of a whole one are declared in the schema."""
        flaw = cls._unfinished() or _flaw_of_variables(cls.writes)
        if not flaw:
            drawn = cls().draw(np.random.default_rng(0))
            if list(drawn) != list(cls.draws):
                flaw = (
                    f"`draw` gives {', '.join(drawn) or 'nothing'} and `draws` names "
                    f"{', '.join(cls.draws) or 'nothing'}: both must name the same constants with "
                    "units"
                )
        for other in () if flaw else SENSORS.loaded():
            signals = {entry.name for entry in cls.writes} & {entry.name for entry in other.writes}
            taken = [*sorted(signals), *sorted(cls.draws.keys() & other.draws.keys())]
            if taken and other.name != name:
                return f"it has {taken[0]!r}, which sensor {other.name!r} has too: rename it"
        for entry in () if flaw else cls.writes:
            declare(entry)
        return flaw

    @classmethod
    def _unfinished(cls) -> str:
        """What it lacks as a class."""
        parameters = getattr(cls, "__dataclass_params__", None)
        if "__dataclass_fields__" not in vars(cls) or not (parameters and parameters.frozen):
            return "make it a frozen dataclass: @dataclasses.dataclass(frozen=True, kw_only=True)"
        for field in dataclasses.fields(cast(Any, cls)):
            if field.default is field.default_factory is dataclasses.MISSING:
                return f"its field {field.name!r} needs a default"
        if cls.measure is Sensor.measure and cls.begin is Sensor.begin:
            return "it needs a method `measure` or `begin`"
        if not cls.reads and cls.inputs is Sensor.inputs:
            return "`reads` must name the signals that it needs, such as true_depth"
        for signal in (*cls.reads, *cls.reads_if_there):
            if not signal.startswith(PREFIXES):
                return f"it reads {signal!r}, which must begin with {', '.join(PREFIXES)}"
        if not cls.writes and cls.channels is Sensor.channels:
            return "`writes` must hold a twin.records.schema.Variable for each measured signal"
        try:
            ideal = cls.ideal()
        except NotImplementedError:
            return "it needs a classmethod `ideal`: the sensor without errors"
        if type(ideal) is not cls:
            return f"`ideal` must return a {cls.__name__}, not {ideal!r}"
        return ""


PREFIXES = ("true_", "commanded_", "measured_")


def _flaw_of_variables(writes: Sequence[Any]) -> str:
    for entry in writes:
        if not isinstance(entry, Variable):
            return f"`writes` holds {entry!r}: give twin.records.schema.Variable objects"
        if not entry.name.startswith("measured_"):
            return f"it writes {entry.name!r}, which must begin with measured_"
        if not entry.units or not entry.long_name:
            return f'{entry.name} needs units ("1" for none) and a long_name'
        if VARIABLES.get(entry.name) != entry and entry.limits is None:
            return (
                f"{entry.name} needs limits=(lowest, highest): what the instrument can possibly say"
            )
    return ""


SENSORS: Registry[type[Sensor]] = seams.SENSORS
"""Every sensor by name; the shipped ones are in every suite."""

register = SENSORS.add
"""Add a sensor of one's own; usable as a decorator."""


def table() -> str:
    """The shipped sensors as a markdown table, as docs/reference/sensors.md shows it.

    Units and drawn constants are in the data dictionary.
    """
    rows = ["| sensor | reads | measures |", "|---|---|---|"]
    for name in SENSORS.shipped():
        sensor = SENSORS[name]
        reads = [f"`{signal}`" for signal in sensor.reads] or ["`true_PART` of each moving part"]
        writes = [f"`{entry.name}`" for entry in sensor.writes]
        cells = (reads, writes or ["`measured_PART`"])
        rows.append(f"| `{name}` | {' | '.join(', '.join(cell) for cell in cells)} |")
    return "\n".join(rows) + "\n"
