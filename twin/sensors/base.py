"""Sensor: the base class, the table of its types, and shared code for checks and random streams.

A sensor is a frozen dataclass. Its fields are the settings, its class attributes declare the
signals and constants, and `measure` is its model. After `register`, suites, stores, limits, figures
and tables use the sensor.

A sensor that can measure sample by sample, in a simulation that depends on the readings, defines
`begin` instead. It returns a run, which measures consecutive stretches of a mission. The readings
do not depend on the stretches' lengths.

`register` refuses an incomplete sensor.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin import seams
from twin.errors import InputError, unknown_name
from twin.numbers import Array, number
from twin.records.schema import VARIABLES, Variable, declare
from twin.registry import Registry
from twin.sensors.kernels import gauss_markov_kernel

if TYPE_CHECKING:
    from twin.water.density import DensityProfile

Signals = Mapping[str, NDArray[Any]]
Drawn = Mapping[str, float]

PREFIXES = ("true_", "commanded_", "measured_")
PLACES = (
    "imu", "attitude", "compass", "pressure", "gps", "dvl", "encoders", "onboard", "ctd",
    "altimeter",
)  # fmt: skip
"""Positions of the shipped sensors in the seed tree: append, never reorder. Any other sensor's
position is a hash of its name."""
DRAWN_STREAM, NOISE_STREAM = 0, 1
KNOTS = 20
"""Minimum number of knots per correlation time; slow processes are linear between their knots."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings:
    """Place, water, sea floor and current of a mission, which its truth does not contain."""

    latitude: float = 36.8
    """[deg] Latitude of the mission."""
    longitude: float = -121.8
    """[deg] Longitude, for the composition of the salt; the default is `twin.water.density`'s."""
    density: DensityProfile | None = None
    """Density profile; None: constant, the default profile."""
    bottom_depth: ArrayLike | None = None
    """[m] Depth of the bottom, a number or one per sample; None: out of the instruments' reach."""
    floor: Array | None = None
    """Compiled sea floor; None: flat at `bottom_depth` under each sample."""
    current: Array | None = None
    """Compiled current field; None: the current at the vehicle holds at every depth."""


NOWHERE = Surroundings()
"""Surroundings with all defaults."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Outset:
    """Data of a mission that are known before its first sample."""

    samples: int
    """Maximum number of samples in the mission, n; random numbers are sampled for n samples."""
    signals: Iterable[str]
    """Names of the vehicle's signals."""
    dt: float
    """[s] Time between samples."""
    drawn: Drawn
    """Constants of the mission, of all sensors."""
    rng: np.random.Generator
    """Random stream of the sensor."""
    surroundings: Surroundings = NOWHERE


class SensorRun:
    """Run of a sensor through one mission, in consecutive stretches of samples."""

    delay = 0
    """Number of later samples that a reading needs, such as for a mean around the sample."""
    carried: Array = np.zeros(0)
    """State on which later readings depend, besides the signals and the random numbers."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """Measure the samples first to last - 1; returns arrays (last - first,) by channel.

        Args:
          signals: arrays of the whole mission, shape (n,), known up to sample last - 1 + `delay`.
          first: index after the stretch before, 0 at the mission's start.
        """
        raise NotImplementedError

    def finish(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """Measure the last stretch of a mission that ended after `last` samples."""
        return self.measure(signals, first, last)

    def state(self) -> dict[str, NDArray[Any]]:
        """Copy the state on which later readings depend: arrays by name."""
        return {"carried": self.carried.copy()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a `state` saved earlier."""
        self.carried = np.array(state["carried"], np.float64)


