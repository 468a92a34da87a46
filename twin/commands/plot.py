"""`twin plot`: figures of one mission of a store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.console import Console
from twin.errors import InputError, UnknownName
from twin.plot.registry import FIGURES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twin.records.tracks import NamedTrack
    from twin.records.trajectory import Trajectory

FORMATS = (".png", ".pdf", ".svg")
"""Endings that matplotlib writes here."""
ALL = "all"
CHOICES = ", ".join((*FIGURES, f"or {ALL}"))
"""What --figure takes"""
PRINT_DPI = 300
"""[pixel/in] of a .png, as journals ask for"""


@dataclass(frozen=True, kw_only=True)
class Plot:
    """Figures of one mission: tracks, sections, velocities, actuators, sensors, currents."""

    store: Annotated[Path, tyro.conf.Positional]
    """store (zarr) that holds the mission"""

    mission: int = 0
    """index of the mission in the store"""

    figure: Annotated[str, tyro.conf.arg(help=CHOICES)] = "overview"

    out: Path | None = None
    """file (.png, .pdf or .svg) [default: FIGURE.png]; with --figure all a folder, made if need
    be [default: plots]"""

    tracks: Path | None = None
    """file of dead-reckoned tracks (.nc, .zarr, .npz or .csv) to draw beside the true one"""

    only: str | None = None
    """names of the tracks to draw, separated by commas; default: all of the file"""

    def run(self, console: Console) -> int:
        """Draw and save; says which files were written."""
        from twin.plot.caption import mission_caption
        from twin.records.reader import MissionStore
        from twin.records.store import read_trajectory
        from twin.records.tracks import choose_tracks, read_tracks

        if self.figure not in (*FIGURES, ALL):
            raise UnknownName("figure", self.figure, (*FIGURES, ALL))
        out = self._out()
        trajectory = read_trajectory(self.store, self.mission)
        caption = mission_caption(MissionStore(self.store), self.mission)
        tracks = []
        if self.tracks is not None:
            tracks = choose_tracks(read_tracks(self.tracks, self.mission), self.only)
        if self.figure != ALL:
            self._save(self._draw(self.figure, trajectory, tracks), out, caption, console)
            return 0
        missing = []
        for name in FIGURES:
            try:
                figure = self._draw(name, trajectory, tracks)
            except InputError as error:
                missing.append(f"no {name} figure: {error}")
                continue
            self._save(figure, out / f"{name}.png", caption, console)
        if len(missing) == len(FIGURES):
            raise InputError(missing[0])
        for reason in missing:
            console.note(reason)
        return 0

    def _out(self) -> Path:
        """The file, or the folder of all figures; refused before anything is read."""
        if self.figure == ALL:
            out = self.out or Path("plots")
            if out.suffix.lower() in FORMATS:
                raise InputError(f"--out {out}: --figure all needs a folder, not a file")
            return out
        out = self.out or Path(f"{self.figure}.png")
        if out.suffix.lower() not in FORMATS:
            raise InputError(f"--out {out}: the ending must be one of {', '.join(FORMATS)}")
        return out

    def _draw(self, name: str, trajectory: Trajectory, tracks: Sequence[NamedTrack]) -> Figure:
        """One figure; raises InputError when the mission lacks a signal that it shows."""
        from twin.plot.registry import figure, suited

        takes = suited(trajectory, name).takes_tracks
        if tracks and not takes and self.figure != ALL:
            able = ", ".join(each for each, kind in FIGURES.items() if kind.takes_tracks)
            raise InputError(f"--tracks: the {name} figure draws no tracks; these do: {able}")
        options = {"tracks": tracks} if takes else {}
        try:
            return figure(trajectory, name, **options)
        except InputError as error:
            raise InputError(f"mission {self.mission} of {self.store}: {error}") from error

    def _save(self, figure: Figure, path: Path, caption: str, console: Console) -> None:
        from twin.plot.caption import add_caption
        from twin.records.whole import whole_file

        add_caption(figure, caption)
        with whole_file(path) as place:
            figure.savefig(place, dpi=PRINT_DPI)
        console.say(str(path))
