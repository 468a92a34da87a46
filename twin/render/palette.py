"""Palette: colours of the scene. RGB in 0 to 1.

The track's map is matplotlib's plasma without its darkest part: lightness grows steadily, so that
it reads with every colour blindness, and its warm hues stand out from the water.
"""

from __future__ import annotations

import matplotlib
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TRACK_MAP, TRACK_FROM, TRACK_TO = "plasma", 0.30, 0.97
WATER = np.array(
    [
        [0.00, 0.62, 0.90, 0.93],
        [0.08, 0.36, 0.78, 0.87],
        [0.30, 0.12, 0.55, 0.75],
        [0.65, 0.05, 0.28, 0.52],
        [1.00, 0.03, 0.13, 0.32],
    ]
)
"""Relative depth of the shown water and its colour"""
LIGHT_DEPTH = 120.0
"""[m] over which daylight fades by e: our choice, so that a dive to 500 m still shows something"""
SURFACE_LIGHT = np.array([0.16, 0.62, 0.74])
DEEP_LIGHT = np.array([0.016, 0.085, 0.19])
HORIZON, ZENITH = np.array([0.74, 0.88, 0.95]), np.array([0.30, 0.56, 0.84])
"""The sky, for a chase camera above the water"""
BACKDROP_TOP, BACKDROP_BOTTOM = np.array([0.055, 0.115, 0.19]), np.array([0.012, 0.028, 0.055])
SAND = np.array([0.56, 0.51, 0.40])
FUTURE = np.array([0.80, 0.86, 0.92])
"""The part of the track that is still to come"""
CURRENT = np.array([0.93, 0.98, 1.0])
GLASS = np.array([0.55, 0.88, 1.0])
OTHER_TRACKS = tuple(
    np.array(colour)
    for colour in (
        (0.15, 0.90, 0.50),
        (1.00, 0.58, 0.78),
        (0.50, 0.92, 1.00),
        (0.74, 0.68, 1.00),
        (0.74, 1.00, 0.30),
        (0.62, 0.68, 0.75),
        (1.00, 1.00, 1.00),
    )
)
"""Colours of dead-reckoned tracks, in order; they come round again after the last. Light ones: the
water is blue and dark, and the true track takes the warm hues. White, that of the current's arrows,
comes last."""
WHITE, DIM, INK = (255, 255, 255), (158, 188, 208), (6, 16, 28)
"""Text, its labels and the ground of the heads-up strip, 0 to 255"""


def track_colours(values: Array, low: float, high: float) -> Array:
    """Colours of values (n,) between `low` and `high`; NaN is grey. Shape (n, 3)."""
    span = high - low if high > low else 1.0
    relative = np.clip((np.nan_to_num(values, nan=low) - low) / span, 0.0, 1.0)
    colour_map = matplotlib.colormaps[TRACK_MAP]
    colours = colour_map(TRACK_FROM + (TRACK_TO - TRACK_FROM) * relative)[:, :3]
    return np.where(np.isnan(values)[:, None], 0.6, colours)


def water_colour(relative_depth: Array | float) -> Array:
    """Colour of the water at a relative depth 0 to 1. Shape (..., 3)."""
    depth = np.clip(relative_depth, 0.0, 1.0)
    return np.stack([np.interp(depth, WATER[:, 0], WATER[:, i]) for i in (1, 2, 3)], axis=-1)


def ambient_colour(depth: Array) -> Array:
    """Colour of open water seen level at depths [m], shape (n, 1). Shape (n, 3)."""
    light = np.exp(-np.clip(depth, 0.0, None) / LIGHT_DEPTH)
    return np.asarray(DEEP_LIGHT + (SURFACE_LIGHT - DEEP_LIGHT) * light)
