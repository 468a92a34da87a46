"""DVL-aided dead reckoning: velocity and track from a Doppler velocity log.

With bottom lock the log gives the velocity over ground, without any assumption on the current. With
water lock it gives the velocity through the water below the vehicle. The current is then held from
the last bottom lock, where it was the log's velocity minus the velocity through the water. For a
glider the flight model gives the latter; other vehicles use the log's water lock of the last few
seconds. A Hampel filter removes outliers, and short losses of lock are interpolated. Long losses
are filled by the flight model, or without one by the last measured velocity, and by 0 where depth
rate and pitch show that the vehicle stands (`twin.navigation.standstill`).

Training labels are cleaned like the paper's Tethys data: outliers are removed, and the rest is
smoothed with a Gaussian. Both steps use later samples, so no network reads their result. The
causal smoothing uses earlier samples only, as a vehicle can on board."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter1d, median_filter

from twin.navigation.dead_reckoning import (
    Array,
    AttitudeSeries,
    Mask,
    Signals,
    bridge,
    depth_rate,
    finite_channel,
    hold,
    horizontal_velocity,
    integrate,
    no_glider,
    rotate_to_ned,
)
from twin.navigation.estimators.base import BodyVelocity, Estimate, WindowedEstimator
from twin.navigation.estimators.flight import SteadyFlight
from twin.navigation.standstill import standing
from twin.vehicle.vehicle import Vehicle

Smoothing = Literal["gaussian", "causal", "none"]
SMOOTHINGS: tuple[Smoothing, ...] = get_args(Smoothing)
BOTTOM, WATER = 1, 2
"""Values of `measured_dvl_mode` with a lock; 0 is no lock."""
HAMPEL_SAMPLES = 11
"""Window of the outlier test, in samples: 5.5 s at 2 Hz."""
HAMPEL_SIGMAS = 3.0
MAD_TO_SIGMA = 1.4826
"""[1] Standard deviation divided by median absolute deviation, for a normal distribution."""
LEAST_SPREAD = 2e-3
"""[m/s] Smallest standard deviation that the outlier test assumes: the noise of averaged pings."""
SMOOTHING_S = 1.0
"""[s] Standard deviation of the Gaussian: short against the seconds in which a turn begins."""
REACH = 4.0
"""[1] Cut-off of the Gaussian in standard deviations, as scipy's default."""
SHORT_LOSS_S = 10.0
"""[s] Longest loss of lock that is interpolated."""
CURRENT_TIME_S = 600.0
"""[s] Averaging time of the current found in bottom lock."""
LEAST_WATER_SHARE = 0.5
"""[1] Smallest fraction of samples in water lock for a velocity through the water"""