class Sensor:
    """One device of a vehicle; subclasses are frozen dataclasses whose fields all have defaults."""

    name: ClassVar[str]
    """Name in suites, in stores, on the command line and for its random streams."""
    reads: ClassVar[tuple[str, ...]] = ()
    """Signals that `measure` needs: true_*, commanded_*, or measured_* of other sensors."""
    reads_if_there: ClassVar[tuple[str, ...]] = ()
    """Signals that `measure` uses if the vehicle has them."""
    writes: ClassVar[tuple[Variable, ...]] = ()
    """Measured variables: names, units, meanings and limits."""
    draws: ClassVar[Mapping[str, str]] = {}
    """Units of the constants sampled per mission, by name, in the order of `draw`."""
    ideal_is_truth: ClassVar[bool] = False
    """True: with the settings of `ideal`, the readings are the truth's own arrays."""

    unset: ClassVar[Mapping[str, Any]] = {}
    """Values, by name, of settings that are absent in older stores."""

    @classmethod
    def ideal(cls) -> Self:
        """Make the sensor without errors."""
        raise NotImplementedError

    def inputs(self, signals: Iterable[str]) -> tuple[str, ...]:
        """Signals that `measure` reads from a vehicle that has `signals`."""
        there = set(signals)
        return (*self.reads, *(name for name in self.reads_if_there if name in there))

    def channels(self, signals: Iterable[str]) -> tuple[Variable, ...]:
        """Variables that `measure` writes for a vehicle that has `signals`."""
        return self.writes

    def draw_normal(self, rng: np.random.Generator, spread: Sequence[float]) -> dict[str, float]:
        """Sample a normal number of mean 0 for each of `draws`; `spread`: standard deviations."""
        unit = rng.standard_normal(len(spread))
        return dict(zip(self.draws, (np.asarray(spread) * unit).tolist(), strict=True))

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample the constants of one mission, by name as in `draws`."""
        return {}

    def begin(self, outset: Outset) -> SensorRun:
        """Begin to measure one mission, sample by sample or all at once.

        Raises:
          InputError: the sensor measures whole missions only.
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
        """Measure one mission, all samples of `begin` at once.

        Args:
          signals: the signals of `inputs`, arrays of shape (n,) every `dt` [s], not to be changed.
          drawn: the constants of the mission, of all sensors.
          rng: the sensor's own stream.

        Returns:
          An array of shape (n,) for each of `channels`, in its unit.
        """
        n = len(signals[self.inputs(signals)[0]])
        outset = Outset(
            samples=n, signals=signals, dt=dt, drawn=drawn, rng=rng, surroundings=surroundings
        )
        return self.begin(outset).measure(signals, 0, n)

    @classmethod
    def observed(cls, name: str, signals: Signals) -> NDArray[Any] | None:
        """Find the true signal behind `measured_NAME`, for figures; None when there is none.

        The sensor's own name may precede the signal's: measured_gps_north, true_north.
        """
        own = f"{getattr(cls, 'name', '')}_"
        return signals.get(f"true_{name}", signals.get(f"true_{name.removeprefix(own)}"))

    @classmethod
    def flaw(cls, name: str) -> str:
        """Describe a type's first defect; if there is none, declare its variables in the schema."""
        if flaw := cls._unfinished() or _flaw_of_variables(cls.writes):
            return flaw
        drawn = cls().draw(np.random.default_rng(0))
        if list(drawn) != list(cls.draws):
            return (
                f"`draw` gives {', '.join(drawn) or 'nothing'} and `draws` names "
                f"{', '.join(cls.draws) or 'nothing'}: both must name the same constants with units"
            )
        for other in SENSORS.loaded():
            signals = {entry.name for entry in cls.writes} & {entry.name for entry in other.writes}
            taken = [*sorted(signals), *sorted(cls.draws.keys() & other.draws.keys())]
            if taken and other.name != name:
                return f"it has {taken[0]!r}, which sensor {other.name!r} has too: rename it"
        for entry in cls.writes:
            declare(entry)
        return ""

    @classmethod
    def _unfinished(cls) -> str:
        """Describe the first missing piece of the class."""
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
"""All sensors by name; every suite has the shipped sensors."""

register = SENSORS.add
"""Register your own sensor; usable as a decorator."""


