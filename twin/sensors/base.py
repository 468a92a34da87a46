"""Base: what every sensor says about itself, and what it measures in.

A sensor is one file with one frozen dataclass: its fields are the settings, its class attributes
say what it reads, writes and draws, and `measure` is its model. `register` makes it known; then
suites, stores, limits, figures and tables take it from there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.records.schema import Variable
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

    def measure(
        self,
        signals: Signals,
        *,
        dt: float,
        drawn: Drawn,
        rng: np.random.Generator,
        surroundings: Surroundings = NOWHERE,
    ) -> dict[str, NDArray[Any]]:
        """Measure one mission.

        Args:
          signals: what `inputs` names, arrays of shape (n,) every `dt` [s], not to be changed.
          drawn: the constants of the mission, of all sensors.
          rng: the sensor's own stream.

        Returns:
          An array of shape (n,) for each of `channels`, in its unit.
        """
        raise NotImplementedError

    @classmethod
    def observed(cls, name: str, signals: Signals) -> NDArray[Any] | None:
        """The true signal behind `measured_NAME`, for figures; None when there is none."""
        return signals.get(f"true_{name}")
