"""Log pages: a health check with every fault and estimate, and a hindcast with every surfacing.

Each is one HTML file with its figures inside, and needs no network.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from glider_twin_ops.forecast import DeploymentHindcast, Hindcast, HindcastSurfacing, Scores
from glider_twin_ops.forecast.walk import METHODS
from glider_twin_ops.health.answers import Answers
from glider_twin_ops.health.assessment import DeploymentHealth, KindVerdict
from glider_twin_ops.pages.figures import (
    TITLES,
    belief_figure,
    channel_figures,
    current_figure,
    error_figure,
    evidence_figure,
    map_figure,
)
from twin.cli import format_number
from twin.navigation import Ellipse
from twin.show import Page
from twin.show.style import moment_of

FEW = 4
"""Maximum number of deployments that all have channels shown; of more, only those with an alarm"""
BELIEVED = {
    "drag": "Drag K_D0 [kg/m]",
    "neutral_density": "Density of the water in which it neither sinks nor rises [kg/m3]",
}
MOST_ROWS = 60
"""Maximum number of rows of the table: the last surfacings"""


def write_health(
    folder: Path,
    found: Sequence[DeploymentHealth],
    command: str = "",
    answered: Mapping[str, Answers] | None = None,
) -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path.

    Args:
      answered: answers by the deployment's name, see `glider_twin_ops.health.answer_for`.

    Raises:
      WriteError: something that is no page is in the way.
    """
    page = Page(
        folder,
        "Is something wrong with the vehicle?",
        "Each dive gives numbers that a sound vehicle repeats. A fault is called where what it "
        "does to them, by flights of the twin, is likelier than drift.",
    )
    page.numbers(
        {
            "deployments": str(len(found)),
            "with an alarm": str(sum(one.alarm for one in found)),
            "days": f"{sum(one.days for one in found):.1f}",
        }
    )
    if len(found) > 1:
        page.points([one.verdict() for one in found])
    for one in found:
        _health_of(page, one, (answered or {}).get(one.name), one.alarm or len(found) <= FEW)
    if command:
        page.section("Command")
        page.code(command)
    return page.write()


def _health_of(page: Page, one: DeploymentHealth, said: Answers | None, whole: bool) -> None:
    page.section(one.name)
    page.say(one.verdict())
    if one.remarks:
        page.points(one.remarks)
    if one.kinds:
        page.say(
            "Every fault that the vehicle can have and this log can show. Those that show in what "
            "is far off its level in the last dive come first, then the likeliest:"
        )
        for place, kind in enumerate(one.kinds):
            summary = f"{kind.probability:.1%} {kind.says} ({kind.kind})"
            page.details(summary, kind_facts(kind), shown=one.alarm and place == 0)
        page.figure(f"{one.name}-evidence", evidence_figure(one),
                    "Log of the odds of a fault after each dive, and the level of an "
                    "alarm, which two dives in a row make. After the others nothing "
                    "speaks for a fault.")  # fmt: skip
    if said is not None:
        _answers(page, one.name, said)
    if one.kinds and whole:
        told = [k for k, column in enumerate(one.values.T) if np.isfinite(column).any()]
        page.section(f"{one.name}: what each dive says")
        page.say("Each number in each dive, and its level with two standard deviations.")
        page.pair(channel_figures(one, told, one.name))
    if one.lacking:
        page.say(f"The log does not tell: {', '.join(one.lacking)}.")


def kind_facts(kind: KindVerdict) -> dict[str, object]:
    """Facts on a type of fault from the dives, by their names."""
    unit = "" if kind.unit == "1" else f" {kind.unit}"
    return {
        "probability": format_number(kind.probability, 3),
        "since dive": kind.since_dive,
        "size": f"{format_number(kind.size, 3)} +- {format_number(kind.size_deviation, 2)}{unit}",
        "shows in": ", ".join(kind.channels) or "nothing of this log",
        "dives to look at": ", ".join(map(str, kind.dives)) or "-",
        "what else looks like it": kind.otherwise,
        "to find out": kind.find_out,
        "not told apart from": ", ".join(kind.also) or "-",
    }


def _answers(page: Page, name: str, said: Answers) -> None:
    """Add drag, compass, pump and energy to the page."""
    page.section(f"{name}: drag, compass, pump, energy")
    if said.beliefs is not None:
        page.pair([(f"{name}-{key}", belief_figure(said, key), f"{text}: after each dive with two "
                    "standard deviations, and looking back (dashed).")
                   for key, text in BELIEVED.items()])  # fmt: skip
    if said.drag is not None:
        page.say(
            f"Drag changed by {100.0 * said.drag['change']:+.1f} +- "
            f"{100.0 * said.drag['change_deviation']:.1f} % from the first dive to the last."
        )
    if said.compass is not None:
        page.say(
            f"Compass: iron of {said.compass['iron_deg']:.1f} +- "
            f"{said.compass['iron_deviation_deg']:.1f} degree, largest on heading "
            f"{said.compass['largest_at_deg']:.0f}."
        )
        page.table(
            [
                {"heading": f"{at['heading_deg']:.0f}",
                 "true less compass": f"{at['deviation_deg']:+.1f}",
                 "+-": f"{at['standard_deviation_deg']:.1f}"}
                for at in said.compass["by_heading"]
            ], "Compass by heading, in degree, from the currents between fixes.", first=False,
        )  # fmt: skip
    if said.pump is not None:
        page.table(
            [
                {"depth [m]": f"{at['from_m']:.0f} to {at['to_m']:.0f}",
                 "rate [cm3/s]": at["rate_cm3_s"], "+-": at["rate_cm3_s_deviation"],
                 "power [W]": at.get("power_w"), "+- [W]": at.get("power_w_deviation"),
                 "samples": int(at["samples"])}
                for at in said.pump
            ], "Pump, by depth.", first=False,
        )  # fmt: skip
    if said.energy is not None:
        page.table(
            [
                {"device": device, "energy [kW h]": at["energy_kwh"], "factor": at["value"],
                 "+-": at["deviation"], "unit": at["unit"]}
                for device, at in said.energy["devices"].items()
            ], f"Energy by device; {said.energy['power_w']:.2f} W in the mean.", first=False,
        )  # fmt: skip
    if said.lacking:
        page.facts({f"no {what}": why for what, why in said.lacking.items()})


