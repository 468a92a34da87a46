"""HUD: what is drawn over every frame. The strip of readouts, labels, legend and depth curve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.show.render import canvas as palette
from twin.show.render import lettering, tags
from twin.show.render.camera import View
from twin.show.render.canvas import NAME, SMALLEST_FONT, VALUE, Canvas, box, dot, tiles
from twin.show.render.panel import draw_panel
from twin.show.render.playback import Poses
from twin.show.render.readout import readouts
from twin.show.render.stage import Stage

Pixels = NDArray[np.uint8]

CURSOR = (255, 150, 60)


class Hud:
    """Draws over frames of one shot; what does not change is drawn once."""

    def __init__(self, stage: Stage, poses: Poses, canvas: Canvas, notes: Sequence[str]):
        """`notes` are lines for the upper left corner, the first of them bold."""
        self._stage, self._poses, self._canvas = stage, poses, canvas
        self._seen: tuple[View | None, list[tags.Mark]] = (None, [])
        self._columns, self._value_size = self._arrange()
        self._panel = tiles(draw_panel(canvas, stage, notes, self._columns, readouts(poses, 0)))

    def draw(self, frame: Pixels, index: int, view: View) -> None:
        """Draw over frame `index` (height, width, 3), in place."""
        canvas = self._canvas
        tags.draw_marks(frame, canvas, self._marks(index, view))
        if view.parallel:
            _, bar = tags.scale_bar(canvas, self._stage.layout, view)
            box(frame, bar, palette.WHITE, palette.INK)
        tags.draw_compass(frame, canvas, view)
        for add, keep, left, top in self._panel:
            lettering.blend(frame, add, keep, left, top)
        y = canvas.value_top
        for readout, x in zip(readouts(self._poses, index), self._columns, strict=False):
            lettering.write(frame, readout.value, x, y, self._value_size, palette.WHITE, bold=True)
        self._draw_cursor(frame, index)

    def _marks(self, index: int, view: View) -> list[tags.Mark]:
        """Labels of the scene; worked out again only when the camera has moved."""
        stage = self._stage
        if stage.chase:
            return tags.ladder_marks(self._canvas, stage.ladder(self._poses, index), view)
        if view is not self._seen[0]:
            draw = tags.map_marks if view.parallel else tags.block_marks
            self._seen = (view, draw(self._canvas, stage.layout, view))
        return self._seen[1]

    def _draw_cursor(self, frame: Pixels, index: int) -> None:
        """Where on the depth curve the glider is."""
        canvas = self._canvas
        x0, y0, x1, y1 = canvas.curve
        first, last = self._stage.lines[0].ribbon.span
        along = (float(self._poses.time[index]) - first) / (last - first)
        down = float(self._poses.position[index, 2]) / self._stage.layout.high[2]
        x, y = x0 + along * (x1 - x0), y0 + min(max(down, 0.0), 1.0) * (y1 - y0)
        dot(frame, x, y, 4.5 * canvas.unit + 1.0, palette.WHITE)
        dot(frame, x, y, 3.0 * canvas.unit + 0.5, CURSOR)

    def _arrange(self) -> tuple[list[float], int]:
        """Left edges of the readouts that fit, and the largest font size at which they do."""
        canvas = self._canvas
        left, right = canvas.px(24), canvas.curve[0] - canvas.px(36)
        items = readouts(self._poses, 0)
        size = canvas.font_size(VALUE)
        while True:
            names = [lettering.width(item.name, canvas.font_size(NAME)) for item in items]
            values = [lettering.width(item.widest, size, True) for item in items]
            widths = np.maximum(names, values)
            gap = (right - left - int(widths.sum())) / (len(items) - 1)
            if gap >= 0.6 * size or len(items) == 2:
                break
            if size > SMALLEST_FONT:
                size -= 1
            else:
                items.pop()  # a small picture shows the first ones, and these readably
        starts = left + np.concatenate([[0.0], np.cumsum(widths[:-1])])
        return [float(start + i * gap) for i, start in enumerate(starts)], size
