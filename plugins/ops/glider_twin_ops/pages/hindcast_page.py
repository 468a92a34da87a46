"""Page of a hindcast: figures and a table of surfacings in one file that needs no network.

The figures are maps with ellipses, the current over time, and errors by method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from glider_twin_ops.forecast.hindcast import DeploymentHindcast, Hindcast
from glider_twin_ops.forecast.walk import METHODS, HindcastSurfacing, Scores
from twin.geodesy import position
from twin.navigation import Ellipse, outline
from twin.numbers import Array
from twin.show import Page, style
from twin.show.figures import box_around, draw_base, joined_longitude
from twin.show.style import LABEL, draw_dates, moment_of

STYLED = {
    "forecast": ("forecast", "vermillion"),
    "persistence": ("persistence", "blue"),
    "tide": ("mean and tide", "yellow"),
    "no_current": ("no current", "green"),
    "onboard": ("on board", "purple"),
}
TITLES = {name: title for name, (title, _) in STYLED.items()}
COLOURS = {name: style.PALETTE[colour] for name, (_, colour) in STYLED.items()}
CLOSE = 6
"""Surfacings of the detailed map"""
MOST_ROWS = 60
"""Surfacings in the table, the last ones"""
HOUR = 3600.0
"""[s]"""
ELLIPSE_POINTS = 73


def map_figure(one: DeploymentHindcast) -> Figure:
    """All surfacings, and the last few with the ellipses of their forecasts."""
    scored = [s for s in one.surfacings if s.scored]
    few = (scored or list(one.surfacings))[-CLOSE:]
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 3.9)
        whole, close = figure.subplots(1, 2)
        _draw_map(whole, one.surfacings, "deployment", {})
        marks = {"forecast": "+", "persistence": "x"}
        _draw_map(close, few, f"last {len(few)} surfacings", marks)
        figure.legend(*close.get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return figure


def _draw_map(
    axes: Axes, surfacings: Sequence[HindcastSurfacing], title: str, marks: Mapping[str, str]
) -> None:
    """Fixes; with marks of methods their surfacings, and the ellipses of the forecast."""
    fixes, begins = (np.array([s.places[name] for s in surfacings]) for name in ("fix", "begin"))
    outlines = [_ellipse(s) for s in surfacings] if marks else []
    named = {
        name: np.array([s.places[name] for s in surfacings if name in s.places]).reshape(-1, 2)
        for name in marks
    }
    every = np.concatenate([begins, fixes, *named.values(), *(ring.T for ring in outlines)])
    unrolled = joined_longitude(every[:, 1])
    unroll = dict(zip(every[:, 1].tolist(), (unrolled - every[:, 1]).tolist(), strict=True))

    def along(longitude: Array) -> Array:
        return np.array([x + unroll[x] for x in longitude.tolist()])

    draw_base(axes, box_around(every[:, 0], unrolled, 0.95))
    axes.set_title(title)
    for ring in outlines:
        axes.plot(along(ring[1]), ring[0], color=COLOURS["forecast"], lw=0.8, zorder=3,
                  label="90 % ellipse" if ring is outlines[0] else "")  # fmt: skip
    for begin, fix in zip(begins, fixes, strict=True):
        ends = along(np.array([begin[1], fix[1]]))
        axes.plot(ends, [begin[0], fix[0]], color=style.GUIDE, lw=0.8, zorder=2)
    axes.plot(along(fixes[:, 1]), fixes[:, 0], ".", color=style.COMMAND, ms=5.0, ls="none",
              label="fix", zorder=4)  # fmt: skip
    for name, at in named.items():
        axes.plot(along(at[:, 1]), at[:, 0], marks[name], color=COLOURS[name], ms=6.0, mew=1.4,
                  ls="none", label=TITLES[name], zorder=4)  # fmt: skip


def _ellipse(one: HindcastSurfacing) -> Array:
    """Latitude, longitude [degree] of the 90 % ellipse about the forecast, (2, n)."""
    judged = one.surfacing
    north, east = outline(judged.reach[1] * judged.covariance, ELLIPSE_POINTS).T
    return np.stack(position(north, east, *one.places["forecast"]))


def current_figure(one: DeploymentHindcast) -> Figure:
    """North and east over time: observed after each dive, forecast before it with its 90 %."""
    start = one.surfacings[0].time
    days = np.array([(s.time - start) / HOUR for s in one.surfacings])
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 3.4)
        for k, (axes, name) in enumerate(
            zip(figure.subplots(2, 1, sharex=True), ("north", "east"), strict=True)
        ):
            observed, expected, variance = np.array([
                (s.found[k], s.expected[k],
                 s.current.reach[1] * s.current.covariance[k, k] / (s.hours * HOUR) ** 2)
                for s in one.surfacings
            ]).T  # fmt: skip
            reach = np.sqrt(variance)
            axes.fill_between(days, expected - reach, expected + reach, color=COLOURS["forecast"],
                              alpha=0.18, lw=0.0, label="extent of the 90 % ellipse")  # fmt: skip
            axes.plot(days, expected, color=COLOURS["forecast"], lw=1.0, label="forecast")
            axes.plot(days, observed, ".", color=style.COMMAND, ms=4.0, label="found")
            axes.set_ylabel(f"{name} [m/s]")
            most = 1.3 * float(np.abs(observed).max()) + 0.05
            axes.set_ylim(-most, most)
            if 1 < one.train < len(days):  # the first leg has no surfacing of its own here
                axes.axvline(0.5 * (days[one.train - 2] + days[one.train - 1]), color=style.GUIDE,
                             ls=(0, (3, 2)), lw=0.9, label="scored from here")  # fmt: skip
        draw_dates(axes, start, HOUR)
        axes.set_xlabel(LABEL)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=4)
    return figure


def error_figure(one: DeploymentHindcast) -> Figure:
    """What part of the scored surfacings each method missed by less than so much."""
    scored = [s for s in one.surfacings if s.scored]
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 2.6)
        axes = figure.add_subplot()
        for name in METHODS:
            errors = np.sort([e for s in scored if np.isfinite(e := s.surfacing.error(name))])
            if errors.size:
                share = np.arange(1, errors.size + 1) / errors.size
                axes.step(np.concatenate([[0.0], errors]), np.concatenate([[0.0], share]),
                          where="post", color=COLOURS[name], label=TITLES[name])  # fmt: skip
        axes.set_xlim(left=0.0)
        axes.set_ylim(0.0, 1.02)
        axes.set_xlabel("error [m/h]")
        axes.set_ylabel("part of the surfacings")
        axes.legend(loc="lower right")
    return figure


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
         "go at the speed of the last three dives toward the waypoint for their median duration, "
         "each with a current of its own; on board: that with which the vehicle reckons."),
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
                f"{words} Forecast / best rival is the forecast's error over that of the best "
                "other one, below 1 where it is better; inside are the parts that came up in the "
                "ellipses.",
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
        "forecast / best rival": scores.ratio,
        "part inside 50 %": scores.coverage_50,
        "part inside 90 %": scores.coverage_90,
    }


def _deployment(page: Page, one: DeploymentHindcast) -> None:
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
    """Row of a table."""
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
