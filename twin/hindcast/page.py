"""Page of a hindcast: figures, maps and a table of surfacings in one file without a network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from twin.hindcast.figures import TITLES, current_figure, error_figure, map_figure
from twin.hindcast.hindcast import DeploymentHindcast, Hindcast
from twin.hindcast.scores import METHODS, Scores
from twin.hindcast.walk import NINETY
from twin.navigation.ellipse import Ellipse
from twin.plot.dates import moment_of
from twin.plot.page import Page

MOST_ROWS = 60
"""Surfacings in the table, the last ones"""


def build_page(folder: Path, found: Hindcast, command: str = "") -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path.

    Raises:
      WriteError: something that is no page is in the way.
    """
    page = Page(
        folder,
        "Where it surfaced, and where it was expected",
        f"The first {100 * found.train_fraction:.0f} % of each deployment taught the parameters of "
        "the current; every later surfacing was forecast from the fixes before its dive.",
    )
    page.numbers(_large(found.scores))
    rows = [(one.name, one.scores) for one in found.deployments]
    if len(rows) > 1:
        rows.append(("all", found.scores))
    partial = [name for name in METHODS if any(name in scores.partial for _, scores in rows)]
    page.table(
        [
            {"deployment": name, "scored": scores.segments, **_row(scores, partial)}
            for name, scores in rows
        ],
        "Mean error, metres per hour since the fix before. All methods are given the same way "
        "through the water; persistence adds the current of the dive before.",
        first=False,
    )
    for one in found.deployments:
        _deployment(page, one)
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
        "forecast/persistence": scores.ratio,
        "in 50 %": scores.coverage_50,
        "in 90 %": scores.coverage_90,
    }


def _deployment(page: Page, one: DeploymentHindcast) -> None:
    page.section(one.name)
    parameters = one.tuned.parameters
    said = (
        "Its fixes speak for persistence: the last dive's current is the forecast."
        if parameters.persists
        else f"Tide of {', '.join(parameters.constituents) or 'no constituent'}, eddies that last "
        f"{parameters.eddy_time:.0f} h, inertial oscillation, wandering mean."
    )
    if one.scores.ratio_interval is not None:
        low, high = one.scores.ratio_interval
        said += (
            f" Error by that of persistence {one.scores.ratio:.2f}, 95 % interval {low:.2f} to "
            f"{high:.2f}."
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
    if one.scores.segments:
        page.figure(
            f"errors-{one.name}",
            error_figure(one),
            "Part of the scored surfacings that were missed by less than an error.",
        )
    page.table(
        [
            {
                "surfaced, UTC": f"{moment_of(s.time):%m-%d %H:%M}",
                "hours": s.hours,
                "latitude": f"{s.places['fix'][0]:.4f}",
                "longitude": f"{s.places['fix'][1]:.4f}",
                **{f"{TITLES[n]}, m/h": s.error(n) if n in s.missed else None for n in METHODS},
                "90 % ellipse, km": _kilometres(Ellipse.of(NINETY * s.covariance)),
                "held": "yes" if s.distance <= NINETY else "no",
            }
            for s in one.surfacings[-MOST_ROWS:]
            if s.scored
        ],
        f"The last scored surfacings, {MOST_ROWS} at most; semi-axes of the ellipses.",
        first=False,
    )


def _kilometres(ellipse: Ellipse) -> str:
    return f"{ellipse.semi_major_m / 1e3:.2f} x {ellipse.semi_minor_m / 1e3:.2f}"
