"""HUD (head-up display) drawn over every frame: readouts, labels, legend and depth curve.

The panel is the constant part of the display in a shot. Readouts are names and values in the strip
at the lower edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from twin.show.render import camera, tags
from twin.show.render import canvas as palette
from twin.show.render.canvas import LEGEND, NAME, NAME_TOP, NOTES_TOP, TITLE, VALUE, Canvas, Pixels
from twin.show.render.playback import Poses, spins, turns
from twin.show.render.stage import Stage

STRIP_ALPHA, LEGEND_ALPHA = 0.66, 0.45
BAR, ROW = (190, 11), 20
"""[pixel of the base picture] BAR: colour bar's width, height. ROW: height of a legend's row"""
LEGEND_SHARE = 0.32  # largest width of the legend / picture's width; a wider one is left out
LEAST_ROW = 1.35  # least height of a legend's row, as a multiple of its font size
EDGE, CURVE, CURSOR = (120, 190, 215, 150), (200, 226, 238, 255), (255, 150, 60)
OVERSAMPLING = 3  # the curve is drawn larger and shrunk, for smooth edges
UNKNOWN = "–"
SHARED = 2  # most moving parts that share one readout


def draw_panel(
    canvas: Canvas,
    stage: Stage,
    notes: Sequence[str],
    columns: Sequence[float],
    items: Sequence[Readout],
) -> Pixels:
    """Draw the strip with the names of its readouts, the depth curve, the notes and the legend.

    Args:
      notes: lines for the upper left corner, the first line bold.
      columns: left edge of each readout [pixel]; further readouts are left out.

    Returns:
      RGBA, shape (height, width, 4).
    """
    image = Image.new("RGBA", (canvas.width, canvas.height), (0, 0, 0, 0))
    draw = ImageDraw.Draw(image)
    ink = (*palette.INK, round(255 * STRIP_ALPHA))
    draw.rectangle((0, canvas.strip_top, canvas.width, canvas.height), fill=ink)
    draw.line((0, canvas.strip_top, canvas.width, canvas.strip_top), fill=EDGE)
    face = palette.font(canvas.font_size(NAME))
    for item, x in zip(items, columns, strict=False):
        y = canvas.strip_top + canvas.px(NAME_TOP)
        draw.text((x, y), item.name, font=face, fill=(*palette.DIM, 255))
    _draw_curve(image, canvas, stage)
    y = canvas.px(NOTES_TOP)
    for i, line in enumerate(notes):
        size = canvas.font_size(LEGEND if i else TITLE)
        draw.text(
            (canvas.px(22), y), line, font=palette.font(size, i == 0),
            fill=(*(palette.DIM if i else palette.WHITE), 255),
            stroke_width=canvas.px(1), stroke_fill=(*palette.INK, 150),
        )  # fmt: skip
        y += round(1.4 * size)
    _draw_legend(image, canvas, stage)
    return np.asarray(image)


def _draw_curve(image: Image.Image, canvas: Canvas, stage: Stage) -> None:
    """Draw depth against time for the whole time span of the film."""
    x0, y0, x1, y1 = canvas.curve
    ribbon = stage.lines[0].ribbon
    first, last = ribbon.span
    depth = -ribbon.nodes[:, 2] / stage.layout.factors[2]
    xs = (ribbon.time - first) / (last - first) * (x1 - x0)
    ys = np.clip(depth / stage.layout.high[2], 0.0, 1.0) * (y1 - y0)
    margin = 4
    size = (x1 - x0 + 2 * margin, y1 - y0 + 2 * margin)
    large = Image.new("RGBA", (OVERSAMPLING * size[0], OVERSAMPLING * size[1]), (0, 0, 0, 0))
    draw, edge = ImageDraw.Draw(large), OVERSAMPLING * margin
    surface = (edge, edge, edge + OVERSAMPLING * (x1 - x0), edge)
    draw.line(surface, fill=EDGE, width=canvas.px(2) + 1)
    points = edge + OVERSAMPLING * np.column_stack([xs, ys])
    width = max(OVERSAMPLING, canvas.px(5))
    draw.line([*map(tuple, points.tolist())], fill=CURVE, width=width, joint="curve")
    image.alpha_composite(large.resize(size, Image.Resampling.LANCZOS), (x0 - margin, y0 - margin))


def _draw_legend(image: Image.Image, canvas: Canvas, stage: Stage) -> None:
    """Draw names of dead-reckoned tracks, the current and the colour scale, lower right.

    No legend is drawn in a picture so small that the legend would cover the scene.
    """
    draw, px = ImageDraw.Draw(image), canvas.px
    size = canvas.font_size(LEGEND)
    face, row, scale = palette.font(size), max(px(ROW), round(LEAST_ROW * size)), stage.scale
    bar = (px(BAR[0]), px(BAR[1]))
    keys = [(line.name, line.colour) for line in stage.lines[1:]]
    if strongest := stage.current.strongest:
        digits = 2 if strongest >= 0.01 else 3
        keys.append((f"{stage.current_name}, up to {strongest:.{digits}f} m/s", None))
    wide = max(bar[0], palette.text_width(scale.label, size))
    wide = max([wide, *(px(34) + palette.text_width(name, size) for name, _ in keys)])
    high = 3 * row - px(6) + row * len(keys)
    if wide > LEGEND_SHARE * canvas.width:
        return
    left = canvas.width - px(20) - wide
    top = canvas.strip_top - px(18) - high
    pad = px(10)
    draw.rounded_rectangle(
        (left - pad, top - pad, left + wide + pad, top + high + px(4)),
        radius=px(6),
        fill=(*palette.INK, round(255 * LEGEND_ALPHA)),
    )
    y = top
    for name, colour in keys:
        middle = y + row // 2
        if colour is None:  # the current's arrow
            rgb = tuple(int(255 * c) for c in palette.CURRENT)
            draw.line((left, middle, left + px(18), middle), fill=rgb, width=px(3))
            head = [(left + a * canvas.unit, middle + b * canvas.unit)
                    for a, b in ((26, 0), (16, -5), (16, 5))]  # fmt: skip
            draw.polygon(head, fill=rgb)
        else:
            rgb = tuple(int(255 * c) for c in colour)
            draw.line((left, middle, left + px(26), middle), fill=rgb, width=px(4))
        draw.text((left + px(34), middle), name, font=face, anchor="lm")
        y += row
    draw.text((left, y + row // 2), scale.label, font=face, anchor="lm")
    y += row
    colours = palette.track_colours(np.linspace(0, 1, bar[0]), 0.0, 1.0)
    rows = np.repeat((255 * colours).astype(np.uint8)[None], bar[1], axis=0)
    image.paste(Image.fromarray(rows), (left, y))
    y += bar[1] + px(2)
    least, most = scale.ends
    draw.text((left, y), least, font=face, anchor="la")
    draw.text((left + bar[0], y), most, font=face, anchor="ra")


class Hud:
    """Display drawn over the frames of one shot; its constant part is drawn once."""

    def __init__(self, stage: Stage, poses: Poses, canvas: Canvas, notes: Sequence[str]):
        """Draw the constant part; `notes` are lines for the upper left corner, the first bold."""
        self._stage, self._poses, self._canvas = stage, poses, canvas
        self._columns, self._value_size = self._arrange()
        panel = draw_panel(canvas, stage, notes, self._columns, readouts(poses, 0))
        self._rows = np.flatnonzero(panel[..., 3].any(axis=1))
        self._panel = palette.layer(panel[self._rows])

    def draw(self, frame: Pixels, index: int, view: camera.View) -> None:
        """Draw over frame `index` (height, width, 3), in place."""
        canvas, stage = self._canvas, self._stage
        if stage.chase:
            marks = tags.ladder_marks(canvas, stage.ladder(self._poses, index), view)
        else:
            label = tags.map_marks if view.parallel else tags.block_marks
            marks = label(canvas, stage.layout, view)
        tags.draw_marks(frame, canvas, marks)
        if view.parallel:
            _, bar = tags.scale_bar(canvas, stage.layout, view)
            palette.box(frame, bar, palette.WHITE, palette.INK)
        tags.draw_compass(frame, canvas, view)
        frame[self._rows] = palette.mixed(frame[self._rows], *self._panel)
        y = canvas.value_top
        for readout, x in zip(readouts(self._poses, index), self._columns, strict=False):
            palette.write(frame, readout.value, x, y, self._value_size, palette.WHITE, bold=True)
        # mark the glider's place on the depth curve
        x0, y0, x1, y1 = canvas.curve
        first, last = stage.lines[0].ribbon.span
        along = (float(self._poses.time[index]) - first) / (last - first)
        down = float(self._poses.position[index, 2]) / stage.layout.high[2]
        place = x0 + along * (x1 - x0), y0 + min(max(down, 0.0), 1.0) * (y1 - y0)
        palette.dot(frame, *place, 4.5 * canvas.unit + 1.0, palette.WHITE)
        palette.dot(frame, *place, 3.0 * canvas.unit + 0.5, CURSOR)

    def _arrange(self) -> tuple[list[float], int]:
        """Left edges of the readouts that fit, and the largest font size at which they fit."""
        canvas = self._canvas
        left, right = canvas.px(24), canvas.curve[0] - canvas.px(36)
        items = readouts(self._poses, 0)
        size = canvas.font_size(VALUE)
        while True:
            names = [palette.text_width(item.name, canvas.font_size(NAME)) for item in items]
            values = [palette.text_width(item.widest, size, True) for item in items]
            widths = np.maximum(names, values)
            gap = (right - left - int(widths.sum())) / (len(items) - 1)
            if gap >= 0.6 * size or len(items) == 2:
                break
            if size > palette.SMALLEST_FONT:
                size -= 1
            else:
                items.pop()  # a small picture shows only the first readouts, but readably
        starts = left + np.concatenate([[0.0], np.cumsum(widths[:-1])])
        return [float(start + i * gap) for i, start in enumerate(starts)], size


class Readout(NamedTuple):
    """One name and value of the strip."""

    name: str
    value: str
    widest: str  # a text as long as the longest value, so that the columns do not move


def readouts(poses: Poses, index: int) -> list[Readout]:
    """Readouts of time, depth, pitch, heading, speed, net buoyancy and moving parts at one frame.

    A quantity that is unknown in the whole mission has no readout. A log without net buoyancy shows
    the pumped volume instead. In a gap of a log only the time is known.
    """
    speed, heading = float(poses.speed[index]), round(float(poses.heading[index])) % 360
    rate = f"{speed:.2f} m/s" if np.isfinite(speed) else UNKNOWN
    pumped = np.nan if poses.pumped is None else float(poses.pumped[index])
    figures = {
        "depth": Readout("DEPTH", f"{plain(poses.position[index, 2], 1)} m", "0000.0 m"),
        "pitch": Readout("PITCH", f"{signed(poses.pitch[index], 1)}°", "+00.0°"),
        "heading": Readout("HEADING", f"{heading:03d}°", "000°"),
        "speed": Readout("SPEED", rate, "0.00 m/s"),
        "net_mass": Readout("NET BUOYANCY", buoyancy(float(poses.net_mass[index])), "▼ 0.00 kg"),
        # a negative pumped volume means a heavy vehicle
        "pumped": Readout("PUMPED", f"{signed(pumped, 0)} cm³" if np.isfinite(pumped) else UNKNOWN,
                          "+000 cm³"),
    }  # fmt: skip
    unknown = set(poses.unknown)
    if "net_mass" not in unknown or poses.pumped is None:
        unknown.add("pumped")
    items = [item for name, item in figures.items() if name not in unknown] + _parts(poses, index)
    if poses.bridged is not None and poses.bridged[index]:
        items = [item._replace(value=UNKNOWN) for item in items]
    return [Readout("TIME", clock(float(poses.time[index])), "00:00:00"), *items]


def _parts(poses: Poses, index: int) -> list[Readout]:
    """Readouts of sliding, turning and spinning parts; a pump appears as net buoyancy.

    One or two parts, as those of a glider's battery, share a readout; three or more have their own.
    """
    single = [
        _part(joint, float(value), fine=len(poses.joints) > SHARED)
        for joint, value in zip(poses.joints, poses.parts[index], strict=True)
    ]
    if not 0 < len(single) <= SHARED:
        return single
    return [Readout(*map("  ".join, zip(*single, strict=True)))]


def _part(joint: str, value: float, *, fine: bool) -> Readout:
    """Readout of one part; with `fine` its angle has a decimal."""
    name = joint.replace("_", " ").upper()
    if spins(joint):
        return Readout(name, f"{plain(value, 0)} rad/s", f"{tags.MINUS}000 rad/s")
    if turns(joint):
        angle = signed(np.rad2deg(value), 1 if fine else 0)
        return Readout(name, f"{angle}°", "+00.0°" if fine else "+00°")
    if abs(value) >= 1.0:  # a length in the water, no travel of a battery
        return Readout(name, f"{plain(value, 1)} m", "00.0 m")
    return Readout(name, f"{signed(1000 * value, 0)} mm", "+00 mm")


def clock(seconds: float) -> str:
    """Format seconds as hours, minutes and seconds, such as 1:02:03."""
    whole = round(seconds)
    return f"{whole // 3600:d}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def plain(value: float, digits: int) -> str:
    """Format a number with a typographic minus, and without a minus on a rounded zero."""
    return f"{float(value):z.{digits}f}".replace("-", tags.MINUS)


def signed(value: float, digits: int) -> str:
    """Format a number like `plain`, with a plus on positive numbers."""
    text = plain(value, digits)
    return f"+{text}" if round(float(value), digits) > 0 else text


def buoyancy(mass: float) -> str:
    """Format net buoyancy mass [kg] with an arrow: down for a heavy glider (positive)."""
    if not np.isfinite(mass):
        return UNKNOWN
    if abs(mass) < 0.005:
        return "neutral"
    return f"{'▼' if mass >= 0 else '▲'} {abs(mass):.2f} kg"
