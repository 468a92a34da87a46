"""Base of the figures: base class and table of types; `register` adds a figure of your own.

The file of a figure has a function that takes a trajectory and returns a matplotlib Figure, and a
`FigureKind` with the figure's name and summary.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from twin import seams
from twin.errors import InputError, UnknownName
from twin.registry import Registry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twin.records.trajectory import Trajectory

LOG, OVERVIEW = "log", "overview"


@dataclasses.dataclass(frozen=True)
class FigureKind:
    """One type of figure of a mission."""

    name: str
    """name on the command line; the figure's file is NAME.png"""
    summary: str
    """content of the figure, for tables and help"""
    draw: Callable[..., Figure]
    """function of a Trajectory, with keyword options that have defaults"""
    takes_tracks: bool = False
    """True if `draw` has the option `tracks`: dead-reckoned tracks beside the true track"""

    def flaw(self, name: str) -> str:
        """Defect of the figure type as a clause; empty if there is none."""
        if not callable(self.draw):
            return "`draw` must be a function of a trajectory that returns a Figure"
        first, *options = inspect.signature(self.draw).parameters.values()
        if any(option.default is option.empty for option in options):
            return f"the options of `draw` beside {first.name!r} need defaults"
        if self.takes_tracks != ("tracks" in [option.name for option in options]):
            return "`takes_tracks` must say whether `draw` has an option `tracks`"
        return ""


FIGURES: Registry[FigureKind] = seams.FIGURES
"""Figures by their names on the command line."""

register = FIGURES.add
"""Add a figure of your own."""


def figure_names() -> tuple[str, ...]:
    """Names that `figure`, `Trajectory.plot` and `twin plot --figure` take."""
    return tuple(FIGURES)


def suited(trajectory: Trajectory, name: str) -> FigureKind:
    """Return the figure type of a name; the overview becomes `log` if the motion is unknown."""
    known = "true_depth" in trajectory and "true_surge" in trajectory
    return FIGURES[LOG if name == OVERVIEW and not known else name]


def figure(trajectory: Trajectory, name: str = OVERVIEW, **options: Any) -> Figure:
    """Draw a figure of one mission; the overview becomes `log` if the motion is unknown.

    Args:
      name: one of `figure_names()`.
      options: options of that figure, such as tracks=[...] or colour="pitch".

    Raises:
      UnknownName: no such figure or option. InputError: the trajectory lacks a needed signal.
    """
    kind = suited(trajectory, name)
    name = kind.name
    _, *allowed = inspect.signature(kind.draw).parameters
    for option in options:
        if option not in allowed:
            raise UnknownName(f"option of figure {name!r}", option, allowed)
    try:
        return kind.draw(trajectory, **options)
    except UnknownName as error:
        if not error.name.startswith(("true_", "measured_", "commanded_")):
            raise
        raise InputError(
            f"this mission has no signal {error.name}, which the {name} figure shows"
        ) from error
