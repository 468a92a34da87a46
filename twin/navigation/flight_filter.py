"""Flight filter: errors of a glider's flight model, estimated during the mission.

The filter integrates the hull's equation of motion, with added mass and the law of the file, from
the measured inputs. The result is speed and flow angles: in glides, in turns, stalled, tail first,
and coasting at the surface. In steady glides, the balance of forces (`twin.identify.speed`) gives a
depth rate. The measured depth rate corrects seven constants of the mission:

    (ln of the factors on K_D0 and K_alpha, pitch error of the forward and of the downward
     accelerometer [rad], ballast [kg], compressibility of the hull [1/Pa], ln of that on K_D)

by an iterated extended Kalman filter (Bell and Cathey, 1993) on constants. A single dive cannot
separate drag from ballast: many pairs give one depth rate. Dives and climbs at several angles can,
so the estimate improves over a mission. The filter needs the density from a CTD: without it the
error of the buoyancy in stratified water exceeds that of the drag.

Gyro biases make the attitude's pitch drift from the accelerometers'; the filter removes the slow
difference. Depth was computed for a standard ocean; the density corrects its rate.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.navigation.dead_reckoning import no_glider, values_of
from twin.navigation.flight_filter_kernels import (
    CARRIED,
    CHANNELS,
    CONSTANTS,
    COVARIANCE,
    GUESS,
    LEARNED,
    filtered,
)
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

FLIGHT_FILTER = 3
"""Version of the outputs: 1 was a steady balance, 2 follows the hull's motion under water, 3 also
at the surface. A network trained on one version cannot read another."""
TYPICAL_COMPRESSIBILITY = 5e-10
"""[1/Pa] Compressibility of a hull whose file has none."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlightSpread:
    """Standard deviations of a hull's parameters from its vehicle's file; 0 is not allowed."""

    coefficient: float = 0.058
    """[1] Lift slope, log of its factor: +-10 %, uniform"""
    drag: float = 0.3
    """[1] Both drags, log of their factor: growth adds half within a season, without lift"""
    pitch: float = 2.2e-3
    """[rad] Pitch by the accelerometers: 2 mg of bias and 0.05 deg of misalignment"""
    ballast: float = 0.08
    """[kg] Net mass in water of the reference density: pilots ballast for the water of a
    mission, whose density is not in the file"""
    compressibility: float = 1.2e-10
    """[1/Pa] Compressibility of the hull"""
    depth_rate: float = 2e-2
    """[m/s] Depth rate of one correction. The balance's own error, 3 mm/s, lasts through a
    glide: forty corrections count as one"""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"flight spread {field.name} is {value!r}: it must be above 0")

    @property
    def prior(self) -> Array:
        """Prior standard deviations of the seven constants."""
        drags, tilts = (self.drag, self.coefficient), (self.pitch, self.pitch)
        return np.array([*drags, *tilts, self.ballast, self.compressibility, self.drag])


ANY, CLEAN, USUAL = "any", "clean", "usual"
HULLS: Mapping[str, FlightSpread] = {
    ANY: FlightSpread(),
    CLEAN: FlightSpread(drag=FlightSpread.coefficient, depth_rate=3e-3),
    USUAL: FlightSpread(drag=0.15, depth_rate=1e-2),
}
"""Prior knowledge of the hulls: `any`, `clean` (no growth, as in preset `field`), or between them
`usual`, which the shipped networks read. With
`clean`, a lasting error of the depth rate counts as the hull's. Track error with 40 % more drag:
1.06 % of the path by networks of clean hulls, 0.58 % by networks of any; on clean hulls 0.32 and
0.41 % (docs/results/networks.md, "A hull that is not as its file")."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlightStart:
    """Estimate of CONSTANTS before a filter's first sample, such as from earlier dives.

    Raises:
      InputError: a wrong number of constants, or an invalid covariance.
    """

    constants: tuple[float, ...]
    deviations: tuple[float, ...]
    """Standard deviations of the constants' errors"""
    correlation: tuple[tuple[float, ...], ...]
    """Correlation of the errors; a covariance would span twenty orders, too many for a file"""
    depth_rate: float
    """[m/s] Standard deviation of one correction, in place of `FlightSpread.depth_rate`"""

    def __post_init__(self) -> None:
        size, correlation = len(CONSTANTS), np.array(self.correlation, float)
        shapes = np.shape(self.constants), np.shape(self.deviations), correlation.shape
        if shapes != ((size,), (size,), (size, size)):
            raise InputError(f"a flight filter begins with {size} constants and their correlation")
        if not (math.isfinite(self.depth_rate) and self.depth_rate > 0.0):
            raise InputError(f"depth_rate {self.depth_rate!r} of a correction must be above 0 m/s")
        if not np.isfinite([*self.constants, *self.deviations, *correlation.ravel()]).all():
            raise InputError("what a flight filter begins with is not finite")
        if not (
            min(self.deviations) > 0.0
            and np.allclose(correlation, correlation.T)
            and np.linalg.eigvalsh(correlation).min() > 0.0
        ):
            raise InputError(
                "what a flight filter begins with is no uncertainty: deviations must be above 0, "
                "and their correlation symmetric and positive definite"
            )

    @classmethod
    def of(cls, constants: Array, covariance: Array, depth_rate: float) -> FlightStart:
        """Create from constants (7,) and the covariance of their errors (7, 7)."""
        deviations = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(deviations, deviations)
        return cls(
            constants=tuple(constants.tolist()),
            deviations=tuple(deviations.tolist()),
            correlation=tuple(map(tuple, correlation.tolist())),
            depth_rate=depth_rate,
        )

    @property
    def covariance(self) -> Array:
        """Covariance of the errors, (7, 7)."""
        return np.array(self.correlation) * np.outer(self.deviations, self.deviations)


