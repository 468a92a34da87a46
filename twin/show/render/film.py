"""Film: stills and videos of a shot, by one process or several.

Frames do not depend on who paints them: every worker builds the same scene and paints every n-th
frame, and the parent encodes them in order. So a video is the same for any number of workers.
"""

from __future__ import annotations

import dataclasses
import multiprocessing
import multiprocessing.connection
import os
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, TwinError
from twin.faults.base import Fault
from twin.numbers import processors
from twin.records.storage.whole import check_file_target, whole_file
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory
from twin.show.render.encode import STILL_FORMATS, VIDEO_FORMATS, Encoder
from twin.show.render.painter import Painter
from twin.show.render.playback import POSITION
from twin.show.render.shot import Shot
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

SLOTS = 3
"""Frames that each worker may be ahead of the encoder"""
GAP = "measured_gap"
"""Flag of samples that a log does not have"""
PATIENCE = 1.0
"""[s] between looks at whether a silent worker still lives"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Subject:
    """What a film is about."""

    trajectory: Trajectory
    vehicle: Vehicle
    tracks: tuple[NamedTrack, ...] = ()
    """Dead-reckoned tracks beside the true one"""
    title: str = ""
    floor: Array | None = None
    """Table of the mission's sea floor; None: what is drawn is decoration"""
    faults: Sequence[Fault] = ()
    """What is wrong with the vehicle: what is gone is not drawn from then on"""


def still(subject: Subject, shot: Shot, at: float | None = None) -> Pixels:
    """One picture, (height, width, 3), at mission time `at` [s]; None is the last in the
    part at which the vehicle's place is known, outside the gaps of a log.
    """
    times = shot.still_time(subject.trajectory.time, at, known_samples(subject.trajectory))
    with _painter(subject, shot, times) as painter:
        return painter.paint(0)


def known_samples(trajectory: Trajectory) -> NDArray[np.bool_]:
    """Samples at which the place is known and measured, (time,)."""
    known = np.isfinite([trajectory[f"true_{name}"] for name in POSITION]).all(axis=0)
    if GAP in trajectory:
        known &= ~(trajectory[GAP] > 0.0)
    return np.asarray(known)


def save_still(path: Path, subject: Subject, shot: Shot, at: float | None = None) -> None:
    """Write one picture as PNG.

    Raises:
      InputError: the path does not end in .png, or the shot does not fit.
    """
    from PIL import Image

    if path.suffix.lower() not in STILL_FORMATS:
        raise InputError(f"picture {path.name}: the ending must be {STILL_FORMATS[0]}")
    picture = Image.fromarray(still(subject, shot, at))
    with whole_file(path) as place:
        picture.save(place, optimize=True)


def save_video(
    path: Path,
    subject: Subject,
    shot: Shot,
    *,
    workers: int = 1,
    progress: Callable[[], None] | None = None,
) -> int:
    """Write a video (.mp4 or .gif) and return its number of frames.

    Args:
      workers: processes that paint; 1 paints in this one.
      progress: called after each frame.

    Raises:
      InputError: unknown ending, impossible size, or the shot does not fit.
      EncodeError: ffmpeg failed.
    """
    if workers < 1:
        raise InputError(f"workers {workers} must be at least 1")
    if path.suffix.lower() not in VIDEO_FORMATS:
        raise InputError(f"video {path.name}: the ending must be {' or '.join(VIDEO_FORMATS)}")
    times = shot.frame_times(subject.trajectory.time)
    check_file_target(path)
    workers = min(workers, len(times))
    painted = (
        _frames(subject, shot, times) if workers == 1 else _shared(subject, shot, times, workers)
    )
    with whole_file(path) as place, Encoder(place, shot.width, shot.height, shot.fps) as encoder:
        for frame in painted:
            encoder.write(frame)
            if progress is not None:
                progress()
    return len(times)


def default_workers() -> int:
    """One painter per core that this process may use: Mesa's own threads gain less."""
    return processors()


def _painter(subject: Subject, shot: Shot, times: Array) -> Painter:
    return Painter(
        subject.trajectory,
        subject.vehicle,
        shot,
        times,
        subject.tracks,
        title=subject.title,
        floor=subject.floor,
        faults=subject.faults,
    )


def _frames(subject: Subject, shot: Shot, times: Array) -> Iterator[Pixels]:
    with _painter(subject, shot, times) as painter:
        for index in range(painter.frames):
            yield painter.paint(index)


class _Worker:
    """A process that paints every n-th frame into a ring of shared frames."""

    def __init__(self, subject: Subject, shot: Shot, times: Array, indices: range):
        context = multiprocessing.get_context("spawn")
        self.shape = (SLOTS, shot.height, shot.width, 3)
        self.memory = SharedMemory(create=True, size=int(np.prod(self.shape)))
        self.frames: Pixels = np.ndarray(self.shape, np.uint8, self.memory.buf)
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(
            target=_paint,
            args=(theirs, self.memory.name, subject, shot, times, indices),
            daemon=True,
        )
        self.process.start()
        theirs.close()

    def wait(self) -> None:
        """Until the next frame is painted; raises what the worker raised."""
        while not self.pipe.poll(PATIENCE):
            if not self.process.is_alive():
                break
        try:
            message = self.pipe.recv()
        except EOFError:
            self.process.join()
            raise TwinError(
                f"a render worker ended with code {self.process.exitcode}; try --workers 1"
            ) from None
        if isinstance(message, BaseException):
            raise message

    def close(self) -> None:
        """End the process and release its memory."""
        self.pipe.close()
        self.process.join(timeout=5.0)
        if self.process.is_alive():
            self.process.terminate()
            self.process.join()
        del self.frames
        self.memory.close()
        self.memory.unlink()


def _shared(subject: Subject, shot: Shot, times: Array, workers: int) -> Iterator[Pixels]:
    # Each painter has a core of its own: Mesa must not start a thread per core in each of them.
    before = os.environ.get("LP_NUM_THREADS")
    os.environ["LP_NUM_THREADS"] = "1"
    crew: list[_Worker] = []
    try:
        for first in range(workers):
            crew.append(_Worker(subject, shot, times, range(first, len(times), workers)))
        for index in range(len(times)):
            worker = crew[index % workers]
            worker.wait()
            yield worker.frames[(index // workers) % SLOTS]
            worker.pipe.send(None)
    finally:
        if before is None:
            os.environ.pop("LP_NUM_THREADS", None)
        else:
            os.environ["LP_NUM_THREADS"] = before
        for worker in crew:
            worker.close()


def _paint(
    pipe: multiprocessing.connection.Connection[Any, Any],
    name: str,
    subject: Subject,
    shot: Shot,
    times: Array,
    indices: range,
) -> None:
    """The worker's process: paint, announce, and wait when SLOTS frames are unread."""
    # A spawned process shares its parent's resource tracker, so that nothing is tracked twice.
    memory = SharedMemory(name=name)
    frames: Pixels = np.ndarray((SLOTS, shot.height, shot.width, 3), np.uint8, memory.buf)
    try:
        with _painter(subject, shot, times) as painter:
            ahead = 0
            for count, index in enumerate(indices):
                if ahead == SLOTS:
                    pipe.recv()
                    ahead -= 1
                frames[count % SLOTS] = painter.paint(index)
                ahead += 1
                pipe.send(True)
            while ahead:
                pipe.recv()
                ahead -= 1
    except (EOFError, BrokenPipeError, KeyboardInterrupt):
        return  # the parent has gone: it says why
    except Exception as error:
        pipe.send(error)
    finally:
        del frames
        memory.close()
        pipe.close()
