"""Figures of the pages: tracks and currents, channels of health, errors of forecasts."""

from __future__ import annotations

import contextlib
import textwrap
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from glider_twin_ops.forecast import DeploymentHindcast, Forecast, HindcastSurfacing, LoggedLeg
from glider_twin_ops.forecast.member_flights import HALF, NINETY
from glider_twin_ops.forecast.walk import METHODS
from glider_twin_ops.health.answers import Answers
from glider_twin_ops.health.assessment import DeploymentHealth
from glider_twin_ops.health.channels import CHANNELS
from glider_twin_ops.pages.surfacing_map import CLOSE, ROUND_SPEEDS, STEPS
from twin.geodesy import position
from twin.navigation import outline
from twin.numbers import Array
from twin.show import style
from twin.show.figures import box_around, draw_base, joined_longitude
from twin.show.style import LABEL, draw_dates

HOUR, DAY = 3600.0, 86400.0
"""[s]"""
CLOSE_SURFACINGS = 6
"""Number of last surfacings on the map of forecasts"""
MAP, SERIES, SMALL = (4.1, 3.9), (4.1, 2.4), (4.1, 1.75)
"""[in] Sizes of figures that stand side by side, or one below the other on a phone"""
LETTERS = 105
"""Letters in a line of the picture for e-mail"""
BAND = 2.0
"""Standard deviations that a band shows on each side of a level or an estimate"""
ELLIPSE_POINTS = 73
LONGEST_ARROW, TICKS, WIDE = 0.18, 25.0, 1.4
"""LONGEST_ARROW: strongest current's arrow over the map's width. TICKS: maximum number of small
ticks of an axis. WIDE: width over height of the map for e-mail"""
STYLED = {
    "forecast": ("forecast", "vermillion"),
    "over_ground": ("over ground as the last three", "sky"),
    "persistence": ("persistence", "blue"),
    "tide": ("mean and tide", "yellow"),
    "no_current": ("no current", "green"),
    "onboard": ("on board", "purple"),
}
TITLES = {name: title for name, (title, _) in STYLED.items()}
COLOURS = {name: style.PALETTE[colour] for name, (_, colour) in STYLED.items()}


@contextlib.contextmanager
def _drawn(size: tuple[float, float]) -> Iterator[tuple[Figure, Axes]]:
    """Make a figure [in] in the project's style with one pair of axes."""
    with style.styled():
        figure = style.new_figure(*size)
        yield figure, figure.add_subplot()


def _date(axes: Axes, start: float, unit: float) -> None:
    """Draw dates below axes whose times count in `unit` [s] from `start` [s] unix on."""
    draw_dates(axes, start, unit)
    axes.set_xlabel(LABEL)


def track_figure(legs: Sequence[LoggedLeg]) -> Figure:
    """Map of dives with their mean currents."""
    with _drawn(MAP) as (figure, axes):
        _draw_track(axes, legs, None)
    return figure


def mail_figure(title: str, lines: Sequence[str], legs: Sequence[LoggedLeg],
                found: Forecast | None) -> Figure:  # fmt: skip
    """Map of the last dives and next surfacings above a text; the text alone without dives."""
    told = [part for line in lines for part in textwrap.wrap(line, LETTERS)]
    words = 0.16 * (len(told) + 1)
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, words + (4.4 if legs else 0.4))
        lines_of_it = "\n".join(textwrap.wrap(title, LETTERS - 25))
        figure.suptitle(lines_of_it, x=0.02, ha="left", weight="bold")
        size = figure.get_size_inches()[1]
        if legs:
            below = words / size
            figure.set_layout_engine("constrained", rect=(0.0, below, 1.0, 1.0 - below))
            axes = figure.subplots()
            _draw_track(axes, legs[-CLOSE:], found, WIDE)
            axes.legend(*axes.get_legend_handles_labels(), loc="upper left",
                        bbox_to_anchor=(1.01, 1.0), frameon=False)  # fmt: skip
        figure.text(0.02, (words - 0.05) / size, "\n".join(told), va="top", fontsize=8.0)
    return figure


