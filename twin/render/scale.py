"""Scale: what colours the true track, and the range of its colour scale."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory
from twin.render.playback import closed
from twin.render.scene_geometry import nice_step

Array = NDArray[np.float64]

SIGNALS = {
    "speed": (("true_surge", "true_sway", "true_heave"), "speed through water [m/s]"),
    "current": (("true_current_north", "true_current_east"), "current speed [m/s]"),
}
"""Components whose length is the value, and the label"""
LEAST_RANGE = 0.02
"""[m/s] of a colour scale: less would colour noise"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scale:
    """A colour scale."""

    label: str
    low: float
    high: float

    def text(self, value: float) -> str:
        """A value with the decimals that this scale needs."""
        return f"{value:.2f}" if self.high < 10.0 else f"{value:.0f}"


def track_values(
    trajectory: Trajectory, colour: str, shown: NDArray[np.bool_], tracks: Sequence[NamedTrack]
) -> tuple[Array, Scale]:
    """Values of the samples `shown` and the scale that colours them; `colour` as in `Shot`.

    Raises:
      InputError: the mission does not record the signal, or error is wanted without tracks.
    """
    if colour == "error":
        return _errors(trajectory, shown, tracks)
    names, label = SIGNALS[colour]
    found = [trajectory.signals.get(name) for name in names]
    columns = [c for c in found if c is not None and np.isfinite(c).any()]
    if len(columns) < len(names):
        raise InputError(f"cannot colour by {colour}: this mission records no {', '.join(names)}")
    squares = [np.square(closed(trajectory.time, column)) for column in columns]
    values = np.sqrt(np.sum(squares, axis=0))[shown]
    low, high = (float(v) for v in np.percentile(values, [2.0, 98.0]))
    step = nice_step(max(high - low, LEAST_RANGE) / 4)
    low, high = step * math.floor(low / step + 1e-9), step * math.ceil(high / step - 1e-9)
    return values, Scale(label=label, low=low, high=max(high, low + step))


def _errors(
    trajectory: Trajectory, shown: NDArray[np.bool_], tracks: Sequence[NamedTrack]
) -> tuple[Array, Scale]:
    """Distance [m] of the first dead-reckoned track from the true one."""
    if not tracks:
        raise InputError("colouring by error needs a dead-reckoned track: give --tracks FILE")
    north, east = tracks[0].at(trajectory.time[shown])
    values = np.hypot(
        north - trajectory["true_north"][shown], east - trajectory["true_east"][shown]
    )
    high = float(np.nanmax(values)) if np.isfinite(values).any() else 0.0
    step = nice_step(max(high, 1.0) / 4)
    high = step * math.ceil(max(high, 1.0) / step - 1e-9)
    return values, Scale(label=f"position error of {tracks[0].title} [m]", low=0.0, high=high)
