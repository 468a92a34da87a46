"""Markers reader: a still camera's video and the vehicle's log become one log with velocities.

The vertical motion joins the clocks: the depth in the video is shifted until it fits the depth of
the log. The log's attitude then gives the attitude of the camera.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from factory.importing import Channel, DeploymentLog, ReadOptions, Tally, read_logs, sniff
from glider_twin_vision.camera_sensor import LOGGED, WORST, labelled
from glider_twin_vision.detection import Detector, Pose
from glider_twin_vision.lens import Lens
from glider_twin_vision.markers import Board
from glider_twin_vision.smoother import Frames, Settings, smooth
from twin.errors import InputError

Array = NDArray[np.float64]
LEAST_POSES = 20
LEAST_MOTION = 0.05
"""[m] Least deviation of the depth in a video, to join clocks by it"""
WORST_FIT = 0.3
"""[1] Largest deviation of the depth's difference, relative to the depth's own deviation"""
WORST_CLOCK = 0.1
"""[s] Largest deviation of the clocks' difference"""
SOUNDING = 0.01
"""[m] Deviation of the log's depth"""
TOGETHER = 1.0
"""[s] Time within which depths err alike"""
LEAST_INSIDE = 0.9
"""[1] Part of the poses that must lie in the log's time"""
COARSE, FINE = 0.1, 0.005
"""[s] Steps of the search for the clocks' difference"""
AROUND = 41
"""Number of poses over which a corner's deviation is estimated"""


class Poses(NamedTuple):
    """Poses in camera axes, by picture."""

    time: Array
    """[s] of the video, (n,)"""
    place: Array
    """[m] (n, 3)"""
    turn: Array
    """From body to camera axes, (n, 3, 3)"""
    covariance: Array
    """(n, 6, 6), see `Pose.unit`"""


def read_markers(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Read one video and its log.

    Raises:
      InputError: an option is missing, a file cannot be used, or the two do not fit together.
    """
    if options.camera is None or options.log is None:
        raise InputError(f"{paths[0].name}: markers need --camera CALIBRATION and --log LOG")
    if len(paths) != 1:
        raise InputError(f"{paths[1].name} is a second video: markers are read from one at a time")
    log = _log(options.log, tally)
    lens, board = Lens.read(options.camera), Board(side=options.marker_side)
    poses = poses_in(paths[0], lens, board, tally)
    times, attitude, force, depth = _of_log(log, options.log)
    offset, deviation, misfit = joined_clocks(poses, times, attitude, depth)
    start = f"the video begins {offset - times[0]:.2f} +- {deviation:.2f} s after the log"
    fit = f"the depths fit to {100.0 * misfit:.1f} cm"
    tally.add("note", "clocks", 1, f"by the vertical motion {start}; {fit}")
    at = poses.time + offset
    inside = (at >= times[0]) & (at <= times[-1])
    turn = camera_turn(poses, times, attitude, offset)
    six = np.zeros((6, 6))
    six[:3, :3] = six[3:, 3:] = turn
    frames = Frames(
        time=at[inside], place=(poses.place @ turn.T)[inside], turn=(turn @ poses.turn)[inside],
        covariance=(six @ poses.covariance @ six.T)[inside],
    )  # fmt: skip
    near = (times >= frames.time[0] - 1.0) & (times <= frames.time[-1] + 1.0)
    found = smooth(times[near], attitude[near], force[near], frames, Settings())
    clear = np.max(found.deviation, axis=1) <= WORST
    tally.add("removed", "measured_camera_*", ~clear, f"stated deviation above {WORST:g} m/s")
    measured = {
        name: Channel.finite(times[near], values)
        for name, values in labelled(found.velocity, found.deviation).items()
    }
    channels = {**log.channels, **measured}
    return [dataclasses.replace(log, channels=channels, files=(paths[0].name, *log.files))]


def poses_in(path: Path, lens: Lens, board: Board, tally: Tally) -> Poses:
    """Poses of a vehicle in the pictures of a video.

    Raises:
      InputError: the video cannot be read, has another size than the calibration, or hardly shows
        a marker.
    """
    detector = Detector(board, lens)
    times: list[float] = []
    found: list[Pose] = []
    count = seen = 0
    for moment, picture in _pictures(path, lens):
        count += 1
        sight = detector.sight(picture)
        seen += len(sight.ids) > 0
        pose = detector.pose(sight)
        if pose is not None:
            times.append(moment)
            found.append(pose)
    sure = f"{seen} with markers, {len(found)} with a certain pose"
    tally.add("note", "pictures", 1, f"{count} in {path.name}, {sure}")
    if len(found) < LEAST_POSES:
        raise InputError(
            f"{path.name}: {seen} of {count} pictures show markers and {len(found)} give a pose, "
            f"{LEAST_POSES} are needed: look at the video, --camera and --marker-side"
        )
    # a corner's deviation, from the residuals of the poses around each
    squares = uniform_filter1d(np.array([one.squares for one in found]), AROUND, mode="nearest")
    freedom = uniform_filter1d(
        np.array([float(one.freedom) for one in found]), AROUND, mode="nearest"
    )
    unit = np.array([one.unit for one in found])
    return Poses(
        np.array(times), np.array([one.place for one in found]),
        np.array([one.turn for one in found]), unit * (squares / freedom)[:, None, None],
    )  # fmt: skip


def _pictures(path: Path, lens: Lens) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Time [s] and grey picture of each frame of a video."""
    video = cv2.VideoCapture(str(path))
    rate = video.get(cv2.CAP_PROP_FPS)
    if not video.isOpened() or not rate > 0.0:
        raise InputError(f"{path.name} cannot be read as a video")
    number = 0
    while True:
        going, picture = video.read()
        if not going:
            break
        if picture.shape[:2] != (lens.height, lens.width):
            raise InputError(
                f"{path.name} has pictures of {picture.shape[1]} x {picture.shape[0]}, and the "
                f"calibration is for {lens.width} x {lens.height}: calibrate at the video's size"
            )
        yield number / rate, np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))
        number += 1
    video.release()


