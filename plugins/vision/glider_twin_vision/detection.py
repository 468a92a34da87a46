"""Detection: markers in a picture by OpenCV, and the vehicle's pose from their corners.

The pose minimises the squared distances of the corners in the picture (`cv2.solvePnP`). Its
covariance is s^2 (J^T J)^-1, with the Jacobian J of the pinhole and the deviation s of a corner.
One plate alone has two poses of nearly equal fit when it is far; such a pose is left out.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray

from glider_twin_vision.lens import Lens
from glider_twin_vision.markers import Board, dictionary

Array = NDArray[np.float64]
AMBIGUOUS = 3.0
"""[1] Least ratio of the misfits of a single plate's two poses"""
HALF = 0.5
"""[pixel] AprilTag's edges count from the corner of the first pixel, all others from its centre"""
LEAST_CONTRAST = 8.0
"""[grey level] Spread of a picture below which only noise is left"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Sight:
    """Markers found in one picture."""

    ids: NDArray[np.int64]
    """Numbers of the markers, (n,)"""
    corners: Array
    """[pixel] Corners as in `Board.corners`, (n, 4, 2)"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """Pose of the vehicle in camera axes, by one picture."""

    place: Array
    """[m] Place of the centre of buoyancy, (3,)"""
    turn: Array
    """Matrix from body to camera axes, (3, 3)"""
    unit: Array
    """Covariance for a corner deviation of 1 pixel, (6, 6): a small rotation [rad] in camera axes
    that precedes `turn`, and the place [m]"""
    squares: float
    """[pixel2] Sum of squared residuals"""
    freedom: int
    """Number of corner coordinates, less 6"""


class Detector:
    """Finder of one board's markers in pictures of one lens."""

    def __init__(self, board: Board, lens: Lens) -> None:
        """Make the finder."""
        rough, fine = cv2.aruco.DetectorParameters(), cv2.aruco.DetectorParameters()
        rough.adaptiveThreshWinSizeMax, rough.minMarkerPerimeterRate = 43, 0.015
        fine.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
        self._rough, self._fine = (cv2.aruco.ArucoDetector(dictionary(), s) for s in (rough, fine))
        self._points, self._lens = board.corners(), lens

    def sight(self, picture: NDArray[np.uint8]) -> Sight:
        """Find the markers in a picture, RGB or grey; water's veil is stretched away first."""
        grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) if picture.ndim == 3 else picture
        low, high = (float(one) for one in np.percentile(grey[::4, ::4], (0.5, 99.95)))
        wide = max(high - low, LEAST_CONTRAST)
        even = cv2.convertScaleAbs(
            cv2.subtract(grey, np.full_like(grey, int(low))), None, 230.0 / wide
        )
        found: dict[int, Array] = {}
        rough, ids, _ = self._rough.detectMarkers(cv2.GaussianBlur(even, (3, 3), 0.8))
        for number, corners in zip([] if ids is None else ids.ravel(), rough, strict=True):
            # corner by corner OpenCV is drawn into the marker by blur; fitted edges are not
            side = np.ptp(corners[0], axis=0).max()
            first = np.maximum(np.floor(corners[0].min(axis=0) - 0.5 * side).astype(int), 0)
            last = np.ceil(corners[0].max(axis=0) + 0.5 * side).astype(int)
            part = np.ascontiguousarray(even[first[1] : last[1], first[0] : last[0]])
            again, names, _ = self._fine.detectMarkers(part)
            same = np.flatnonzero([] if names is None else names.ravel() == number)
            if len(same) and number < len(self._points):
                found[int(number)] = again[same[0]][0].astype(float) + first - HALF
        return Sight(
            ids=np.array(list(found), np.int64),
            corners=np.array(list(found.values()), float).reshape(-1, 4, 2),
        )

    def pose(self, sight: Sight) -> Pose | None:
        """Pose by a sight; None without markers, or where two poses fit alike."""
        if not len(sight.ids):
            return None
        points = self._points[sight.ids].reshape(-1, 3)
        pixels = sight.corners.reshape(-1, 2)
        seen = self._lens.normalised(pixels)
        camera = np.eye(3)
        if len(sight.ids) == 1:
            count, turns, places, misfits = cv2.solvePnPGeneric(
                points, seen, camera, None, flags=cv2.SOLVEPNP_IPPE
            )
            fits = np.asarray(misfits, float).ravel()
            if not count or (count > 1 and fits[1] < AMBIGUOUS * max(fits[0], 1e-9)):
                return None
            turn, place = turns[0], places[0]
        else:
            found, turn, place = cv2.solvePnP(points, seen, camera, None, flags=cv2.SOLVEPNP_SQPNP)
            if not found:
                return None
        turn, place = cv2.solvePnPRefineLM(points, seen, camera, None, turn, place)
        matrix: Array = np.array(cv2.Rodrigues(turn)[0], np.float64)
        at: Array = np.array(place, np.float64).ravel()
        turned = points @ matrix.T
        if not np.isfinite(at).all() or (turned + at)[:, 2].min() <= 0.0:
            return None
        residual = (self._lens.project(turned + at) - pixels).ravel()
        unit = np.linalg.inv(information(turned[None], at[None], self._lens.matrix[0, 0])[0])
        return Pose(
            place=at, turn=matrix, unit=unit, squares=float(residual @ residual),
            freedom=residual.size - 6,
        )  # fmt: skip


def information(turned: Array, place: Array, focal: float, weights: Array | None = None) -> Array:
    """Inverse covariances of poses, (n, 6, 6), for a corner deviation of 1 pixel.

    Args:
      turned: [m] corners from the centre of buoyancy, in camera axes, (n, corners, 3).
      place: [m] centre of buoyancy in camera axes, (n, 3).
      focal: [pixel] focal length.
      weights: [1/pixel2] inverse variances of the corners, (n, corners); None: 1.
    """
    at = turned + place[:, None]
    x, y, z = at[..., 0], at[..., 1], np.maximum(at[..., 2], 1e-3)
    zero = np.zeros_like(z)
    slope = np.stack(
        [np.stack([1.0 / z, zero, -x / z**2], -1), np.stack([zero, 1.0 / z, -y / z**2], -1)], -2
    )
    a, b, c = turned[..., 0], turned[..., 1], turned[..., 2]
    # d(theta x r)/d(theta) = -[r x]
    cross = np.stack(
        [np.stack([zero, c, -b], -1), np.stack([-c, zero, a], -1), np.stack([b, -a, zero], -1)], -2
    )
    jacobian = focal * np.concatenate([slope @ cross, slope], -1)
    given = np.ones_like(z) if weights is None else weights
    return np.einsum("ncij,nc,ncik->njk", jacobian, given, jacobian)
