"""Forecast page: a forecast as one HTML file with a map, which opens without a network."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from pathlib import Path

from glider_twin_ops.forecast.member_flights import HALF, NINETY, Surfacing
from glider_twin_ops.forecast.surfacing_forecast import Forecast
from glider_twin_ops.pages import surfacing_map
from twin.cli import printable
from twin.records.storage import LIST, check_folder_target, whole_folder

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
@media (max-width: 40rem) { body { padding: 1rem .75rem 2rem; } }
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
        f"{surfacing_map.draw_map(found)}\n"
        '<p class="lead">Ellipses hold 50 and 90 % of the surfacings; the table has their '
        "semi-axes, from the middle to the edge, and the bearing of the longer. "
        "Dots are members, the broken line is the mean of what is known. "
        "Coast: Natural Earth 1:50m, coarse.</p>\n"
        f"{_table(found)}\n<dl>{cells}</dl>\n<script>{surfacing_map.SCRIPT}</script>"
    )
    return html_page(title, body, style=STYLE + surfacing_map.STYLE, head=again)


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
