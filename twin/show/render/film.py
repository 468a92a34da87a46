"""Film: stills and videos of a shot, painted by one process or several, encoded by ffmpeg.

Frames do not depend on the process that paints them, and are encoded in order. So a video is
identical for any number of workers. The program ffmpeg comes with imageio-ffmpeg.
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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, TwinError
from twin.extras import require
from twin.numbers import Array, processors
from twin.records.storage.whole import check_file_target, whole_file
from twin.records.trajectory import Trajectory
from twin.show.render import playback
from twin.show.render.painter import Painter
from twin.show.render.subject import Shot, Subject

Pixels = NDArray[np.uint8]

VIDEO_FORMATS, STILL_FORMATS = (".mp4", ".gif"), (".png",)
AHEAD = 3  # most frames for each worker that wait for the encoder
GAP = "measured_gap"  # flag of interpolated samples in a gap of a log
QUALITY = 20  # x264's constant rate factor: 18 looks lossless, 23 is its default
PRESET = "veryfast"  # x264's preset: half the time of `fast` for a tenth more bytes
GIF_FPS = 20.0  # largest frame rate of a gif: browsers slow frames down that last under 0.03 s


def still(subject: Subject, shot: Shot, at: float | None = None) -> Pixels:
    """Paint one picture, (height, width, 3), at mission time `at` [s]; None takes the last time in
    the shown part at which the vehicle's position is known, outside gaps of a log.
    """
    times = shot.still_time(subject.trajectory.time, at, known_samples(subject.trajectory))
    with Painter(subject, shot, times) as painter:
        return painter.paint(0)


def known_samples(trajectory: Trajectory) -> NDArray[np.bool_]:
    """Mask of the samples whose position is known and outside gaps, (time,)."""
    known = np.isfinite([trajectory[f"true_{name}"] for name in playback.POSITION]).all(axis=0)
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
      workers: number of processes that paint; 1 paints in this process.
      progress: function that is called after each frame.

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
    painted = _frames(subject, shot, times, min(workers, len(times)))
    with whole_file(path) as place, encoder(place, shot) as write:
        for frame in painted:
            write(frame)
            if progress is not None:
                progress()
    return len(times)


def default_workers() -> int:
    """Default number of workers: one for each usable core, faster than Mesa's own threads."""
    return processors()


def _frames(subject: Subject, shot: Shot, times: Array, workers: int) -> Iterator[Pixels]:
    """Iterate over the frames in order; OpenGL needs workers that are spawned, not forked."""
    if workers == 1:
        with Painter(subject, shot, times) as painter:
            yield from map(painter.paint, range(painter.frames))
        return
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


def _begin(*shown: Any) -> None:
    """Initialise a worker: it ignores interrupts, which its parent handles, and ends with it."""
    global _painter
    _painter = functools.cache(lambda: Painter(*shown))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["LP_NUM_THREADS"] = "1"  # one core for each worker: Mesa must not take all cores
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


_painter: Callable[[], Painter]
"""Function that makes this worker's painter once"""


def _paint(index: int) -> Pixels:
    return _painter().paint(index)


class EncodeError(TwinError):
    """Failure of ffmpeg to write the video; the message has ffmpeg's last line."""


@contextlib.contextmanager
def encoder(path: Path, shot: Shot) -> Iterator[Callable[[Pixels], None]]:
    """Context with a function that adds frames (height, width, 3) to a video, complete at exit.

    Raises:
      InputError: the format cannot have this size, or imageio-ffmpeg is missing.
      EncodeError: ffmpeg failed.
    """
    suffix = path.suffix.lower()
    if suffix == ".mp4" and (shot.width % 2 or shot.height % 2):
        raise InputError(f"mp4 needs an even width and height, not {shot.width}x{shot.height}")
    require("imageio_ffmpeg", extra="video", purpose="writing a video")
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            _command(shot, suffix, path),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=log,
        )
        pipe = process.stdin
        assert pipe is not None

        def failed() -> EncodeError:
            process.wait()
            log.seek(0)
            lines = log.read().decode(errors="replace").strip().splitlines()
            last = lines[-1] if lines else f"ffmpeg ended with code {process.returncode}"
            return EncodeError(f"cannot write {path.name}: {last}")

        def write(frame: Pixels) -> None:
            try:
                pipe.write(frame.data)
            except OSError as error:
                raise failed() from error

        try:
            yield write
            pipe.close()
            if process.wait() != 0:
                raise failed()
        except BaseException:
            process.kill()
            raise
        finally:
            process.wait()
            with contextlib.suppress(BrokenPipeError):  # buffered bytes have nowhere to go
                pipe.close()


def _command(shot: Shot, suffix: str, path: Path) -> list[str]:
    import imageio_ffmpeg

    size, fps = f"{shot.width}x{shot.height}", f"{shot.fps:g}"
    # Use one palette for the whole film, and a dither pattern that is steady where nothing moves.
    palette = (
        f"fps={min(shot.fps, GIF_FPS):g},split[a][b];[a]palettegen=max_colors=192:stats_mode=full"
        "[p];[b][p]paletteuse=dither=bayer:bayer_scale=4:diff_mode=rectangle"
    )
    h264 = f"-c:v libx264 -preset {PRESET} -crf {QUALITY} -pix_fmt yuv420p -movflags +faststart -an"
    out = h264.split() if suffix == ".mp4" else ["-filter_complex", palette, "-loop", "0"]
    source = f"-f rawvideo -pix_fmt rgb24 -s {size} -r {fps} -i pipe:0"
    words = ["-y", "-hide_banner", "-loglevel", "error", "-nostdin", *source.split(), *out]
    return [imageio_ffmpeg.get_ffmpeg_exe(), *words, str(path)]
