"""What a figure of a report is: a place on the page, a caption and a drawing."""

from __future__ import annotations

import abc
from typing import ClassVar

from matplotlib.figure import Figure

from learn.report.contents import Contents
from twin.errors import InputError, unknown_name
from twin.plugins import place_of
from twin.registry import check_class

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
