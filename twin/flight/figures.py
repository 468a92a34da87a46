"""Figures of a flight: section and histogram of the vertical water velocity, and a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from twin.errors import InputError
from twin.flight.flight import Flight
from twin.plot import style
from twin.records.whole import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

CM = 100.0
HOUR = 3600.0
MOST_POINTS = 20000
"""of a section; more than its pixels"""
BINS = 60


def section(flight: Flight) -> Figure:
    """Depth over time, coloured by the vertical velocity of the water [cm/s]."""
    starts = _starts(flight)
    pieces, values = [], []
    total = sum(len(one.dive.depth) for one in flight.missions)
    step = max(1, total // MOST_POINTS)
    for one, start in zip(flight.missions, starts, strict=True):
        depth, w = one.dive.depth[::step], CM * one.dive.water_up[::step]
        time = (start + flight.store.period * step * np.arange(len(depth))) / HOUR
        points = np.column_stack([time, depth])
        pieces.append(np.stack([points[:-1], points[1:]], axis=1))
        values.append(0.5 * (w[:-1] + w[1:]))
    segments, w = np.concatenate(pieces), np.concatenate(values)
    keep = np.isfinite(segments).all(axis=(1, 2)) & np.isfinite(w)
    if not keep.any():
        raise InputError("no vertical water velocity to draw: no dive that the model can fly")
    with style.styled():
        figure = style.new_figure(width=style.PAGE_WIDTH, height=2.8)
        axes = figure.add_subplot()
        lines = LineCollection(list(segments[keep]), array=w[keep], cmap="RdBu_r", linewidths=1.4)
        largest = float(np.percentile(np.abs(w[keep]), 98))
        lines.set_clim(-largest, largest)
        axes.add_collection(lines)
        ends = segments[keep][:, :, 0]
        axes.set_xlim(float(ends.min()), float(ends.max()))
        style.depth_axis(axes, float(segments[keep][:, :, 1].max()))
        axes.set_xlabel("time since the first sample [h]")
        bar = figure.colorbar(lines, ax=axes, pad=0.02, aspect=22)
        bar.set_label("vertical water velocity, up [cm/s]")
        bar.outline.set_visible(False)
    return figure


def histogram(flight: Flight) -> Figure:
    """How often which vertical velocity was found, in dives and in climbs."""
    dives = [one.dive for one in flight.missions]
    w = CM * np.concatenate([dive.water_up for dive in dives])
    known = np.isfinite(w)
    if not known.any():
        raise InputError("no vertical water velocity to draw: no dive that the model can fly")
    largest = float(np.percentile(np.abs(w[known]), 99.5))
    edges = np.linspace(-largest, largest, BINS + 1)
    with style.styled():
        figure = style.new_figure()
        axes = figure.add_subplot()
        for label, masks, colour in (
            ("dives", [dive.descending for dive in dives], style.PALETTE["blue"]),
            ("climbs", [dive.ascending for dive in dives], style.PALETTE["vermillion"]),
        ):
            part = w[np.concatenate(masks) & known]
            if not part.size:
                continue
            text = f"{label}: mean {part.mean():.2f}, deviation {part.std():.2f} cm/s"
            axes.hist(
                part, list(edges), density=True, histtype="step", color=colour, lw=1.3, label=text
            )
            axes.axvline(part.mean(), color=colour, lw=0.8, ls="--")
        axes.set_xlabel("vertical water velocity, up [cm/s]")
        axes.set_ylabel("share per cm/s")
        axes.set_ylim(top=1.3 * axes.get_ylim()[1])
        axes.legend(loc="upper left")
    return figure


def track_map(flight: Flight) -> Figure:
    """The corrected track with its deviation, the fixes and the depth-averaged currents."""
    placed = all(one.place.known for one in flight.missions)
    if not placed and len(flight.missions) > 1:
        raise InputError("no map: the store does not say where its missions began")
    with style.styled():
        figure = style.new_figure(width=4.6, height=3.6)
        axes = figure.add_subplot()
        for one in flight.missions:
            x, y = _xy(flight, one.dive.mission, one.position)
            axes.plot(x, y, color=style.ESTIMATE, lw=1.0, zorder=2)
            if len(one.fixes):
                x, y = _xy(flight, one.dive.mission, one.fixes.position)
                axes.plot(x, y, ".", color=style.COMMAND, ms=3.5, zorder=3)
        _arrows(axes, flight)
        axes.plot([], [], color=style.ESTIMATE, label="corrected track")
        axes.plot([], [], ".", color=style.COMMAND, label="GPS fix")
        if placed:
            middle = np.concatenate([_xy(flight, o.dive.mission, o.position)[1]
                                     for o in flight.missions])  # fmt: skip
            axes.set_aspect(1.0 / np.cos(np.radians(float(np.nanmean(middle)))))
            axes.set_xlabel("longitude [°]")
            axes.set_ylabel("latitude [°]")
        else:
            axes.set_aspect("equal")
            axes.set_xlabel("east [m]")
            axes.set_ylabel("north [m]")
        axes.margins(0.12)
        axes.legend(loc="best")
    return figure


def _arrows(axes: Axes, flight: Flight) -> None:
    """The depth-averaged currents, at the middles of their dives, with a scale."""
    by_mission = {one.dive.mission: one for one in flight.missions}
    if not flight.currents:
        return
    middles = []
    for current in flight.currents:
        one = by_mission[current.mission]
        middle = one.position[[(current.first + current.last) // 2]]
        middles.append([values[0] for values in _xy(flight, current.mission, middle)])
    x, y = np.array(middles).T
    north = np.array([one.north for one in flight.currents])
    east = np.array([one.east for one in flight.currents])
    quiver = axes.quiver(x, y, east, north, color=style.TRUTH, width=0.004, zorder=4)
    quiver.set_in_layout(False)
    usual = float(np.hypot(north, east).max())
    nice = max(float(f"{usual:.0e}"), 0.01)
    label = f"current {CM * nice:.0f} cm/s"
    axes.quiverkey(quiver, 0.18, 0.06, nice, label, labelpos="E", fontproperties={"size": 7.5})


def _xy(flight: Flight, mission: int, points: Array) -> tuple[Array, Array]:
    """Longitude and latitude [degree] of points [m], or east and north without a place."""
    one = next(one for one in flight.missions if one.dive.mission == mission)
    if not one.place.known:
        return points[:, 1], points[:, 0]
    latitude, longitude = one.place.degrees(points[:, 0], points[:, 1])
    return longitude, latitude


def _starts(flight: Flight) -> list[float]:
    """[s] of each mission's first sample since that of the first; one after the other without."""
    from twin.records.logs import start_times

    chosen = [one.dive.mission for one in flight.missions]
    starts = start_times(flight.store)[chosen]
    if np.isfinite(starts).all():
        return [float(start) for start in starts - starts.min()]
    lengths = flight.store.period * np.array([len(one.dive.depth) for one in flight.missions])
    return [float(end) for end in np.concatenate([[0.0], np.cumsum(lengths)[:-1]])]


FIGURES = {"w_section": section, "w_histogram": histogram, "map": track_map}
"""By the name of their files"""


def write_figures(flight: Flight, folder: Path) -> tuple[list[Path], list[str]]:
    """Draw all figures into a folder; returns their files, and why others are missing.

    Raises:
      WriteError: the disk refuses.
    """
    written, missing = [], []
    for name, draw in FIGURES.items():
        try:
            figure = draw(flight)
        except InputError as error:
            missing.append(f"no {name} figure: {error}")
            continue
        path = folder / f"{name}.png"
        with whole_file(path) as place:
            figure.savefig(place, dpi=PRINT_DPI)
        written.append(path)
    return written, missing


PRINT_DPI = 200
"""[pixel/in]"""
