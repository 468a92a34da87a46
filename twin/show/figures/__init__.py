"""Figures of trajectories: functions that return a matplotlib Figure, all in one style.

No figure uses pyplot: save one with `figure.savefig(path)`, or show it in a notebook. Each figure
is imported when it is first used; `register` adds a figure of your own.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.show.figures.base import FIGURES as FIGURES
    from twin.show.figures.base import LOG as LOG
    from twin.show.figures.base import OVERVIEW as OVERVIEW
    from twin.show.figures.base import FigureKind as FigureKind
    from twin.show.figures.base import figure as figure
    from twin.show.figures.base import figure_names as figure_names
    from twin.show.figures.base import register as register
    from twin.show.figures.base import suited as suited
    from twin.show.figures.logged_dive import log_figure as log_figure
    from twin.show.figures.map import Currents as MapCurrents  # noqa: F401
    from twin.show.figures.map import MapContent as MapContent
    from twin.show.figures.map import draw_base as draw_base
    from twin.show.figures.map import draw_content as draw_map  # noqa: F401
    from twin.show.figures.map import joined as joined_longitude  # noqa: F401
    from twin.show.figures.map_ground import NEIGHBOURS as NEIGHBOURS
    from twin.show.figures.map_ground import box_around as box_around
    from twin.show.figures.map_ground import rings as rings
    from twin.show.figures.page_layout import INDEX as INDEX
    from twin.show.figures.page_layout import Page as Page
    from twin.show.figures.page_layout import add_caption as add_caption
    from twin.show.figures.page_layout import check_page_target as check_page_target
    from twin.show.figures.page_layout import mission_caption as mission_caption
    from twin.show.figures.page_layout import missions_caption as missions_caption
    from twin.show.figures.section import overview_figure as overview_figure
    from twin.show.figures.section import section_figure as section_figure
    from twin.show.figures.signals import actuator_figure as actuator_figure
    from twin.show.figures.signals import sensor_figure as sensor_figure
    from twin.show.figures.signals import velocity_figure as velocity_figure
    from twin.show.figures.track import track_3d_figure as track_3d_figure
    from twin.show.figures.track import track_figure as track_figure
    from twin.show.figures.water import current_figure as current_figure

__getattr__, __dir__ = attach(__name__, places(__name__))
