"""What a figure of a report is: a place on the page, a caption and a drawing.

Figures of a report by name, in the order of the page; imported when they are looked up.
"""

from __future__ import annotations

import abc
from typing import Any, ClassVar

from matplotlib.figure import Figure

from learn.report.contents import Contents
from twin.errors import InputError, unknown_name
from twin.seams import Registry, check_class, place_of

SECTIONS = (
    *("velocities", "dead_reckoning", "doppler", "over_ground", "tracks", "uncertainty"),
    "training",
)
"""Places on the page, in its order."""


class ReportFigure(abc.ABC):
    """A figure of the page; it looks at the page's contents and may have nothing to show."""

    summary: ClassVar[str]
    """What it shows, a few words."""
    section: ClassVar[str]
    """Where it stands, one of `SECTIONS`."""
    beside: ClassVar[bool] = False
    """Whether it stands beside the next one that is so, where the window is wide enough."""

    @abc.abstractmethod
    def draw(self, contents: Contents) -> Figure | None:
        """The drawing; None where the contents have nothing for it."""

    @abc.abstractmethod
    def caption(self, contents: Contents) -> str:
        """What a reader sees in it, in whole sentences."""


def check_figure(name: str, kind: type[ReportFigure]) -> type[ReportFigure]:
    """Make sure that a figure says what it must.

    Raises:
      InputError: it is only half there, with what it lacks.
    """
    check_class("report figure", name, kind, ReportFigure, ("summary", "section"))
    if kind.section not in SECTIONS:
        raise InputError(
            f"report figure {name!r} ({place_of(kind)}): "
            f"{unknown_name('section', kind.section, SECTIONS)}"
        )
    return kind


_HERE = "learn.report.figures"

REPORT_FIGURES: Registry[Any] = Registry(
    "report figure",
    group="glider_twin.report_figures",
    shipped={
        "velocities": f"{_HERE}.velocities:Velocities",
        "distribution": f"{_HERE}.error_figures:ErrorDistribution",
        "doppler_track": f"{_HERE}.tracks:DopplerTrack",
        "doppler_track_3d": f"{_HERE}.tracks:DopplerTrack3d",
        "doppler_errors": f"{_HERE}.error_figures:DopplerErrors",
        "dives": f"{_HERE}.velocities:Dives",
        "track": f"{_HERE}.tracks:TrackFigure",
        "track_3d": f"{_HERE}.tracks:Track3d",
        "errors": f"{_HERE}.error_figures:Errors",
        "uncertainty": f"{_HERE}.velocities:UncertaintyFigure",
        "training_data": f"{_HERE}.training_data:TrainingData",
        "learning": f"{_HERE}.lines:Learning",
    },
    check=f"{_HERE}.base:check_figure",
    check_shipped=False,
)
"""Every figure, a subclass of `learn.report.figures.base.ReportFigure`; its name is its file's."""
