"""Camera poses: errors in drawn pictures beside their stated deviations.

    python -m benchmarks.camera_poses [--pictures 120] [--seed 0]

A camera looks at the vehicle from random directions, in water of 2 to 15 m of visibility. The table
has the errors of place and rotation, the deviations that the covariance states, and the ratio, by
range, by the angle from the bow to the line of sight, and by thirds of the visibility. A corner's
deviation is the residual of all pictures in water of that third, as a video's reader pools it.
"""

from __future__ import annotations

import itertools
import sys
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import command
from glider_twin_vision.detection import Detector
from glider_twin_vision.lens import action_camera
from glider_twin_vision.markers import Board
from glider_twin_vision.observer import looking
from glider_twin_vision.scene import Scene, Water
from twin import load_vehicle

THIRDS = (2.0, 3.91, 7.66, 15.0)
"""[m] Edges of the thirds of the visibility, which is even in its logarithm"""


def main(pictures: int = 120, seed: int = 0, json_: bool = False) -> None:
    """Draw, detect, print.

    Args:
      pictures: number of pictures.
      seed: seed of directions, water and noise.
      json_: print JSON.
    """
    rng, board = np.random.default_rng(seed), Board()
    body = np.array([0.0, 0.0, 3.0]), np.eye(3)
    every, found = [], []
    with Scene(load_vehicle("bluerov2"), board, action_camera()) as scene:
        detector = Detector(board, scene.lens)
        for _ in range(pictures):
            visibility = 2.0 * 7.5 ** rng.random()
            away = min(rng.uniform(1.2, 4.0), 0.8 * visibility)
            bearing, rise = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 0.7)
            aside = np.array([np.cos(bearing) * np.cos(rise), np.sin(bearing) * np.cos(rise),
                              -np.sin(rise)])  # fmt: skip
            eye = body[0] + away * aside
            turn = looking((body[0] + rng.normal(0.0, 0.15, 3) - eye)[None])[0]
            motion = 40.0 * rng.standard_normal(2)
            picture = scene.picture(
                (eye, turn), body, Water(visibility=visibility), rng, (motion[0], motion[1])
            )
            pose = detector.pose(detector.sight(picture))
            third = int(np.searchsorted(THIRDS, visibility)) - 1
            every.append((away, abs(np.degrees(bearing)), third))
            if pose is None:
                continue
            rotation = Rotation.from_matrix(pose.turn @ (turn.T @ body[1]).T).as_rotvec()
            error = np.r_[rotation, pose.place - turn.T @ (body[0] - eye)]
            found.append((*every[-1], *error, *np.diag(pose.unit), pose.squares, pose.freedom))
    asked, data = np.array(every), np.array(found)
    corner = np.empty(len(data))
    for third in range(3):
        of = data[:, 2] == third
        corner[of] = np.sqrt(data[of, 15].sum() / max(data[of, 16].sum(), 1.0))
    stated = np.sqrt(data[:, 9:15]) * corner[:, None]
    rows: list[dict[str, Any]] = []
    groups = [("range", 0, (1.0, 2.0, 3.0, 4.0), "m"), ("angle", 1, (0, 60, 120, 180), "deg"),
              ("visibility", 2, (-0.5, 0.5, 1.5, 2.5), "")]  # fmt: skip
    for name, column, edges, unit in groups:
        for k, (low, high) in enumerate(itertools.pairwise(edges)):
            of = (data[:, column] >= low) & (data[:, column] <= high)
            seen = (asked[:, column] >= low) & (asked[:, column] <= high)
            text = (
                f"{low:g} to {high:g} {unit}" if unit else f"{THIRDS[k]:g} to {THIRDS[k + 1]:g} m"
            )
            turn, place = data[of, 3:6], data[of, 6:9]
            said = stated[of]
            rows.append({
                "by": name, "from": text, "pictures": int(seen.sum()),
                "poses %": 100.0 * of.sum() / max(seen.sum(), 1),
                "place mm": 1e3 * np.sqrt(np.mean(place**2)),
                "stated mm": 1e3 * np.sqrt(np.mean(said[:, 3:] ** 2)),
                "rotation deg": np.degrees(np.sqrt(np.mean(turn**2))),
                "stated deg": np.degrees(np.sqrt(np.mean(said[:, :3] ** 2))),
                "error/stated": np.sqrt(np.mean((data[of, 3:9] / said) ** 2)),
            })  # fmt: skip
    command.say(rows, rows, json=json_, digits=3)


if __name__ == "__main__":
    sys.exit(command.run(main))
