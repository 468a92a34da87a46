"""Map drawing: surfacings, ellipses, track and coast as one SVG that needs nothing else.

Positions are drawn at equal scale north and east of the middle of the view; wheel and drag zoom and
move it where a browser runs the page's few lines of script, and without them it is a picture.
"""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

import numpy as np

from glider_twin_ops.forecast.surfacing import HALF, NINETY, degrees
from glider_twin_ops.forecast.surfacing_forecast import Forecast
from twin.numbers import Array

WIDTH, HEIGHT = 960.0, 640.0
"""[px] of the view box"""
MARGIN = 1.25
"""Of the view over what must be seen"""
LEAST_SPAN = 0.02
"""[degree] of latitude that is shown at least: 2 km"""
NEAR = 1.5
"""A target farther away than so many spans is outside of the first view"""
MOST_DOTS = 400
"""Members that are drawn of a surfacing"""
WIDER = 12.0
"""Spans around the middle whose coast is drawn, for who zooms out"""
METRES_PER_DEGREE = 111_195.0
COLOURS = ("#0072b2", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#e69f00")
"""Of surfacings in turn: Okabe and Ito's, which colour-blind readers tell apart"""


class MapFrame:
    """Degrees to pixels."""

    def __init__(self, points: Array, far: Array):
        """A view of points, (point, 2), longitude and latitude; of far ones if they are near."""
        west, south = points.min(axis=0)
        east, north = points.max(axis=0)
        self.middle = 0.5 * (west + east), 0.5 * (south + north)
        self.shrink = math.cos(math.radians(self.middle[1]))
        span = max(north - south, (east - west) * self.shrink * HEIGHT / WIDTH, LEAST_SPAN)
        for longitude, latitude in far:
            away = max(
                abs(latitude - self.middle[1]), abs(longitude - self.middle[0]) * self.shrink
            )
            if away < NEAR * span:
                span = max(span, 2.0 * away)
        self.span = MARGIN * span
        self.scale = HEIGHT / self.span

    def at(self, points: Array) -> Array:
        """Pixels, (point, 2)."""
        x = 0.5 * WIDTH + (points[:, 0] - self.middle[0]) * self.shrink * self.scale
        y = 0.5 * HEIGHT - (points[:, 1] - self.middle[1]) * self.scale
        return np.stack([x, y], axis=1)

    @property
    def metres_per_pixel(self) -> float:
        """At the middle."""
        return METRES_PER_DEGREE / self.scale


def draw_map(found: Forecast) -> str:
    """The SVG element."""
    place = found.request.place
    start = np.array([[place.longitude_deg, place.latitude_deg]])
    rings = [one.ring(NINETY, place) for one in found.surfacings]
    frame = MapFrame(np.concatenate([start, found.track, *rings]), found.targets())
    parts = [
        f'<svg id="map" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        f'aria-label="map of the next surfacings" xmlns="http://www.w3.org/2000/svg">',
        f'<rect x="{-WIDER * WIDTH:g}" y="{-WIDER * HEIGHT:g}" width="{(2 * WIDER + 1) * WIDTH:g}" '
        f'height="{(2 * WIDER + 1) * HEIGHT:g}" class="sea"/>',
        *_land(frame),
        *_graticule(frame),
    ]
    if len(found.track) > 1:
        parts.append(f'<polyline class="track" points="{_points(frame.at(found.track))}"/>')
    for one, ring in reversed(list(zip(found.surfacings, rings, strict=True))):
        colour = COLOURS[(one.number - 1) % len(COLOURS)]
        half = one.ring(HALF, place)
        title = f"surfacing {one.number}: {found.moment(one.time_s)} UTC"
        dots = frame.at(degrees(one.members[:MOST_DOTS], place))
        parts += [
            f'<g fill="{colour}" stroke="{colour}"><title>{html.escape(title)}</title>',
            f'<polygon class="ninety" points="{_points(frame.at(ring))}"/>',
            f'<polygon class="half" points="{_points(frame.at(half))}"/>',
            *(f'<circle class="member" cx="{x:.1f}" cy="{y:.1f}" r="1.6"/>' for x, y in dots),
            "</g>",
        ]
    x0, y0 = frame.at(start)[0]
    west = 0
    for one in found.surfacings:
        colour = COLOURS[(one.number - 1) % len(COLOURS)]
        x, y = frame.at(degrees(np.array([[one.north, one.east]]), place))[0]
        west += 1 if x < x0 else -1
        parts.append(
            f'<g fill="{colour}"><circle class="here" cx="{x:.1f}" cy="{y:.1f}" r="5"/></g>'
            + _label("name", x, y - 8.0, f"{one.number}: {found.minute(one.time_s)[11:]}", x < x0)
        )
    for k, (x, y) in enumerate(frame.at(found.targets()), start=1):
        parts.append(
            f'<g class="target"><path d="M{x:.1f} {y - 7:.1f}l7 7l-7 7l-7-7z"/></g>'
            + _label("", x, y + 4.0, f"target {k}", False)
        )
    parts.append(
        f'<g class="start"><rect x="{x0 - 5:.1f}" y="{y0 - 5:.1f}" width="10" height="10"/></g>'
        + _label("", x0, y0 + 4.0, f"start {str(place.time)[11:16]}", west < 0)
    )
    parts += [*_scale_bar(frame), "</svg>"]
    return "\n".join(parts)


def _label(kind: str, x: float, y: float, words: str, left: bool) -> str:
    """Words beside a point."""
    at, anchor = (x - 10.0, "end") if left else (x + 10.0, "start")
    return f'<text class="{kind}" x="{at:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'


def _points(points: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _land(frame: MapFrame) -> list[str]:
    """The coast in and around the view."""
    from twin.show.figures import NEIGHBOURS, rings

    reach = WIDER * frame.span * max(1.0, WIDTH / HEIGHT / frame.shrink)
    low = np.array(frame.middle) - reach
    high = np.array(frame.middle) + reach
    found = []
    for ring in rings():
        for turn in NEIGHBOURS:
            moved = ring + np.array([turn, 0.0])
            if (moved.max(axis=0) > low).all() and (moved.min(axis=0) < high).all():
                clipped = _clipped(moved, low, high)
                if len(clipped) > 2:
                    found.append(f"M{_points(frame.at(clipped))}z")
    return [f'<path class="land" fill-rule="evenodd" d="{"".join(found)}"/>'] if found else []


def _clipped(ring: Array, low: Array, high: Array) -> Array:
    """A ring inside a box (Sutherland and Hodgman 1974)."""
    points = ring
    for axis in (0, 1):
        for bound, sign in ((low[axis], 1.0), (high[axis], -1.0)):
            inside = sign * (points[:, axis] - bound) >= 0.0
            kept: list[Array] = []
            for k in range(len(points)):
                before, here = points[k - 1], points[k]
                if inside[k] != inside[k - 1]:
                    share = (bound - before[axis]) / (here[axis] - before[axis])
                    kept.append(before + share * (here - before))
                if inside[k]:
                    kept.append(here)
            if not kept:
                return np.zeros((0, 2))
            points = np.array(kept)
    return points


def _graticule(frame: MapFrame) -> list[str]:
    """Lines of latitude and longitude with their degrees and minutes."""
    step = _step(frame.span / 4.0)
    parts = ['<g class="grid">']
    for axis in (0, 1):
        middle = frame.middle[axis]
        reach = 0.5 * frame.span * (WIDTH / HEIGHT / frame.shrink if axis == 0 else 1.0)
        first = math.ceil((middle - reach) / step)
        for k in range(first, math.floor((middle + reach) / step) + 1):
            value = k * step
            point = np.array([[value, frame.middle[1]] if axis == 0 else [frame.middle[0], value]])
            x, y = frame.at(point)[0]
            if axis == 0:
                parts.append(f'<path d="M{x:.1f} 0V{HEIGHT:g}"/>')
                spare = ' class="spare"' if k % 2 else ""  # narrow screens leave these out
                parts.append(
                    f'<text{spare} x="{x + 3:.1f}" y="{HEIGHT - 6:g}">{_name(value, "EW")}</text>'
                )
            else:
                parts.append(f'<path d="M0 {y:.1f}H{WIDTH:g}"/>')
                parts.append(f'<text x="4" y="{y - 4:.1f}">{_name(value, "NS")}</text>')
    return [*parts, "</g>"]


def _step(rough: float) -> float:
    """The round step [degree] next above a rough one."""
    minutes: Sequence[float] = (
        0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800,
    )  # fmt: skip
    return next((m for m in minutes if m >= 60.0 * rough), 1800.0) / 60.0


def _name(value: float, letters: str) -> str:
    """Such as 36\N{DEGREE SIGN} 48.5' N."""
    turned = (value + 180.0) % 360.0 - 180.0 if letters == "EW" else value
    minutes = round(abs(turned) * 60.0, 2)
    whole, rest = divmod(minutes, 60.0)
    return f"{whole:.0f}\N{DEGREE SIGN} {rest:g}' {letters[0] if turned >= 0.0 else letters[1]}"


def _scale_bar(frame: MapFrame) -> list[str]:
    """A round length of a fifth of the width."""
    rough = 0.2 * WIDTH * frame.metres_per_pixel
    power = 10.0 ** math.floor(math.log10(rough))
    metres = max(m * power for m in (1.0, 2.0, 5.0) if m * power <= rough)
    name = f"{metres / 1e3:g} km" if metres >= 1e3 else f"{metres:g} m"
    right, y = WIDTH - 24.0, 30.0
    left = right - metres / frame.metres_per_pixel
    return [
        f'<g class="scale"><path d="M{left:.1f} {y - 5:g}V{y:g}H{right:g}V{y - 5:g}"/>'
        f'<text x="{0.5 * (left + right):.1f}" y="{y - 9:g}">{name}</text></g>'
    ]
