"""Daily page: a page whose top has the next surfacing, waypoint, readings and map.

`daily.html` and `daily.css` are the template of the top.
"""

from __future__ import annotations

import math
from importlib.resources import files

from markupsafe import Markup

from glider_twin_ops.forecast.member_flights import NINETY
from glider_twin_ops.pages import surfacing_map
from glider_twin_ops.watching.dive_table import polar
from glider_twin_ops.watching.expected_plan import Arrival, LastFix
from glider_twin_ops.watching.morning import Morning
from twin.cli import printable
from twin.records.coordinates import utc_minute
from twin.show import Page

DAY, KILO = 86400.0, 1e3
MAP_CAPTION = (
    "Ellipses hold 50 and 90 % of each surfacing, dots are members, the broken line is the mean. "
    "Grey lines join the fixes of the last dives; arrows are their mean currents. Ctrl and the "
    "wheel zoom, dragging moves. Coast: Natural Earth 1:50m, coarse."
)


class DailyPage(Page):
    """Page with the next surfacing, the waypoint and the map at its top."""

    def top(self, told: Morning) -> None:
        """Fill the template with what is known."""
        chart = Markup()
        if told.surfacings is not None or told.legs:
            goal = "last course" if told.arrival is None else "waypoint {}"
            drawn = surfacing_map.draw_map(told.surfacings, told.legs, start="fix", goal=goal)
            form = "<figure>{}<figcaption>{}</figcaption></figure>\n<script>{}</script>"
            script = Markup(surfacing_map.SCRIPT)
            chart = Markup(form).format(Markup(drawn), MAP_CAPTION, script)
        facts = (Markup("<dt>{}</dt><dd>{}</dd>").format(*one) for one in _now(told).items())
        self._body.append(
            Markup(_file("daily.html")).format(
                style=Markup(surfacing_map.STYLE + _file("daily.css")),
                alone="" if chart else " alone",
                facts=Markup("").join(facts),
                chart=chart,
                **_next(told),
            )
        )


def _file(name: str) -> str:
    return files(__package__).joinpath(name).read_text("utf-8")


def _next(told: Morning) -> dict[str, str]:
    """Texts on the next surfacing; the reason where there is no forecast."""
    found = told.surfacings
    if found is None or not found.surfacings:
        why = next(iter(told.missing), "")
        if found is not None:
            why = found.left_out or f"no surfacing within {found.request.hours:g} h"
        texts = "Next surfacing", "not known", "", why
    else:
        one, ellipse = found.surfacings[0], found.surfacings[0].ellipse(NINETY)
        texts = (
            "Next surfacing",
            f"{_chart(one.latitude, 'NS')} {_chart(one.longitude, 'EW')}",
            f"{found.minute(one.time_s)} UTC ({found.bounds(one)})",
            f"{one.latitude:.4f}, {one.longitude:.4f}; 90 % within "
            f"{ellipse.semi_major_m / KILO:.1f} x {ellipse.semi_minor_m / KILO:.1f} km, the longer "
            f"towards {ellipse.bearing_deg:03.0f}",
        )
    names = "what", "where", "when", "within"
    return {name: printable(text) for name, text in zip(names, texts, strict=True)}


def _chart(value: float, letters: str) -> str:
    """Degrees and minutes of a latitude or longitude as charts write them."""
    whole, minutes = divmod(round(60.0 * abs(value), 2), 60.0)
    return f"{whole:.0f}\N{DEGREE SIGN}{minutes:05.2f}\N{PRIME}{letters[value < 0.0]}"


def _now(told: Morning) -> dict[str, str]:
    """Waypoint, last fix and readings: names and values."""
    found: dict[str, str] = {}
    if (way := told.arrival) is not None:
        found["waypoint"] = f"{distance_text(way)}, at {way.latitude:.4f}, {way.longitude:.4f}"
        found["arrival"] = arrival_text(way)
    elif told.surfacings is not None:
        found["waypoint"] = "not known; goto in deployment.toml names one"
    if (fix := told.last_fix) is not None:
        found["last fix"] = fix_text(fix)
    if told.legs:
        speed, towards = polar(*told.legs[-1].leg.current.tolist())
        until = utc_minute(told.legs[-1].leg.end)[5:]
        found["current"] = f"{speed:.2f} m/s towards {towards:03.0f}, mean of the dive to {until}"
    found |= {one.what: printable(one.text()) for one in told.readings}
    if told.used is not None:
        found["power"] = f"{told.used.power:.2f} W"
    if told.lasts is not None:
        found["days left"] = f"{told.lasts.days:.1f} (90 %: {told.lasts.between()})"
    if fix is not None and told.outlook is not None and (home := told.outlook.home) is not None:
        by = f"{utc_minute(fix.time + home.safe_days * DAY)} UTC"
        found["turn home"] = f"by {by}" if home.safe else too_late_text(home.reached)
    if told.plan:
        found["taken to go"] = told.plan.partition(". ")[0]
    return found


def too_late_text(reached: float) -> str:
    """Sentence on a turn home that comes too late, by the fraction of draws that get home."""
    return f"turning now, {100.0 * reached:.0f} of 100 draws get home"


def distance_text(way: Arrival) -> str:
    """Distance and bearing of a waypoint."""
    return f"{way.km:.1f} km towards {way.bearing:03.0f}"


def fix_text(fix: LastFix) -> str:
    """Time and place of a fix."""
    return f"{utc_minute(fix.time)} UTC at {fix.latitude:.4f}, {fix.longitude:.4f}"


def arrival_text(way: Arrival) -> str:
    """Time of arrival with its 90 % and the speed made good, or why there is none."""
    if math.isinf(way.time):
        return f"never: it makes {way.speed:.2f} m/s good towards it"
    late = "later than all draws" if math.isinf(way.late) else utc_minute(way.late)[5:]
    said = f"{utc_minute(way.time)} UTC (90 %: {utc_minute(way.early)[5:]} to {late})"
    goes_on = ", if it goes on so after the forecast" if way.beyond else ""
    return f"{said} at {way.speed:.2f} m/s made good{goes_on}"
