"""Tags: labels at points of the scene (depths, distances, the map's grid), and the compass."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from twin.show.render import canvas as palette
from twin.show.render import sea
from twin.show.render.camera import Array, SceneLayout, View, nice_step, ticks
from twin.show.render.canvas import LABEL, Canvas, Pixels

KILO = 1000.0
MINUS = "−"
COMPASS = 48  # size of the compass [pixel of the base picture]
SCALE_BAR = 56  # distance from the close-up to the map's scale bar [pixel of the base picture]
OVERSAMPLING = 4  # the compass is drawn larger and shrunk, for smooth edges


class Mark(NamedTuple):
    """Label at a position in the picture."""

    text: str
    x: float  # [pixel] from the left; NaN behind the camera
    y: float  # [pixel] from the top
    anchor: str  # in the form of `palette.write`


def block_marks(canvas: Canvas, layout: SceneLayout, view: View) -> list[Mark]:
    """Labels of depths on the block's left edge, and of distances on its lower front edge."""
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
    points, gap = layout.display_block(points), (0, canvas.px(4))
    return found + _marks(canvas, view, points, _names(distances), "mt", gap)


def map_marks(canvas: Canvas, layout: SceneLayout, view: View) -> list[Mark]:
    """Labels of north and east along the chart's grid, and of the scale bar's length."""
    found: list[Mark] = []
    for axis, (forward, back) in enumerate((("N", "S"), ("E", "W"))):
        values = sea.grid_values(layout, axis)
        points = np.tile([layout.low[0], layout.low[1], 0.0], (len(values), 1))
        points[:, axis] = values
        anchor, gap = ("rm", (-canvas.px(7), 0)) if axis == 0 else ("mt", (0, canvas.px(4)))
        names = [
            f"{name} {forward if value >= 0.0 else back}"
            for name, value in zip(_names(np.abs(values), every=True), values, strict=True)
        ]
        found += _marks(canvas, view, layout.display_block(points), names, anchor, gap)
    length, (left, top, wide, _) = scale_bar(canvas, layout, view)
    (name,) = _names(np.array([length]))
    return [*found, Mark(name, left + wide / 2, top - canvas.px(3), "mb")]


def scale_bar(
    canvas: Canvas, layout: SceneLayout, view: View
) -> tuple[float, tuple[int, int, int, int]]:
    """Round length [m] of the map's scale bar, and its box under the close-up: left, top, width,
    height [pixel]."""
    metres_per_pixel = 2 * view.frustum()[1] / canvas.width / layout.scale
    length = nice_step(0.14 * canvas.width * metres_per_pixel)
    left, inset_top, _, inset_height = canvas.inset
    top = inset_top + inset_height + canvas.px(SCALE_BAR)
    return length, (left, top, round(length / metres_per_pixel), canvas.px(4))


def ladder_marks(
    canvas: Canvas, ladder: list[tuple[float, Array, Array]], view: View
) -> list[Mark]:
    """Labels of depths beside the current's arrows of the chase camera."""
    if not ladder:
        return []
    names = [f"{depth:g} m" for depth, _, _ in ladder]
    # Place each label left of the arrow's leftmost end, so that no arrow crosses its label.
    ends = np.array([[start, start + vector] for _, start, vector in ladder])
    left = np.argmin(view.project(ends.reshape(-1, 3))[:, 0].reshape(-1, 2), axis=1)
    points = ends[np.arange(len(ladder)), left]
    marks = _marks(canvas, view, points, names, "rm", (-canvas.px(18), 0))
    return [mark for mark in marks if 0 < mark.y < canvas.strip_top]


def draw_marks(frame: Pixels, canvas: Canvas, marks: list[Mark]) -> None:
    """Write marks into a frame."""
    size = canvas.font_size(LABEL)
    for text, x, y, anchor in marks:
        palette.write(frame, text, x, y, size, palette.WHITE, anchor=anchor, halo=palette.INK)


def draw_compass(frame: Pixels, canvas: Canvas, view: View) -> None:
    """Draw an arrow to north; up is the camera's direction of view.

    The compass stands upper left under the title. In the map, which has labels there, it stands at
    the close-up's right edge beside the scale bar.
    """
    ahead = view.up if view.parallel else view.forward
    angle = math.atan2(float(view.right[0]), float(ahead[0]))
    size, left, top = canvas.px(COMPASS), canvas.px(22), canvas.compass_top
    if view.parallel:
        inset_left, inset_top, wide, high = canvas.inset
        left = inset_left + wide - size
        top = inset_top + high + canvas.px(SCALE_BAR) - round(0.6 * size)
    palette.blend(frame, *_compass(size, round(math.degrees(angle))), left, top)
    x = left + size / 2 + 0.64 * size * math.sin(angle)
    y = top + size / 2 - 0.64 * size * math.cos(angle)
    palette.write(
        frame, "N", x, y, canvas.font_size(13), palette.WHITE, bold=True, anchor="mm",
        halo=palette.INK,
    )  # fmt: skip


@functools.lru_cache(maxsize=360)
def _compass(size: int, angle: int) -> tuple[palette.Wide, palette.Wide]:
    """Layer of the compass, north at `angle` [degree] clockwise from up."""
    large = Image.new("RGBA", (OVERSAMPLING * size, OVERSAMPLING * size), (190, 214, 228, 0))
    draw = ImageDraw.Draw(large)
    middle, reach = OVERSAMPLING * size / 2, 0.39 * OVERSAMPLING * size
    rim = (0.03 * OVERSAMPLING * size, 0.97 * OVERSAMPLING * size)
    box = (rim[0], rim[0], rim[1], rim[1])
    draw.ellipse(box, outline=(190, 214, 228), width=max(2, size // 12))
    turn = math.radians(angle)
    tip = reach * np.array([math.sin(turn), -math.cos(turn)])
    across = 0.3 * np.array([-tip[1], tip[0]])
    for point, colour in ((tip, (255, 110, 70)), (-tip, (225, 235, 240))):
        draw.polygon([tuple(middle + corner) for corner in (point, across, -across)], fill=colour)
    return palette.layer(np.asarray(large.resize((size, size), Image.Resampling.BOX)))


def _marks(
    canvas: Canvas, view: View, points: Array, names: list[str], anchor: str, gap: tuple[int, int]
) -> list[Mark]:
    """Make labels at points (n, 3) in display units, shifted by `gap` [pixel]."""
    places = view.project(points)[:, :2] * [canvas.width, canvas.height] + gap
    return [Mark(name, x, y, anchor) for name, (x, y) in zip(names, places.tolist(), strict=True)]


def _names(metres: Array, *, every: bool = False) -> list[str]:
    """Texts of distances [m] in m or km; the last text has the unit, or `every` text."""
    kilo = bool(np.abs(metres).max(initial=0.0) >= 2 * KILO)
    values = metres / KILO if kilo else metres
    names = [f"{value if value else 0.0:g}".replace("-", MINUS) for value in values]
    first = 0 if every else len(names) - 1
    unit = "km" if kilo else "m"
    return [f"{name} {unit}" if k >= first else name for k, name in enumerate(names)]
