"""Scene geometry: how metres become display units, and the block of water that is shown.

A picture that spans kilometres would show a 2 m glider as nothing. So the glider keeps its size of
about 2 display units and the sea shrinks around it: one horizontal scale, and one vertical scale
that may exaggerate depth, as oceanographers draw sections. The chase camera keeps true scale.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from twin.frames import flip_vector

Array = NDArray[np.float64]

NICE = (1.0, 2.0, 5.0)
"""Mantissas of tick steps"""
EXAGGERATIONS = (1.0, 2.0, 3.0, 4.0, 5.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0)
HEIGHT_RATIO = {"orbit": 0.30, "side": 0.46, "map": 0.30}
"""Height over length of the water block that the automatic exaggeration aims at, by camera, in a
picture of WIDESCREEN; in a taller one the block is taller too."""
WIDESCREEN = 16 / 9
WIDTH_RATIO = {"orbit": 0.28, "side": 0.28, "map": 0.55, "chase": 0.28}
"""Least width over length of the block, so that a straight track has a body of water around it."""
MARGIN = 0.07
"""Margin around the track, as part of the block's length"""
BELOW = 0.12
"""Water under the deepest point, as part of the depth"""
LEAST_DEPTH = 5.0
"""[m] of a block whose mission hardly dives"""
LEAST_LENGTH = 12.0
"""[m] of a block whose mission hardly moves"""
VEHICLE_SHARE = 0.095
"""Length of the glider over the width of the view"""
VIEW_MARGIN = 1.25
"""Width of the view over the block's length, roughly: sets the scale, not the framing."""


SIDE_SHARE = 0.04
"""Free part on each side without a HUD"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Frame:
    """What framing keeps free, as parts of the picture's height and width."""

    aspect: float
    """Width over height of the picture"""
    bottom: float = SIDE_SHARE
    top: float = SIDE_SHARE
    left: float = SIDE_SHARE
    right: float = SIDE_SHARE

    @property
    def filled(self) -> float:
        """Height of the part that is filled."""
        return 1.0 - self.bottom - self.top


@dataclasses.dataclass(frozen=True, kw_only=True)
class SceneLayout:
    """The block of water in metres, and the scales to display units.

    The block's axes: x along `azimuth` (from north towards east), y to its right, z down.
    """

    azimuth: float
    """[rad]"""
    low: Array
    """[m] least x, y of the block and 0, shape (3,)"""
    high: Array
    """[m] largest x, y of the block and its depth, shape (3,)"""
    scale: float
    """Display units per metre, horizontally"""
    exaggeration: float
    """Vertical over horizontal scale"""

    @property
    def centre(self) -> Array:
        """Of the block's surface, NED [m], shape (3,)."""
        middle = (self.low + self.high) / 2
        return self.to_ned(np.array([middle[0], middle[1], 0.0]))

    @property
    def size(self) -> Array:
        """Length, width, depth [m], shape (3,)."""
        return self.high - self.low

    @property
    def factors(self) -> Array:
        """Display units per metre along x, y, z, shape (3,)."""
        return self.scale * np.array([1.0, 1.0, self.exaggeration])

    def to_ned(self, block: Array) -> Array:
        """Block axes to NED [m], shape (..., 3)."""
        return np.asarray(block) @ self._turn().T

    def to_block(self, ned: Array) -> Array:
        """NED to block axes [m], shape (..., 3)."""
        return np.asarray(ned) @ self._turn()

    def display(self, ned: Array) -> Array:
        """NED [m] to display units, z up, the block's centre at the surface as origin."""
        return flip_vector(np.asarray(ned) - self.centre) * self.factors

    def display_block(self, block: Array) -> Array:
        """Block axes [m] to display units."""
        return self.display(self.to_ned(block))

    def corners(self) -> Array:
        """The block's corners in display units: surface then floor, shape (8, 3)."""
        (x0, y0, _), (x1, y1, z1) = self.low, self.high
        xy = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        return self.display_block(np.array([(x, y, z) for z in (0.0, z1) for x, y in xy]))

    def _turn(self) -> Array:
        c, s = math.cos(self.azimuth), math.sin(self.azimuth)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def plan(
    paths: list[Array],
    *,
    hull_length: float,
    floor: float | None,
    exaggeration: float | None,
    camera: str,
    frame: Frame,
) -> SceneLayout:
    """The layout that holds all `paths`, each (n, 3) NED [m].

    Args:
      hull_length: [m] of the glider.
      floor: [m] depth of the floor, None for a little below the deepest point.
      exaggeration: vertical over horizontal scale, None for automatic.
      camera: as in `Shot`. The map's block is aligned with north, the others' with the track;
        the chase camera has one display unit per metre and no exaggeration.
      frame: what the picture keeps free; the map's block fills the rest.
    """
    points = np.concatenate(paths)
    azimuth = 0.0 if camera == "map" else principal_azimuth(points[:, :2])
    trial = SceneLayout(
        azimuth=azimuth, low=np.zeros(3), high=np.ones(3), scale=1.0, exaggeration=1.0
    )
    inside = trial.to_block(points)
    low, high = inside.min(axis=0), inside.max(axis=0)
    length = max(float(max(high[0] - low[0], high[1] - low[1])), LEAST_LENGTH)
    middle = (low + high) / 2
    half = np.maximum((high - low) / 2 + MARGIN * length, WIDTH_RATIO[camera] * length / 2)
    if camera == "map":
        wide = frame.aspect * (1.0 - frame.left - frame.right) / frame.filled
        half[:2] = np.maximum(half[:2], [half[1] / wide, half[0] * wide])
    depth = max(float(high[2]) * (1 + BELOW), LEAST_DEPTH)
    if floor is not None:
        depth = max(floor, float(high[2]) + 1e-3)
    low, high = middle - half, middle + half
    low[2], high[2] = 0.0, depth
    if camera == "chase":
        scale, exaggeration = 1.0, 1.0
    else:
        view = max(high[0] - low[0], high[1] - low[1]) * VIEW_MARGIN
        scale = min(1.0, hull_length / (VEHICLE_SHARE * view))
        if exaggeration is None:
            ratio = HEIGHT_RATIO[camera] * min(max(WIDESCREEN / frame.aspect, 0.5), 2.0)
            wanted = ratio * float(max(high[:2] - low[:2])) / depth
            exaggeration = min(EXAGGERATIONS, key=lambda e: abs(math.log(e / max(wanted, 1e-9))))
    return SceneLayout(azimuth=azimuth, low=low, high=high, scale=scale, exaggeration=exaggeration)


def principal_azimuth(horizontal: Array) -> float:
    """Direction [rad from north towards east] along which points (n, 2) spread most."""
    centred = horizontal - horizontal.mean(axis=0)
    if np.abs(centred).max(initial=0.0) < 1e-6:
        return 0.0
    _, vectors = np.linalg.eigh(centred.T @ centred)
    axis = vectors[:, -1]
    if np.dot(horizontal[-1] - horizontal[0], axis) < 0:
        axis = -axis
    return math.atan2(axis[1], axis[0])


def ticks(low: float, high: float, *, about: int = 5) -> Array:
    """Round values from `low` to `high`, about `about` of them, shape (n,)."""
    step = nice_step((high - low) / about)
    return np.asarray(step * np.arange(math.ceil(low / step - 1e-9), math.floor(high / step) + 1))


def nice_step(rough: float) -> float:
    """The number 1, 2 or 5 times a power of ten that is nearest to `rough`."""
    power = 10.0 ** math.floor(math.log10(rough))
    return min((m * power for m in (*NICE, 10.0)), key=lambda s: abs(math.log(s / rough)))