class Dvl(WindowedEstimator):
    """Doppler velocity log, with gaps filled by steady flight on a glider.

    A step uses every water lock and fills the rest by the flight model. Without a flight model, the
    last measured velocity is held: through the water in water lock, over ground in bottom lock,
    where a navigator then finds no current.
    """

    kind = "dvl"
    title = "DVL-aided"
    summary = (
        "Doppler log: over ground in bottom lock, through the water in water lock, gaps filled by "
        "`steady_flight` or, where the vehicle is not a glider, by the last velocity; the current "
        "found in bottom lock carried on"
    )
    colour = "black"
    without_water = (
        "The DVL-aided method is missing in the tables through the water: in less than half of "
        "the samples its log was in water lock, and in bottom lock it measures the velocity over "
        "ground, so that it says nothing on the one through the water. It is among the tracks "
        "over ground."
    )
    channels = (
        *(f"measured_dvl_{name}" for name in ("surge", "sway", "heave", "mode")),
        *("measured_depth", "measured_roll", "measured_pitch", "measured_heading"),
    )

    @classmethod
    def needs(cls, vehicle: Vehicle) -> tuple[str, ...]:
        """Add the channels of the flight model for a glider."""
        flight = () if no_glider(vehicle) else SteadyFlight.channels
        return tuple(dict.fromkeys((*cls.channels, *flight)))

    def batch(self, signals: Signals, least_water: float = LEAST_WATER_SHARE) -> Estimate:
        """See `VelocityEstimator`; without any lock the estimate is empty.

        `least_water` is the least fraction of samples in water lock for a velocity.
        """
        period = self.period
        mode = np.rint(np.nan_to_num(signals["measured_dvl_mode"])).astype(int)
        log = _velocities(signals)
        locked = np.isfinite(log).all(axis=1) & (mode > 0)
        if not locked.any():
            return Estimate()
        attitude = AttitudeSeries.of(signals)
        rate = depth_rate(finite_channel(signals, "measured_depth"), period)
        bottom, water = locked & (mode == BOTTOM), locked & (mode == WATER)
        on_ground = np.stack([_filled(log[:, i], bottom, None, period) for i in range(3)], axis=1)
        over = rotate_to_ned(on_ground, attitude)[:, :2]
        usable = np.asarray(np.isfinite(over).all(axis=1))
        flown, known = self._through_water(signals, log, water)
        surge, sway = (_filled(log[:, i], water, flown[:, i], period) for i in (0, 1))
        through = horizontal_velocity(surge, sway, rate, attitude)
        model = horizontal_velocity(flown[:, 0], flown[:, 1], rate, attitude)
        current = _carried(over - model, usable & known, period)
        guess = through + current
        if no_glider(self.vehicle):
            held = np.stack([hold(on_ground[:, i], usable) for i in range(3)], axis=1)
            held[self._standing(signals)] = 0.0
            after_bottom = hold(bottom.astype(float), locked) > 0.0
            guess = np.where(after_bottom[:, None], rotate_to_ned(held, attitude)[:, :2], guess)
        track = integrate(np.where(usable[:, None], over, guess), period)
        measured = water.mean() >= least_water
        return Estimate(
            surge=surge if measured else None, sway=sway if measured else None, ground_track=track
        )

    def last(self, signals: Signals) -> BodyVelocity:
        """See `WindowedEstimator`; without any lock, the velocity of a glider's flight model."""
        if not no_glider(self.vehicle):
            found = self.batch(signals, least_water=0.0)
            if found.surge is None or found.sway is None:
                surge, sway = self._flown(signals)[-1].tolist()
                return BodyVelocity(surge=surge, sway=sway)
            return BodyVelocity(surge=float(found.surge[-1]), sway=float(found.sway[-1]))
        log = _velocities(signals)  # the last good sample counts; without one, the vehicle rests
        good = np.isfinite(log).all(axis=1) & (np.nan_to_num(signals["measured_dvl_mode"]) > 0.0)
        for i in range(3):
            good &= ~spikes(np.nan_to_num(log[:, i]), good)
        if not good.any() or (not good[-1] and self._standing(signals)[-1]):
            return BodyVelocity(surge=0.0, sway=0.0)
        surge, sway, heave = log[np.flatnonzero(good)[-1]].tolist()
        return BodyVelocity(surge=surge, sway=sway, heave=heave)

    def _standing(self, signals: Signals) -> Mask:
        """Samples at which depth rate and pitch show that the vehicle stands, (time,)."""
        pitch = np.deg2rad(finite_channel(signals, "measured_pitch"))
        return standing(pitch, self.period, depth=finite_channel(signals, "measured_depth"))

    def _flown(self, signals: Signals) -> Array:
        """Surge and sway [m/s] by a glider's flight model, (time, 2)."""
        flight = SteadyFlight(self.vehicle, self.period).batch(signals)
        assert flight.surge is not None
        assert flight.sway is not None
        return np.stack([flight.surge, flight.sway], axis=1)

    def _through_water(self, signals: Signals, log: Array, water: Mask) -> tuple[Array, Mask]:
        """Surge and sway [m/s] for the current's estimate, (time, 2), and their valid samples.

        A glider uses its flight model. Other vehicles hold the last water lock, valid for
        `SHORT_LOSS_S`."""
        if not no_glider(self.vehicle):
            return self._flown(signals), np.ones(len(log), bool)
        water = water & ~spikes(log[:, 0], water) & ~spikes(log[:, 1], water)
        held = np.stack([hold(log[:, i], water) for i in (0, 1)], axis=1)
        held[self._standing(signals)] = 0.0
        age = np.arange(len(log)) - hold(np.arange(len(log), dtype=float), water, -np.inf)
        return held, np.asarray(age * self.period <= SHORT_LOSS_S)


def _velocities(signals: Signals) -> Array:
    """Velocities that the log measured [m/s], (time, 3)."""
    return np.stack([np.asarray(signals[name], float) for name in Dvl.channels[:3]], axis=1)


