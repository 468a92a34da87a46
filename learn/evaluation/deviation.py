"""Deviation: predicted standard deviation of a dead-reckoned position along the track.

The error of a velocity component is modelled as a stationary Gauss-Markov process with standard
deviation s and correlation time T. Its integral has the variance (Papoulis 1991, section 10)

    P(t) = 2 s^2 T [t - T (1 - exp(-t / T))],

which is s^2 t^2 for t << T (a bias) and 2 s^2 T t for t >> T (a random walk). A heading error moves
the position across the distance made good. A fix resets the position error to the fix's own.

GPS fixes after dives test the stated errors of the networks and the current together.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from learn.networks.familiarity import widened
from twin.errors import InputError
from twin.navigation.current import Leg, consistency_of
from twin.navigation.dead_reckoning import (
    LEAST_COSINE,
    SHALLOW_DEPTH,
    Array,
    horizontal_error,
    horizontal_velocity,
    integrate,
)
from twin.navigation.estimators.base import VelocityDeviation
from twin.navigation.settings import ADAPTED

if TYPE_CHECKING:
    from learn.data.dataset import MissionSequence
    from learn.evaluation.score import MissionScore, ReferenceVelocity
    from learn.networks.predictor import Adapted
    from twin.navigation.estimators.base import Estimate

SECONDS_PER_HOUR = 3600.0
BIAS_TIME_S = 4.0 * SECONDS_PER_HOUR
"""[s] Correlation time of velocity errors that last for a whole mission."""
SHORT_STEP = 1e-3
"""[1] Ratio of sample period to correlation time below which a series avoids cancellation."""
WITHIN = 0.68
"""[1] Fraction of samples whose error is within the interval of surge or sway."""
COMPASS_SD = math.radians(0.8)
"""[rad] Heading accuracy of the paper's attitude sensor (its table on the 3DM-GX5-25)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorModel:
    """Error statistics that a navigator assumes; the defaults are for a calibrated compass."""

    velocity_sd: float = 0.005
    """[m/s] Standard deviation of each horizontal component of the velocity through the water; an
    ensemble adds the standard deviation of its members."""
    velocity_time: float = BIAS_TIME_S
    """[s] Correlation time of `velocity_sd`: a wrong vehicle constant lasts for a mission."""
    heading_sd: float = COMPASS_SD
    """[rad] Standard deviation of a constant heading error; 0 for an ideal compass."""
    current_sd: float = 0.0
    """[m/s] Standard deviation of an unknown current's components; 0 for tracks through water."""
    current_time: float = 3.0 * SECONDS_PER_HOUR
    """[s] Correlation time of the current: a quarter of the semidiurnal tide."""
    fix_sd: float = 4.0
    """[m] Standard deviation of each component of a GPS fix: 3 to 5 m is usual."""
    surge_interval: float = 0.0
    """[m/s] Half-width of the interval with 68 % of the surge errors in validation, all missions
    weighted alike; 0: unknown"""
    sway_interval: float = 0.0
    """[m/s] Half-width of the 68 % interval for sway, like `surge_interval`; 0: unknown"""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"error model {field.name} is {value!r}: it must be at least 0")

    @property
    def surge_sd(self) -> float:
        """[m/s] Standard deviation of surge if it has the whole error: sway's is small."""
        return math.sqrt(2.0) * self.velocity_sd


def fit_error_model(
    scores: Sequence[MissionScore],
    seconds: Sequence[float],
    surge_errors: Sequence[Array] = (),
    sway_errors: Sequence[Array] = (),
    *,
    ideal_compass: bool,
) -> ErrorModel:
    """Fit the velocity error of an error model to missions outside the training.

    The position error at a mission's end, with true attitude, is attributed to a velocity bias:
    s = rms(error / time) / sqrt(2) per horizontal component.

    Args:
      scores: scores of the networks on validation missions.
      seconds: [s] duration of each mission.
      surge_errors: [m/s] surge error of each mission, (time,).
      sway_errors: [m/s] sway error of each mission, (time,).
    """
    drifts = [
        score.tracks["velocity"].end_m / duration
        for score, duration in zip(scores, seconds, strict=True)
        if "velocity" in score.tracks and duration > 0
    ]
    heading = 0.0 if ideal_compass else COMPASS_SD
    if not drifts:
        return ErrorModel(heading_sd=heading)
    rms = math.sqrt(math.fsum(d * d for d in drifts) / len(drifts))
    return ErrorModel(
        velocity_sd=rms / math.sqrt(2.0),
        heading_sd=heading,
        surge_interval=_interval(surge_errors),
        sway_interval=_interval(sway_errors),
    )