def _draw_track(
    axes: Axes, legs: Sequence[LoggedLeg], found: Forecast | None, shape: float = 0.95
) -> None:
    """Draw fixes, currents and a forecast on a map of a shape, width over height."""
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
    draw_base(axes, box_around(every[:, 0], longitude, shape))
    _fine_ticks(axes)
    west, east, *around = np.split(longitude, np.cumsum([len(p) for p in (begins, ends, *rings)]))
    axes.plot(np.stack([west, east]), np.stack([begins[:, 0], ends[:, 0]]), color=style.GUIDE,
              lw=0.9, zorder=2)  # fmt: skip
    axes.plot(east, ends[:, 0], ".", color=style.COMMAND, ms=4.0, ls="none", zorder=4, label="fix")
    _arrows(axes, np.stack([0.5 * (west + east), 0.5 * (begins[:, 0] + ends[:, 0])]),
            np.array([one.leg.current for one in legs]))  # fmt: skip
    for k, (x, ring) in enumerate(zip(around, [*rings, track], strict=True)):
        last = k == len(rings)
        if len(ring):
            axes.plot(x, ring[:, 0], color=style.ESTIMATE, lw=0.9, zorder=3,
                      ls=(0, (4, 2)) if last else "-",
                      label="forecast" if last else "50 and 90 %" if k == 0 else "")  # fmt: skip
    if found is not None:
        _draw_places(axes, found, longitude[0] - begins[0, 1])


def _fine_ticks(axes: Axes) -> None:
    """Small ticks of round minutes, their step in the labels, so that one can read a place off."""
    for axis, (low, high), name in (
        (axes.xaxis, axes.get_xlim(), "longitude"),
        (axes.yaxis, axes.get_ylim(), "latitude"),
    ):
        step = next((m for m in STEPS if TICKS * m >= 60.0 * (high - low)), STEPS[-1])
        whole = np.arange(np.ceil(60.0 * low / step), np.floor(60.0 * high / step) + 1.0)
        axis.set_minor_locator(FixedLocator((whole * step / 60.0).tolist()))
        axis.set_label_text(f"{name}, ticks of {step:g}\N{PRIME}")
    axes.tick_params(which="minor", length=3.0, top=True, right=True)


def _arrows(axes: Axes, middles: Array, current: Array) -> None:
    """Draw the mean current of each dive as an arrow from its middle, (2, dive), and a key."""
    known = np.isfinite(current).all(axis=1)
    if not known.any():
        return
    most = max(float(np.hypot(*current[known].T).max()), ROUND_SPEEDS[0])
    speed = max(one for one in ROUND_SPEEDS if one <= most)
    arrows = axes.quiver(
        *middles[:, known], current[known, 1], current[known, 0], color=style.PALETTE["blue"],
        width=0.005, zorder=3, scale=most / LONGEST_ARROW, scale_units="width",
    )  # fmt: skip
    axes.quiverkey(arrows, 0.8, 0.95, speed, f"current {speed:g} m/s", labelpos="S", labelsep=0.05,
                   fontproperties={"size": 7.5})  # fmt: skip


def _draw_places(axes: Axes, found: Forecast, turned: float) -> None:
    """Draw the surfacings' numbers at their centres, and targets, at the edge where they are far.

    Args:
      turned: [degree] longitude on the map less longitude in the forecast.
    """
    for one in found.surfacings:
        axes.annotate(f"{one.number}", (one.longitude + turned, one.latitude), ha="center",
                      va="center", color=style.ESTIMATE, weight="bold", zorder=5)  # fmt: skip
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    for k, (x, y) in enumerate(found.targets() + np.array([turned, 0.0])):
        inside = west <= x <= east and south <= y <= north
        at = np.clip(x, west, east), np.clip(y, south, north)
        turn = np.rad2deg(np.arctan2(y - 0.5 * (south + north), x - 0.5 * (west + east))) - 90.0
        axes.plot(*at, marker="D" if inside else (3, 0, turn), ms=5.0, ls="none", zorder=5,
                  color=style.PALETTE["purple"], clip_on=False,
                  label="" if k else "goes to")  # fmt: skip


def water_figure(legs: Sequence[LoggedLeg]) -> Figure:
    """Mean current of each dive, north and east, over time."""
    start = legs[0].leg.start
    days = np.array([(one.leg.start + 0.5 * one.leg.duration - start) / DAY for one in legs])
    current = np.array([one.leg.current for one in legs])
    with _drawn(SERIES) as (figure, axes):
        for k, (name, colour) in enumerate((("north", "blue"), ("east", "vermillion"))):
            axes.plot(days, current[:, k], "o-", color=style.PALETTE[colour], ms=3.0, lw=0.8,
                      label=name)  # fmt: skip
        axes.axhline(0.0, color=style.GUIDE, lw=0.7)
        axes.set_ylabel("current [m/s]")
        _date(axes, start, DAY)
        axes.legend(ncols=2)
    return figure


