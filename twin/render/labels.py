"""Labels: texts at points of the scene. Depths, distances, the map's grid, and the way north."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from twin.render import palette, sea, text
from twin.render.camera import View
from twin.render.canvas import LABEL, Canvas
from twin.render.layout import Layout, nice_step, ticks
from twin.render.readout import MINUS

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

KILO = 1000.0
COMPASS, COMPASS_TOP = 48, 82
"""Size and top of the compass [pixel of the base picture]"""
OVERSAMPLING = 4
"""The compass is drawn larger and shrunk, for smooth edges."""


def draw_block(frame: Pixels, canvas: Canvas, layout: Layout, view: View) -> None:
    """Depths along the block's left edge, distances along its lower front edge."""
    corners = layout.corners()
    seen = view.project(corners)
    left = int(np.argmin(seen[:4, 0]))
    top, foot = corners[left], corners[left + 4]
    gap = canvas.px(8)
    for depth in sea.depth_ticks(layout):
        x, y, _ = view.project((top + depth / layout.high[2] * (foot - top))[None])[0]
        _write(frame, canvas, f"{depth:g} m", x * canvas.width - gap, y * canvas.height, "rm")
    sides = [float(layout.low[1]), float(layout.high[1])]
    ends = np.array(
        [[[x, y, layout.high[2]] for x in (layout.low[0], layout.high[0])] for y in sides]
    )
    far = view.project(layout.display_block(ends.reshape(-1, 3)))[:, 2].reshape(2, 2).sum(axis=1)
    front = sides[int(np.argmin(far))]
    distances = ticks(0.0, float(layout.size[0]), about=5)
    unit = _unit(float(distances[-1]))
    for distance in distances:
        point = np.array([[layout.low[0] + distance, front, layout.high[2]]])
        x, y, _ = view.project(layout.display_block(point))[0]
        name = _number(distance, unit) + (f" {unit}" if distance == distances[-1] else "")
        _write(frame, canvas, name, x * canvas.width, y * canvas.height + canvas.px(4), "mt")


def draw_map(frame: Pixels, canvas: Canvas, layout: Layout, view: View) -> None:
    """North and east of the start along the chart's grid, and a scale bar."""
    step = sea.grid_step(layout)
    for axis, letter in enumerate("NE"):
        values = sea.grid_values(layout, axis, step)
        unit = _unit(float(np.abs(values).max(initial=0.0)))
        for value in values:
            point = np.array([layout.low[0], layout.low[1], 0.0])
            point[axis] = value
            x, y, _ = view.project(layout.display_block(point)[None])[0]
            name = _number(value, unit) + (f" {unit} {letter}" if value == values[-1] else "")
            if axis == 0:
                _write(
                    frame, canvas, name, x * canvas.width - canvas.px(7), y * canvas.height, "rm"
                )
            else:
                below = y * canvas.height + canvas.px(4)
                _write(frame, canvas, name, x * canvas.width, below, "mt")
    metres_per_pixel = 2 * view.frustum()[0] / canvas.width / layout.scale
    length = nice_step(0.14 * canvas.width * metres_per_pixel)
    wide = round(length / metres_per_pixel)
    left, top, thick = canvas.px(26), canvas.strip_top - canvas.px(24), canvas.px(4)
    for colour, grow in ((palette.INK, 1), (palette.WHITE, 0)):
        frame[top - grow : top + thick + grow, left - grow : left + wide + grow] = colour
    unit = _unit(length)
    _write(
        frame, canvas, f"{_number(length, unit)} {unit}", left + wide / 2, top - canvas.px(3), "mb"
    )


def draw_ladder(
    frame: Pixels, canvas: Canvas, ladder: list[tuple[float, Array, Array]], view: View
) -> None:
    """Depths beside the arrows of the chase camera."""
    for depth, start, _ in ladder:
        x, y, along = view.project(start[None])[0]
        if along > 0 and 0 < x < 1 and 0 < y * canvas.height < canvas.strip_top:
            left = x * canvas.width - canvas.px(10)
            _write(frame, canvas, f"{depth:g} m", left, y * canvas.height, "rm")


def draw_compass(frame: Pixels, canvas: Canvas, view: View) -> None:
    """An arrow to north, upper left under the title; up is the way the camera looks."""
    north = np.array([1.0, 0.0, 0.0])
    ahead = view.up if view.parallel else view.forward
    direction = np.array([north @ view.right, -(north @ ahead)])
    x, y = direction / np.linalg.norm(direction)
    size = canvas.px(COMPASS)
    left, top = canvas.px(22), canvas.px(COMPASS_TOP)
    tile = np.ascontiguousarray(frame[top : top + size, left : left + size])
    if tile.shape != (size, size, 3):
        return  # a picture smaller than its compass
    large = Image.fromarray(tile).resize((OVERSAMPLING * size, OVERSAMPLING * size))
    draw = ImageDraw.Draw(large)
    middle, reach = OVERSAMPLING * size / 2, 0.39 * OVERSAMPLING * size
    rim = (0.03 * OVERSAMPLING * size, 0.97 * OVERSAMPLING * size)
    draw.ellipse(
        (rim[0], rim[0], rim[1], rim[1]), outline=(190, 214, 228), width=max(2, size // 12)
    )
    tip, across = reach * np.array([x, y]), 0.3 * reach * np.array([-y, x])
    for point, colour in ((tip, (255, 110, 70)), (-tip, (225, 235, 240))):
        corners = [tuple(middle + corner) for corner in (point, across, -across)]
        draw.polygon(corners, fill=colour)
    small = large.resize((size, size), Image.Resampling.BOX)
    frame[top : top + size, left : left + size] = np.asarray(small)
    centre = np.array([left + size / 2, top + size / 2]) + 0.64 * size * np.array([x, y])
    text.write(
        frame,
        "N",
        float(centre[0]),
        float(centre[1]),
        canvas.font_size(13),
        palette.WHITE,
        bold=True,
        anchor="mm",
        halo=palette.INK,
    )


def _write(frame: Pixels, canvas: Canvas, name: str, x: float, y: float, anchor: str) -> None:
    size = canvas.font_size(LABEL)
    text.write(frame, name, x, y, size, palette.WHITE, anchor=anchor, halo=palette.INK)


def _unit(largest: float) -> str:
    return "km" if largest >= 2 * KILO else "m"


def _number(metres: float, unit: str) -> str:
    value = metres / KILO if unit == "km" else metres
    return f"{value if value else 0.0:g}".replace("-", MINUS)
