"""Morning page: one HTML file that needs no network; beside it JSON, a text for e-mail, GeoJSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.forecast import Forecast, notice_boxes
from glider_twin_ops.forecast.member_flights import NINETY
from glider_twin_ops.forecast.surfacing_forecast import boxes_text, collection
from glider_twin_ops.health import CHANNELS, DeploymentHealth
from glider_twin_ops.pages.daily_page import (
    DailyPage,
    arrival_text,
    distance_text,
    fix_text,
    too_late_text,
)
from glider_twin_ops.pages.figures import (
    channel_figures,
    evidence_figure,
    mail_figure,
    track_figure,
    water_figure,
)
from glider_twin_ops.pages.forecast_page import forecast_row
from glider_twin_ops.pages.log_pages import kind_facts
from glider_twin_ops.watching.changes import sentence, state_in_words
from glider_twin_ops.watching.dive_table import polar
from glider_twin_ops.watching.expected_plan import NAMES, ProposedFiles
from glider_twin_ops.watching.morning import Morning
from twin.cli import counted, one_line, printable
from twin.errors import StoreError
from twin.records.coordinates import utc_minute
from twin.records.storage import damaged_files
from twin.show import Page

PAGE = "page"
LATEST, SUMMARY, GEOJSON = "latest.json", "summary.txt", "forecast.geojson"
ROUTES = "routes.geojson"
BOXES, BOXES_TEXT, MAIL = "boxes.geojson", "boxes.txt", "mail"
BESIDE = (LATEST, SUMMARY, GEOJSON, ROUTES, BOXES, BOXES_TEXT, *NAMES)
DAY, KILO = 86400.0, 1e3
SHOWN = 4
"""Number of channels of health that are drawn: those farthest from their level"""
UNITS = {"Pa": ("MPa", 1e-6)}
"""Unit and factor in which the table of energy shows a unit"""
RATES = ("rate_dive", "rate_climb", "pump_rate", "hotel")
"""Channels whose sentences come first"""


def write_morning(
    told: Morning,
    folder: Path,
    *,
    new: Sequence[str],
    made: Mapping[str, Any],
    as_of: str = "",
    came: Sequence[str] = (),
) -> Path:
    """Write `folder/page`, in place of the page before.

    Args:
      new: sentences on changes since that page.
      made: provenance of the page, for `latest.json`.
      as_of: moment up to which dives count; empty: all dives.
      came: sentences that compare a past page's forecast with what came.

    Raises:
      WriteError: something that is no page is in the way, or the disk refuses.
    """
    lead = [told.deployment] * bool(told.deployment)
    lead += [f"with {told.vehicle.name}"] if told.vehicle else []
    lead += [f"as of {as_of} UTC"] if as_of else []
    leads = [" ".join(lead) or told.title]
    if told.dives:
        leads.append(f"{counted(len(told.dives), 'dive')}, {len(told.legs)} from fix to fix")
    verdict = told.verdict
    if told.health is not None and told.health.alarm:  # which vehicle judged goes to the lead
        verdict, *qualified = verdict.split("; ")
        leads += qualified
    page = DailyPage(folder / PAGE, verdict, "; ".join(leads), beside=BESIDE)
    page.top(told)
    if new:
        page.section("New since the page before")
        page.points(new)
    if told.table:
        page.section("Dives")
        page.table(
            [one.row() for one in reversed(told.table)],
            f"The last {counted(len(told.table), 'dive')} of {len(told.dives)}, the newest first. "
            "Way and speed over ground are from fix to fix; the current is the dive's mean.",
        )
    if (said := told.dialogue) is not None:
        page.section("Said at its last surfacing")
        page.say(f"{said.vehicle}, {utc_minute(said.time)} UTC by its clock.")
        page.facts(said.facts())
    if (flown := told.surfacings) is not None:
        _forecast(page, told, flown)
    if told.missing:
        page.section("What is missing")
        page.points(told.missing)
    if came:
        page.section("What came")
        page.points(came)
    if told.legs:
        page.section("Track and currents")
        page.pair(
            [
                (
                    "deployment",
                    track_figure(told.legs),
                    "All dives: fixes, straight lines between those that begin and end a dive, and "
                    "its mean current.",
                ),
                (
                    "current",
                    water_figure(told.legs),
                    "Mean current of each dive: its way over ground less its way through the "
                    "water.",
                ),
            ]
        )
    if told.health is not None:
        _health(page, told, told.health)
    if told.followed is not None:
        page.section("Parameters")
        page.table(
            told.parameters(),
            f"Followed over the last {counted(len(told.followed_dives), 'dive')} from the vehicle "
            "file's values on, by depth rates and pitches.",
            first=False,
        )
    _energy(page, told)
    if told.routes is not None:
        page.section("Routes")
        page.say(
            f"To the next place, {told.routes.speed:.2f} m/s through the water at "
            f"{told.routes.pitch_deg:.0f} degree: {told.routes.verdict()}."
        )
        page.table(
            [one.row() for one in told.routes.routes],
            "Hours and gain over the straight way with intervals of 90 % over draws of the water, "
            "by the twin's speed at each pitch. Corners of each, for `goto`:",
        )
        page.facts({one.name: one.goto for one in told.routes.routes})
        page.attach(ROUTES, json.dumps(told.routes.geojson(), indent=1) + "\n")
    if told.proposed is not None:
        _proposal(page, told, told.proposed)
    page.attach(LATEST, json.dumps({**made, **told.describe()}, indent=1) + "\n")
    lines = summary(told, new)
    page.attach(SUMMARY, lines)
    verdict, *rest = lines.splitlines()
    page.picture(MAIL, mail_figure(verdict, rest, told.legs, told.surfacings))
    boxes = [] if flown is None else notice_boxes(flown)
    page.attach(BOXES_TEXT, boxes_text(boxes, told.deployment or told.title))
    for name, features in (
        (GEOJSON, [] if flown is None else flown.geojson()["features"]),
        (BOXES, [one.feature() for one in boxes]),
    ):
        page.attach(name, json.dumps(collection(features), indent=1) + "\n")
    return page.write()


def _proposal(page: Page, told: Morning, proposed: ProposedFiles) -> None:
    page.section("Proposal")
    page.say(
        "The plan above as files for the vehicle, which lie beside this page. They were read back, "
        "and the forecast flies what they say. Nothing is sent: read them, and send them yourself."
    )
    if told.changes:
        page.table(told.changes, "What its last dives did, and what the files ask:", first=False)
    for name, text in proposed.files.items():
        page.say(name)
        page.code(text)
        page.attach(name, text)
        if name in proposed.changes:
            page.say(f"Against the {name} in the source, which it flies now:")
            page.code(proposed.changes[name] or "no difference\n")


def read_latest(folder: Path) -> dict[str, Any] | None:
    """Read `latest.json` of the page before; None without one, or where it was changed."""
    try:
        if any(damaged_files(folder / PAGE, [LATEST])):
            return None
        found = json.loads((folder / PAGE / LATEST).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError, StoreError):
        return None
    return found if isinstance(found, dict) and {"made_of", "parts", "new"} <= {*found} else None


def summary(told: Morning, new: Sequence[str]) -> str:
    """Text for an e-mail, ten lines at most."""
    lines = [told.verdict]
    if told.dives:
        said_of = f"{counted(len(told.dives), 'dive')} of {told.deployment}"
        lines.append(f"{said_of}, {len(told.legs)} from fix to fix")
        if told.legs:
            speed, course = polar(*told.legs[-1].leg.current.tolist())
            lines[-1] += f"; current of the last {speed:.2f} m/s towards {course:03.0f} degree"
    if (fix := told.last_fix) is not None:
        lines.append(f"Last fix {fix_text(fix)}")
    if (said := told.dialogue) is not None and said.why:
        lines[-1] += f"; came up because of: {said.why}" + (
            f", {counted(said.aborts, 'abort')} since its reset" if said.aborts else ""
        )
    if (way := told.arrival) is not None:
        lines[-1] += f"; waypoint {distance_text(way)}, arrival {arrival_text(way)}"
    if (found := told.surfacings) is not None and found.surfacings:
        one, ellipse = found.surfacings[0], found.surfacings[0].ellipse(NINETY)
        lines += [
            f"Next surfacing {found.minute(one.time_s)} UTC "
            f"({found.bounds(one)}) at {one.latitude:.4f}, {one.longitude:.4f}, 90 % within "
            f"{ellipse.semi_major_m / KILO:.1f} x {ellipse.semi_minor_m / KILO:.1f} km "
            f"(semi-axes, the longer towards {ellipse.bearing_deg:.0f})",
            f"Taken to go {told.plan}",
        ]
    words = state_in_words(told)
    lines.append(sentence("; ".join(words[name] for name in RATES[:2] if name in words)))
    readings = [f"{one.what} {one.text()}" for one in told.readings]
    lines.append(sentence("; ".join([*filter(None, [_power(told)]), *readings])))
    lines += list(new[:2])
    if told.missing:
        more = len(told.missing) - 1
        lines.append(f"Missing: {told.missing[0]}" + (f" (and {more} more)" if more else ""))
    return "\n".join([printable(one_line(line)) for line in lines if line][:10]) + "\n"


def _power(told: Morning) -> str:
    if told.used is None:
        return ""
    said = f"{told.used.power:.2f} W so far"
    if told.lasts is None:
        return said
    said += (
        f", {told.lasts.power:.2f} W to come: {told.lasts.days:.1f} days left (90 %: "
        f"{told.lasts.between()})"
    )
    fix, outlook = told.last_fix, told.outlook
    if fix is not None and outlook is not None and (home := outlook.home) is not None:
        said += (
            f"; turn home by {utc_minute(fix.time + home.safe_days * DAY)} UTC"
            if home.safe
            else f"; {too_late_text(home.reached)}"
        )
    return said


def _forecast(page: Page, told: Morning, found: Forecast) -> None:
    page.section("Next surfacings")
    page.say(f"Taken to go {told.plan}.")
    if found.surfacings:
        page.table(
            [forecast_row(found, one) for one in found.surfacings],
            "Ellipses hold 50 and 90 % of the surfacings; their semi-axes are from the middle to "
            "the edge, with the bearing of the longer.",
        )
    elif not found.left_out:
        page.say(f"No surfacing within {found.request.hours:g} h.")
    said = [one for one in (*found.remarks, found.bounds_known) if one]
    if said:
        page.points(said)
    page.facts(found.spread)
    page.say("Boxes of twelve hours for authorities, which also lie beside this page:")
    page.code(boxes_text(notice_boxes(found), told.deployment))


def _health(page: Page, morning: Morning, health: DeploymentHealth) -> None:
    page.section("Health")
    if health.alarm:
        first = health.kinds[0]
        noticed: dict[str, object] = {"what": first.says, "noticed after dive": health.noticed_dive}
        page.facts(noticed | kind_facts(first))
        page.table(health.likeliest(), "If there is a fault, which one:")
    words = state_in_words(morning)
    if said := [sentence(words[name]) for name in RATES if name in words]:
        page.points(said)
    told = [k for k, channel in enumerate(CHANNELS) if channel.name not in health.lacking]
    if told and len(health.dives):
        if np.isfinite(health.evidence).any():
            page.figure(
                "evidence",
                evidence_figure(health),
                "Log of the odds of a fault after each dive, and the level of an alarm.",
            )
        innovations = (health.levels.innovation[:, k] for k in told)
        known = (one[np.isfinite(one)] for one in innovations)
        last = {k: float(one[-1]) if one.size else None for k, one in zip(told, known, strict=True)}
        off = sorted(told, key=lambda k: -abs(last[k] or 0.0))
        page.say("What is farthest from its level, each dive and the level:")
        page.pair(channel_figures(health, off[:SHOWN], "health"))
        page.table(
            [
                {
                    "channel": CHANNELS[k].name,
                    "in words": words.get(CHANNELS[k].name) or f"{CHANNELS[k].says}: not known now",
                    "level": float(health.levels.level[-1, k]),
                    "deviation": float(health.levels.deviation[-1, k]),
                    "unit": CHANNELS[k].unit,
                    "last innovation": last[k],
                }
                for k in told
            ],
            "Levels after the last dive. An innovation is a dive's value less the level before it, "
            "over its deviation.",
            first=False,
        )
    if health.remarks:
        page.points(health.remarks)
    if health.lacking:
        told_by = f"{len(CHANNELS) - len(health.lacking)} of {len(CHANNELS)} channels"
        page.say(f"Judged by {told_by}. Not told by this log: {', '.join(health.lacking)}.")


def _energy(page: Page, told: Morning) -> None:
    if told.used is None:
        return
    page.section("Energy")
    page.say(f"Over {told.used.hours:.1f} h {_power(told)}.")
    if told.outlook is not None and told.outlook.rows:
        page.table(
            [one.row() for one in told.outlook.rows],
            "Days left with what the dives so far took, and with what the twin says that a change "
            "of the plan adds to it.",
        )
    if told.outlook is not None and (home := told.outlook.home) is not None:
        said = (
            f"Going on as planned, 95 of 100 draws still get there if it turns within "
            f"{home.safe_days:.1f} days of the last fix, half of them within {home.days:.1f}"
            if home.safe
            else f"If it turns at the last fix, {100.0 * home.reached:.0f} of 100 draws get there"
        )
        page.say(
            f"Home is {home.away_km:.1f} km away. {said}: by a straight way against the mean "
            "current so far."
        )
    total = sum(one.energy for one in told.used.terms)
    units = {one.name: UNITS.get(one.unit, (one.unit, 1.0)) for one in told.used.terms}
    page.table(
        [
            {
                "consumer": one.name,
                "factor": one.value * units[one.name][1],
                "deviation": (
                    None if np.isnan(one.deviation) else one.deviation * units[one.name][1]
                ),
                "unit": units[one.name][0],
                "energy [kJ]": one.energy / 1e3,
                "part": one.energy / total if total > 0.0 else None,
            }
            for one in told.used.terms
        ],
        "By the log's counter of charge; without a deviation the factor is the vehicle file's.",
        first=False,
    )
