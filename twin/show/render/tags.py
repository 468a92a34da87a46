"""Labels: texts at points of the scene. Depths, distances, the map's grid, and the way north."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from twin.show.render import canvas as palette
from twin.show.render import sea
from twin.show.render.camera import View
from twin.show.render.canvas import LABEL, Canvas
from twin.show.render.scene_geometry import SceneLayout, nice_step, ticks

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

KILO = 1000.0
MINUS = "−"
COMPASS = 48
"""Size of the compass [pixel of the base picture]"""
SCALE_BAR = 56
"""From the close-up down to the map's scale bar [pixel of the base picture]"""
OVERSAMPLING = 4
"""The compass is drawn larger and shrunk, for smooth edges."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mark:
    """A text at a place in the picture."""

    text: str
    x: float
    """[pixel] from the left; NaN behind the camera"""
    y: float
    """[pixel] from the top"""
    anchor: str
    """As `palette.write` takes it"""


def block_marks(canvas: Canvas, layout: SceneLayout, view: View) -> list[Mark]:
    """Depths along the block's left edge, distances along its lower front edge."""
    corners = layout.corners()
    left = int(np.argmin(view.project(corners[:4])[:, 0]))
    top, foot = corners[left], corners[left + 4]
    depths = sea.depth_ticks(layout)
    points = top + (depths / layout.high[2])[:, None] * (foot - top)
    gap = (-canvas.px(8), 0)
    found = _marks(canvas, view, points, [f"{depth:g} m" for depth in depths], "rm", gap)
    sides = [float(layout.low[1]), float(layout.high[1])]
    ends = [[x, y, layout.high[2]] for y in sides for x in (layout.low[0], layout.high[0])]
    far = view.project(layout.display_block(np.array(ends)))[:, 2].reshape(2, 2).sum(axis=1)
    front = sides[int(np.argmin(far))]
    distances = ticks(0.0, float(layout.size[0]), about=5)
    points = np.column_stack(
        [layout.low[0] + distances, np.full((len(distances), 2), [front, layout.high[2]])]
    )
    names = _names(distances)
    return found + _marks(
        canvas, view, layout.display_block(points), names, "mt", (0, canvas.px(4))
    )


def map_marks(canvas: Canvas, layout: SceneLayout, view: View) -> list[Mark]:
    """North and east of the start along the chart's grid, and the length of the scale bar."""
    step, found = sea.grid_step(layout), []
    for axis, (forward, back) in enumerate((("N", "S"), ("E", "W"))):
        values = sea.grid_values(layout, axis, step)
        points = np.tile([layout.low[0], layout.low[1], 0.0], (len(values), 1))
        points[:, axis] = values
        anchor, gap = ("rm", (-canvas.px(7), 0)) if axis == 0 else ("mt", (0, canvas.px(4)))
        letters = [forward if value >= 0.0 else back for value in values]
        names = [
            f"{name} {letter}"
            for name, letter in zip(_names(np.abs(values), every=True), letters, strict=True)
        ]
        found += _marks(canvas, view, layout.display_block(points), names, anchor, gap)
    length, (left, top, wide, _) = scale_bar(canvas, layout, view)
    name = _names(np.array([length]))[0]
    middle = left + wide / 2
    return [*found, Mark(text=name, x=middle, y=top - canvas.px(3), anchor="mb")]


def scale_bar(
    canvas: Canvas, layout: SceneLayout, view: View
) -> tuple[float, tuple[int, int, int, int]]:
    """A round length [m] and its bar in the map, under the close-up: left, top, width, height
    [pixel]."""
    metres_per_pixel = 2 * view.frustum()[0] / canvas.width / layout.scale
    length = nice_step(0.14 * canvas.width * metres_per_pixel)
    left, inset_top, _, inset_height = canvas.inset
    top = inset_top + inset_height + canvas.px(SCALE_BAR)
    return length, (left, top, round(length / metres_per_pixel), canvas.px(4))


