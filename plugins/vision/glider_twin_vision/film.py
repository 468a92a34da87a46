"""Film: the video of a stored mission by a camera that sees markers on the vehicle."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from glider_twin_vision.lens import action_camera
from glider_twin_vision.markers import PLATES, Board
from glider_twin_vision.observer import SIGNALS, View, watch
from glider_twin_vision.scene import Scene, Water
from glider_twin_vision.sighting import Losses
from twin.errors import InputError
from twin.show.render import read_subject


class Film(NamedTuple):
    """A written video."""

    calibration: Path
    """File with the camera's calibration, as OpenCV writes it"""
    pictures: int
    view: View
    """Vehicle and camera in each picture"""


def film(
    store: Path, out: Path, *, mission: int = 0, observer: str = "frame", rate: float = 10.0,
    distance: float = 4.0, visibility: float = 10.0, side: float = 0.15,
    seconds: float | None = None, seed: int = 0, losses: Losses | None = None,
) -> Film:  # fmt: skip
    """Write the video of a mission and, beside it, the calibration .yaml. Lost pictures are black.

    Args:
      rate: [1/s] pictures.
      distance: [m] of the camera, see `watch`.
      visibility: [m] of the water.
      side: [m] black square of a marker.
      seconds: [s] length from the mission's start; None: all.

    Raises:
      InputError: the store is no mission, the observer is unknown, or the video cannot be written.
    """
    subject = read_subject(store, mission)
    period = float(np.median(np.diff(subject.trajectory.time)))
    count = len(subject.trajectory.time) if seconds is None else int(seconds / period) + 1
    truth = {name: np.asarray(subject.trajectory[name], float)[:count] for name in SIGNALS}
    if len(truth["true_depth"]) < 4:
        raise InputError(f"the video would last {seconds:g} s: at least {3 * period:g} are needed")
    rng = np.random.default_rng(seed)
    view = watch(truth, period, rng, name=observer, rate=rate, distance=distance)
    board, lens, water = Board(side=side), action_camera(), Water(visibility=visibility)
    free = (losses or Losses()).arrive(rng, len(view.time), len(PLATES), 1.0 / rate)
    calibration = out.with_suffix(".yaml")
    lens.write(calibration)
    size = lens.width, lens.height
    video = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"mp4v"), rate, size)
    if not video.isOpened():
        raise InputError(f"video {out} cannot be written: is its folder there?")
    floor = float(truth["true_depth"].max()) + 2.0
    before = None
    with Scene(subject.vehicle, board, lens, floor=floor) as scene:
        place, _ = view.seen()
        pixels = lens.project(place)
        for k in range(len(view.time)):
            motion = (pixels[k] - (pixels[k] if before is None else before)) * rate
            before = pixels[k]
            if not free[k].any():
                video.write(np.zeros((lens.height, lens.width, 3), np.uint8))
                continue
            scene.hide(~free[k])
            picture = scene.picture(
                (view.eye[k], view.eye_turn[k]), (view.body[k], view.body_turn[k]), water, rng,
                (motion[0], motion[1]),
            )  # fmt: skip
            video.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    video.release()
    return Film(calibration, len(view.time), view)
