"""`twin plot`: figures of one mission of a store."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.console import Console
from twin.errors import InputError, unknown_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = (".png", ".pdf", ".svg")
"""Endings that matplotlib writes here."""
ALL = "all"


@dataclass(frozen=True, kw_only=True)
class Plot:
    """Figures of one mission: tracks, sections, velocities, actuators, sensors, currents."""

    store: Annotated[Path, tyro.conf.Positional]
    """Store (zarr) that holds the mission."""

    mission: int = 0
    """Index of the mission in the store."""

    figure: str = "overview"
    """overview, track, track_3d, section, velocity, actuator, sensor, current, or all."""

    out: Path = Path("plot.png")
    """File (.png, .pdf or .svg); with --figure all a folder, made if need be."""

    tracks: Path | None = None
    """File of dead-reckoned tracks (.nc, .zarr, .npz or .csv) to draw beside the true one."""

    def run(self, console: Console) -> int:
        """Draw and save; says which files were written."""
        from twin.plot import FIGURES
        from twin.render.tracks import read_tracks
        from twin.store import read_trajectory

        if self.figure not in (*FIGURES, ALL):
            raise InputError(unknown_name("figure", self.figure, (*FIGURES, ALL)))
        if self.figure != ALL and self.out.suffix.lower() not in FORMATS:
            raise InputError(f"--out {self.out}: the ending must be one of {', '.join(FORMATS)}")
        trajectory = read_trajectory(self.store, self.mission)
        tracks = read_tracks(self.tracks, self.mission) if self.tracks is not None else []
        measured = any(name.startswith("measured_") for name in trajectory.signals)
        names = [self.figure]
        if self.figure == ALL:
            names = [name for name in FIGURES if measured or name != "sensor"]
            self.out.mkdir(parents=True, exist_ok=True)
        for name in names:
            path = self.out / f"{name}.png" if self.figure == ALL else self.out
            draw = FIGURES[name]
            drawn: Figure = (
                draw(trajectory, tracks) if name in _WITH_TRACKS else draw(trajectory)  # type: ignore[operator]
            )
            path.parent.mkdir(parents=True, exist_ok=True)
            drawn.savefig(path)
            console.say(str(path))
        if self.figure == ALL and not measured:
            console.note("no sensor figure: the mission has no measured signals")
        return 0


_WITH_TRACKS = ("overview", "track", "track_3d")