def _log(path: Path, tally: Tally) -> DeploymentLog:
    kind = sniff(path)
    if kind is None:
        raise InputError(f"{path.name} is no log that `factory import` knows: give another --log")
    _, logs = read_logs(kind, [path], ReadOptions(), tally)
    return logs[0]


def _of_log(log: DeploymentLog, path: Path) -> tuple[Array, Array, Array, Array]:
    """Times [s], attitude [rad], specific force [m/s2], each (n, 3), and depth [m] of a log."""
    names = (*LOGGED, "measured_depth")
    lacking = [name for name in names if len(log.channel(name)) < 4]
    if lacking:
        raise InputError(f"{path.name} has no {lacking[0]}, which the camera's poses need")
    first = max(log.channel(name).time[0] for name in names)
    last = min(log.channel(name).time[-1] for name in names)
    times = log.channel(LOGGED[0]).time
    times = times[(times >= first) & (times <= last)]

    def on_grid(name: str) -> Array:
        channel = log.channel(name)
        return np.interp(times, channel.time, channel.values)

    heading = log.channel(LOGGED[2])
    turned = np.unwrap(np.radians(heading.values))
    attitude = np.stack([*(np.radians(on_grid(name)) for name in LOGGED[:2]),
                         np.interp(times, heading.time, turned)], axis=-1)  # fmt: skip
    force = np.stack([on_grid(name) for name in LOGGED[3:]], axis=-1)
    return times, attitude, force, on_grid("measured_depth")


def joined_clocks(
    poses: Poses, times: Array, attitude: Array, depth: Array
) -> tuple[float, float, float]:
    """Time of the log [s] at which the video begins, its deviation [s], and the misfit [m].

    The vertical is the vehicle's mean one at first, then the one by the log's attitude. The
    deviation is that of a shift by least squares, with errors alike within TOGETHER.

    Args:
      times, attitude, depth: of the log, [s], [rad] (n, 3) and [m].

    Raises:
      InputError: the vehicle hardly moved up and down, or its depth fits nowhere in the log.
    """
    down = poses.turn[:, :, 2].mean(axis=0)
    down /= np.linalg.norm(down)
    spread = np.einsum("i,nij,j->n", down, poses.covariance[:, 3:, 3:], down) + SOUNDING**2
    weight = (1.0 / spread) / np.sum(1.0 / spread)

    def size(values: Array) -> float:
        """Weighted standard deviation of values at the poses."""
        return float(np.sqrt(weight @ (values - weight @ values) ** 2))

    half = 0.5 * float(poses.time[-1])
    trial = np.arange(times[0] - half, times[-1] - half, COARSE)
    offset, misfit, motion = float("nan"), float("inf"), 0.0
    for step in (COARSE, FINE):
        along = poses.place @ down
        motion = size(along)
        if motion < LEAST_MOTION:
            raise InputError(
                f"the vehicle moves {100.0 * motion:.1f} cm up and down in the video: let it dive "
                "and climb at least half a metre, so that the clocks can be joined"
            )
        at = trial[:, None] + poses.time
        inside = ((at >= times[0]) & (at <= times[-1])).mean(axis=1) > LEAST_INSIDE
        if not inside.any():
            raise InputError("the video is longer than the log: cut it to the log's time")
        misfits = [size(along - np.interp(one, times, depth)) for one in at[inside]]
        offset, misfit = float(trial[inside][np.argmin(misfits)]), min(misfits)
        if step == COARSE:
            given = _given(times, attitude, poses.time + offset).as_matrix()[:, 2]
            down = np.einsum("nij,nj->ni", poses.turn, given).mean(axis=0)
            down /= np.linalg.norm(down)
            trial = np.arange(offset - 4.0 * COARSE, offset + 4.0 * COARSE, FINE)
    if not misfit < WORST_FIT * motion:
        raise InputError(
            f"the depth in the video fits nowhere in the log (misfit {misfit:.2f} m of "
            f"{motion:.2f} m): is it the log of this dive, and does the camera stand still?"
        )
    rate = size(np.interp(poses.time + offset, times, np.gradient(depth, times)))
    apart = len(np.unique(np.floor(poses.time / TOGETHER)))
    deviation = misfit / max(rate, 1e-9) / float(np.sqrt(apart))
    if deviation > WORST_CLOCK:
        raise InputError(
            f"the clocks join to {deviation:.2f} s only, {WORST_CLOCK:g} are needed: the vehicle "
            "must change its vertical velocity while the camera sees its markers"
        )
    return offset, deviation, misfit


def _given(times: Array, attitude: Array, at: Array) -> Rotation:
    """Attitude of the log at times [s]."""
    angles = np.stack([np.interp(at, times, one) for one in np.unwrap(attitude, axis=0).T], axis=-1)
    return Rotation.from_euler("ZYX", angles[:, ::-1])


def camera_turn(poses: Poses, times: Array, attitude: Array, offset: float) -> Array:
    """Matrix from camera axes to north-east-down, (3, 3), by the log's attitude."""
    given = _given(times, attitude, poses.time + offset)
    return np.asarray((given * Rotation.from_matrix(poses.turn).inv()).mean().as_matrix())
