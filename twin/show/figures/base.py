"""Registry: the figures of a mission by name; `register` adds one's own.

A figure is one file with one function that takes a trajectory and returns a matplotlib Figure, and
one `FigureKind` that says its name and what it shows.
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
    """One figure of a mission."""

    name: str
    """what the command line calls it; its file is NAME.png"""
    summary: str
    """what it shows, for tables and help"""
    draw: Callable[..., Figure]
    """of a Trajectory, with keyword options that have defaults"""
    takes_tracks: bool = False
    """whether `draw` has the option `tracks`: dead-reckoned tracks beside the true one"""

    def flaw(self, name: str) -> str:
        """A flaw of the kind as a clause; empty where there is none."""
        if not callable(self.draw):
            return "`draw` must be a function of a trajectory that returns a Figure"
        first, *options = inspect.signature(self.draw).parameters.values()
        if any(option.default is option.empty for option in options):
            return f"the options of `draw` beside {first.name!r} need defaults"
        if self.takes_tracks != ("tracks" in [option.name for option in options]):
            return "`takes_tracks` must say whether `draw` has an option `tracks`"
        return ""


FIGURES: Registry[FigureKind] = seams.FIGURES
"""Every figure by the name that the command line uses."""

register = FIGURES.add
"""Add a figure of one's own."""


def figure_names() -> tuple[str, ...]:
    """Names that `figure`, `Trajectory.plot` and `twin plot --figure` take."""
    return tuple(FIGURES)


def suited(trajectory: Trajectory, name: str) -> FigureKind:
    """The figure of that name; `log` for the overview of a mission whose motion is not known."""
    known = "true_depth" in trajectory and "true_surge" in trajectory
    return FIGURES[LOG if name == OVERVIEW and not known else name]


def figure(trajectory: Trajectory, name: str = OVERVIEW, **options: Any) -> Figure:
    """A figure of one mission; `overview` of a mission whose motion is not known is `log`.

    Args:
      name: one of `figure_names()`.
      options: of that figure, such as tracks=[...] or colour="pitch".

    Raises:
      UnknownName: no such figure or option. InputError: the trajectory lacks what it shows.
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


def table() -> str:
    """The shipped figures as a markdown table, as docs/howto/render.md shows it."""
    rows = ["| `--figure` | shows |", "|---|---|"]
    rows += [f"| `{name}` | {FIGURES[name].summary} |" for name in FIGURES.shipped()]
    return "\n".join(rows) + "\n"
