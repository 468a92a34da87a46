"""Estimated channels: what an on-board filter makes of the measured ones, beside them.

Features read `estimated_surge` as they read `measured_pitch`; no store holds it. It is worked out
where missions are read, or under way sample by sample, for the vehicle as its file says.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.navigation.flight_filter import FlightFilter
from twin.navigation.flight_filter_kernels import CHANNELS, OUTPUTS
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

ESTIMATED = tuple(f"estimated_{name}" for name in OUTPUTS)
"""Of `twin.navigation.flight_filter`, in the order of its outputs."""

CTD = "measured_density"
"""What a vehicle without a CTD lacks of the channels behind them."""


def sources(channels: Iterable[str]) -> tuple[str, ...]:
    """What must be measured for these channels, each once."""
    found: dict[str, None] = {}
    for channel in channels:
        found |= dict.fromkeys(CHANNELS if channel in ESTIMATED else (channel,))
    return tuple(found)


def estimate(
    signals: Mapping[str, Array], vehicle: Vehicle, period: float, *, mission: int
) -> dict[str, Array]:
    """All of ESTIMATED, each (time,), of one whole mission with one sample every `period` [s].

    Raises:
      InputError: the vehicle does not glide by lift and drag coefficients.
      StoreError: a channel that is needed is not finite; mission, channel and sample are named.
    """
    for name in CHANNELS:
        bad = np.flatnonzero(~np.isfinite(signals[name]))
        if bad.size:
            raise StoreError(
                f"channel {name} of mission {mission} is not finite at {bad.size} samples, first "
                f"at {bad[0] * period:.1f} s, and the flight filter needs it: repair the store, or "
                "train without it (`learn fit --without flight`)"
            )
    made = FlightFilter(vehicle, period).run(signals)
    return {name: np.ascontiguousarray(made[:, k]) for k, name in enumerate(ESTIMATED)}


def can_estimate(vehicle: Vehicle, channels: Iterable[str]) -> bool:
    """Whether a vehicle glides, and a store has the channels for it."""
    return FlightFilter.unsuited(vehicle) == "" and set(CHANNELS) <= set(channels)
