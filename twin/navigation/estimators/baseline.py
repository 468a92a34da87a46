"""Baselines as velocity estimators that the command line can name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

from numpy.typing import NDArray

from twin.errors import InputError
from twin.navigation.baselines.registry import BASELINES
from twin.navigation.estimator import BodyVelocity, State, VelocityEstimator
from twin.vehicle.vehicle import Vehicle


class ByBaseline(VelocityEstimator):
    """A baseline sample by sample, for the vehicle as its file says."""

    baseline: ClassVar[str]
    """its name"""

    def __init__(self, inner: VelocityEstimator):
        self._inner = inner
        self.period, self.channels = inner.period, inner.channels

    @classmethod
    def open(cls, argument: str, vehicle: Vehicle, period: float) -> Self:
        """See `VelocityEstimator`; it takes no argument."""
        if argument:
            raise InputError(f"estimator {cls.kind!r} takes no argument, not {argument!r}")
        kind = BASELINES[cls.baseline]
        if why := kind.unsuited(vehicle):
            raise InputError(f"estimator {cls.kind!r}: {why}")
        return cls(kind(vehicle=vehicle).begin(period))

    def reset(self) -> None:
        """See `VelocityEstimator`."""
        self._inner.reset()

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`."""
        return self._inner.step(sample)

    def state(self) -> dict[str, NDArray[Any]]:
        """See `VelocityEstimator`."""
        return self._inner.state()

    def restore(self, state: State) -> None:
        """See `VelocityEstimator`."""
        self._inner.restore(state)


class ByEkf(ByBaseline):
    """See `twin.navigation.baselines.ekf`."""

    kind = baseline = "ekf"
    summary = "extended Kalman filter on the vehicle's momentum equations"


class BySteadyFlight(ByBaseline):
    """See `twin.navigation.baselines.steady_flight`."""

    kind = baseline = "steady_flight"
    summary = "forces in balance at every sample"


class ByPitchPlusAlpha(ByBaseline):
    """See `twin.navigation.baselines.pitch_plus_alpha`."""

    kind = baseline = "pitch_plus_alpha"
    summary = "depth rate over the tangent of pitch plus one angle of attack"


class ByDvl(ByBaseline):
    """See `twin.navigation.baselines.dvl`."""

    kind = baseline = "dvl"
    summary = "Doppler log, filled by a glider's flight model or else by its last velocity"