def _filled(values: Array, valid: Mask, fallback: Array | None, period: float) -> Array:
    """Interpolate outliers and short losses; fill the rest from `fallback`, or with NaN."""
    valid = valid & ~spikes(values, valid)
    index = np.arange(len(values))
    rest = np.full(len(values), np.nan) if fallback is None else fallback
    if not valid.any():
        return rest
    places = index[valid]
    after = np.searchsorted(places, index).clip(0, len(places) - 1)
    before = (np.searchsorted(places, index, side="right") - 1).clip(0)
    near = (places[after] - places[before]) * period <= SHORT_LOSS_S
    inside = (index >= places[0]) & (index <= places[-1])
    return np.where(near & inside, bridge(values, valid), np.where(valid, values, rest))


def spikes(values: Array, valid: Mask) -> Mask:
    """Mark outliers like `outliers`, but with each sample's deviation from its own median.

    Samples removed in a turn are interpolated, which hardly changes a track."""
    smooth = bridge(values, valid)
    middle = median_filter(smooth, HAMPEL_SAMPLES, mode="nearest")
    off = np.abs(smooth - middle)
    spread = MAD_TO_SIGMA * median_filter(off, HAMPEL_SAMPLES, mode="nearest")
    return valid & (off > HAMPEL_SIGMAS * np.maximum(spread, LEAST_SPREAD))


def _carried(current: Array, known: Mask, period: float) -> Array:
    """Exponential average of the valid samples, held in between, zero before; (time, 2)."""
    weight = 1.0 - np.exp(-period / CURRENT_TIME_S)
    out = np.zeros_like(current)
    mean, total = np.zeros(2), 0.0
    for k in np.flatnonzero(known):
        total += weight * (1.0 - total)
        mean = mean + (current[k] - mean) * (weight / total)
        out[k] = mean
    return np.stack([hold(out[:, i], known) for i in range(2)], axis=1)


def outliers(values: Array, valid: Mask, *, causal: bool = False) -> Mask:
    """Mark valid samples whose distance from the running median exceeds three scaled MADs (Hampel).

    A window holds valid samples only, so it joins the samples on both sides of a gap.

    Args:
      values: [m/s], (time,).
      valid: True for samples with a measurement, (time,).
      causal: windows end at the sample; otherwise they are centred on it.
    """
    found = np.zeros(len(values), bool)
    if not valid.any():
        return found
    known = values[valid]
    half = HAMPEL_SAMPLES // 2
    around = (HAMPEL_SAMPLES - 1, 0) if causal else (half, half)
    windows = sliding_window_view(np.pad(known, around, mode="edge"), HAMPEL_SAMPLES)
    middle = np.median(windows, axis=1)
    # Deviations from the window's own median are large throughout a turn, so it has no outliers.
    spread = MAD_TO_SIGMA * np.median(np.abs(windows - middle[:, None]), axis=1)
    found[valid] = np.abs(known - middle) > HAMPEL_SIGMAS * np.maximum(spread, LEAST_SPREAD)
    return found


def smoothed(values: Array, valid: Mask, period: float, kind: Smoothing = "gaussian") -> Array:
    """Average valid samples with their valid neighbours; NaN elsewhere; (time,).

    The weights are normalised over the valid samples, so that a gap neither pulls its neighbours
    to zero nor is filled.

    Args:
      values: [m/s], (time,).
      valid: True for samples with a measurement, (time,).
      period: [s] between samples.
      kind: `gaussian` of `SMOOTHING_S`; `causal`, its half in the past, which lags by 0.8 of
        `SMOOTHING_S`; or `none`.
    """
    if kind == "none":
        return np.where(valid, values, np.nan)
    counted = valid.astype(float)
    total = _weighted(np.where(valid, values, 0.0), period, kind)
    weight = _weighted(counted, period, kind)
    return np.where(valid, total / np.where(valid, weight, 1.0), np.nan)


def _weighted(values: Array, period: float, kind: Smoothing) -> Array:
    """Kernel-weighted sum of the samples, with zeros beyond the ends."""
    sigma = SMOOTHING_S / period
    if kind == "gaussian":
        return np.asarray(gaussian_filter1d(values, sigma, mode="constant", truncate=REACH))
    past = np.exp(-0.5 * np.square(np.arange(round(REACH * sigma) + 1) / sigma))
    return np.convolve(values, past / past.sum())[: len(values)]
