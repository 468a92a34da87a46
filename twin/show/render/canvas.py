"""Canvas: sizes, text and small shapes drawn over a picture, and the scene's colours.

Colours of the scene are RGB in 0 to 1. Pillow draws each letter once; words are then blended into
frames. The font is DejaVu Sans, which comes with matplotlib, so that pictures do not depend on a
machine's fonts.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from twin.show.render import subject
from twin.show.render.camera import Array, Frame

Pixels = NDArray[np.uint8]
Wide = NDArray[np.uint16]
Colour = tuple[int, int, int]

BASE_WIDTH, BASE_HEIGHT = 1280, 720
"""[pixel] Size of the base picture, for which lengths are given; they scale with the picture"""
STRIP = 85  # height of the strip of readouts [pixel of the base picture]
FREE = {"bottom": 42, "top": 72, "left": 0.075, "right": 0.245}
"""Margins that framing keeps free: bottom (distances, above the strip) and top (title) in pixels of
the base picture; left (depths) and right (close-up and legend) as fractions of its width"""
INSET_WIDTH, INSET_ASPECT = 0.217, 1.43
"""Close-up. INSET_WIDTH: as a fraction of the picture's width. INSET_ASPECT: width over height"""
CURVE_SHARE = 0.22  # width of the depth curve as a fraction of the picture's
NAME_TOP, VALUE_TOP, NOTES_TOP, COMPASS_TOP = 15, 34, 14, 82
"""[pixel of the base picture] NAME_TOP, VALUE_TOP: readouts below the strip's top. NOTES_TOP,
COMPASS_TOP: below the picture's top"""
TITLE, VALUE, NAME, LABEL, LEGEND = 19, 25, 16, 17, 16
"""Font sizes [pixel of a BASE_WIDTH x BASE_HEIGHT picture]"""
SMALLEST_FONT = 8  # [pixel] smallest legible font size
TRACK_MAP, TRACK_FROM, TRACK_TO = "plasma", 0.30, 0.97
LIGHT_DEPTH = 120.0
"""[m] Depth over which daylight fades by e: our choice, so that a dive to 500 m stays visible"""
SURFACE_LIGHT = np.array([0.16, 0.62, 0.74])
DEEP_LIGHT = np.array([0.016, 0.085, 0.19])
HORIZON, ZENITH = np.array([0.74, 0.88, 0.95]), np.array([0.30, 0.56, 0.84])
"""Colours of the sky, for a chase camera above the water"""
BACKDROP_TOP, BACKDROP_BOTTOM = np.array([0.055, 0.115, 0.19]), np.array([0.012, 0.028, 0.055])
SAND = np.array([0.56, 0.51, 0.40])
FUTURE = np.array([0.80, 0.86, 0.92])  # the part of the track that is not flown yet
CURRENT = np.array([0.93, 0.98, 1.0])
GLASS = np.array([0.55, 0.88, 1.0])
OTHER_TRACKS = tuple(np.array([
    (0.15, 0.90, 0.50), (1.00, 0.58, 0.78), (0.50, 0.92, 1.00), (0.74, 0.68, 1.00),
    (0.74, 1.00, 0.30), (0.62, 0.68, 0.75), (1.00, 1.00, 1.00),
]))  # fmt: skip
"""Colours of dead-reckoned tracks, in order, repeated after the last. All are light, since the
water is blue and dark and the true track has warm hues. White, the colour of the current's arrows,
comes last."""
WHITE, DIM, INK = (255, 255, 255), (158, 188, 208), (6, 16, 28)
"""Colours from 0 to 255. WHITE: text. DIM: labels. INK: background of the strip"""
_FILES = {False: "DejaVuSans.ttf", True: "DejaVuSans-Bold.ttf"}
CACHE = 4096  # most cached words and letters; a long video has as many different numbers
HALO_SHARE = 14  # font size / width of its halo
OVERHANG = 2  # [pixel] by which a letter may extend beyond its width


