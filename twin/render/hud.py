"""HUD: the strip of readouts, labels of the scene, legend and depth curve, drawn on frames."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from twin.render import palette, text
from twin.render.camera import View
from twin.render.layout import nice_step
from twin.render.replay import Poses
from twin.render.stage import Stage

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

STRIP = 0.118
"""Height of the strip over the picture's"""
STRIP_ALPHA = 0.62
CURVE_SHARE = 0.22
"""Width of the depth curve over the picture's"""
BASE_HEIGHT = 720
"""[pixel] at which sizes are given; they grow with the picture"""
TITLE, VALUE, NAME, LABEL = 17, 25, 12, 14
"""Font sizes [pixel at BASE_HEIGHT]"""
SMALLEST_FONT = 7
PANEL_ALPHA = 0.45


@dataclasses.dataclass(frozen=True, kw_only=True)
class Readout:
    """One figure of the strip."""

    name: str
    value: str
    widest: str
    """The longest value it can show: keeps the columns where they are"""


def readouts(poses: Poses, index: int) -> list[Readout]:
    """The strip's figures at one frame."""
    seconds = int(round(float(poses.time[index])))
    clock = f"{seconds // 3600:d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
    mass = float(poses.net_mass[index])
    shift, rotation = poses.battery[index]
    heading = round(float(poses.heading[index])) % 360
    return [
        Readout(name="TIME", value=clock, widest="00:00:00"),
        Readout(name="DEPTH", value=f"{_zero(poses.position[index, 2], 1)} m", widest="0000.0 m"),
        Readout(name="PITCH", value=f"{_signed(poses.pitch[index], 1)}°", widest="+00.0°"),
        Readout(name="HEADING", value=f"{heading:03d}°", widest="000°"),
        Readout(name="SPEED", value=_known(poses.speed[index], "{:.2f} m/s"), widest="0.00 m/s"),
        Readout(name="NET BUOYANCY", value=_buoyancy(mass), widest="▼ 0.00 kg"),
        Readout(
            name="BATTERY",
            value=f"{_signed(1000 * shift, 0)} mm  {_signed(np.rad2deg(rotation), 0)}°",
            widest="+00 mm  +00°",
        ),
    ]


def _zero(value: float, digits: int) -> str:
    """The number without the minus sign of a rounded zero."""
    return f"{value:.{digits}f}".replace("-", "−") if round(value, digits) else f"{0:.{digits}f}"


def _signed(value: float, digits: int) -> str:
    rounded = round(float(value), digits)
    return f"{rounded:+.{digits}f}".replace("-", "−") if rounded else f"{0:.{digits}f}"


def _known(value: float, form: str) -> str:
    return form.format(value) if np.isfinite(value) else "–"


def _buoyancy(mass: float) -> str:
    """Weight that is left in water: a triangle that points the way it pulls."""
    if not np.isfinite(mass):
        return "–"
    return f"{'▼' if mass >= 0 else '▲'} {abs(mass):.2f} kg"


