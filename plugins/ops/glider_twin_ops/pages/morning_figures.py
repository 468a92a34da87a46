"""Morning figures: track with currents and ellipses, currents over time, a picture for e-mail."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from glider_twin_ops.forecast import Forecast, LoggedLeg
from glider_twin_ops.forecast.member_flights import HALF, NINETY
from twin.numbers import Array
from twin.show import style
from twin.show.figures import box_around, draw_base, joined_longitude
from twin.show.style import LABEL, draw_dates

DAY = 86400.0
CLOSE = 4
"""Last dives of the detailed map"""
MAP, SERIES = (4.1, 3.9), (4.1, 2.4)
"""[in] of figures that stand beside each other, and below each other on a phone"""
LETTERS = 105
"""In a line of the picture for e-mail"""


def track_figure(legs: Sequence[LoggedLeg], found: Forecast | None = None) -> Figure:
    """Dives, with the numbered ellipses of the next surfacings and where it goes."""
    with style.styled():
        figure = style.new_figure(*MAP)
        axes = figure.subplots()
        _draw_track(axes, legs, found)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def mail_figure(title: str, lines: Sequence[str], legs: Sequence[LoggedLeg],
                found: Forecast | None) -> Figure:  # fmt: skip
    """The last dives and the next surfacings, with words below them; words alone without dives."""
    told = [part for line in lines for part in textwrap.wrap(line, LETTERS)]
    words = 0.16 * (len(told) + 1)
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, words + (4.4 if legs else 0.4))
        figure.suptitle(
            "\n".join(textwrap.wrap(title, LETTERS - 25)), x=0.02, ha="left", weight="bold"
        )
        size = figure.get_size_inches()[1]
        if legs:
            below = words / size
            figure.set_layout_engine("constrained", rect=(0.0, below, 1.0, 1.0 - below))
            axes = figure.subplots()
            _draw_track(axes, legs[-CLOSE:], found)
            axes.legend(*axes.get_legend_handles_labels(), loc="best", frameon=True)
        figure.text(0.02, (words - 0.05) / size, "\n".join(told), va="top", fontsize=8.0)
    return figure


def _draw_track(axes: Axes, legs: Sequence[LoggedLeg], found: Forecast | None) -> None:
    begins = np.array([one.begin for one in legs])
    ends = np.array([one.end for one in legs])
    rings: list[Array] = []
    track = np.zeros((0, 2))
    if found is not None:
        place, track = found.request.place, found.track.reshape(-1, 2)[:, ::-1]
        rings = [
            one.ring(part, place)[:, ::-1] for one in found.surfacings for part in (NINETY, HALF)
        ]
    every = np.concatenate([begins, ends, *rings, track])
    longitude = joined_longitude(every[:, 1])
    draw_base(axes, box_around(every[:, 0], longitude, 0.95))
    west, east, *around = np.split(longitude, np.cumsum([len(p) for p in (begins, ends, *rings)]))
    axes.plot(np.stack([west, east]), np.stack([begins[:, 0], ends[:, 0]]), color=style.GUIDE,
              lw=0.9, zorder=2)  # fmt: skip
    axes.plot(east, ends[:, 0], ".", color=style.COMMAND, ms=4.0, ls="none", zorder=4, label="fix")
    current = np.array([one.leg.current for one in legs])
    axes.quiver(
        0.5 * (west + east), 0.5 * (begins[:, 0] + ends[:, 0]), current[:, 1], current[:, 0],
        color=style.PALETTE["blue"], width=0.004, zorder=3, label="current",
    )  # fmt: skip
    for k, (x, ring) in enumerate(zip(around, [*rings, track], strict=True)):
        last = k == len(rings)
        if len(ring):
            axes.plot(x, ring[:, 0], color=style.ESTIMATE, lw=0.9, zorder=3,
                      ls=(0, (4, 2)) if last else "-",
                      label="forecast" if last else "50 and 90 %" if k == 0 else "")  # fmt: skip
    if found is not None:
        _draw_places(axes, found, longitude[0] - begins[0, 1])


def _draw_places(axes: Axes, found: Forecast, turned: float) -> None:
    """Numbers of the surfacings at their middles, and targets, at the edge where they are far.

    Args:
      turned: [degree] by which the map's longitudes are beyond those of the forecast.
    """
    for one in found.surfacings:
        axes.annotate(f"{one.number}", (one.longitude + turned, one.latitude), ha="center",
                      va="center", color=style.ESTIMATE, weight="bold", zorder=5)  # fmt: skip
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    for k, (x, y) in enumerate(found.targets() + np.array([turned, 0.0])):
        inside = west <= x <= east and south <= y <= north
        at = np.clip(x, west, east), np.clip(y, south, north)
        axes.plot(*at, "D" if inside else ">", color=style.PALETTE["purple"], ms=5.0, ls="none",
                  clip_on=False, zorder=5, label="" if k else "goes to")  # fmt: skip


def water_figure(legs: Sequence[LoggedLeg]) -> Figure:
    """Mean current of each dive, north and east, over time."""
    start = legs[0].leg.start
    days = np.array([(one.leg.start + 0.5 * one.leg.duration - start) / DAY for one in legs])
    current = np.array([one.leg.current for one in legs])
    with style.styled():
        figure = style.new_figure(*SERIES)
        axes = figure.add_subplot()
        for k, (name, colour) in enumerate((("north", "blue"), ("east", "vermillion"))):
            axes.plot(days, current[:, k], "o-", color=style.PALETTE[colour], ms=3.0, lw=0.8,
                      label=name)  # fmt: skip
        axes.axhline(0.0, color=style.GUIDE, lw=0.7)
        axes.set_ylabel("current [m/s]")
        draw_dates(axes, start, DAY)
        axes.set_xlabel(LABEL)
        axes.legend(ncols=2)
    return figure
