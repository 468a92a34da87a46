"""Lens: a calibrated camera as OpenCV writes it, and pictures seen through its distortion.

Camera axes are OpenCV's: x right, y down, z ahead. Pixel (0, 0) is the centre of the first pixel.
"""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError

Array = NDArray[np.float64]
KEYS = ("image_width", "image_height", "camera_matrix", "distortion_coefficients")
"""Entries of a calibration file, named as OpenCV's calibration sample names them"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Lens:
    """Pinhole with distortion, of the model of `cv2.calibrateCamera`."""

    matrix: Array
    """[pixel] Camera matrix, (3, 3)"""
    distortion: Array
    """Distortion coefficients k1, k2, p1, p2, k3 ..., (n,)"""
    width: int
    """[pixel]"""
    height: int
    """[pixel]"""

    @classmethod
    def read(cls, path: Path) -> Lens:
        """Read a calibration that OpenCV wrote, YAML, XML or JSON.

        Raises:
          InputError: the file is missing, is none of OpenCV's, or lacks an entry.
        """
        if not path.is_file():
            raise InputError(f"calibration {path} is not there: give the file that OpenCV wrote")
        try:
            file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
            lacking = [key for key in KEYS if file.getNode(key).empty()]
            if not lacking:
                width, height = (int(file.getNode(key).real()) for key in KEYS[:2])
                matrix, distortion = (file.getNode(key).mat() for key in KEYS[2:])
        except (cv2.error, SystemError) as error:
            raise InputError(f"calibration {path} is no file of OpenCV's: {error}") from error
        if lacking:
            raise InputError(
                f"calibration {path} lacks {lacking[0]}: it needs {', '.join(KEYS)}, as OpenCV's "
                "calibration writes them"
            )
        if matrix is None or matrix.shape != (3, 3) or not matrix[0, 0] > 0.0:
            raise InputError(
                f"calibration {path}: camera_matrix must be 3 x 3, with a focal length"
            )
        return cls(
            matrix=np.array(matrix, float), distortion=np.array(distortion, float).ravel(),
            width=width, height=height,
        )  # fmt: skip

    def write(self, path: Path) -> None:
        """Write the calibration as OpenCV does."""
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        values: list[Any] = [self.width, self.height, self.matrix, self.distortion[:, None]]
        for key, value in zip(KEYS, values, strict=True):
            file.write(key, value)
        file.release()

    @functools.cached_property
    def widened(self) -> Array:
        """[pixel] Matrix of the pinhole picture, as large as the lens's, that holds all it sees."""
        x = np.linspace(-0.5, self.width - 0.5, 41)
        y = np.linspace(-0.5, self.height - 0.5, 31)
        edge = [(a, b) for a in x for b in (y[0], y[-1])] + [
            (a, b) for a in (x[0], x[-1]) for b in y
        ]
        seen = np.abs(self.normalised(np.array(edge)))
        focal = min(0.5 * self.width / seen[:, 0].max(), 0.5 * self.height / seen[:, 1].max())
        centre = 0.5 * (self.width - 1), 0.5 * (self.height - 1)
        return np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])

    @functools.cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Pixel of the widened pinhole picture that each pixel of the lens sees."""
        grid = np.stack(np.meshgrid(np.arange(self.width), np.arange(self.height)), axis=-1)
        seen = self.normalised(grid.reshape(-1, 2).astype(float)).reshape(grid.shape)
        wide = self.widened
        found = (seen * [wide[0, 0], wide[1, 1]] + wide[:2, 2]).astype(np.float32)
        return found[..., 0], found[..., 1]

    def bend(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        """Distort a picture of the pinhole `widened`, (height, width, n)."""
        found = cv2.remap(picture, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(found)

    def normalised(self, pixels: Array) -> Array:
        """Directions x/z and y/z, (n, 2), of pixels, (n, 2)."""
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
        points = np.ascontiguousarray(pixels[:, None])
        found = cv2.undistortPoints(points, self.matrix, self.distortion, criteria=stop)
        return np.asarray(found, float)[:, 0]

    def project(self, points: Array) -> Array:
        """[pixel] Picture, (n, 2), of points in camera axes [m], (n, 3)."""
        still = np.zeros(3)
        found, _ = cv2.projectPoints(points, still, still, self.matrix, self.distortion)
        return np.asarray(found, float)[:, 0]


def action_camera() -> Lens:
    """Small camera behind a flat port, 70 degrees wide in water, with barrel distortion; ours."""
    return Lens(
        matrix=np.array([[685.0, 0.0, 483.0], [0.0, 685.0, 356.0], [0.0, 0.0, 1.0]]),
        distortion=np.array([-0.14, 0.03, 0.0005, -0.0003, 0.0]), width=960, height=720,
    )  # fmt: skip