def _interval(errors: Sequence[Array]) -> float:
    """Half-width that holds the fraction WITHIN of the errors; each mission has equal weight."""
    if not errors:
        return 0.0
    weights = np.concatenate([np.full(len(e), 1.0 / len(e)) for e in errors])
    far = np.abs(np.concatenate(list(errors)))
    order = np.argsort(far)
    share = np.cumsum(weights[order]) / len(errors)
    return float(far[order[np.searchsorted(share, WITHIN)]])


def surge_interval(
    model: ErrorModel, mission: MissionSequence, adapted: Adapted | None, outside: float | None
) -> Array:
    """[m/s] Predicted half-width of the interval with 68 % of the surge errors, (time,).

    It is the validation's half-width, `widened` by the hull's score, or `Adapted.interval`.

    Args:
      mission: mission, with the channels ADAPTED if the run is adapted.
      adapted: vehicle constants of an adapted run, else None.
      outside: score of `Familiarity.outside`; None: unknown.
    """
    if adapted is None:
        return np.full(mission.samples, widened(model.surge_interval, outside))
    _, steady, sd = (mission.signals[name] for name in ADAPTED)
    return np.asarray(adapted.interval(model.surge_interval, steady, sd))


def network_position_sd(
    reference: ReferenceVelocity, estimate: Estimate, model: ErrorModel
) -> Array:
    """[m] Standard deviation of the track through the water without fixes, (time,).

    The variance over an ensemble's members adds to the model's, sample by sample.
    """
    assert estimate.surge is not None
    assert estimate.sway is not None
    velocity = horizontal_velocity(
        estimate.surge, estimate.sway, reference.depth_rate, reference.measured
    )
    spread = np.full(len(velocity), model.velocity_sd**2)
    if estimate.surge_sd is not None:
        # Heave is solved from the vertical velocity, so the track has surge over cos(pitch).
        forward = estimate.surge_sd / np.maximum(np.cos(reference.measured.pitch), LEAST_COSINE)
        spread = spread + forward**2 / 2.0
    if estimate.sway_sd is not None:
        spread = spread + estimate.sway_sd**2 / 2.0
    return position_sd(velocity, reference.mission.period, model, velocity_sd=np.sqrt(spread))


class Coverage:
    """Count missions that end within two predicted standard deviations, and samples within the
    intervals of surge and sway; `add` is a callback for `evaluate`."""

    def __init__(
        self,
        model: ErrorModel,
        adapted: Adapted | None = None,
        outside: Callable[[MissionSequence], float] | None = None,
    ) -> None:
        """Start without missions; `outside` is a mission's out-of-distribution score."""
        self._model, self._adapted, self._outside = model, adapted, outside
        self._ends: list[tuple[float, float]] = []
        self._within: dict[str, list[float]] = {"surge": [], "sway": []}

    def add(self, reference: ReferenceVelocity, estimates: Mapping[str, Estimate]) -> None:
        """Add one mission, with its estimate called `network`."""
        estimate = estimates["network"]
        track = reference.track(estimate, reference.measured)
        error = horizontal_error(track[-1:], reference.water_track[-1:])
        deviation = network_position_sd(reference, estimate, self._model)
        self._ends.append((float(error[0]), float(deviation[-1])))
        mission = reference.mission
        outside = None if self._outside is None else self._outside(mission)
        if self._model.surge_interval:
            assert estimate.surge is not None
            interval = surge_interval(self._model, mission, self._adapted, outside)
            far = np.abs(estimate.surge - reference.surge)
            self._within["surge"].append(float(np.mean(far < interval)))
        if self._model.sway_interval:
            assert estimate.sway is not None
            wide = widened(self._model.sway_interval, outside)
            far = np.abs(estimate.sway - reference.sway)
            self._within["sway"].append(float(np.mean(far < wide)))

    def figures(self) -> dict[str, float | None]:
        """Mean predicted standard deviation at mission end [m], fraction of missions within two
        standard deviations, and fractions of samples within the intervals of surge and sway."""
        found: dict[str, float | None] = {"position_sd_m_mean": None, "within_2sd": None}
        if self._ends:
            errors, deviations = np.array(self._ends).T
            found["position_sd_m_mean"] = float(deviations.mean())
            found["within_2sd"] = float((errors <= 2.0 * deviations).mean())
        return found | {
            f"{name}_within": float(np.mean(shares)) if shares else None
            for name, shares in self._within.items()
        }


