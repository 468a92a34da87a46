"""Forecast page: a forecast as one HTML file with a map, which opens without a network.

The map is one SVG with surfacings, ellipses, track and coast. Its scale is equal north and east of
the view's middle. With the page's script, wheel and drag zoom and move the map; without the script
it is a picture.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from glider_twin_ops.forecast.member_flights import HALF, NINETY, Surfacing, degrees
from glider_twin_ops.forecast.surfacing_forecast import Forecast
from twin.cli import printable
from twin.numbers import Array
from twin.records.storage import LIST, check_folder_target, whole_folder

WIDTH, HEIGHT = 960.0, 640.0
"""[px] of the view box"""
MARGIN, NEAR, LEAST_SPAN = 1.25, 1.5, 0.02
"""Ratio of the view to the extent that must be seen; extents beyond which a target is left outside
the first view; [degree] least latitude shown, 2 km"""
MOST_DOTS = 400
"""Most members drawn for a surfacing"""
WIDER = 12.0
"""Number of view heights around the middle in which the coast is drawn, for zooming out"""
METRES_PER_DEGREE = 111_195.0
STEPS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800)
"""[minute] Steps between lines of latitude and longitude"""
COLOURS = ("#0072b2", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#e69f00")
"""Colours of surfacings in turn: Okabe and Ito's, which colour-blind readers can distinguish"""


class MapFrame:
    """Frame of a map, which turns degrees into pixels."""

    def __init__(self, points: Array, far: Array):
        """Fit the view to points, (point, 2), longitude and latitude, and to far points nearby."""
        low, high = points.min(axis=0), points.max(axis=0)
        self.middle = 0.5 * (low + high)
        self.shrink = math.cos(math.radians(self.middle[1]))
        width, height = (high - low).tolist()
        span = max(height, width * self.shrink * HEIGHT / WIDTH, LEAST_SPAN)
        for away in (np.abs(far - self.middle) * [self.shrink, 1.0]).max(axis=1).tolist():
            if away < NEAR * span:
                span = max(span, 2.0 * away)
        self.span = MARGIN * span
        self.scale = HEIGHT / self.span

    def at(self, points: Array) -> Array:
        """Pixels of points, (point, 2)."""
        off = (points - self.middle) * [self.shrink, -1.0] * self.scale
        return np.asarray(off + np.array([0.5 * WIDTH, 0.5 * HEIGHT]))


def draw_map(found: Forecast) -> str:
    """Draw the map as an SVG element."""
    place = found.request.place
    start = np.array([[place.longitude_deg, place.latitude_deg]])
    rings = [one.ring(NINETY, place) for one in found.surfacings]
    targets = found.targets()
    frame = MapFrame(np.concatenate([start, found.track, *rings]), targets)
    wide = (2 * WIDER + 1) * WIDTH, (2 * WIDER + 1) * HEIGHT
    parts = [
        f'<svg id="map" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        f'aria-label="map of the next surfacings" xmlns="http://www.w3.org/2000/svg">',
        f'<rect x="{-WIDER * WIDTH:g}" y="{-WIDER * HEIGHT:g}" width="{wide[0]:g}" '
        f'height="{wide[1]:g}" class="sea"/>',
        *_land(frame),
        *_graticule(frame),
    ]
    if len(found.track) > 1:
        parts.append(f'<polyline class="track" points="{_points(frame.at(found.track))}"/>')
    x0, y0 = frame.at(start)[0]
    names, west = [], 0
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
        x, y = frame.at(degrees(np.array([[one.north, one.east]]), place))[0]
        west += 1 if x < x0 else -1
        names.append(
            f'<g fill="{colour}"><circle class="here" cx="{x:.1f}" cy="{y:.1f}" r="5"/></g>'
            + _label("name", x, y - 8.0, f"{one.number}: {found.minute(one.time_s)[11:]}", x < x0)
        )
    parts += reversed(names)
    for k, (x, y) in enumerate(frame.at(targets), start=1):
        parts.append(
            f'<g class="target"><path d="M{x:.1f} {y - 7:.1f}l7 7l-7 7l-7-7z"/></g>'
            + _label("", x, y + 4.0, f"target {k}", False)
        )
    parts.append(
        f'<g class="start"><rect x="{x0 - 5:.1f}" y="{y0 - 5:.1f}" width="10" height="10"/></g>'
        + _label("", x0, y0 + 4.0, f"start {str(place.time)[11:16]}", west < 0)
    )
    return "\n".join([*parts, _scale_bar(METRES_PER_DEGREE / frame.scale), "</svg>"])


