"""Encode: frames into an mp4 or gif file, through the ffmpeg that imageio-ffmpeg carries."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path
from typing import IO, Self

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, TwinError
from twin.extras import require

Pixels = NDArray[np.uint8]

VIDEO_FORMATS = (".mp4", ".gif")
STILL_FORMATS = (".png",)
QUALITY = 20
"""x264's constant rate factor: 18 looks lossless, 23 is its default"""
PRESET = "veryfast"
"""x264's: half the time of `fast` for a tenth more bytes"""
GIF_FPS = 20.0
"""Most frames per second of a gif: its clock counts hundredths and browsers slow down below 3"""


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
            if kind is not None and not self._process.stdin.closed:
                _close_quietly(self._process.stdin)
            self._log.close()

    def _last_words(self) -> str:
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"ffmpeg ended with code {self._process.returncode}"


def _close_quietly(pipe: IO[bytes]) -> None:
    """Close a pipe whose reader was killed: what was buffered has nowhere to go."""
    try:
        pipe.close()
    except BrokenPipeError:
        return


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
