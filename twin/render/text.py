"""Text: words drawn once by Pillow, then blended into frames as often as they appear.

The font is DejaVu Sans, which comes with matplotlib, so that pictures do not depend on what a
machine has installed.
"""

from __future__ import annotations

import functools
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Pixels = NDArray[np.uint8]
Colour = tuple[int, int, int]

_FILES = {False: "DejaVuSans.ttf", True: "DejaVuSans-Bold.ttf"}
CACHE = 4096
"""Words kept; a long video has as many different numbers"""


@functools.lru_cache(maxsize=64)
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The font at `size` [pixel]."""
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / _FILES[bold]
    return ImageFont.truetype(str(path), size)


@functools.lru_cache(maxsize=CACHE)
def mask(text: str, size: int, bold: bool = False) -> Pixels:
    """Coverage of the text, 0 to 255, shape (line height, width): words align by their top."""
    face = font(size, bold)
    ascent, descent = face.getmetrics()
    width = max(1, int(np.ceil(face.getlength(text))))
    image = Image.new("L", (width, ascent + descent), 0)
    ImageDraw.Draw(image).text((0, 0), text, fill=255, font=face)
    return np.asarray(image)


def width(text: str, size: int, bold: bool = False) -> int:
    """[pixel]"""
    return int(mask(text, size, bold).shape[1])


def write(
    frame: Pixels,
    text: str,
    x: float,
    y: float,
    size: int,
    colour: Colour,
    *,
    bold: bool = False,
    anchor: str = "lt",
    halo: Colour | None = None,
) -> None:
    """Write into a frame (height, width, 3) in place; what lies outside is cut off.

    Args:
      x, y: [pixel] of the anchor.
      anchor: l, m or r for the horizontal, t, m or b for the vertical.
      halo: colour of a one-pixel rim that keeps text readable on any ground.
    """
    word = mask(text, size, bold)
    h, w = word.shape
    left = round(x - {"l": 0.0, "m": w / 2, "r": w}[anchor[0]])
    top = round(y - {"t": 0.0, "m": h / 2, "b": h}[anchor[1]])
    if halo is not None:
        for dx, dy in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            _stamp(frame, word, left + dx, top + dy, halo)
    _stamp(frame, word, left, top, colour)


def _stamp(frame: Pixels, word: Pixels, left: int, top: int, colour: Colour) -> None:
    height, width_ = frame.shape[:2]
    h, w = word.shape
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + w, width_), min(top + h, height)
    if x0 >= x1 or y0 >= y1:
        return
    cover = word[y0 - top : y1 - top, x0 - left : x1 - left, None].astype(np.uint16)
    ground = frame[y0:y1, x0:x1]
    blend = ground * (255 - cover) + np.array(colour, np.uint16) * cover
    frame[y0:y1, x0:x1] = ((blend + 127) // 255).astype(np.uint8)