def _label(kind: str, x: float, y: float, words: str, left: bool) -> str:
    """SVG text beside a point."""
    at, anchor = (x - 10.0, "end") if left else (x + 10.0, "start")
    return f'<text class="{kind}" x="{at:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'


def _points(points: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _land(frame: MapFrame) -> list[str]:
    """The coast in and around the view."""
    from matplotlib.path import Path as Ring
    from matplotlib.transforms import Bbox

    from twin.show.figures import NEIGHBOURS, rings

    reach = WIDER * frame.span * max(1.0, WIDTH / HEIGHT / frame.shrink)
    box = Bbox([frame.middle - reach, frame.middle + reach])
    found = []
    for ring in rings():
        for turn in NEIGHBOURS:
            moved = ring + np.array([turn, 0.0])
            if (moved.max(axis=0) > box.min).all() and (moved.min(axis=0) < box.max).all():
                inside = Ring(moved).clip_to_bbox(box)
                inside.should_simplify = False
                parts = (frame.at(np.asarray(part, float)) for part in inside.to_polygons())
                found += [f"M{_points(part)}z" for part in parts]
    return [f'<path class="land" fill-rule="evenodd" d="{"".join(found)}"/>'] if found else []


def _graticule(frame: MapFrame) -> list[str]:
    """Lines of latitude and longitude with their degrees and minutes."""
    step = next((m for m in STEPS if m >= 15.0 * frame.span), STEPS[-1]) / 60.0
    parts = ['<g class="grid">']
    for axis, letters in enumerate(("EW", "NS")):
        middle = frame.middle[axis]
        reach = 0.5 * frame.span * (WIDTH / HEIGHT / frame.shrink if axis == 0 else 1.0)
        first = math.ceil((middle - reach) / step)
        for k in range(first, math.floor((middle + reach) / step) + 1):
            point = frame.middle.copy()
            point[axis] = k * step
            x, y = frame.at(point[None])[0]
            value = (k * step + 180.0) % 360.0 - 180.0 if axis == 0 else k * step
            whole, rest = divmod(round(abs(value) * 60.0, 2), 60.0)
            name = f"{whole:.0f}\N{DEGREE SIGN} {rest:g}' {letters[value < 0.0]}"
            if axis == 0:
                spare = ' class="spare"' if k % 2 else ""  # hidden on narrow screens
                parts += [
                    f'<path d="M{x:.1f} 0V{HEIGHT:g}"/>',
                    f'<text{spare} x="{x + 3:.1f}" y="{HEIGHT - 6:g}">{name}</text>',
                ]
            else:
                parts += [
                    f'<path d="M0 {y:.1f}H{WIDTH:g}"/>',
                    f'<text x="4" y="{y - 4:.1f}">{name}</text>',
                ]
    return [*parts, "</g>"]


def _scale_bar(metres_per_pixel: float) -> str:
    """Scale bar of a round length, at most a fifth of the width."""
    rough = 0.2 * WIDTH * metres_per_pixel
    power = 10.0 ** math.floor(math.log10(rough))
    metres = max(m * power for m in (1.0, 2.0, 5.0) if m * power <= rough)
    name = f"{metres / 1e3:g} km" if metres >= 1e3 else f"{metres:g} m"
    right, y = WIDTH - 24.0, 30.0
    left = right - metres / metres_per_pixel
    return (
        f'<g class="scale"><path d="M{left:.1f} {y - 5:g}V{y:g}H{right:g}V{y - 5:g}"/>'
        f'<text x="{0.5 * (left + right):.1f}" y="{y - 9:g}">{name}</text></g>'
    )


INDEX, DOCUMENT, GEOJSON = "index.html", "forecast.json", "forecast.geojson"
FILES = (INDEX, DOCUMENT, GEOJSON)

STYLE = """:root { color-scheme: light; --ink: #1a1a1a; --dim: #5c6570; --line: #dde1e6;
  --ground: #fff; --shade: #0004; }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: var(--ink);
  background: #fff; max-width: 64rem; margin: 0 auto; padding: 1.5rem 1.25rem 3rem; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: 0 0 .25rem; }
p.lead, caption, footer { color: var(--dim); }
dl { display: grid; grid-template-columns: repeat(auto-fit, minmax(12rem, 1fr)); gap: .75rem;
  margin: 1rem 0; }
dl div { border: 1px solid var(--line); border-radius: 6px; padding: .6rem .8rem; }
dt { color: var(--dim); font-size: .85rem; }
dd { margin: 0; font-size: 1.2rem; font-variant-numeric: tabular-nums; }
table { border-collapse: collapse; font-size: .8rem; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .6rem .3rem 0; text-align: right; white-space: nowrap;
  border-bottom: 1px solid var(--line); }
th { color: var(--dim); font-weight: 600; vertical-align: bottom; }
th:last-child, td:last-child { padding-right: 0; }
svg { width: 100%; height: auto; border: 1px solid var(--line); border-radius: 6px;
  touch-action: pan-y pinch-zoom; cursor: grab; display: block; --unit: 1; }
svg text { font: calc(13px * var(--unit)) system-ui, "DejaVu Sans", sans-serif; fill: var(--ink);
  paint-order: stroke; stroke: #fff; stroke-width: 3px; }
.sea { fill: #eef4f8; } .land { fill: #e8e2d0; stroke: #8c8570; stroke-width: 1; }
.grid path { stroke: #c5d0d9; stroke-width: .8; } .grid text { fill: var(--dim);
  font-size: calc(11px * var(--unit)); }
.track { fill: none; stroke: #333; stroke-width: 1.6; stroke-dasharray: 5 3; }
.ninety { fill-opacity: .12; stroke-width: 1.2; }
.half { fill-opacity: .2; stroke-width: 1.2; }
.member { fill-opacity: .55; stroke: none; } .here { stroke: #fff; stroke-width: 1.5; }
.name { font-weight: 600; }
.target path { fill: #fff; stroke: #000; stroke-width: 1.5; } .start rect { fill: #000; }
.scale path { fill: none; stroke: #000; stroke-width: 1.5; } .scale text { text-anchor: middle; }
svg * { vector-effect: non-scaling-stroke; }
@media (max-width: 40rem) { body { padding: 1rem .75rem 2rem; } svg { --unit: 2.6; }
  .grid .spare { display: none; } }
"""

SCRIPT = """
const map = document.getElementById("map"), box = map.viewBox.baseVal;
// Words keep their size on the screen, on a phone and where the map is zoomed.
const fit = () => map.style.setProperty("--unit", box.width / map.getBoundingClientRect().width);
addEventListener("resize", fit);
fit();
map.addEventListener("wheel", event => {
  event.preventDefault();
  const by = event.deltaY > 0 ? 1.15 : 1 / 1.15, frame = map.getBoundingClientRect();
  const x = box.x + (event.clientX - frame.left) / frame.width * box.width;
  const y = box.y + (event.clientY - frame.top) / frame.height * box.height;
  box.x = x + (box.x - x) * by; box.y = y + (box.y - y) * by;
  box.width *= by; box.height *= by;
  fit();
}, { passive: false });
map.addEventListener("pointermove", event => {
  if (!event.buttons) return;
  const frame = map.getBoundingClientRect();
  box.x -= event.movementX / frame.width * box.width;
  box.y -= event.movementY / frame.height * box.height;
});
"""


def check_forecast_target(folder: Path) -> None:
    """Refuse, before anything is flown, a folder that a forecast cannot be written to.

    Raises:
      WriteError: something that is no forecast is in the way.
    """
    check_folder_target(folder, overwrite=True, ours=_is_forecast)


def write_forecast(found: Forecast, folder: Path, *, reload_s: float | None = None) -> Path:
    """Write page, JSON and GeoJSON; an earlier forecast there is replaced at once.

    Args:
      reload_s: [s] time after which a browser loads the page again; None: never.

    Raises:
      WriteError: something that is no forecast is in the way, or the disk refuses.
    """
    with whole_folder(folder, overwrite=True, ours=_is_forecast) as place:
        (place / INDEX).write_text(page(found, reload_s=reload_s), encoding="utf-8")
        for name, data in ((DOCUMENT, found.describe()), (GEOJSON, found.geojson())):
            (place / name).write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    return folder / INDEX


def page(found: Forecast, *, reload_s: float | None = None) -> str:
    """Make the HTML text of the page."""
    from twin.show import html_page

    request, place = found.request, found.request.place
    title = f"{request.vehicle.name}: the next surfacings"
    state = "" if found.complete else f", {found.flown} of {request.members} members"
    state += " so far" if state and reload_s is not None else ""
    lead = (
        f"{request.mission.name}, from {place.latitude_deg:.4f}, {place.longitude_deg:.4f} at "
        f"{place.time} UTC, {request.hours:g} h ahead{state}"
    )
    again = "" if reload_s is None else f'<meta http-equiv="refresh" content="{reload_s:g}">\n'
    facts = {
        "members": f"{found.flown}" + (f" ({found.failed} failed)" if found.failed else ""),
        "energy per day": found.energy_per_day,
        "days left": "-" if found.days_left is None else f"{found.days_left:.1f}",
        **{f"drawn: {name}": words for name, words in found.spread.items()},
    }
    cells = "".join(
        f"<div><dt>{_text(name)}</dt><dd>{_text(value)}</dd></div>" for name, value in facts.items()
    )
    body = (
        f'<h1>{_text(title)}</h1>\n<p class="lead">{_text(lead)}</p>\n'
        f"{draw_map(found)}\n"
        '<p class="lead">Ellipses hold 50 and 90 % of the surfacings; the table has their '
        "semi-axes, from the middle to the edge, and the bearing of the longer. "
        "Dots are members, the broken line is the mean of what is known. "
        "Coast: Natural Earth 1:50m, coarse.</p>\n"
        f"{_table(found)}\n<dl>{cells}</dl>\n<script>{SCRIPT}</script>"
    )
    return html_page(title, body, style=STYLE, head=again)


def _table(found: Forecast) -> str:
    rows = [forecast_row(found, one) for one in found.surfacings]
    said = [*found.request.notes(), *found.remarks, found.bounds_known]
    note = "".join(f"<p>{_text(one)}</p>" for one in said if one)
    if not rows:
        return note or f"<p>No surfacing within {found.request.hours:g} h.</p>"
    lines = [f"<th>{'</th><th>'.join(map(_text, rows[0]))}</th>"]
    lines += [f"<td>{'</td><td>'.join(map(_text, one.values()))}</td>" for one in rows]
    table = "".join(f"<tr>{line}</tr>" for line in lines)
    return f'<div class="scroll"><table>{table}</table></div>{note}'


def forecast_row(found: Forecast, one: Surfacing) -> Mapping[str, str]:
    """Cells of a surfacing's row in a table, by their headings."""
    half, most = (
        f"{e.semi_major_m / 1e3:.2f} x {e.semi_minor_m / 1e3:.2f} km, "
        f"{e.bearing_deg:.0f}\N{DEGREE SIGN}"
        for e in (one.ellipse(HALF), one.ellipse(NINETY))
    )
    return {
        "surfacing": f"{one.number}",
        "UTC": found.minute(one.time_s),
        "5 to 95 %": found.bounds(one),
        "latitude": f"{one.latitude:.4f}",
        "longitude": f"{one.longitude:.4f}",
        "50 % semi-axes": half,
        "90 % semi-axes": most,
        "energy": f"{one.energy_kj:.1f} kJ",
        "members": f"{100.0 * one.part:.0f} %",
    }


def _is_forecast(folder: Path) -> bool:
    """Return whether a folder holds a forecast and nothing else."""
    return {INDEX} <= {path.name for path in folder.iterdir()} <= {*FILES, LIST}


def _text(text: str) -> str:
    return html.escape(printable(text), quote=True)
