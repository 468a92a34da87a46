"""Page: a forecast as one HTML file with its map, which opens anywhere without a network."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from pathlib import Path

from glider_twin_ops.forecast.surfacing import HALF, NINETY, Surfacing
from glider_twin_ops.forecast.surfacing_forecast import Forecast
from glider_twin_ops.pages.forecast_map import draw_map
from twin.cli import printable
from twin.navigation import Ellipse
from twin.records.storage import LIST, check_folder_target, whole_folder

INDEX, DOCUMENT, GEOJSON = "index.html", "forecast.json", "forecast.geojson"
FILES = (INDEX, DOCUMENT, GEOJSON)
HOUR = 3600.0

STYLE = """
:root { color-scheme: light; --ink: #1a1a1a; --dim: #5c6570; --line: #dde1e6;
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
      reload_s: after so many seconds a browser reads the page again; None: never.

    Raises:
      WriteError: something that is no forecast is in the way, or the disk refuses.
    """
    with whole_folder(folder, overwrite=True, ours=_is_forecast) as place:
        (place / INDEX).write_text(page(found, reload_s=reload_s), encoding="utf-8")
        for name, data in ((DOCUMENT, found.describe()), (GEOJSON, found.geojson())):
            (place / name).write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    return folder / INDEX


def page(found: Forecast, *, reload_s: float | None = None) -> str:
    """The HTML text."""
    from twin.show.figures import SHADED

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
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{again}<title>{_text(title)}</title>\n<style>{STYLE}{SHADED}</style></head>\n<body>\n"
        f'<h1>{_text(title)}</h1>\n<p class="lead">{_text(lead)}</p>\n'
        f"{draw_map(found)}\n"
        '<p class="lead">Ellipses hold 50 and 90 % of the surfacings; the table has their '
        "semi-axes, from the middle to the edge, and the bearing of the longer. "
        "Dots are members, the broken line is the mean of what is known. "
        "Coast: Natural Earth 1:50m, coarse.</p>\n"
        f"{_table(found)}\n<dl>{cells}</dl>\n<script>{SCRIPT}</script>\n</body></html>\n"
    )


def _table(found: Forecast) -> str:
    rows = [forecast_row(found, one) for one in found.surfacings]
    said = [*found.request.notes(), *found.remarks, found.bounds_known]
    note = "".join(f"<p>{_text(one)}</p>" for one in said if one)
    if not rows:
        return note or f"<p>No surfacing within {found.request.hours:g} h.</p>"
    head = "".join(f"<th>{_text(name)}</th>" for name in rows[0])
    lines = [
        "<tr>" + "".join(f"<td>{_text(value)}</td>" for value in one.values()) + "</tr>"
        for one in rows
    ]
    return f'<div class="scroll"><table><tr>{head}</tr>{"".join(lines)}</table></div>{note}'


def forecast_row(found: Forecast, one: Surfacing) -> Mapping[str, str]:
    """A surfacing as cells of a table, by their headings."""
    return {
        "surfacing": f"{one.number}",
        "UTC": found.minute(one.time_s),
        "5 to 95 %": found.bounds(one),
        "latitude": f"{one.latitude:.4f}",
        "longitude": f"{one.longitude:.4f}",
        "50 % semi-axes": _axes(one.ellipse(HALF)),
        "90 % semi-axes": _axes(one.ellipse(NINETY)),
        "energy": f"{one.energy_kj:.1f} kJ",
        "members": f"{100.0 * one.part:.0f} %",
    }


def _axes(ellipse: Ellipse) -> str:
    return (
        f"{ellipse.semi_major_m / 1e3:.2f} x {ellipse.semi_minor_m / 1e3:.2f} km, "
        f"{ellipse.bearing_deg:.0f}\N{DEGREE SIGN}"
    )


def _is_forecast(folder: Path) -> bool:
    """Whether a folder holds a forecast and nothing else."""
    names = {path.name for path in folder.iterdir()}
    return INDEX in names and names <= {*FILES, LIST}


def _text(text: str) -> str:
    return html.escape(printable(text), quote=True)
