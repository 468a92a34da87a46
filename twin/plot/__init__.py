"""Plots of trajectories: functions that return a matplotlib Figure, all in one style.

Nothing here uses pyplot: save a figure with `figure.savefig(path)`, or show it in a notebook. Each
figure is imported when it is first used; `registry` adds one of one's own.
"""

from twin.lazy import attach

_PLACES = {
    "FIGURES": "twin.plot.registry:FIGURES",
    "FigureKind": "twin.plot.registry:FigureKind",
    "actuator_figure": "twin.plot.actuator:actuator_figure",
    "current_figure": "twin.plot.current_profile:current_figure",
    "figure": "twin.plot.registry:figure",
    "figure_names": "twin.plot.registry:figure_names",
    "log_figure": "twin.plot.logged_dive:log_figure",
    "overview_figure": "twin.plot.overview:overview_figure",
    "register": "twin.plot.registry:register",
    "section_figure": "twin.plot.section:section_figure",
    "sensor_figure": "twin.plot.sensor:sensor_figure",
    "track_3d_figure": "twin.plot.track_3d:track_3d_figure",
    "track_figure": "twin.plot.track:track_figure",
    "velocity_figure": "twin.plot.velocity:velocity_figure",
}
"""Where each public name is."""

__all__ = [*_PLACES]
__getattr__, __dir__ = attach(__name__, _PLACES)
