"""Navigation settings: guidance of a simulation by estimates instead of the true state.

The flight filter computes the channels ESTIMATED from measured ones.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.errors import InputError, StoreError
from twin.navigation.flight_filter import FlightFilter, FlightSpread, FlightStart
from twin.navigation.flight_filter_kernels import CHANNELS, OUTPUTS
from twin.numbers import Array, number
from twin.plugins import place_of
from twin.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from twin.navigation.current import CurrentParameters
    from twin.navigation.estimators.base import VelocityEstimator
    from twin.sensors.suite import SensorSuite

TRUTH, ESTIMATE = "truth", "estimate"
"""Settings of guidance. TRUTH: it uses the true state. ESTIMATE: it uses an estimate by the
vehicle's usual estimator."""
ESTIMATED = tuple(f"estimated_{name}" for name in OUTPUTS)
"""Channels of `twin.navigation.flight_filter`, in the order of its outputs"""
MIXED = ("surge", "steady", "surge_sd")
ADAPTED = tuple(f"adapted_{name}" for name in MIXED)
"""Channels of a second flight filter, which starts from earlier dives; networks mix in its surge"""
CTD = "measured_density"
"""Channel of the flight filter that only a CTD measures"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Navigation:
    """Guidance by an on-board estimate: its sensors, velocity estimator and current filter."""

    estimator: str | VelocityEstimator = ESTIMATE
    """Velocity estimator: a name such as "ekf" or "network:runs/mine", an object, or
    "estimate" for the usual one of the vehicle."""
    sensors: str | SensorSuite = "field"
    """Sensor suite, or the name of a preset."""
    seed: int = 0
    """Seed of the sensors' errors."""
    bottom_depth: float | None = None
    """[m] Bottom depth for the DVL in scenarios without a sea floor; None: no bottom in range."""
    current: CurrentParameters | None = None
    """Parameters of the current filter; None: those of a usual sea, with the speed error that the
    estimator states and the compass error that the sensors state."""

    def __post_init__(self) -> None:
        from twin.navigation.current import CurrentParameters
        from twin.navigation.estimators.base import VelocityEstimator
        from twin.sensors.suite import SensorSuite

        if isinstance(self.sensors, str):
            object.__setattr__(self, "sensors", SensorSuite.preset(self.sensors))
        for name, kinds in (
            ("estimator", (str, VelocityEstimator)),
            ("sensors", SensorSuite),
            ("seed", int),
            ("current", (CurrentParameters, type(None))),
        ):
            if not isinstance(getattr(self, name), kinds):
                raise InputError(f"navigation: {name} is {getattr(self, name)!r}")
        if self.seed < 0:
            raise InputError(f"navigation: seed {self.seed} must be 0 or more")
        if self.bottom_depth is not None and not number(self.bottom_depth, "bottom_depth") > 0.0:
            raise InputError(f"navigation: bottom_depth {self.bottom_depth} m must be above 0")

    @classmethod
    def of(cls, given: str | VelocityEstimator | Navigation | None) -> Navigation | None:
        """Convert a word, an estimator or other settings to settings; None for the truth.

        Raises:
          InputError: `given` is something else.
        """
        from twin.navigation.estimators.base import VelocityEstimator

        if given is None or isinstance(given, Navigation):
            return given
        if isinstance(given, str | VelocityEstimator):
            return None if given == TRUTH else cls(estimator=given)
        raise InputError(
            f"navigate is {given!r}: give {TRUTH!r}, {ESTIMATE!r}, the name of a velocity "
            "estimator, an estimator, or a twin.Navigation"
        )

    @property
    def suite(self) -> SensorSuite:
        """Sensor suite."""
        assert not isinstance(self.sensors, str)  # __post_init__ replaced a name by its suite
        return self.sensors

    @property
    def compass_deviation(self) -> float:
        """[degree] Error of the sensors' compass, as stated."""
        return float(self.suite.compass.deviation_deg)

    def open(self, vehicle: Vehicle, period: float) -> VelocityEstimator:
        """Open the estimator for a vehicle, with samples every `period` [s].

        Raises:
          InputError: no estimator has that name, or it does not suit the vehicle.
        """
        from twin.navigation.estimators import open_velocity_estimator, usual_velocity_estimator

        if not isinstance(self.estimator, str):
            self.estimator.reset()
            return self.estimator
        if self.estimator == ESTIMATE:
            return usual_velocity_estimator(vehicle, period)
        return open_velocity_estimator(self.estimator, vehicle, period)

    def describe(self) -> dict[str, Any]:
        """Settings for JSON; `navigation_from_dict` rebuilds them if the estimator is named."""
        named = isinstance(self.estimator, str)
        return {
            "estimator": self.estimator if named else None,
            "estimator_class": "" if named else place_of(self.estimator),
            "sensors": self.suite.settings(),
            "seed": self.seed,
            "bottom_depth": self.bottom_depth,
            "current": None if self.current is None else dataclasses.asdict(self.current),
        }


