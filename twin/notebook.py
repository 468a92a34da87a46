"""Notebook display: HTML of an object, a small table beside a small picture.

The picture is a short SVG, so that displaying an object loads no plotting library.
"""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Mapping, Sequence

WIDTH, HEIGHT, EDGE = 260.0, 90.0, 6.0
"""[px] WIDTH, HEIGHT: of a picture. EDGE: width of its empty margin"""
POINTS = 200
"""Maximum number of points of a line; the picture cannot resolve more"""
INK, GREY = "#2a6f97", "#8d99a6"


def card(title: str, rows: Mapping[str, object], picture: str = "") -> str:
    """HTML card of an object.

    Args:
      title: title of one line.
      rows: values by their labels.
      picture: SVG, such as `line`, `spans` and `hull` return.
    """
    cells = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
        f"<td style='text-align:left'>{html.escape(str(value))}</td></tr>"
        for name, value in rows.items()
    )
    return (
        f"<div><b>{html.escape(title)}</b><div style='display:flex;gap:1em;align-items:center'>"
        f"<table>{cells}</table>{picture}</div></div>"
    )


def line(x: Sequence[float], y: Sequence[float], label: str, *, down: bool = False) -> str:
    """SVG of a line through the finite points, with a label and the range of y.

    Args:
      down: y grows downwards, as depth does.
    """
    every = max(1, math.ceil(len(x) / POINTS))
    pairs = zip(x[::every], y[::every], strict=True)
    points = [(float(a), float(b)) for a, b in pairs if math.isfinite(a) and math.isfinite(b)]
    if len(points) < 2:
        return ""
    low, high = (f(b for _, b in points) for f in (min, max))
    across, up = _scale([a for a, _ in points], WIDTH), _scale([low, high], HEIGHT)
    path = " ".join(f"{across(a):.1f},{up(b) if down else HEIGHT - up(b):.1f}" for a, b in points)
    drawn = f"<polyline points='{path}' fill='none' stroke='{INK}' stroke-width='1.5'/>"
    return _svg(drawn, f"{label}: {low:.4g} to {high:.4g}")


def spans(rows: Sequence[tuple[str, float, float]], label: str) -> str:
    """SVG of values with error bars: rows of name, value and standard deviation, about zero."""
    if not rows:
        return ""
    reach = max(1e-9, *(abs(value) + deviation for _, value, deviation in rows))
    step = HEIGHT / len(rows)
    drawn = f"<line x1='{WIDTH / 2}' x2='{WIDTH / 2}' y1='0' y2='{HEIGHT}' stroke='{GREY}'/>"
    for k, (name, value, deviation) in enumerate(rows):
        ends = (value - deviation, value, value + deviation)
        left, middle, right = (WIDTH / 2 + (WIDTH / 2 - EDGE) * one / reach for one in ends)
        y = (k + 0.5) * step
        drawn += (
            f"<g><title>{html.escape(name)}</title><line x1='{left:.1f}' x2='{right:.1f}' "
            f"y1='{y:.1f}' y2='{y:.1f}' stroke='{INK}'/>"
            f"<circle cx='{middle:.1f}' cy='{y:.1f}' r='2.5' fill='{INK}'/></g>"
        )
    return _svg(drawn, label)


def hull(length: float, diameter: float, parts: Mapping[str, tuple[float, float]]) -> str:
    """SVG of a hull seen from starboard, its bow to the right, with dots where parts act.

    Args:
      length, diameter: [m] size of the hull.
      parts: [m] position forward of the middle and down, by the part's name.
    """
    scale = min((WIDTH - 2 * EDGE) / length, (HEIGHT - 2 * EDGE) / diameter)
    x, y = WIDTH / 2, HEIGHT / 2
    drawn = (
        f"<ellipse cx='{x}' cy='{y}' rx='{scale * length / 2:.1f}' "
        f"ry='{scale * diameter / 2:.1f}' fill='none' stroke='{INK}' stroke-width='1.5'/>"
    )
    for name, (forward, below) in parts.items():
        drawn += (
            f"<circle cx='{x + scale * forward:.1f}' cy='{y + scale * below:.1f}' r='3' "
            f"fill='{GREY}'><title>{html.escape(name)}</title></circle>"
        )
    return _svg(drawn, f"{length:.3g} m long, {diameter:.3g} m thick")


def _scale(values: Sequence[float], size: float) -> Callable[[float], float]:
    low, high = min(values), max(values)
    way = (high - low) or 1.0
    return lambda value: EDGE + (size - 2 * EDGE) * (value - low) / way


def _svg(drawn: str, label: str) -> str:
    return (
        f"<figure style='margin:0'><svg width='{WIDTH:g}' height='{HEIGHT:g}' role='img' "
        f"aria-label='{html.escape(label, quote=True)}'>{drawn}</svg>"
        f"<figcaption style='font-size:smaller'>{html.escape(label)}</figcaption></figure>"
    )