def evidence_figure(one: DeploymentHealth) -> Figure:
    """Log odds of a fault over the dives."""
    hours = (one.time - one.time[0]) / HOUR
    known = np.isfinite(one.evidence)
    with _drawn((6.0, 2.0)) as (figure, axes):
        axes.plot(hours[known], one.evidence[known], ".-", color=style.COMMAND, lw=1.0, ms=4.0)
        axes.axhline(one.threshold, color=style.PALETTE["vermillion"], lw=1.0, label="alarm")
        axes.set_ylabel("log odds of a fault")
        axes.legend(loc="upper left")
        _date(axes, float(one.time[0]), HOUR)
    return figure


def channel_figures(
    one: DeploymentHealth, which: Sequence[int], name: str
) -> list[tuple[str, Figure, str]]:
    """Draw channels of health with their levels: name, figure and caption of each."""
    hours = (one.time - one.time[0]) / HOUR
    begun = one.dives.index(one.since_dive) if one.alarm and one.since_dive is not None else None
    found = []
    for k in which:
        seen = np.isfinite(one.values[:, k])
        after = slice(int(np.argmax(seen)), None)
        with _drawn(SMALL) as (figure, axes):
            _band(axes, hours[after], one.levels.level[after, k], one.levels.deviation[after, k])
            axes.plot(hours[seen], one.values[seen, k], ".", color=style.COMMAND, ms=4.0)
            if begun is not None:
                axes.axvline(hours[begun], color=style.PALETTE["vermillion"], lw=0.9)
            draw_dates(axes, float(one.time[0]), HOUR)
        channel = CHANNELS[k]
        unit = "" if channel.unit == "1" else f" [{channel.unit.replace(' s-1', '/s')}]"
        caption = f"{channel.name}{unit}: {channel.says}."
        found.append((f"{name}-{channel.name}", figure, caption))
    return found


def belief_figure(said: Answers, name: str) -> Figure:
    """Estimate of a parameter after each dive with its band, and smoothed over all dives."""
    assert said.beliefs is not None
    hours = (said.time - said.time[0]) / HOUR
    value, off = said.beliefs.value(name), said.beliefs.deviation(name)
    back = said.beliefs.value(name, smoothed=True)
    with _drawn(SMALL) as (figure, axes):
        _band(axes, hours, value, off)
        axes.plot(hours, back, "--", color=style.COMMAND, lw=0.9)
        # the wide bands of the first dives would hide the others
        low, high = (np.quantile(value + side * BAND * off, q) for side, q in ((-1, 0.1), (1, 0.9)))
        axes.set_ylim(min(low, back.min()) - 0.1 * (high - low),
                      max(high, back.max()) + 0.1 * (high - low))  # fmt: skip
        draw_dates(axes, float(said.time[0]), HOUR)
    return figure


def _band(axes: Axes, hours: Array, value: Array, deviation: Array) -> None:
    blue = style.PALETTE["blue"]
    axes.fill_between(hours, value - BAND * deviation, value + BAND * deviation, color=blue,
                      alpha=0.2, lw=0.0)  # fmt: skip
    axes.plot(hours, value, color=blue, lw=1.0)


def map_figure(one: DeploymentHindcast) -> Figure:
    """Map of all surfacings, and of the last few with the ellipses of their forecasts."""
    scored = [s for s in one.surfacings if s.scored]
    few = (scored or list(one.surfacings))[-CLOSE_SURFACINGS:]
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
    """Draw fixes and, for the methods in `marks`, their forecasts with the ellipses."""
    fixes, begins = (np.array([s.places[name] for s in surfacings]) for name in ("fix", "begin"))
    outlines = []
    for one in surfacings if marks else ():  # latitude, longitude [degree] of 90 % ellipses, (2, n)
        reach = one.surfacing.reach[1] * one.surfacing.covariance
        north, east = outline(reach, ELLIPSE_POINTS).T
        outlines.append(np.stack(position(north, east, *one.places["forecast"])))
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


def current_figure(one: DeploymentHindcast) -> Figure:
    """Current north and east over time: found after each dive, forecast before it with 90 %."""
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
        _date(axes, start, HOUR)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=4)
    return figure


def error_figure(one: DeploymentHindcast) -> Figure:
    """Fraction of the scored surfacings whose error is below a value, for each method."""
    scored = [s for s in one.surfacings if s.scored]
    with _drawn((style.PAGE_WIDTH, 2.6)) as (figure, axes):
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