def navigation_from_dict(data: Mapping[str, Any]) -> Navigation:
    """Rebuild settings from `Navigation.describe`.

    Raises:
      InputError: the estimator was an object.
    """
    from twin.navigation.current import CurrentParameters
    from twin.sensors.suite import SensorSuite

    if data["estimator"] is None:
        raise InputError(
            f"this run was navigated by an object of {data['estimator_class']}, which a file does "
            "not hold: register the estimator under a name (twin.navigation.estimators.register)"
        )
    current = data["current"]
    if current is not None:
        current = CurrentParameters(**{**current, "constituents": tuple(current["constituents"])})
    return Navigation(
        estimator=data["estimator"],
        sensors=SensorSuite.from_settings(data["sensors"]),
        seed=data["seed"],
        bottom_depth=data["bottom_depth"],
        current=current,
    )


def sources(channels: Iterable[str]) -> tuple[str, ...]:
    """Measured channels from which these channels are computed, each once."""
    read = (CHANNELS if channel in ESTIMATED else (channel,) for channel in channels)
    return tuple(dict.fromkeys(itertools.chain.from_iterable(read)))


def estimate(
    signals: Mapping[str, Array],
    vehicle: Vehicle,
    period: float,
    *,
    mission: int,
    spread: FlightSpread | None = None,
    advise: Callable[[Sequence[str]], str] = lambda _: "",
) -> dict[str, Array]:
    """Estimate all of ESTIMATED, each (time,), for one mission with a sample every `period` [s].

    Args:
      signals: channels that the filter reads.
      vehicle: vehicle with the nominal parameters of its file.
      mission: number for error messages.
      spread: uncertainty of the hull's parameters.
      advise: gives advice on bad channels for error messages, besides repairing the store.

    Raises:
      InputError: the vehicle does not glide by lift and drag coefficients.
      StoreError: a required channel is not finite; mission, channel and sample are named.
    """
    for name in CHANNELS:
        bad = np.flatnonzero(~np.isfinite(signals[name]))
        if bad.size:
            raise StoreError(
                f"channel {name} of mission {mission} is not finite at {bad.size} samples, first "
                f"at {bad[0] * period:.1f} s, and the flight filter needs it: repair the store"
                + advise([name])
            )
    made = FlightFilter(vehicle, period, spread).run(signals)
    return {name: np.ascontiguousarray(made[:, k]) for k, name in enumerate(ESTIMATED)}


def estimate_adapted(
    signals: Mapping[str, Array],
    vehicle: Vehicle,
    period: float,
    start: FlightStart,
    spread: FlightSpread | None = None,
) -> dict[str, Array]:
    """Estimate all of ADAPTED, each (time,), with a second filter that starts from earlier dives.

    Arguments are as in `estimate`, which has checked that the signals are finite.
    """
    made = FlightFilter(vehicle, period, spread, start).run(signals)
    return {
        channel: np.ascontiguousarray(made[:, OUTPUTS.index(name)])
        for channel, name in zip(ADAPTED, MIXED, strict=True)
    }


def can_estimate(vehicle: Vehicle, channels: Iterable[str]) -> bool:
    """True if a vehicle glides and a store has all channels of the flight filter."""
    return FlightFilter.unsuited(vehicle) == "" and set(CHANNELS) <= set(channels)