class FixConsistency:
    """Test of a navigator's stated errors at GPS fixes; `add` is a callback for `evaluate`.

    The test uses dives from fix to fix below `SHALLOW_DEPTH`. The networks' velocity and the
    measured attitude give the displacement through the water.
    """

    def __init__(self, stated: VelocityDeviation, compass: float, latitude: float) -> None:
        """Start without missions.

        Args:
          stated: stated standard deviation of the networks' velocities.
          compass: [degree] stated standard deviation of the compass.
          latitude: [degree] latitude of the missions.
        """
        self._stated, self._compass, self._latitude = stated, compass, latitude
        self._records: list[list[Leg]] = []

    def add(self, reference: ReferenceVelocity, estimates: Mapping[str, Estimate]) -> None:
        """Add one mission, with its estimate called `network`."""
        period, depth = reference.mission.period, reference.mission.signals["measured_depth"]
        track = reference.track(estimates["network"], reference.measured)
        self._records.append(
            [
                Leg(
                    start=dive.start * period,
                    duration=dive.seconds(period),
                    over_ground=_pair(dive.end_fix - dive.start_fix),
                    through_water=_pair(track[dive.end] - track[dive.start]),
                )
                for dive in reference.dives
                if np.max(depth[dive.span]) > SHALLOW_DEPTH
            ]
        )

    def figures(self) -> dict[str, float | int | None]:
        """Fields of `twin.navigation.current.Consistency`, by name."""
        found = consistency_of(
            self._records,
            latitude=self._latitude,
            speed_scale=self._stated.scale,
            compass=self._compass,
            noise=self._stated.noise,
            memory=self._stated.memory,
        )
        return dataclasses.asdict(found)


def _pair(metres: Array) -> tuple[float, float]:
    return float(metres[0]), float(metres[1])


def position_sd(
    velocity: Array,
    period: float,
    model: ErrorModel,
    *,
    velocity_sd: Array | None = None,
    fixes: NDArray[np.intp] | None = None,
) -> Array:
    """[m] Standard deviation of the horizontal position, both axes' variances summed, (time,).

    Args:
      velocity: [m/s] estimated velocity, north and east, (time, 2).
      period: [s] between samples.
      model: error statistics.
      velocity_sd: [m/s] standard deviation of each component, (time,); None: as in the model.
      fixes: samples at which the position is reset to a fix.
    """
    samples = len(velocity)
    spread = np.full(samples, model.velocity_sd) if velocity_sd is None else velocity_sd
    reset = np.zeros(samples, bool)
    if fixes is not None:
        reset[fixes] = True
    water = _integrated_variance(spread, model.velocity_time, period, reset)
    drift = np.full(samples, model.current_sd)
    current = _integrated_variance(drift, model.current_time, period, reset)
    along = _since_reset(velocity, period, reset)
    across = (model.heading_sd * np.hypot(*along.T)) ** 2
    start = np.where(np.cumsum(reset) > 0, 2.0 * model.fix_sd**2, 0.0)
    return np.sqrt(start + 2.0 * (water + current) + across)


def _integrated_variance(
    spread: Array, time: float, period: float, reset: NDArray[np.bool_]
) -> Array:
    """Variance of the integral of a Gauss-Markov process with slowly varying s, (time,).

    The recursion is exact for constant s: with c = cov(integral, process), a = exp(-h / T),
    P += 2 c T (1 - a) + 2 s^2 T [h - T (1 - a)] and c = a c + s^2 T (1 - a). At a reset P and c
    are zero: the fix gives the position and no information on the velocity error.
    """
    if time == 0.0:
        return np.zeros(len(spread))
    ratio = period / time
    decay = math.exp(-ratio)
    kept = -time * math.expm1(-ratio)
    # h - T (1 - a), from its series if the difference would be only rounding
    rest = period - kept if ratio > SHORT_STEP else period * ratio * (0.5 - ratio / 6.0)
    out = np.zeros(len(spread))
    variance = covariance = 0.0
    for k in range(1, len(spread)):
        if reset[k]:
            variance = covariance = 0.0
        else:
            power = spread[k - 1] ** 2
            variance += 2.0 * covariance * kept + 2.0 * power * time * rest
            covariance = decay * covariance + power * kept
        out[k] = variance
    return out


def _since_reset(velocity: Array, period: float, reset: NDArray[np.bool_]) -> Array:
    """[m] Displacement north and east since the last reset, (time, 2)."""
    track = integrate(velocity, period)
    last = np.maximum.accumulate(np.where(reset, np.arange(len(reset)), 0))
    return track - track[last]