def _require(config: Any, names: Iterable[str], fits: Callable[[float], bool], rule: str) -> None:
    """Raise InputError unless the numbers of each named field fit a rule.

    A field holds several numbers if its default or its type is a tuple.
    """
    for name in names:
        value, label = getattr(config, name), f"{type(config).__name__}.{name}"
        (declared,) = (f for f in dataclasses.fields(config) if f.name == name)
        several = isinstance(value, tuple) and (
            isinstance(declared.default, tuple) or "tuple" in str(declared.type)
        )
        for one in [number(one, label) for one in (value if several else (value,))]:
            if not fits(one):
                raise InputError(f"{label} is {one:g}: it must be {rule}")


def require_non_negative(config: Any, *names: str) -> None:
    """Raise InputError unless each named field is finite and at least 0."""
    _require(config, names, lambda v: math.isfinite(v) and v >= 0.0, "finite and at least 0")


def require_positive(config: Any, *names: str) -> None:
    """Raise InputError unless each named field is above 0 (infinity is allowed)."""
    _require(config, names, lambda v: v > 0.0, "above 0")


def require_finite(config: Any, *names: str) -> None:
    """Raise InputError unless each named field is finite."""
    _require(config, names, math.isfinite, "finite")


def drawn_value(drawn: Drawn, name: str) -> float:
    """Return the constant `name` of a mission; raises InputError, which offers the nearest name."""
    try:
        return float(drawn[name])
    except KeyError:
        raise InputError(unknown_name("drawn sensor value", name, drawn)) from None


def signal(truth: Signals, name: str) -> Array:
    """Return truth[name] as a contiguous float64 vector, copied only if necessary."""
    try:
        array = truth[name]
    except KeyError:
        raise InputError(
            f"truth lacks {name!r}, which the sensors need: add it to the recorded signals"
        ) from None
    return np.ascontiguousarray(array, dtype=np.float64)


def columns(signals: Signals, names: Iterable[str], span: Any = slice(None)) -> list[Array]:
    """Return signals by name, each at a span or at indices of samples."""
    return [signal(signals, name)[span] for name in names]


def sensor_generator(
    seed: np.random.SeedSequence, sensor: str, stream: int = NOISE_STREAM
) -> np.random.Generator:
    """Make the random generator of a sensor from `seed`, which is not changed.

    Each sensor has two streams, `DRAWN_STREAM` for the constants of a mission and `NOISE_STREAM`,
    so that neither another sensor nor a constant given by hand changes the noise.
    """
    if sensor in PLACES:
        place = PLACES.index(sensor)
    else:
        place = int.from_bytes(hashlib.sha256(sensor.encode()).digest()[:8])
    key = (*seed.spawn_key, place, stream)
    child = np.random.SeedSequence(seed.entropy, spawn_key=key, pool_size=seed.pool_size)
    return np.random.Generator(np.random.SFC64(child))


def normals(rng: np.random.Generator, *shape: int) -> NDArray[np.float32]:
    """Sample standard normal float32: rounding of 1e-7 sigma, cheaper than float64."""
    return rng.standard_normal(shape, dtype=np.float32)


def knot_count(n: int, stride: int) -> int:
    """Number of knots that span `n` samples."""
    return (n - 1) // stride + 2


def gauss_markov_knots(std: float, dt: float, correlation_time: float) -> tuple[float, float, int]:
    """Standard deviation at the knots, decay from knot to knot and stride of a process.

    Knots are at most 1/KNOTS of the correlation time apart; decay = exp(-h / correlation_time) is
    the exact step. Linear interpolation lowers the mean variance to 2/3 + decay/3. The knots
    compensate for this, so that `std` is the RMS of the result.
    """
    stride = max(1, int(correlation_time / (KNOTS * dt)))
    decay = math.exp(-stride * dt / correlation_time)
    if stride > 1:
        std /= math.sqrt((2.0 + decay) / 3.0)
    return std, decay, stride


def gauss_markov(
    rng: np.random.Generator, n: int, *, std: float, dt: float, correlation_time: float
) -> Array:
    """Sample a stationary first-order Gauss-Markov process (n,), RMS `std`, every `dt` [s]."""
    std, decay, stride = gauss_markov_knots(std, dt, correlation_time)
    out = np.empty(n)
    gauss_markov_kernel(normals(rng, knot_count(n, stride)), std, decay, stride, out)
    return out
