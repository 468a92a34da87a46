"""DVL-aided dead reckoning: what a Doppler velocity log adds.

With bottom lock the log gives the velocity over ground: no current is left to guess. With water
lock it gives the velocity through the water below the vehicle, and the current is carried on from
the last bottom lock, where it was the difference of the log and the flight model. Spikes are
removed with a Hampel filter, short losses are interpolated, long ones filled by the flight model.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
from scipy.ndimage import median_filter

from learn.navigation.baselines.base import Baseline, Estimate, Mask, bridge, hold, no_glider
from learn.navigation.baselines.steady_flight import SteadyFlight
from learn.navigation.dead_reckoning import (
    Array,
    Attitude,
    Signals,
    depth_rate,
    finite_channel,
    horizontal_velocity,
    integrate,
    rotate_to_ned,
)
from twin.vehicle.vehicle import Vehicle

BOTTOM, WATER = 1, 2
"""measured_dvl_mode"""
HAMPEL_SAMPLES = 11
"""Window of the spike filter: 5.5 s at 2 Hz."""
HAMPEL_SIGMAS = 3.0
MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution."""
LEAST_SPREAD = 2e-3
"""[m/s] spread below which nothing counts as a spike: the noise of averaged pings."""
SHORT_LOSS_S = 10.0
"""[s] longer losses of lock are filled by the flight model."""
CURRENT_TIME_S = 600.0
"""[s] over which the current found in bottom lock is averaged."""
LEAST_WATER_SHARE = 0.5
"""of the samples in water lock: below it the log says nothing on the velocity through the water"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dvl(Baseline):
    """Doppler velocity log, filled by steady flight."""

    title = "DVL-aided"
    summary = (
        "Doppler log: over ground in bottom lock, through the water in water lock, gaps filled by "
        "`steady_flight`, the current found in bottom lock carried on"
    )
    colour = "black"
    without_water = (
        "The DVL-aided method is missing in the tables through the water: in less than half of "
        "the samples its log was in water lock, and in bottom lock it measures the velocity over "
        "ground, so that it says nothing on the one through the water. It is among the tracks "
        "over ground."
    )
    channels: ClassVar[tuple[str, ...]] = (
        *(f"measured_dvl_{name}" for name in ("surge", "sway", "heave", "mode")),
        *SteadyFlight.channels,
    )

    @classmethod
    def unsuited(cls, vehicle: Vehicle) -> str:
        """It needs a glider."""
        return no_glider(vehicle)

    def estimate(self, signals: Signals, period: float) -> Estimate:
        """See `learn.navigation.baselines.base.Baseline`; without any lock nothing is estimated."""
        mode = np.rint(finite_channel(signals, "measured_dvl_mode")).astype(int)
        log = np.stack(
            [np.asarray(signals[f"measured_dvl_{n}"], float) for n in ("surge", "sway", "heave")],
            axis=1,
        )
        locked = np.isfinite(log).all(axis=1) & (mode > 0)
        if not locked.any():
            return Estimate()
        flight = SteadyFlight(vehicle=self.vehicle).estimate(signals, period)
        assert flight.surge is not None
        assert flight.sway is not None
        attitude = Attitude.of(signals)
        rate = depth_rate(finite_channel(signals, "measured_depth"), period)
        bottom, water = locked & (mode == BOTTOM), locked & (mode == WATER)

        surge, sway = (
            _filled(log[:, i], water, guess, period)
            for i, guess in enumerate((flight.surge, flight.sway))
        )
        through = horizontal_velocity(surge, sway, rate, attitude)
        nothing = np.full(len(mode), np.nan)
        over = np.stack([_filled(log[:, i], bottom, nothing, period) for i in range(3)], axis=1)
        over = rotate_to_ned(over, attitude)[:, :2]
        usable = np.asarray(np.isfinite(over).all(axis=1))
        flown = horizontal_velocity(flight.surge, flight.sway, rate, attitude)
        current = _carried(over - flown, usable, period)
        track = integrate(np.where(usable[:, None], over, through + current), period)
        measured = water.mean() >= LEAST_WATER_SHARE
        return Estimate(
            surge=surge if measured else None,
            sway=sway if measured else None,
            ground_track=track,
        )


def _filled(values: Array, valid: Mask, fallback: Array, period: float) -> Array:
    """Spikes and short losses interpolated between valid samples, the rest from `fallback`."""
    valid = valid & ~spikes(values, valid)
    index = np.arange(len(values))
    if not valid.any():
        return np.where(valid, values, fallback)
    places = index[valid]
    after = np.searchsorted(places, index).clip(0, len(places) - 1)
    before = (np.searchsorted(places, index, side="right") - 1).clip(0)
    near = (places[after] - places[before]) * period <= SHORT_LOSS_S
    inside = (index >= places[0]) & (index <= places[-1])
    return np.where(near & inside, bridge(values, valid), np.where(valid, values, fallback))


def spikes(values: Array, valid: Mask) -> Mask:
    """Hampel's test: farther from the running median than three scaled median deviations."""
    smooth = bridge(values, valid)
    middle = median_filter(smooth, HAMPEL_SAMPLES, mode="nearest")
    off = np.abs(smooth - middle)
    spread = MAD_TO_SIGMA * median_filter(off, HAMPEL_SAMPLES, mode="nearest")
    return valid & (off > HAMPEL_SIGMAS * np.maximum(spread, LEAST_SPREAD))


def _carried(current: Array, known: Mask, period: float) -> Array:
    """Exponential average of the known samples, held in between, zero before; (time, 2)."""
    weight = 1.0 - np.exp(-period / CURRENT_TIME_S)
    out = np.zeros_like(current)
    mean, total = np.zeros(2), 0.0
    for k in np.flatnonzero(known):
        total += weight * (1.0 - total)
        mean = mean + (current[k] - mean) * (weight / total)
        out[k] = mean
    return np.stack([hold(out[:, i], known) for i in range(2)], axis=1)