@dataclasses.dataclass(frozen=True, kw_only=True)
class Canvas:
    """Size of a picture, and positions and lengths that depend on the size."""

    width: int  # [pixel]
    height: int  # [pixel]

    @property
    def unit(self) -> float:
        """Pixels of this picture per pixel of the base picture."""
        return min(self.width / BASE_WIDTH, self.height / BASE_HEIGHT)

    @property
    def strip_top(self) -> int:
        """First row of the strip."""
        # A small picture's letters stop shrinking at SMALLEST_FONT: the strip must hold them.
        letters = NAME_TOP * self.unit + 1.25 * (self.font_size(NAME) + self.font_size(VALUE))
        return self.height - max(self.px(STRIP), round(letters))

    @property
    def value_top(self) -> int:
        """First row of the strip's values."""
        below = self.px(NAME_TOP) + round(1.2 * self.font_size(NAME))
        return self.strip_top + max(self.px(VALUE_TOP), below)

    @property
    def compass_top(self) -> int:
        """First row of the compass, under two lines of notes."""
        notes = 1.4 * (self.font_size(TITLE) + self.font_size(LEGEND)) + self.px(NOTES_TOP + 14)
        return max(self.px(COMPASS_TOP), round(notes))

    @property
    def inset(self) -> tuple[int, int, int, int]:
        """Left, top, width, height of the glider's close-up, upper right."""
        wide = round(INSET_WIDTH * self.width)
        high = min(round(wide / INSET_ASPECT), self.height // 2)
        return self.width - self.px(20) - wide, self.px(25), wide, high

    @property
    def frame(self) -> Frame:
        """Margins that framing keeps free for the strip, title, labels and close-up."""
        free_below = FREE["bottom"] * self.unit / self.height
        return Frame(
            aspect=self.width / self.height,
            bottom=min((self.height - self.strip_top) / self.height + free_below, 0.4),
            top=min(FREE["top"] * self.unit / self.height, 0.3),
            left=FREE["left"],
            right=FREE["right"],
        )

    @property
    def curve(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom of the depth curve."""
        right = self.width - self.px(20)
        left = right - round(CURVE_SHARE * self.width)
        return left, self.strip_top + self.px(20), right, self.height - self.px(14)

    def px(self, size: float) -> int:
        """Convert a length of the base picture to this picture's pixels, at least 1."""
        return max(1, round(size * self.unit))

    def font_size(self, size: float) -> int:
        """Convert a font size of the base picture to this picture's pixels."""
        return max(SMALLEST_FONT, round(size * self.unit))


def frame_of(shot: subject.Shot) -> Frame:
    """Margins that framing keeps free in a shot's pictures."""
    if shot.hud:
        return Canvas(width=shot.width, height=shot.height).frame
    return Frame(aspect=shot.width / shot.height)


def dot(frame: Pixels, x: float, y: float, radius: float, colour: Colour) -> None:
    """Draw a smooth disc into a frame, in place, clipped to the frame."""
    height, width = frame.shape[:2]
    x0, x1 = max(int(x - radius - 1), 0), min(int(x + radius + 2), width)
    y0, y1 = max(int(y - radius - 1), 0), min(int(y + radius + 2), height)
    if x0 >= x1 or y0 >= y1:
        return
    ys, xs = np.ogrid[y0:y1, x0:x1]
    cover = np.clip(radius + 0.5 - np.hypot(xs - x, ys - y), 0.0, 1.0)[..., None]
    part = frame[y0:y1, x0:x1]
    frame[y0:y1, x0:x1] = (part * (1 - cover) + np.array(colour) * cover).astype(np.uint8)


def border(frame: Pixels, place: tuple[int, int, int, int], colour: Colour) -> None:
    """Draw a thin border just inside a box (left, top, width, height), in place."""
    left, top, wide, high = place
    part, thick = frame[top : top + high, left : left + wide], max(1, round(frame.shape[0] / 480))
    for edge in (part[:thick], part[-thick:], part[:, :thick], part[:, -thick:]):
        edge[:] = colour


def box(frame: Pixels, place: tuple[int, int, int, int], colour: Colour, rim: Colour) -> None:
    """Fill a box (left, top, width, height) with a rim of one pixel, in place."""
    left, top, wide, high = place
    frame[top - 1 : top + high + 1, left - 1 : left + wide + 1] = rim
    frame[top : top + high, left : left + wide] = colour


def layer(picture: Pixels) -> tuple[Wide, Wide]:
    """Layer of an RGBA picture: colours to add, and fraction (..., 1) to keep, both times 255."""
    alpha = picture[..., 3:].astype(np.uint16)
    return picture[..., :3] * alpha, 255 - alpha


WATER = np.array(
    [
        [0.00, 0.62, 0.90, 0.93],
        [0.08, 0.36, 0.78, 0.87],
        [0.30, 0.12, 0.55, 0.75],
        [0.65, 0.05, 0.28, 0.52],
        [1.00, 0.03, 0.13, 0.32],
    ]
)
"""Rows of relative depth in the shown water, 0 to 1, and colour, RGB"""


def track_colours(values: Array, low: float, high: float) -> Array:
    """Colours of values (n,) between `low` and `high`; NaN is grey. Shape (n, 3)."""
    span = high - low if high > low else 1.0
    relative = np.clip((np.nan_to_num(values, nan=low) - low) / span, 0.0, 1.0)
    colour_map = matplotlib.colormaps[TRACK_MAP]
    colours = colour_map(TRACK_FROM + (TRACK_TO - TRACK_FROM) * relative)[:, :3]
    return np.where(np.isnan(values)[:, None], 0.6, colours)


def water_colour(relative_depth: Array | float) -> Array:
    """Colour of the water at a relative depth 0 to 1. Shape (..., 3)."""
    depth = np.clip(relative_depth, 0.0, 1.0)
    return np.stack([np.interp(depth, WATER[:, 0], WATER[:, i]) for i in (1, 2, 3)], axis=-1)


@functools.lru_cache(maxsize=64)
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Font of `size` [pixel]."""
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / _FILES[bold]
    return ImageFont.truetype(str(path), size)


def text_width(text: str, size: int, bold: bool = False) -> int:
    """[pixel] Width of a text."""
    return max(1, math.ceil(sum(_advance(letter, size, bold) for letter in text)))


@functools.lru_cache(maxsize=CACHE)
def word(
    text: str, size: int, colour: Colour, bold: bool = False, halo: Colour | None = None
) -> tuple[Wide, Wide]:
    """Layer of a word, in the form of `layer`.

    The layer's height is the font's line height, so that words of one size align by their top. A
    halo is a rim that keeps text readable on any background; it widens all sides equally.
    """
    rim = max(1, round(size / HALO_SHARE)) if halo is not None else 0
    cover = _compose(text, size, bold, rim, 0)
    if halo is None:
        return cover * np.array(colour, np.uint16), 255 - cover
    ground = np.maximum(_compose(text, size, bold, rim, rim), cover)
    add = cover * np.array(colour, np.uint16) + (ground - cover) * np.array(halo, np.uint16)
    return add, 255 - ground


def _compose(text: str, size: int, bold: bool, margin: int, stroke: int) -> Wide:
    """Coverage of a word, (height, width, 1), from cached letters.

    Readouts change with every frame. Drawing ten letters anew would cost more than the rest of the
    display.
    """
    letters = [_letter(letter, size, bold, margin, stroke) for letter in text]
    height = letters[0].shape[0] if letters else 1
    cover = np.zeros((height, text_width(text, size, bold) + 2 * (margin + OVERHANG)), np.uint16)
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
    """Write text into a frame (height, width, 3), in place, clipped to the frame.

    Args:
      x, y: [pixel] position of the anchor.
      anchor: l, m or r for the horizontal, then t, m or b for the vertical.
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
    """Blend a layer into a frame at (left, top), in place: frame = (frame * keep + add) / 255."""
    height, width = frame.shape[:2]
    h, w = add.shape[:2]
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + w, width), min(top + h, height)
    if x0 < x1 and y0 < y1:
        part = (slice(y0 - top, y1 - top), slice(x0 - left, x1 - left))
        frame[y0:y1, x0:x1] = mixed(frame[y0:y1, x0:x1], add[part], keep[part])


def mixed(ground: Pixels, add: Wide, keep: Wide) -> Wide:
    """Compute (ground * keep + add) / 255, rounded to the nearest integer, (height, width, 3)."""
    total = ground * keep
    total += add
    # Dividing by 255 exactly, without a division: (m + 128 + ((m + 128) >> 8)) >> 8.
    total += 128
    total += total >> 8
    total >>= 8
    return total
