"""Text: words drawn once by Pillow, then blended into frames as often as they appear.

The font is DejaVu Sans, which comes with matplotlib, so that pictures do not depend on what a
machine has installed.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Pixels = NDArray[np.uint8]
Wide = NDArray[np.uint16]
Colour = tuple[int, int, int]

_FILES = {False: "DejaVuSans.ttf", True: "DejaVuSans-Bold.ttf"}
CACHE = 4096
"""Words kept; a long video has as many different numbers"""
HALO_SHARE = 14
"""Font size over the width of its halo"""
OVERHANG = 2
"""[pixel] by which a letter may reach over its width"""


@functools.lru_cache(maxsize=64)
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The font at `size` [pixel]."""
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / _FILES[bold]
    return ImageFont.truetype(str(path), size)


def width(text: str, size: int, bold: bool = False) -> int:
    """[pixel]"""
    return max(1, math.ceil(sum(_advance(letter, size, bold) for letter in text)))


@functools.lru_cache(maxsize=CACHE)
def word(
    text: str, size: int, colour: Colour, bold: bool = False, halo: Colour | None = None
) -> tuple[Wide, Wide]:
    """What a word adds to a frame and what it keeps of it, both (height, width, 3) of 255.

    Its box is the font's line height, so that words of one size align by their top; a halo, a rim
    that keeps text readable on any ground, makes it larger on each side alike.
    """
    rim = max(1, round(size / HALO_SHARE)) if halo is not None else 0
    cover = _compose(text, size, bold, rim, 0)
    if halo is None:
        return cover * np.array(colour, np.uint16), np.repeat(255 - cover, 3, axis=-1)
    ground = np.maximum(_compose(text, size, bold, rim, rim), cover)
    add = cover * np.array(colour, np.uint16) + (ground - cover) * np.array(halo, np.uint16)
    return add, np.repeat(255 - ground, 3, axis=-1)


def _compose(text: str, size: int, bold: bool, margin: int, stroke: int) -> Wide:
    """Coverage of a word, (height, width, 1), from letters that were drawn before.

    The readouts change with every frame, and drawing ten letters again costs more than the rest of
    the display.
    """
    letters = [_letter(letter, size, bold, margin, stroke) for letter in text]
    height = letters[0].shape[0] if letters else 1
    cover = np.zeros((height, width(text, size, bold) + 2 * (margin + OVERHANG)), np.uint16)
    pen = 0.0
    for letter, drawn in zip(text, letters, strict=True):
        left = round(pen)
        part = cover[:, left : left + drawn.shape[1]]
        np.maximum(part, drawn[:, : part.shape[1]], out=part)
        pen += _advance(letter, size, bold)
    return cover[:, OVERHANG : cover.shape[1] - OVERHANG, None]


@functools.lru_cache(maxsize=CACHE)
def _letter(letter: str, size: int, bold: bool, margin: int, stroke: int) -> Wide:
    face = font(size, bold)
    ascent, descent = face.getmetrics()
    wide = math.ceil(_advance(letter, size, bold)) + 2 * (margin + OVERHANG)
    image = Image.new("L", (wide, ascent + descent + 2 * margin), 0)
    place = (margin + OVERHANG, margin)
    ImageDraw.Draw(image).text(place, letter, fill=255, font=face, stroke_width=stroke)
    return np.asarray(image).astype(np.uint16)


@functools.lru_cache(maxsize=CACHE)
def _advance(letter: str, size: int, bold: bool) -> float:
    return float(font(size, bold).getlength(letter))


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
      halo: colour of the rim, or None.
    """
    if not (math.isfinite(x) and math.isfinite(y)):
        return  # behind the camera
    add, keep = word(text, size, colour, bold, halo)
    h, w = add.shape[:2]
    left = round(x - {"l": 0.0, "m": w / 2, "r": w}[anchor[0]])
    top = round(y - {"t": 0.0, "m": h / 2, "b": h}[anchor[1]])
    blend(frame, add, keep, left, top)


def blend(frame: Pixels, add: Wide, keep: Wide, left: int, top: int) -> None:
    """frame = (frame * keep + add) / 255 where the two lie over the frame, in place."""
    height, width_ = frame.shape[:2]
    h, w = add.shape[:2]
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + w, width_), min(top + h, height)
    if x0 >= x1 or y0 >= y1:
        return
    part = (slice(y0 - top, y1 - top), slice(x0 - left, x1 - left))
    mixed = frame[y0:y1, x0:x1] * keep[part]
    mixed += add[part]
    # Dividing by 255 exactly, without a division: (m + 128 + ((m + 128) >> 8)) >> 8.
    mixed += 128
    mixed += mixed >> 8
    mixed >>= 8
    frame[y0:y1, x0:x1] = mixed