def ladder_marks(
    canvas: Canvas, ladder: list[tuple[float, Array, Array]], view: View
) -> list[Mark]:
    """Depths beside the arrows of the chase camera."""
    if not ladder:
        return []
    names = [f"{depth:g} m" for depth, _, _ in ladder]
    # Left of whichever end lies further left, so that no arrow points through its label.
    ends = np.array([[start, start + vector] for _, start, vector in ladder])
    left = np.argmin(view.project(ends.reshape(-1, 3))[:, 0].reshape(-1, 2), axis=1)
    points = ends[np.arange(len(ladder)), left]
    marks = _marks(canvas, view, points, names, "rm", (-canvas.px(18), 0))
    return [mark for mark in marks if 0 < mark.y < canvas.strip_top]


def draw_marks(frame: Pixels, canvas: Canvas, marks: list[Mark]) -> None:
    """Write marks into a frame."""
    size = canvas.font_size(LABEL)
    for mark in marks:
        palette.write(
            frame, mark.text, mark.x, mark.y, size, palette.WHITE, anchor=mark.anchor,
            halo=palette.INK,
        )  # fmt: skip


def draw_compass(frame: Pixels, canvas: Canvas, view: View) -> None:
    """An arrow to north; up is the way the camera looks.

    It stands upper left under the title; in the map, whose labels are there, at the close-up's
    right edge beside the scale bar.
    """
    north = np.array([1.0, 0.0, 0.0])
    ahead = view.up if view.parallel else view.forward
    angle = math.atan2(float(north @ view.right), float(north @ ahead))
    size, left, top = canvas.px(COMPASS), canvas.px(22), canvas.compass_top
    if view.parallel:
        inset_left, inset_top, wide, high = canvas.inset
        left = inset_left + wide - size
        top = inset_top + high + canvas.px(SCALE_BAR) - round(0.6 * size)
    add, keep = _compass(size, round(math.degrees(angle)))
    palette.blend(frame, add, keep, left, top)
    palette.write(
        frame,
        "N",
        left + size / 2 + 0.64 * size * math.sin(angle),
        top + size / 2 - 0.64 * size * math.cos(angle),
        canvas.font_size(13),
        palette.WHITE,
        bold=True,
        anchor="mm",
        halo=palette.INK,
    )


@functools.lru_cache(maxsize=360)
def _compass(size: int, angle: int) -> tuple[palette.Wide, palette.Wide]:
    """What the compass adds and keeps, north at `angle` [degree] clockwise from up."""
    large = Image.new("RGBA", (OVERSAMPLING * size, OVERSAMPLING * size), (190, 214, 228, 0))
    draw = ImageDraw.Draw(large)
    middle, reach = OVERSAMPLING * size / 2, 0.39 * OVERSAMPLING * size
    rim = (0.03 * OVERSAMPLING * size, 0.97 * OVERSAMPLING * size)
    draw.ellipse(
        (rim[0], rim[0], rim[1], rim[1]), outline=(190, 214, 228), width=max(2, size // 12)
    )
    turn = math.radians(angle)
    tip = reach * np.array([math.sin(turn), -math.cos(turn)])
    across = 0.3 * np.array([-tip[1], tip[0]])
    for point, colour in ((tip, (255, 110, 70)), (-tip, (225, 235, 240))):
        draw.polygon([tuple(middle + corner) for corner in (point, across, -across)], fill=colour)
    small = np.asarray(large.resize((size, size), Image.Resampling.BOX)).astype(np.uint16)
    alpha = small[..., 3:]
    return small[..., :3] * alpha, np.repeat(255 - alpha, 3, axis=-1)


def _marks(
    canvas: Canvas, view: View, points: Array, names: list[str], anchor: str, gap: tuple[int, int]
) -> list[Mark]:
    """Marks at points (n, 3) in display units, moved by `gap` [pixel]."""
    places = view.project(points)[:, :2] * [canvas.width, canvas.height] + gap
    return [
        Mark(text=name, x=float(x), y=float(y), anchor=anchor)
        for name, (x, y) in zip(names, places, strict=True)
    ]


def _names(metres: Array, *, every: bool = False) -> list[str]:
    """Distances as text; the last one says the unit, or `every` one."""
    kilo = bool(np.abs(metres).max(initial=0.0) >= 2 * KILO)
    values = metres / KILO if kilo else metres
    names = [f"{value if value else 0.0:g}".replace("-", MINUS) for value in values]
    first = 0 if every else len(names) - 1
    unit = "km" if kilo else "m"
    return [f"{name} {unit}" if k >= first else name for k, name in enumerate(names)]
