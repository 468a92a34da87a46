"""Scale: what colours the true track, and the range of its colour scale."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.records.logged import source_of
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory
from twin.show.render.scene_geometry import nice_step

Array = NDArray[np.float64]

SIGNALS = {
    "speed": (("true_surge", "true_sway", "true_heave"), "speed through water", "m/s"),
    "current": (("true_current_north", "true_current_east"), "current speed", "m/s"),
    "depth": (("true_depth",), "depth", "m"),
}
"""Components whose length is the value, the label and the unit"""
LEAST_RANGE = 0.02
"""[m/s] of a colour scale: less would colour noise"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scale:
    """A colour scale."""

    label: str
    low: float
    high: float
    clipped: tuple[bool, bool] = (False, False)
    """Whether some values are below `low`, and above `high`: they have the colours of the ends"""

    def text(self, value: float) -> str:
        """A value with the decimals that this scale needs."""
        return f"{value:.2f}" if self.high < 10.0 else f"{value:.0f}"

    @property
    def ends(self) -> tuple[str, str]:
        """Words for both ends, which say whether values go beyond them."""
        below, above = self.clipped
        return ("≤ " * below) + self.text(self.low), ("≥ " * above) + self.text(self.high)


def track_values(
    trajectory: Trajectory,
    colour: str | None,
    shown: NDArray[np.bool_],
    tracks: Sequence[NamedTrack],
) -> tuple[Array, Scale]:
    """Values of the samples `shown` and the scale that colours them; `colour` as in `Shot`.

    Of a log they are NaN where nothing tells them.

    Raises:
      InputError: the mission does not record the signal, or error is wanted without tracks.
    """
    if colour == "error":
        return _errors(trajectory, shown, tracks)
    if colour is None:
        colour = "speed" if _known(trajectory, "speed") else "depth"
    names, label, unit = SIGNALS[colour]
    if not _known(trajectory, colour):
        able = ", ".join(name for name in SIGNALS if _known(trajectory, name))
        raise InputError(
            f"cannot colour by {colour}: this mission records no {', '.join(names)}; it can by "
            f"{able}"
        )
    source = source_of(trajectory, names[0], "")
    squares = [np.square(trajectory[name]) for name in names]
    values = np.sqrt(np.sum(squares, axis=0))[shown]
    if not np.isfinite(values).any():
        raise InputError(f"cannot colour by {colour}: it is not known in the shown part")
    low, high = (float(v) for v in np.nanpercentile(values, [2.0, 98.0]))
    step = nice_step(max(high - low, LEAST_RANGE) / 4)
    low, high = step * math.floor(low / step + 1e-9), step * math.ceil(high / step - 1e-9)
    if colour == "current" and source:
        label = source
    elif source:
        label = f"{label}, {source}"
    label = f"{label} [{unit}]"
    high = max(high, low + step)
    least = 1e-6 * (high - low)
    clipped = bool(np.nanmin(values) < low - least), bool(np.nanmax(values) > high + least)
    return values, Scale(label=label, low=low, high=high, clipped=clipped)


def _known(trajectory: Trajectory, colour: str) -> bool:
    """Whether a mission has anything to colour so."""
    return all(
        name in trajectory and bool(np.isfinite(trajectory[name]).any())
        for name in SIGNALS[colour][0]
    )


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
    word = source_of(trajectory, "true_north", "")
    label = f"position error of {tracks[0].title} [m]"
    if word:
        label = f"distance of {tracks[0].title} from the {word} [m]"
    return values, Scale(label=label, low=0.0, high=high)
