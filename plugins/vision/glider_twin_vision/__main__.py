"""Measure the corner noise of markers in drawn pictures: `python -m glider_twin_vision`.

Each cell draws one plate at a place in a small picture of the lens's focal length, with veil, noise
and the blur of usual motion, and compares the corners found with the true ones.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import math
import sys

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from glider_twin_vision.detection import Detector
from glider_twin_vision.lens import Lens, action_camera
from glider_twin_vision.markers import Board
from glider_twin_vision.scene import Scene, Water
from glider_twin_vision.sighting import COLUMNS, TABLE
from twin import load_vehicle

SIDES = (14.0, 20.0, 30.0, 50.0, 110.0)
ANGLES = (0.0, 35.0, 55.0, 75.0)
THICKNESSES = (0.0, 0.3, 0.6, 0.9)
PICTURES = 12
MOTION = 40.0
"""[pixel/s] Deviation of the vehicle's velocity in the picture, each axis"""
ASTRAY = 3.0
"""[pixel] Error of a corner beyond which a marker counts as not found"""
LEAST = 0.05
"""[pixel] Least deviation, for cells with few finds"""


def small_lens() -> Lens:
    """Lens of the usual focal length whose picture holds one plate."""
    full = action_camera()
    matrix = full.matrix.copy()
    matrix[:2, 2] = 119.5
    return dataclasses.replace(full, matrix=matrix, distortion=np.zeros(5), width=240, height=240)


def measured_cell(
    scene: Scene,
    side: float,
    angle: float,
    thickness: float,
    rng: np.random.Generator,
    pictures: int,
) -> tuple[float, float]:
    """Part of the pictures in which a plate is found, and the deviation of a corner [pixel]."""
    board, lens = Board(), scene.lens
    detector = Detector(board, lens)
    distance = lens.matrix[0, 0] * board.side / side
    errors: list[NDArray[np.float64]] = []
    for _ in range(pictures):
        number = int(rng.integers(len(board.outward)))
        corners = board.corners()[number]
        centre, outward = corners.mean(axis=0), board.outward[number]
        # line of sight: the plate's normal, turned by the angle about an axis in the plate
        across = (corners[1] - corners[0]) / board.side
        lean = Rotation.from_rotvec(outward * rng.uniform(0.0, 2.0 * math.pi)).apply(across)
        sight = Rotation.from_rotvec(lean * math.radians(angle)).apply(outward)
        turn = Rotation.align_vectors([[0.0, 0.0, -1.0]], [sight])[0]
        roll = Rotation.from_rotvec([0.0, 0.0, math.radians(rng.uniform(-25.0, 25.0))])
        to_camera = (roll * turn).as_matrix()
        place = np.array([0.0, 0.0, distance]) - to_camera @ centre
        place[:2] += rng.uniform(-20.0, 20.0, 2) / lens.matrix[0, 0] * distance
        # the camera stands still in the water's axes, level with the pool
        body = np.array([0.0, 0.0, 3.0]), np.eye(3)
        eye = body[0] - to_camera.T @ place, to_camera.T
        water = Water(visibility=distance / max(thickness, 1e-3))
        motion = MOTION * rng.standard_normal(2)
        found = detector.sight(scene.picture(eye, body, water, rng, (motion[0], motion[1])))
        true = lens.project(corners @ to_camera.T + place)
        for one, pixels in zip(found.ids, found.corners, strict=True):
            if one == number and np.abs(pixels - true).max() < ASTRAY:
                errors.append(pixels - true)
    spread = math.sqrt(np.mean(np.square(errors))) if errors else 1.0
    return len(errors) / pictures, max(spread, LEAST)


def main() -> None:
    """Draw all cells and write the table."""
    rows = []
    with Scene(load_vehicle("bluerov2"), Board(), small_lens()) as scene:
        for number, cell in enumerate(itertools.product(SIDES, ANGLES, THICKNESSES)):
            found, spread = measured_cell(scene, *cell, np.random.default_rng(number), PICTURES)
            rows.append([f"{one:g}" for one in cell] + [f"{found:.3f}", f"{spread:.3f}"])
            sys.stderr.write(" ".join(rows[-1]) + "\n")
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(rows)


if __name__ == "__main__":
    main()
