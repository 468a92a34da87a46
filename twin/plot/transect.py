"""Transect: temperature and salinity as sections, depth down, over the distance along the track."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.plot import style
from twin.plot.hydrography import draw_sections
from twin.plot.registry import FigureKind
from twin.records.logged_trajectory import source_of
from twin.records.trajectory import Trajectory

Array = NDArray[np.float64]


def transect_figure(trajectory: Trajectory) -> Figure:
    """Temperature and salinity over the way along the track and depth.

    Raises:
      InputError: the mission has neither.
    """
    distance = along_track(trajectory)
    metres, unit = style.length_unit(distance)
    word = source_of(trajectory, "true_north", "true track")
    return draw_sections(trajectory, distance / metres, f"distance along the {word} [{unit}]")


def along_track(trajectory: Trajectory) -> Array:
    """Horizontal way over ground [m] up to each sample, (time,); straight over unknown samples."""
    place = np.stack([trajectory["true_north"], trajectory["true_east"]], axis=1)
    known = np.isfinite(place).all(axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(place[known], axis=0).T))])
    return np.interp(trajectory.time, trajectory.time[known], way)


FIGURE = FigureKind(
    name="transect",
    summary="temperature and salinity over the distance along the track and depth",
    draw=transect_figure,
)
