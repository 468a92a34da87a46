"""Sighting: poses by a camera without drawing, from corner noise measured in drawn pictures.

`corner_noise.csv` has the deviation of a corner and the part of markers found, by the marker's side
in pixels, its angle to the line of sight, and the range over the visibility. `python -m
glider_twin_vision` draws pictures and writes the file. A mission's poses then need no pictures.
"""

from __future__ import annotations

import csv
import dataclasses
import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation

from glider_twin_vision.detection import information
from glider_twin_vision.lens import Lens
from glider_twin_vision.markers import Board
from glider_twin_vision.observer import View
from glider_twin_vision.smoother import Frames

Array = NDArray[np.float64]
TABLE = Path(__file__).with_name("corner_noise.csv")
COLUMNS = ("side_px", "angle_deg", "range_over_visibility", "found", "deviation_px")
UNSURE = 0.1
"""[rad] Deviation of a rotation from which on a plate's two poses fit alike (`Detector.pose`)"""
HIDING = 1.0
"""[s] Mean time for which something hides a marker"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Losses:
    """Losses of pictures and of markers that are in a picture."""

    dropped: float = 0.03
    """[1] Part of the pictures that never arrive"""
    hidden: float = 0.2
    """[1] Part of the pictures in which something hides a marker, each for itself"""

    def arrive(
        self, rng: np.random.Generator, count: int, markers: int, step: float
    ) -> NDArray[np.bool_]:
        """Mask of the markers that nothing hides, in pictures that arrive, (count, markers)."""
        leave = min(step / HIDING, 1.0)
        enter = leave * self.hidden / max(1.0 - self.hidden, 1e-9)
        free = np.empty((count, markers), bool)
        now = rng.random(markers) >= self.hidden
        for k, draw in enumerate(rng.random((count, markers))):
            now = np.where(now, draw >= enter, draw < leave)
            free[k] = now
        return free & (rng.random(count) >= self.dropped)[:, None]


@functools.cache
def table() -> tuple[RegularGridInterpolator, RegularGridInterpolator]:
    """Part of markers found, and logarithm of a corner's deviation [pixel], by three columns."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        rows = np.array([[float(row[name]) for name in COLUMNS] for row in csv.DictReader(file)])
    axes = tuple(np.unique(rows[:, k]) for k in range(3))
    shape = tuple(len(axis) for axis in axes)
    rows = rows[np.lexsort(rows[:, 2::-1].T)]
    found, spread = (rows[:, k].reshape(shape) for k in (3, 4))
    return RegularGridInterpolator(axes, found), RegularGridInterpolator(axes, np.log(spread))


def of_table(side: Array, angle: Array, thickness: Array) -> tuple[Array, Array]:
    """Part found and corner deviation [pixel]; nothing is found beyond the table."""
    found, spread = table()
    points = np.stack([side, angle, thickness], axis=-1)
    low, high = (np.array([axis[k] for axis in found.grid]) for k in (0, -1))
    inside = (side >= low[0]) & (angle <= high[1]) & (thickness <= high[2])
    nearest = np.clip(points, low, high)
    return np.where(inside, found(nearest), 0.0), np.exp(spread(nearest))


def sighted(
    view: View, board: Board, lens: Lens, rng: np.random.Generator, *, visibility: float,
    losses: Losses, focal_error: float = 0.0,
) -> Frames:  # fmt: skip
    """Poses that pictures of a view would give, with errors of their own covariance.

    Args:
      visibility: [m] of the water.
      focal_error: [1] error of the calibrated focal length, which makes all ranges longer.
    """
    place, turn = view.seen()
    centres = board.corners().mean(axis=1)
    at = place[:, None] + np.einsum("nij,mj->nmi", turn, centres)
    distance = np.linalg.norm(at, axis=-1)
    facing = np.einsum("nmi,nij,mj->nm", -at / distance[..., None], turn, board.outward)
    angle = np.degrees(np.arccos(np.clip(facing, -1.0, 1.0)))
    focal, ahead = lens.matrix[0, 0], np.maximum(at[..., 2], 1e-3)
    side = focal * board.side / ahead
    pixel = focal * at[..., :2] / ahead[..., None] + lens.matrix[:2, 2]
    inside = (at[..., 2] > 0.1) & (pixel > 0.5 * side[..., None]).all(axis=-1)
    inside &= (pixel < np.array([lens.width, lens.height]) - 0.5 * side[..., None]).all(axis=-1)
    found, spread = of_table(side, angle, distance / visibility)
    step = float(view.time[1] - view.time[0])
    seen = losses.arrive(rng, len(place), len(centres), step)
    seen &= inside & (rng.random(found.shape) < found)
    kept = np.flatnonzero(seen.any(axis=1))
    points = board.corners().reshape(-1, 3)
    turned = np.einsum("nij,cj->nci", turn[kept], points)
    weight = np.repeat(np.where(seen, spread**-2.0, 0.0)[kept], 4, axis=1)
    covariance = np.linalg.inv(information(turned, place[kept], focal, weight))
    sure = np.diagonal(covariance, axis1=1, axis2=2)[:, :3].max(axis=1) < UNSURE**2
    kept, covariance = kept[sure], covariance[sure]
    error = np.einsum(
        "nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal((len(kept), 6))
    )
    guess: Array = Rotation.from_rotvec(error[:, :3]).as_matrix() @ turn[kept]
    return view.frames(kept, place[kept] * (1.0 + focal_error) + error[:, 3:], guess, covariance)
