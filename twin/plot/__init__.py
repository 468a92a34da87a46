"""Plots of trajectories: functions that return a matplotlib Figure, all in one style.

Nothing here uses pyplot: save a figure with `figure.savefig(path)`, or show it in a notebook.
"""

from collections.abc import Callable

from matplotlib.figure import Figure

from twin.plot.current_profile import current_figure
from twin.plot.logged_dive import log_figure
from twin.plot.overview import overview_figure
from twin.plot.section import section_figure
from twin.plot.sensors import sensor_figure
from twin.plot.signals import actuator_figure, velocity_figure
from twin.plot.track import track_3d_figure, track_figure

FIGURES: dict[str, Callable[..., Figure]] = {
    "overview": overview_figure,
    "track": track_figure,
    "track_3d": track_3d_figure,
    "section": section_figure,
    "velocity": velocity_figure,
    "actuator": actuator_figure,
    "sensor": sensor_figure,
    "current": current_figure,
    "log": log_figure,
}
"""Every figure by the name that the command line uses."""

__all__ = [
    "FIGURES",
    "actuator_figure",
    "current_figure",
    "log_figure",
    "overview_figure",
    "section_figure",
    "sensor_figure",
    "track_3d_figure",
    "track_figure",
    "velocity_figure",
]
