"""Pictures of missions and logs: figures, films, pages for browsers, and their common look."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.show import style as style
    from twin.show.figures.page_layout import Page as Page
    from twin.show.figures.page_layout import html_page as html_page
    from twin.show.flight_figures import FLIGHT_FIGURES as FLIGHT_FIGURES
    from twin.show.flight_figures import flight_caption as flight_caption
    from twin.show.flight_figures import read_flight as read_flight
    from twin.show.flight_figures import write_flight_figures as write_flight_figures
    from twin.show.identification import log_check_rows as log_check_rows
    from twin.show.identification import residual_figure as residual_figure
    from twin.show.identification import write_log_check as write_log_check

__getattr__, __dir__ = attach(__name__, places(__name__))
