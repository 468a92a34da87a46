"""Command `twin plot`: figures of a stored mission, of dives of a log, or of a flight file."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.console import Console
from twin.cli.options import PLOT_FORMATS, parse_rows
from twin.errors import InputError, UnknownName
from twin.show.figures import FIGURES, LOG, OVERVIEW

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twin import Trajectory
    from twin.records import NamedTrack

ALL = "all"
FLIGHT_FIGURES = ("w_section", "w_histogram", "map", "currents")
"""Figures of a file of `twin flight`; the first is the default"""
CHOICES = (
    f"{', '.join((*FIGURES, f'or {ALL}'))} [default: {OVERVIEW}]; of a file of `twin flight` "
    f"{', '.join((*FLIGHT_FIGURES, f'or {ALL}'))} [default: {FLIGHT_FIGURES[0]}]"
)
"""Names that --figure takes"""
PRINT_DPI = 300  # [pixel/in] of a .png, as journals ask for


@dataclass(frozen=True, kw_only=True)
class PlotMission:
    """Figures of one mission: map, tracks, sections, water, velocities, actuators, sensors.

    For a log, the track corrected at the fixes, the measured attitude and the flight model's
    velocities replace a simulation's true signals; labels say so.

    Examples:

        twin plot run.zarr --figure section --out section.png
        twin plot real.zarr --missions all --figure map
    """

    store: Annotated[Path, tyro.conf.Positional]
    """store (zarr) that holds the mission, or a file that `twin flight` wrote (.nc, .zarr)"""
    mission: int = 0
    """index of the mission in the store"""
    missions: str | None = None
    """dives of a log in one figure, such as 0-11,14, or all; in place of --mission"""
    figure: Annotated[str | None, tyro.conf.arg(help=CHOICES)] = None

    out: Path | None = None
    """file (.png, .pdf or .svg) [default: FIGURE.png]; with --figure all a folder, made if it is
    missing [default: plots]; older figures are replaced without asking"""
    vehicle: str | None = None
    """for a log: vehicle whose flight model gives the velocities, a file of `twin identify` or a
    shipped name; default: the shipped vehicle of the log's type"""
    tracks: Path | None = None
    """file of dead-reckoned tracks (.nc, .zarr, .npz or .csv) to draw beside the true one"""
    only: str | None = None
    """names of the tracks to draw, separated by commas; default: all tracks of the file"""

    def run(self, console: Console) -> int:
        """Draw and save the figures, and report the written files."""
        from twin.records import is_flight

        if is_flight(self.store):
            return self._run_flight(console)
        name = OVERVIEW if self.figure is None else self.figure
        if name not in (*FIGURES, ALL):
            raise UnknownName("figure", name, (*FIGURES, ALL))
        out = self._out(name)
        if self.tracks is not None and self.missions is not None:
            raise InputError("--tracks are of one mission; give --mission in place of --missions")
        trajectory, caption = self._read(console)
        tracks: list[NamedTrack] = []
        if self.tracks is not None:
            from twin.records import choose_tracks, read_tracks

            tracks = choose_tracks(read_tracks(self.tracks, self.mission), self.only)
        drawers = {
            each: functools.partial(self._draw, each, trajectory, tracks)
            for each in (FIGURES if name == ALL else (name,))
        }
        return self._save_all(drawers, out, caption, console)

    def _run_flight(self, console: Console) -> int:
        """Draw and save figures of a file that `twin flight` wrote."""
        from twin.show import FLIGHT_FIGURES as OF_FLIGHTS
        from twin.show import flight_caption, read_flight

        given = {"--vehicle": self.vehicle, "--tracks": self.tracks, "--missions": self.missions}
        for option, value in given.items():
            if value is not None:
                raise InputError(f"{option} is for stores; {self.store} is a flight")
        name = FLIGHT_FIGURES[0] if self.figure is None else self.figure
        if name not in (*OF_FLIGHTS, ALL):
            raise UnknownName("figure of a flight", name, (*OF_FLIGHTS, ALL))
        out = self._out(name)
        flight = read_flight(self.store)
        every = {
            n: d for n, d in OF_FLIGHTS.items() if n != "currents" or "profile_depth" in flight
        }
        chosen = every if name == ALL else {name: OF_FLIGHTS[name]}
        drawers = {each: functools.partial(draw, flight) for each, draw in chosen.items()}
        return self._save_all(drawers, out, flight_caption(flight, self.store), console)

    def _save_all(
        self,
        drawers: Mapping[str, Callable[[], Figure]],
        out: Path,
        caption: str,
        console: Console,
    ) -> int:
        """Save the only figure to the file `out`, or all that can be drawn to the folder `out`.

        Raises:
          InputError: no figure can be drawn.
        """
        from twin.records import whole_file
        from twin.show.figures import add_caption

        alone, missing = out.suffix.lower() in PLOT_FORMATS, []
        for name, draw in drawers.items():
            try:
                figure = draw()
            except InputError as error:
                if alone:
                    raise
                missing.append(f"no {name} figure: {error}")
                continue
            path = out if alone else out / f"{name}.png"
            add_caption(figure, caption)
            with whole_file(path) as place:
                figure.savefig(place, dpi=PRINT_DPI)
            console.say(str(path))
        if len(missing) == len(drawers):
            raise InputError(missing[0])
        for reason in missing:
            console.note(reason)
        return 0

    def _out(self, name: str) -> Path:
        """Path of the file, or of the folder of all figures; raise InputError if unusable."""
        if name == ALL:
            out = self.out or Path("plots")
            if out.suffix.lower() in PLOT_FORMATS:
                raise InputError(f"--out {out}: --figure all needs a folder, not a file")
            return out
        out = self.out or Path(f"{name}.png")
        if out.suffix.lower() not in PLOT_FORMATS:
            raise InputError(f"--out {out}: the ending must be one of {', '.join(PLOT_FORMATS)}")
        return out

    def _read(self, console: Console) -> tuple[Trajectory, str]:
        """Read the mission, or several dives of a log as one trajectory, and make the caption."""
        from twin.records import MissionStore, read_trajectory
        from twin.show.figures import mission_caption, missions_caption

        with MissionStore(self.store) as store:
            store.check_filled()
            if not store.logged:
                for option in ("missions", "vehicle"):
                    if getattr(self, option) is not None:
                        raise InputError(
                            f"--{option} is for logs: each mission of {self.store} is a flight of "
                            "its own, and the store holds its truth; --mission chooses one"
                        )
                trajectory = read_trajectory(self.store, self.mission)
                return trajectory, mission_caption(store, self.mission)
            chosen = [self.mission]
            if self.missions is not None:
                rows = parse_rows(self.missions)
                chosen = list(range(len(store))) if rows is None else rows
            if self.figure == LOG and len(chosen) == 1:  # needs no flight model
                return read_trajectory(self.store, chosen[0]), mission_caption(store, chosen[0])
            from twin.logs import logged_trajectory

            trajectory = logged_trajectory(self.store, chosen, self.vehicle)
            if trajectory.unflown:
                console.note(
                    f"without a flight model, by the log's own track: {trajectory.unflown}"
                )
            return trajectory, missions_caption(store, chosen, trajectory.vehicle)

    def _draw(self, name: str, trajectory: Trajectory, tracks: list[NamedTrack]) -> Figure:
        """Draw one figure; raise InputError when the mission lacks a signal of the figure."""
        from twin.show.figures import figure, suited

        takes = suited(trajectory, name).takes_tracks
        if tracks and not takes and self.figure != ALL:
            able = ", ".join(each for each, kind in FIGURES.items() if kind.takes_tracks)
            raise InputError(f"--tracks: the {name} figure draws no tracks; these do: {able}")
        options = {"tracks": tracks} if takes else {}
        try:
            return figure(trajectory, name, **options)
        except InputError as error:
            which = f"mission {self.mission}" if self.missions is None else "missions"
            raise InputError(f"{which} of {self.store}: {error}") from error
