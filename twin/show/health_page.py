"""Page of a health check: a verdict for each deployment, and every channel over its dives."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from twin.health.assessment import DeploymentHealth
from twin.health.channels import CHANNELS
from twin.show import style
from twin.show.dates import LABEL, draw_dates
from twin.show.figures.page_layout import Page

COLUMNS = 3
"""Channels side by side"""
HOUR = 3600.0
"""[s]"""
BAND = 2.0
"""Standard deviations of a level that are shown about it"""


def write_health(folder: Path, found: Sequence[DeploymentHealth], command: str = "") -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path.

    Raises:
      WriteError: something that is no page is in the way.
    """
    alarms = sum(one.alarm for one in found)
    page = Page(
        folder,
        "Is something wrong with the vehicle?",
        "Each dive gives numbers that a sound vehicle repeats. A fault is called where what it "
        "does to them, by flights of the twin, is likelier than drift.",
    )
    page.numbers(
        {
            "deployments": str(len(found)),
            "with an alarm": str(alarms),
            "days": f"{sum(one.days for one in found):.1f}",
        }
    )
    page.points([one.verdict() for one in found])
    for one in found:
        _deployment(page, one)
    if command:
        page.section("Command")
        page.code(command)
    return page.write()


def _deployment(page: Page, one: DeploymentHealth) -> None:
    page.section(one.name)
    page.say(one.verdict())
    if not one.kinds:
        return
    page.table(
        [
            {
                "fault": kind.kind,
                "what": kind.says,
                "probability": kind.probability,
                "since dive": kind.since_dive,
                "size": kind.size,
                "+-": kind.size_deviation,
                "unit": kind.unit,
                "shows in": ", ".join(kind.channels) or "nothing of this log",
            }
            for kind in one.kinds
        ],
        "Every fault that the vehicle can have, the likeliest first; dives and sizes are those "
        "that speak for it most, however unlikely it is.",
        first=one.alarm,
    )
    if one.alarm:
        first = one.kinds[0]
        page.facts(
            {
                "first alarm": f"after dive {one.noticed_dive}",
                "dives to look at": ", ".join(map(str, first.dives)),
                "what else looks like it": first.otherwise,
                "to find out": first.find_out,
                "not told apart from": ", ".join(k for k in first.also if k != first.kind) or "-",
            }
        )
    if one.lacking:
        page.say(f"The log does not tell: {', '.join(one.lacking)}.")
    page.figure(f"{one.name}-evidence", evidence_figure(one),
                "Log of the odds of a fault after each dive, and the level of an "
                "alarm.")  # fmt: skip
    page.figure(f"{one.name}-channels", channel_figure(one),
                "Each channel: its value in each dive, and its level with two standard "
                "deviations.")  # fmt: skip


def evidence_figure(one: DeploymentHealth) -> Figure:
    """Evidence over the dives."""
    hours = (one.time - one.time[0]) / HOUR
    known = np.isfinite(one.evidence)
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 2.0)
        axes = figure.add_subplot()
        axes.plot(hours[known], one.evidence[known], ".-", color=style.COMMAND, lw=1.0, ms=4.0)
        axes.axhline(one.threshold, color=style.PALETTE["vermillion"], lw=1.0, label="alarm")
        axes.set_ylabel("log odds of a fault")
        axes.legend(loc="upper left")
        draw_dates(axes, float(one.time[0]), HOUR)
        axes.set_xlabel(LABEL)
    return figure


def channel_figure(one: DeploymentHealth) -> Figure:
    """Every channel that the log tells, with its level."""
    shown = [k for k, column in enumerate(one.values.T) if np.isfinite(column).any()]
    rows = max(-(-len(shown) // COLUMNS), 1)
    hours = (one.time - one.time[0]) / HOUR
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 1.35 * rows + 0.5)
        grid = figure.subplots(rows, COLUMNS, sharex=True, squeeze=False)
        for axes in grid.ravel()[len(shown) :]:
            axes.set_visible(False)
        for axes, k in zip(grid.ravel(), shown, strict=False):
            channel = CHANNELS[k]
            level, off = one.levels.level[:, k], BAND * one.levels.deviation[:, k]
            seen = np.isfinite(one.values[:, k])
            first = int(np.argmax(seen))
            band = slice(first, None)
            axes.fill_between(hours[band], (level - off)[band], (level + off)[band],
                              color=style.PALETTE["blue"], alpha=0.2, lw=0.0)  # fmt: skip
            axes.plot(hours[band], level[band], color=style.PALETTE["blue"], lw=0.8)
            axes.plot(hours[seen], one.values[seen, k], ".", color=style.COMMAND, ms=3.0)
            if one.alarm and one.since_dive in one.dives:
                begun = one.dives.index(int(one.since_dive or 0))
                axes.axvline(hours[begun], color=style.PALETTE["vermillion"], lw=0.9)
            unit = "" if channel.unit == "1" else f" [{channel.unit.replace(' s-1', '/s')}]"
            axes.set_title(f"{channel.name}{unit}", fontsize=7)
            axes.tick_params(labelsize=6)
        for axes in grid[-1]:
            draw_dates(axes, float(one.time[0]), HOUR)
            axes.tick_params(axis="x", labelrotation=30)
    return figure
