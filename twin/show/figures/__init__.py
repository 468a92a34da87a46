"""Plots of trajectories: functions that return a matplotlib Figure, all in one style.

Nothing here uses pyplot: save a figure with `figure.savefig(path)`, or show it in a notebook. Each
figure is imported when it is first used; `registry` adds one of one's own.
"""

from twin.lazy import attach

_PLACES = {
    "FIGURES": "twin.show.figures.base:FIGURES",
    "FigureKind": "twin.show.figures.base:FigureKind",
    "actuator_figure": "twin.show.figures.device:actuator_figure",
    "current_figure": "twin.show.figures.water:current_figure",
    "figure": "twin.show.figures.base:figure",
    "figure_names": "twin.show.figures.base:figure_names",
    "log_figure": "twin.show.figures.logged_dive:log_figure",
    "overview_figure": "twin.show.figures.overview:overview_figure",
    "register": "twin.show.figures.base:register",
    "section_figure": "twin.show.figures.section:section_figure",
    "sensor_figure": "twin.show.figures.device:sensor_figure",
    "track_3d_figure": "twin.show.figures.track:track_3d_figure",
    "track_figure": "twin.show.figures.track:track_figure",
    "velocity_figure": "twin.show.figures.device:velocity_figure",
}
"""Where each public name is."""

__all__ = [*_PLACES]
__getattr__, __dir__ = attach(__name__, _PLACES)