def write_hindcast(folder: Path, found: Hindcast, command: str = "") -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path.

    Raises:
      WriteError: something that is no page is in the way.
    """
    page = Page(
        folder,
        "Where it surfaced, and where it was expected",
        "Every surfacing was forecast from what a pilot knew before its dive; what the forecast "
        "learns, it learned from the dives before.",
    )
    page.numbers(_large(found.surfacing))
    for which, words in (
        ("surfacing", "Where it surfaced: mean error, metres per hour since the fix before. Rivals "
         "go at the speed of the last three dives along the waypoints for their median duration, "
         "each with its own current (on board: the vehicle's estimate), or over ground as the last "
         "three dives."),
        ("current", "The current alone: all methods are given the way through the water and the "
         "duration; on board: the vehicle's own track at the end of the dive."),
        ("members", "Where it surfaced, the forecast by members flown as twin forecast flies them: "
         "they know the currents, the waypoints and the duration expected, and depth and pitch of "
         "the dive before."),
    ):  # fmt: skip
        rows = found.rows(which)
        partial = [name for name in METHODS if any(name in each.partial for _, each in rows)]
        if rows:
            page.table(
                [
                    {"deployment": name, "scored": scores.segments, **_row(scores, partial)}
                    for name, scores in rows
                ],
                f"{words} Forecast / best rival is the forecast's error over that of the rival "
                "that is best over all, below 1 where it is better; inside are the parts that came "
                "up in the ellipses.",
                first=False,
            )
    for one in found.deployments:
        _hindcast_of(page, one)
    if command:
        page.section("Command")
        page.code(command)
    return page.write()


def _large(scores: Scores) -> dict[str, str]:
    if not scores.segments:
        return {"surfacings scored": "0"}
    shown = {
        f"{TITLES[name]}, mean": f"{value:.0f} m/h"
        for name, value in scores.mean.items()
        if value is not None
    }
    if scores.coverage_90 is not None:
        shown["in the 90 % ellipse"] = f"{100 * scores.coverage_90:.0f} %"
    return shown


def _row(scores: Scores, partial: Sequence[str]) -> dict[str, object]:
    return {
        **{TITLES[name]: scores.mean[name] for name in METHODS},
        **{f"{TITLES[name]}, scored": scores.segments_of[name] for name in partial},
        "forecast / best rival": scores.ratio,
        "part inside 50 %": scores.coverage_50,
        "part inside 90 %": scores.coverage_90,
    }


def _hindcast_of(page: Page, one: DeploymentHindcast) -> None:
    page.section(one.name)
    weights = (f"{name} {weight:.2f}" for name, weight in one.walked.pool.pool.weights.items())
    said = f"Weights of the current's models after the last dive: {', '.join(weights)}."
    scores = one.surfacing
    if scores.ratio_interval is not None and scores.rival is not None:
        low, high = scores.ratio_interval
        said += (
            f" Error by that of {TITLES[scores.rival]}, the best rival, {scores.ratio:.2f}, 95 % "
            f"interval {low:.2f} to {high:.2f}."
        )
    page.say(said)
    page.figure(
        f"map-{one.name}",
        map_figure(one),
        "Fixes with straight lines between those that begin and end a dive; beside it the last "
        "surfacings with their forecasts.",
    )
    page.figure(
        f"current-{one.name}",
        current_figure(one),
        "Mean current of each dive, by its two fixes and its way through the water, and as it was "
        "forecast before the dive.",
    )
    if scores.segments:
        page.figure(
            f"errors-{one.name}",
            error_figure(one),
            "Part of the scored surfacings that were missed by less than an error.",
        )
    page.table(
        [_surfacing(s) for s in one.surfacings[-MOST_ROWS:] if s.scored],
        f"The last scored surfacings, {MOST_ROWS} at most; semi-axes of the ellipses.",
        first=False,
    )


def _surfacing(one: HindcastSurfacing) -> dict[str, object]:
    """Row of the table of surfacings."""
    judged, (latitude, longitude) = one.surfacing, one.places["fix"]
    axes = Ellipse.of(judged.reach[1] * judged.covariance)
    return {
        "surfaced, UTC": f"{moment_of(one.time):%m-%d %H:%M}",
        "hours": one.hours,
        "latitude": f"{latitude:.4f}",
        "longitude": f"{longitude:.4f}",
        **{f"{TITLES[n]}, m/h": judged.error(n) if n in judged.missed else None for n in METHODS},
        "90 % ellipse, km": f"{axes.semi_major_m / 1e3:.2f} x {axes.semi_minor_m / 1e3:.2f}",
        "inside 90 %": "yes" if judged.held[1] else "no",
    }