class FlightFilterModel(NamedTuple):
    """Vehicle and settings, in the form that compiled code takes."""

    law: Array
    """K_D0 to CROSS_FLOW, as `FlowFrame.values`"""
    inertia: Array
    """(3, 3) with added mass"""
    hull: Array
    """mass [kg], neutral volume [m3], gravity [m/s2], reference density [kg/m3], compressibility"""
    prior: Array
    rate_variance: float
    period: float
    inverse: Array
    """Inverse of `inertia`"""


NOTHING = np.zeros((0, LEARNED))


def _samples(signals: Mapping[str, Array]) -> Array:
    return np.stack([np.asarray(signals[name], np.float64) for name in CHANNELS], axis=1)


class FlightFilter:
    """Flight filter of one vehicle, over whole missions (`run`) or sample by sample (`step`).

    Both give identical numbers, since they use the same code.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        period: float,
        spread: FlightSpread | None = None,
        start: FlightStart | None = None,
    ):
        """Create the filter.

        Args:
          vehicle: vehicle with the nominal parameters of its file.
          period: [s] between samples.
          spread: standard deviations of the hull's parameters from the file.
          start: estimate from earlier dives, in place of the file and `spread`.

        Raises:
          InputError: the vehicle does not glide by lift and drag coefficients.
        """
        if why := self.unsuited(vehicle):
            raise InputError(f"the flight filter needs a glider's balance of forces: {why}")
        spread = FlightSpread() if spread is None else spread
        self.period, self.start = period, start
        inertia = np.ascontiguousarray(vehicle.mass * np.eye(3) + vehicle.added_mass[:3, :3])
        hull = vehicle.mass, vehicle.neutral_volume, vehicle.gravity, vehicle.reference_density
        self.model = FlightFilterModel(
            vehicle.flow_frame.values(),
            inertia,
            np.array([*hull, vehicle.hull_compressibility or TYPICAL_COMPRESSIBILITY]),
            spread.prior,
            (spread if start is None else start).depth_rate ** 2,
            period,
            np.asarray(np.linalg.inv(inertia), np.float64),
        )
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._carried = np.zeros(CARRIED)
        constants, covariance = self.begins
        self._carried[GUESS:COVARIANCE], self._carried[COVARIANCE:] = constants, covariance.ravel()

    @property
    def begins(self) -> tuple[Array, Array]:
        """Constants and their covariance before the first sample."""
        if self.start is None:
            return np.zeros(len(CONSTANTS)), np.diag(self.model.prior**2)
        return np.array(self.start.constants), self.start.covariance

    def run(self, signals: Mapping[str, Array]) -> Array:
        """Filter the next samples; outputs (time, outputs).

        Args:
          signals: CHANNELS, each (time,), finite.
        """
        return np.asarray(filtered(self.model, _samples(signals), self._carried, NOTHING)[0])

    def glides(self, signals: Mapping[str, Array]) -> Array:
        """Filter the next samples like `run`; return the steady glides used, (n, LEARNED).

        Columns are the means of pitch, roll [rad] and three rates [rad/s], net mass [kg] and its
        derivative by compressibility, the depth rate [m/s], and the sample's index.
        """
        samples = _samples(signals)
        learned = np.zeros((len(samples), LEARNED))
        _, count = filtered(self.model, samples, self._carried, learned)
        return learned[:count].copy()

    def step(self, sample: Mapping[str, float]) -> Array:
        """Filter one sample; outputs (outputs,).

        Raises:
          InputError: a channel is missing or not finite.
        """
        readers = f"; the flight filter reads {', '.join(CHANNELS)}"
        wrong = " of the sample is not finite: hold the last good value"
        given = values_of(sample, CHANNELS, readers, wrong)
        return np.asarray(filtered(self.model, np.array([given]), self._carried, NOTHING)[0][0])

    @staticmethod
    def unsuited(vehicle: Vehicle) -> str:
        """Reason why the filter does not suit a vehicle; empty if it does."""
        return no_glider(vehicle)

    @property
    def constants(self) -> dict[str, tuple[float, float]]:
        """Estimate and standard deviation of each of CONSTANTS."""
        size = len(CONSTANTS)
        variance = np.diag(self._carried[COVARIANCE:].reshape(size, size)).tolist()
        values = self._carried[GUESS:COVARIANCE].tolist()
        return {
            name: (value, math.sqrt(max(one, 0.0)))
            for name, value, one in zip(CONSTANTS, values, variance, strict=True)
        }

    def state(self) -> dict[str, NDArray[Any]]:
        """State as arrays by name, for `restore`."""
        return {"carried": self._carried.copy()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from the state that `state` returned.

        Raises:
          InputError: the state is not one of a flight filter.
        """
        saved = np.array(state.get("carried", np.zeros(0)), np.float64)
        if saved.shape != (CARRIED,):
            raise InputError("this state is not one of a flight filter")
        self._carried = saved
