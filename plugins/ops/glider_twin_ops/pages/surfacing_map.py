"""Surfacing map: one SVG with the next surfacings, the last dives with their currents, and coast.

The map's scale is equal north and east of the view's middle. With `SCRIPT`, wheel and drag zoom and
move the map; without the script it is a picture. `STYLE` has its colours, light and dark.
"""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

import numpy as np

from glider_twin_ops.forecast import Forecast, LoggedLeg
from glider_twin_ops.forecast.member_flights import HALF, NINETY, degrees
from twin.numbers import Array
from twin.records.coordinates import utc_minute

WIDTH, HEIGHT = 960.0, 640.0
"""[px] of the view box"""
MARGIN, NEAR, LEAST_SPAN = 1.25, 1.5, 0.02
"""MARGIN: view over the extent that must be seen. NEAR: extents beyond which a target is left
outside the first view. LEAST_SPAN: [degree] smallest latitude shown, 2 km"""
MOST_DOTS = 400
"""Maximum number of members drawn for a surfacing"""
WIDER = 12.0
"""Number of view heights around the middle in which the coast is drawn, for zooming out"""
METRES_PER_DEGREE = 111_195.0
STEPS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800)
"""[minute] Steps between lines of latitude and longitude"""
LINES = 5.0
"""Maximum number of lines of latitude in a view"""
COLOURS = ("#0072b2", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#e69f00")
"""Colours of surfacings in turn: Okabe and Ito's, which colour-blind readers can distinguish"""
CLOSE = 4
"""Number of last dives that the first view holds, and whose currents have arrows"""
LONGEST_ARROW, HEAD = 90.0, 15.0
"""[px] LONGEST_ARROW: length of the strongest current's arrow. HEAD: length of an arrow's head"""
ROUND_SPEEDS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""[m/s] Speeds of the arrow in the key"""
APART = 18.0
"""[px] Smallest distance between the lines of two labels"""
CROWDED = 40.0
"""[px] Distance of surfacings whose names stand in one column beside them all"""


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


def draw_map(
    found: Forecast | None,
    legs: Sequence[LoggedLeg] = (),
    *,
    start: str = "start",
    goal: str = "target {}",
) -> str:
    """Draw the map as an SVG element.

    Args:
      found: forecast; None: the dives alone.
      legs: dives before it, at least one without a forecast. The first view then holds the last
        ones and the next surfacing; without them it holds every ellipse.
      start: name of the place where the forecast begins, or the last dive ended.
      goal: name of each target, with `{}` for its number.
    """
    if found is None:
        begin = np.array([legs[-1].end[::-1]])
        time = utc_minute(legs[-1].leg.end)[11:]
        rings, track, targets = [], begin[:0], begin[:0]
    else:
        place = found.request.place
        begin = np.array([[place.longitude_deg, place.latitude_deg]])
        time = str(place.time)[11:16]
        rings = [one.ring(NINETY, place) for one in found.surfacings]
        track, targets = found.track, found.targets()
    dives = np.array([[one.begin[::-1], one.end[::-1]] for one in legs]).reshape(-1, 2, 2)
    dives[..., 0] -= 360.0 * np.round((dives[..., 0] - begin[0, 0]) / 360.0)  # one side of 180
    seen = [ring if not (k and legs) else ring.mean(axis=0)[None] for k, ring in enumerate(rings)]
    last = dives[-CLOSE:].reshape(-1, 2)
    frame = MapFrame(np.concatenate([begin, track, last, *seen]), targets)
    parts = [*_ground(frame), *_dives(frame, dives, legs)]
    if len(track) > 1:
        parts.append(f'<polyline class="track" points="{_points(frame.at(track))}"/>')
    x0, y0 = frame.at(begin)[0]
    east = True
    if found is not None and rings:
        drawn, east = _surfacings(frame, found, rings, x0)
        parts += drawn
    parts += _targets(frame, targets, goal)
    parts.append(
        f'<g class="start"><rect x="{x0 - 5:.1f}" y="{y0 - 5:.1f}" width="10" height="10"/></g>'
        + _label("", x0, y0 + 4.0, f"{start} {time}", not east)
    )
    parts.append(_scale_bar(METRES_PER_DEGREE / frame.scale))
    return "\n".join([*parts, *_arrows(frame, dives[-CLOSE:], legs[-CLOSE:]), "</svg>"])


def _ground(frame: MapFrame) -> list[str]:
    """Begin the SVG: sea, land, lines of latitude and longitude."""
    wide = (2 * WIDER + 1) * WIDTH, (2 * WIDER + 1) * HEIGHT
    return [
        f'<svg id="map" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        f'aria-label="map of the next surfacings" xmlns="http://www.w3.org/2000/svg">',
        f'<rect x="{-WIDER * WIDTH:g}" y="{-WIDER * HEIGHT:g}" width="{wide[0]:g}" '
        f'height="{wide[1]:g}" class="sea"/>',
        *_land(frame),
        *_graticule(frame),
    ]


def _surfacings(
    frame: MapFrame, found: Forecast, rings: Sequence[Array], x0: float
) -> tuple[list[str], bool]:
    """Ellipses, members and names of the surfacings, and whether the start's name goes east."""
    place = found.request.place
    places = np.array([[one.north, one.east] for one in found.surfacings])
    middles = frame.at(degrees(places, place))
    left = middles[:, 0] < x0
    parts: list[str] = []
    marks: list[str] = []
    names: list[str] = []
    taken: dict[bool, list[float]] = {True: [], False: []}
    for one, ring, (x, y), to_left in zip(found.surfacings, rings, middles, left, strict=True):
        colour = COLOURS[(one.number - 1) % len(COLOURS)]
        title = f"surfacing {one.number}: {found.moment(one.time_s)} UTC"
        dots = frame.at(degrees(one.members[:MOST_DOTS], place))
        later = " later" if one.number > 1 else ""
        parts[:0] = [  # the first surfacing lies on top
            f'<g class="surfacing{later}" fill="{colour}" stroke="{colour}">'
            f"<title>{html.escape(title)}</title>",
            f'<polygon class="ninety" points="{_points(frame.at(ring))}"/>',
            f'<polygon class="half" points="{_points(frame.at(one.ring(HALF, place)))}"/>',
            *(f'<circle class="member" cx="{x:.1f}" cy="{y:.1f}" r="1.6"/>' for x, y in dots),
            "</g>",
        ]
        marks.insert(
            0, f'<g fill="{colour}"><circle class="here" cx="{x:.1f}" cy="{y:.1f}" r="5"/></g>'
        )
        side, line = bool(to_left), float(y) - 6.0
        while any(abs(line - other) < APART for other in taken[side]):
            line -= APART
        taken[side].append(line)
        near = middles[(left == to_left) & (np.abs(middles - [x, y]).max(axis=1) < CROWDED), 0]
        edge = near.min() if side else near.max()  # beside all middles that are near
        words = f"{one.number}: {found.minute(one.time_s)[11:]}"
        names.append(_label(f"name{later}", edge, line, words, side))
    return [*parts, *marks, *names], bool(left.mean() >= 0.5)


def _dives(frame: MapFrame, dives: Array, legs: Sequence[LoggedLeg]) -> list[str]:
    """Lines from fix to fix, and the fixes with their times."""
    parts = []
    for one, (begin, end) in zip(legs, map(frame.at, dives), strict=True):
        parts += [
            f'<polyline class="dive" points="{_points(np.stack([begin, end]))}"/>',
            f'<circle class="fix" cx="{end[0]:.1f}" cy="{end[1]:.1f}" r="3.5">'
            f"<title>fix {utc_minute(one.leg.end)} UTC</title></circle>",
        ]
    return parts


def _arrows(frame: MapFrame, dives: Array, legs: Sequence[LoggedLeg]) -> list[str]:
    """Mean current of each dive as an arrow from the dive's middle, and a key with its speed."""
    currents = np.array([one.leg.current for one in legs]).reshape(-1, 2)
    known = np.isfinite(currents).all(axis=1)
    if not known.any():
        return []
    most = max(float(np.hypot(*currents[known].T).max()), ROUND_SPEEDS[0])
    scale = LONGEST_ARROW / most
    middles = frame.at(dives[known].mean(axis=1))
    parts = ['<g class="current"><title>mean current of each dive</title>']
    parts += [
        _arrow(x, y, scale * east, -scale * north)
        for (x, y), (north, east) in zip(middles, currents[known], strict=True)
    ]
    speed = max(one for one in ROUND_SPEEDS if one <= most)
    right, y = WIDTH - 24.0, 80.0
    left = right - scale * speed
    name = _label("", left, y + 4.0, f"current {speed:g} m/s", True)
    return [*parts, _arrow(left, y, right - left, 0.0), "</g>", name]


def _arrow(x: float, y: float, right: float, down: float) -> str:
    length = max(math.hypot(right, down), 1e-9)
    along, across = np.array([right, down]) / length, np.array([-down, right]) / length
    tip, head = np.array([x + right, y + down]), min(HEAD, 0.6 * length)
    back = tip - head * along
    corners = np.stack([tip, back + 0.45 * head * across, back - 0.45 * head * across])
    return (
        f'<path d="M{x:.1f} {y:.1f}L{back[0]:.1f} {back[1]:.1f}"/>'
        f'<polygon points="{_points(corners)}"/>'
    )


def _targets(frame: MapFrame, targets: Array, goal: str) -> list[str]:
    """Draw targets; a first one outside of the view has an arrow at the edge."""
    parts = []
    for k, (x, y) in enumerate(frame.at(targets), start=1):
        parts.append(
            f'<g class="target"><path d="M{x:.1f} {y - 7:.1f}l7 7l-7 7l-7-7z"/></g>'
            + _label("", x, y + 4.0, goal.format(k), False)
        )
        off = np.array([x, y]) - [0.5 * WIDTH, 0.5 * HEIGHT]
        beyond = float(np.max(np.abs(off) / [0.5 * WIDTH - 12.0, 0.5 * HEIGHT - 24.0]))
        if k == 1 and beyond > 1.0:
            way = 26.0 * off / np.hypot(*off)
            x, y = off / beyond + [0.5 * WIDTH, 0.5 * HEIGHT] - way
            parts.append(f'<g class="bound">{_arrow(x, y, *way)}</g>')
            parts.append(_label("later", x, y + 20.0, goal.format(k), bool(way[0] > 0.0)))
    return parts


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
    step = next((m for m in STEPS if LINES * m >= 60.0 * frame.span), STEPS[-1]) / 60.0
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
    right, y = WIDTH - 24.0, 46.0
    left = right - metres / metres_per_pixel
    return (
        f'<g class="scale"><path d="M{left:.1f} {y - 5:g}V{y:g}H{right:g}V{y - 5:g}"/>'
        f'<text x="{0.5 * (left + right):.1f}" y="{y - 9:g}">{name}</text></g>'
    )


STYLE = """:root { --sea: #eef4f8; --land: #e8e2d0; --shore: #8c8570; --mesh: #c5d0d9;
  --strong: #000; --halo: #fff; --drift: #0072b2; }
svg { width: 100%; height: auto; border: 1px solid var(--line); border-radius: 6px;
  touch-action: pan-y pinch-zoom; cursor: grab; display: block; --unit: 1; }
svg text { font: calc(13px * var(--unit)) system-ui, "DejaVu Sans", sans-serif; fill: var(--ink);
  paint-order: stroke; stroke: var(--halo); stroke-width: 3px; }
.sea { fill: var(--sea); } .land { fill: var(--land); stroke: var(--shore); stroke-width: 1; }
.grid path { stroke: var(--mesh); stroke-width: .8; } .grid text { fill: var(--dim);
  font-size: calc(11px * var(--unit)); }
.track, .dive { fill: none; stroke: var(--ink); stroke-width: 1.6; stroke-dasharray: 5 3; }
.dive { stroke: var(--dim); stroke-width: 1; stroke-dasharray: none; }
.fix { fill: var(--ink); } .name { font-weight: 600; }
.current path { stroke: var(--drift); stroke-width: 2; } .current polygon { fill: var(--drift); }
.bound path { stroke: var(--strong); stroke-width: 2; } .bound polygon { fill: var(--strong); }
.ninety { fill-opacity: .12; stroke-width: 1.2; }
.half { fill-opacity: .2; stroke-width: 1.2; }
figure .surfacing.later polygon { fill-opacity: .04; stroke-opacity: .7; }
.member { fill-opacity: .55; stroke: none; } .here { stroke: var(--halo); stroke-width: 1.5; }
.target path { fill: var(--halo); stroke: var(--strong); stroke-width: 1.5; }
.start rect { fill: var(--strong); } .scale text { text-anchor: middle; }
.scale path { fill: none; stroke: var(--strong); stroke-width: 1.5; }
svg * { vector-effect: non-scaling-stroke; }
@media (max-width: 40rem) { svg { --unit: 2.6; } .grid .spare, svg text.later { display: none; } }
"""
"""Style of the map, which takes the colours --ink, --dim and --line of the page"""

SCRIPT = """
const map = document.getElementById("map"), box = map.viewBox.baseVal;
// Words keep their size on the screen, on a phone and where the map is zoomed.
const fit = () => map.style.setProperty("--unit", box.width / map.getBoundingClientRect().width);
addEventListener("resize", fit);
fit();
map.addEventListener("wheel", event => {
  if (map.closest("figure") && !event.ctrlKey) return;  // the wheel goes on down a longer page
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
"""Script of the page that holds the map; in a figure the wheel zooms with Ctrl alone"""
