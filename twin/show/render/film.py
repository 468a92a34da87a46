"""Film: stills and videos of a shot, painted by one process or several, encoded by ffmpeg.

Frames do not depend on who paints them, and are encoded in their order. So a video is the same for
any number of workers. The ffmpeg is the one that imageio-ffmpeg carries.
"""

from __future__ import annotations

import collections
import contextlib
import functools
import multiprocessing
import multiprocessing.connection
import os
import signal
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import IO, Self

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, TwinError
from twin.extras import require
from twin.numbers import processors
from twin.records.storage.whole import check_file_target, whole_file
from twin.records.trajectory import Trajectory
from twin.show.render.painter import Painter
from twin.show.render.playback import POSITION
from twin.show.render.shot import Shot, Subject

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

VIDEO_FORMATS = (".mp4", ".gif")
STILL_FORMATS = (".png",)
AHEAD = 3
"""Frames for each worker that may wait for the encoder"""
GAP = "measured_gap"
"""Flag of samples that a log does not have"""
QUALITY = 20
"""x264's constant rate factor: 18 looks lossless, 23 is its default"""
PRESET = "veryfast"
"""x264's: half the time of `fast` for a tenth more bytes"""
GIF_FPS = 20.0
"""Most frames per second of a gif: its clock counts hundredths and browsers slow down below 3"""


def still(subject: Subject, shot: Shot, at: float | None = None) -> Pixels:
    """One picture, (height, width, 3), at mission time `at` [s]; None is the last in the
    part at which the vehicle's place is known, outside the gaps of a log.
    """
    times = shot.still_time(subject.trajectory.time, at, known_samples(subject.trajectory))
    with Painter(subject, shot, times) as painter:
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
    if workers == 1:
        painted = _frames(subject, shot, times)
    else:
        painted = _shared_frames(subject, shot, times, workers)
    with whole_file(path) as place, Encoder(place, shot.width, shot.height, shot.fps) as encoder:
        for frame in painted:
            encoder.write(frame)
            if progress is not None:
                progress()
    return len(times)


def default_workers() -> int:
    """One painter per core that this process may use: Mesa's own threads gain less."""
    return processors()


def _frames(subject: Subject, shot: Shot, times: Array) -> Iterator[Pixels]:
    with Painter(subject, shot, times) as painter:
        for index in range(painter.frames):
            yield painter.paint(index)


def _shared_frames(subject: Subject, shot: Shot, times: Array, workers: int) -> Iterator[Pixels]:
    """Frames in order, painted by processes that were not forked: OpenGL does not survive it."""
    pool = ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), _begin, (subject, shot, times)
    )
    waiting: collections.deque[Future[Pixels]] = collections.deque()
    try:
        for index in range(len(times)):
            waiting.append(pool.submit(_paint, index))
            if len(waiting) == AHEAD * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    except BrokenProcessPool:
        raise TwinError("a render worker ended before its frame; try --workers 1") from None
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(*shown: object) -> None:
    """A worker's first act; interrupts are the parent's to answer, and it ends with its parent."""
    global _shown
    _shown = shown
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["LP_NUM_THREADS"] = "1"  # each has a core, where Mesa would start a thread per core
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    multiprocessing.connection.wait([parent.sentinel])
    os._exit(1)


_shown: tuple[object, ...] = ()
"""Subject, shot and times of this worker's film"""


@functools.cache
def _painter() -> Painter:
    return Painter(*_shown)  # type: ignore[arg-type]


def _paint(index: int) -> Pixels:
    return _painter().paint(index)


class EncodeError(TwinError):
    """ffmpeg could not write the video; its last line is in the message."""


class Encoder:
    """Writes frames to a video file; until the context manager ends well it is cut."""

    def __init__(self, path: Path, width: int, height: int, fps: float):
        """
        Raises:
          InputError: unknown ending, a size that the format cannot hold, or no imageio-ffmpeg.
        """
        suffix = path.suffix.lower()
        if suffix not in VIDEO_FORMATS:
            raise InputError(f"video {path.name}: the ending must be {' or '.join(VIDEO_FORMATS)}")
        if suffix == ".mp4" and (width % 2 or height % 2):
            raise InputError(f"mp4 needs an even width and height, not {width}x{height}")
        require("imageio_ffmpeg", extra="video", purpose="writing a video")
        self.path = path
        self._shape = (height, width, 3)
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed in __exit__
        self._process = subprocess.Popen(
            [*_command(width, height, fps), *_output(suffix, fps), str(self.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._log,
        )

    def write(self, frame: Pixels) -> None:
        """Add a frame (height, width, 3)."""
        if frame.shape != self._shape or frame.dtype != np.uint8:
            raise ValueError(f"frame {frame.shape} {frame.dtype}, expected {self._shape} uint8")
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(frame).data)
        except OSError as error:
            self._process.wait()
            raise EncodeError(f"cannot write {self.path.name}: {self._last_words()}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        assert self._process.stdin is not None
        try:
            if kind is not None:
                self._process.kill()
                return
            self._process.stdin.close()
            if self._process.wait() != 0:
                raise EncodeError(f"cannot write {self.path.name}: {self._last_words()}")
        finally:
            self._process.wait()
            with contextlib.suppress(BrokenPipeError):  # what was buffered has nowhere to go
                self._process.stdin.close()
            self._log.close()

    def _last_words(self) -> str:
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"ffmpeg ended with code {self._process.returncode}"


def _command(width: int, height: int, fps: float) -> list[str]:
    import imageio_ffmpeg

    return [
        imageio_ffmpeg.get_ffmpeg_exe(),
        *("-y", "-hide_banner", "-loglevel", "error", "-nostdin"),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:g}"),
        *("-i", "pipe:0"),
    ]


def _output(suffix: str, fps: float) -> list[str]:
    if suffix == ".mp4":
        return [
            *("-c:v", "libx264", "-preset", PRESET, "-crf", str(QUALITY), "-pix_fmt", "yuv420p"),
            *("-movflags", "+faststart", "-an"),
        ]
    # One palette for the whole film, and no dither pattern that changes where nothing moves.
    palette = (
        f"fps={min(fps, GIF_FPS):g},split[a][b];[a]palettegen=max_colors=192:stats_mode=full[p];"
        "[b][p]paletteuse=dither=bayer:bayer_scale=4:diff_mode=rectangle"
    )
    return ["-filter_complex", palette, "-loop", "0"]