class Hud:
    """Draws over frames of one shot; what does not change is drawn once."""

    def __init__(self, stage: Stage, poses: Poses, width: int, height: int, notes: list[str]):
        self.stage, self.poses = stage, poses
        self.width, self.height = width, height
        self.unit = height / BASE_HEIGHT
        self.notes = notes
        self.strip_top = height - round(STRIP * height)
        self.curve_box = self._curve_box()
        self.columns = self._columns()
        ground = self._ground()
        alpha = ground[..., 3:].astype(np.uint16)
        self.keep = 255 - alpha
        self.paint = ground[..., :3].astype(np.uint16) * alpha
        rows = np.flatnonzero(alpha.any(axis=(1, 2)))
        self.rows = _runs(rows)

    def px(self, size: float) -> int:
        """A length given at BASE_HEIGHT, in this picture's pixels."""
        return max(1, round(size * self.unit))

    def type_size(self, size: float) -> int:
        """A font size given at BASE_HEIGHT, in this picture's pixels."""
        return max(SMALLEST_FONT, round(size * self.unit))

    def draw(self, frame: Pixels, index: int, view: View) -> None:
        """Draw everything over a frame (height, width, 3), in place."""
        self._scene_labels(frame, index, view)
        for top, bottom in self.rows:
            part = frame[top:bottom]
            blend = part * self.keep[top:bottom] + self.paint[top:bottom]
            frame[top:bottom] = ((blend + 127) // 255).astype(np.uint8)
        self._strip(frame, index)
        self._compass(frame, view)

    # -- what changes --------------------------------------------------------------------------

    def _strip(self, frame: Pixels, index: int) -> None:
        y = self.strip_top + self.px(34)
        for readout, x in zip(readouts(self.poses, index), self.columns, strict=True):
            text.write(frame, readout.value, x, y, self.value_size, palette.WHITE, bold=True)
        x0, y0, x1, y1 = self.curve_box
        first, last = self.poses_span()
        share = (float(self.poses.time[index]) - first) / max(last - first, 1e-9)
        deepest = self.stage.layout.high[2]
        at_x = x0 + share * (x1 - x0)
        at_y = y0 + min(max(float(self.poses.position[index, 2]) / deepest, 0.0), 1.0) * (y1 - y0)
        _dot(frame, at_x, at_y, 4.5 * self.unit + 1, palette.WHITE)
        _dot(frame, at_x, at_y, 3.0 * self.unit + 0.5, (255, 150, 60))

    def poses_span(self) -> tuple[float, float]:
        """First and last mission time [s] of the depth curve."""
        return self.stage.lines[0].ribbon.span

    def _scene_labels(self, frame: Pixels, index: int, view: View) -> None:
        if self.stage.chase:
            self._ladder_labels(frame, index, view)
            return
        layout = self.stage.layout
        size = self.type_size(LABEL)
        corners = layout.corners()
        if view.parallel:
            self._map_labels(frame, view)
            return
        seen = view.project(corners)
        edge = int(np.argmin(seen[:4, 0] * self.width + 0.0 * seen[:4, 2]))
        foot, top = corners[edge + 4], corners[edge]
        for depth in self.stage.depth_ticks:
            share = depth / layout.high[2]
            x, y, _ = view.project((top + share * (foot - top))[None])[0]
            text.write(
                frame,
                f"{depth:g} m",
                x * self.width - self.px(8),
                y * self.height,
                size,
                palette.WHITE,
                anchor="rm",
                halo=palette.INK,
            )
        self._distance_labels(frame, view)

    def _distance_labels(self, frame: Pixels, view: View) -> None:
        """Distances along the block's lower long edge that is nearer to the camera."""
        layout, size = self.stage.layout, self.type_size(LABEL)
        bottom = float(layout.high[2])
        edges = [float(layout.low[1]), float(layout.high[1])]
        middle = [
            view.project(layout.display_block(np.array([[layout.low[0], y, bottom]])))[0, 2]
            + view.project(layout.display_block(np.array([[layout.high[0], y, bottom]])))[0, 2]
            for y in edges
        ]
        y_edge = edges[int(np.argmin(middle))]
        far = float(self.stage.distance_ticks[-1]) if len(self.stage.distance_ticks) else 0.0
        kilo = far >= 2000.0
        for distance in self.stage.distance_ticks:
            point = np.array([[layout.low[0] + distance, y_edge, bottom]])
            x, y, _ = view.project(layout.display_block(point))[0]
            value = f"{distance / 1000:g}" if kilo else f"{distance:g}"
            last = distance == self.stage.distance_ticks[-1]
            text.write(
                frame,
                f"{value} {'km' if kilo else 'm'}" if last else value,
                x * self.width,
                y * self.height + self.px(4),
                size,
                palette.WHITE,
                anchor="mt",
                halo=palette.INK,
            )

    def _map_labels(self, frame: Pixels, view: View) -> None:
        """The map's grid in metres from the start, and a scale bar."""
        layout, step = self.stage.layout, self.stage.grid_step
        kilo, size = step >= 1000.0, self.type_size(LABEL)
        for axis, low, high in zip((0, 1), layout.low, layout.high, strict=False):
            values = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)
            for value in values:
                point = np.array([value, layout.low[1], 0.0]) if axis == 0 else None
                if point is None:
                    point = np.array([layout.low[0], value, 0.0])
                x, y, _ = view.project(layout.display_block(point)[None])[0]
                name = f"{(value + 0.0) / 1000 if kilo else value + 0.0:g}".replace("-", "−")
                if value == values[-1]:
                    name += (" km" if kilo else " m") + (" N" if axis == 0 else " E")
                place = (
                    (x * self.width - self.px(7), y * self.height)
                    if axis == 0
                    else (x * self.width, y * self.height + self.px(4))
                )
                text.write(
                    frame, name, *place, size, palette.WHITE,
                    anchor="rm" if axis == 0 else "mt", halo=palette.INK,
                )  # fmt: skip
        half_width, _, _ = view.frustum()
        metres_per_pixel = 2 * half_width / self.width / layout.scale
        length = nice_step(0.16 * self.width * metres_per_pixel)
        pixels = length / metres_per_pixel
        x, y = self.px(26), self.strip_top - self.px(24)
        thick = self.px(4)
        for colour, grow in ((palette.INK, 1), (palette.WHITE, 0)):
            frame[y - grow : y + thick + grow, x - grow : round(x + pixels) + grow] = colour
        name = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
        text.write(
            frame, name, x + pixels / 2, y - self.px(3), self.type_size(LABEL), palette.WHITE,
            anchor="mb", halo=palette.INK,
        )  # fmt: skip

    def _ladder_labels(self, frame: Pixels, index: int, view: View) -> None:
        for depth, point in ladder(self.stage, self.poses, index):
            x, y, along = view.project(point[None])[0]
            if np.isfinite(x) and 0 < x < 1 and 0 < y < 1 - STRIP and along > 0:
                text.write(
                    frame, f"{depth:g} m", x * self.width - self.px(10), y * self.height,
                    self.type_size(LABEL), palette.WHITE, anchor="rm", halo=palette.INK,
                )  # fmt: skip

    def _compass(self, frame: Pixels, view: View) -> None:
        """An arrow to north, upper left under the title; up is the way the camera looks."""
        ahead = view.up if view.parallel else view.forward
        y, x = ahead[:2] @ [1.0, 0.0], view.right[:2] @ [1.0, 0.0]
        x, y = np.array([x, y]) / np.hypot(x, y)
        size = self.px(48)
        left, top = self.px(22), self.px(74 if len(self.notes) > 1 else 52)
        tile = Image.fromarray(np.ascontiguousarray(frame[top : top + size, left : left + size]))
        big = tile.resize((4 * size, 4 * size))
        draw = ImageDraw.Draw(big)
        middle, reach = 2.0 * size, 1.55 * size
        tip = np.array([middle + reach * x, middle - reach * y])
        tail = np.array([middle - reach * x, middle + reach * y])
        across = np.array([y, x]) * 0.30 * reach
        draw.ellipse(
            (0.12 * size, 0.12 * size, 3.88 * size, 3.88 * size),
            outline=(190, 214, 228), width=max(2, size // 12),
        )  # fmt: skip
        draw.polygon(
            [tuple(tip), tuple(middle + across), tuple(middle - across)], fill=(255, 110, 70)
        )
        draw.polygon(
            [tuple(tail), tuple(middle + across), tuple(middle - across)], fill=(225, 235, 240)
        )
        frame[top : top + size, left : left + size] = np.asarray(
            big.resize((size, size), Image.Resampling.BOX)
        )
        text.write(
            frame, "N", left + size / 2 + 0.62 * size * x, top + size / 2 - 0.62 * size * y,
            self.type_size(13), palette.WHITE, bold=True, anchor="mm", halo=palette.INK,
        )  # fmt: skip

    # -- what stays ----------------------------------------------------------------------------

    def _curve_box(self) -> tuple[int, int, int, int]:
        right = self.width - self.px(20)
        left = right - round(CURVE_SHARE * self.width)
        return left, self.strip_top + self.px(20), right, self.height - self.px(14)

    def _columns(self) -> list[float]:
        """Left edges of the readouts; the font shrinks until all of them fit."""
        left, right = self.px(24), self.curve_box[0] - self.px(44)
        size = self.type_size(VALUE)
        items = readouts(self.poses, 0)
        while True:
            widths = [
                max(text.width(r.widest, size, True), text.width(r.name, self.type_size(NAME)))
                for r in items
            ]
            gap = (right - left - sum(widths)) / max(len(items) - 1, 1)
            if gap >= 0.5 * size or size <= SMALLEST_FONT:
                break
            size -= 1
        self.value_size = size
        starts = left + np.concatenate([[0.0], np.cumsum(widths[:-1])])
        return [float(s + i * max(gap, 4.0)) for i, s in enumerate(starts)]

    def _ground(self) -> Pixels:
        """The unchanging part as RGBA over the whole picture."""
        image = Image.new("RGBA", (self.width, self.height), (0, 0, 0, 0))
        draw = ImageDraw.Draw(image)
        ink = (*palette.INK, round(255 * STRIP_ALPHA))
        draw.rectangle((0, self.strip_top, self.width, self.height), fill=ink)
        draw.line((0, self.strip_top, self.width, self.strip_top), fill=(120, 190, 215, 150))
        name_font = text.font(self.type_size(NAME))
        for readout, x in zip(readouts(self.poses, 0), self.columns, strict=True):
            draw.text(
                (x, self.strip_top + self.px(15)), readout.name, font=name_font,
                fill=(*palette.DIM, 255),
            )  # fmt: skip
        self._draw_curve(image)
        self._draw_notes(image)
        self._draw_legend(image)
        return np.asarray(image)

    def _draw_curve(self, image: Image.Image) -> None:
        """Depth against time of the whole part, beside the readouts."""
        x0, y0, x1, y1 = self.curve_box
        ribbon = self.stage.lines[0].ribbon
        factors = self.stage.layout.factors
        first, last = ribbon.span
        depth = -ribbon.nodes[:, 2] / factors[2]
        xs = x0 + (ribbon.time - first) / (last - first) * (x1 - x0)
        ys = y0 + np.clip(depth / self.stage.layout.high[2], 0.0, 1.0) * (y1 - y0)
        big = Image.new("RGBA", ((x1 - x0 + 8) * 3, (y1 - y0 + 8) * 3), (0, 0, 0, 0))
        draw = ImageDraw.Draw(big)
        points = [(3 * (x - x0 + 4), 3 * (y - y0 + 4)) for x, y in zip(xs, ys, strict=True)]
        draw.line(
            (12, 12, 3 * (x1 - x0 + 4), 12), fill=(120, 190, 215, 160), width=max(2, self.px(2))
        )
        draw.line(points, fill=(200, 226, 238, 255), width=max(3, self.px(5)), joint="curve")
        small = big.resize((x1 - x0 + 8, y1 - y0 + 8), Image.Resampling.LANCZOS)
        image.alpha_composite(small, (x0 - 4, y0 - 4))

    def _draw_notes(self, image: Image.Image) -> None:
        """What the picture is, upper left: a bold first line, smaller further ones."""
        draw = ImageDraw.Draw(image)
        y = self.px(14)
        for i, line in enumerate(self.notes):
            size = self.type_size(TITLE if i == 0 else LABEL - 1)
            draw.text(
                (self.px(22), y), line, font=text.font(size, i == 0),
                fill=(255, 255, 255, 255) if i == 0 else (*palette.DIM, 255),
                stroke_width=max(1, self.px(1)), stroke_fill=(*palette.INK, 150),
            )  # fmt: skip
            y += round(1.35 * size)

    def _draw_legend(self, image: Image.Image) -> None:
        """Colour scale of the true track, names of the others and the current, lower right."""
        draw = ImageDraw.Draw(image)
        size = self.type_size(LABEL - 1)
        face = text.font(size)
        scale = self.stage.scale
        bar_width, bar_height = self.px(190), self.px(11)
        right = self.width - self.px(20)
        lines = [(line.name, line.colour) for line in self.stage.lines[1:]]
        wide = max([bar_width, *(text.width(n, size) + self.px(34) for n, _ in lines)])
        wide = max(wide, text.width(scale.label, size))
        rows = len(lines) + (1 if self.stage.arrow_scale > 0 else 0)
        height = self.px(52) + rows * self.px(20)
        left, top = right - wide, self.strip_top - self.px(14) - height
        pad = self.px(10)
        draw.rounded_rectangle(
            (left - pad, top - pad + self.px(2), right + pad, top + height),
            radius=self.px(6),
            fill=(*palette.INK, round(255 * PANEL_ALPHA)),
        )
        y = top
        for name, colour in lines:
            middle = y + self.px(9)
            assert colour is not None
            rgb = tuple(int(255 * c) for c in colour)
            draw.line((left, middle, left + self.px(24), middle), fill=rgb, width=self.px(4))
            draw.text((left + self.px(32), middle), name, font=face, anchor="lm", fill="white")
            y += self.px(20)
        if self.stage.arrow_scale > 0:
            strongest = float(np.hypot(*self.stage.profile[1].T).max())
            middle = y + self.px(9)
            rgb = tuple(int(255 * c) for c in palette.CURRENT)
            draw.line((left, middle, left + self.px(18), middle), fill=rgb, width=self.px(3))
            draw.polygon(
                [
                    (left + self.px(26), middle),
                    (left + self.px(16), middle - self.px(5)),
                    (left + self.px(16), middle + self.px(5)),
                ],
                fill=rgb,
            )
            draw.text(
                (left + self.px(32), middle), f"current, up to {strongest:.2f} m/s", font=face,
                anchor="lm", fill="white",
            )  # fmt: skip
            y += self.px(20)
        draw.text((left, y), scale.label, font=face, fill="white")
        y += self.px(18)
        colours = palette.track_colours(np.linspace(0, 1, bar_width), 0.0, 1.0)
        bar = np.repeat((255 * colours).astype(np.uint8)[None], bar_height, axis=0)
        image.paste(Image.fromarray(bar), (left, y))
        y += bar_height + self.px(1)
        for value, x, anchor in ((scale.low, left, "la"), (scale.high, left + bar_width, "ra")):
            draw.text(
                (x, y), _scale_text(value, scale.high), font=face, anchor=anchor, fill="white"
            )


def _scale_text(value: float, largest: float) -> str:
    return f"{value:.2f}" if largest < 10.0 else f"{value:.0f}"


def ladder(stage: Stage, poses: Poses, index: int) -> list[tuple[float, Array]]:
    """Depths [m] of the chase camera's arrows and their points in display units, glider at 0."""
    from twin.render.painter import LADDER_OFFSET, LADDER_REACH, LADDER_STEP

    depth = float(poses.position[index, 2])
    heading = np.deg2rad(poses.heading[index])
    lowest = np.ceil((depth - LADDER_REACH) / LADDER_STEP) * LADDER_STEP
    ahead, aside = LADDER_OFFSET
    # Starboard of the heading, in display axes (x north, y west).
    x = ahead * np.cos(heading) - aside * np.sin(heading)
    y = -(ahead * np.sin(heading) + aside * np.cos(heading))
    found = []
    level = lowest
    while level <= depth + LADDER_REACH:
        if 0.0 <= level <= stage.layout.high[2]:
            found.append((float(level), np.array([x, y, depth - level])))
        level += LADDER_STEP
    return found


def _dot(frame: Pixels, x: float, y: float, radius: float, colour: text.Colour) -> None:
    """A smooth disc, in place."""
    height, width = frame.shape[:2]
    x0, x1 = max(int(x - radius - 1), 0), min(int(x + radius + 2), width)
    y0, y1 = max(int(y - radius - 1), 0), min(int(y + radius + 2), height)
    if x0 >= x1 or y0 >= y1:
        return
    ys, xs = np.mgrid[y0:y1, x0:x1]
    cover = np.clip(radius + 0.5 - np.hypot(xs - x, ys - y), 0.0, 1.0)[..., None]
    part = frame[y0:y1, x0:x1]
    frame[y0:y1, x0:x1] = (part * (1 - cover) + np.array(colour) * cover).astype(np.uint8)


def _runs(rows: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Runs of consecutive rows as (first, after last)."""
    if len(rows) == 0:
        return []
    breaks = np.flatnonzero(np.diff(rows) > 1)
    firsts = [int(rows[0]), *(int(rows[b + 1]) for b in breaks)]
    lasts = [*(int(rows[b]) for b in breaks), int(rows[-1])]
    return [(a, b + 1) for a, b in zip(firsts, lasts, strict=True)]
