"""Command `twin view`: show a stored or a live mission in a window or a browser."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from twin.cli.console import Console
from twin.cli.options import Seconds
from twin.cli.program import Ended
from twin.errors import InputError

if TYPE_CHECKING:
    from twin import Scenario
    from twin.show.render import Shot, Subject

SPEED_UP, CHASE_SPEED_UP = 60.0, 5.0  # default mission seconds per second


@dataclass(frozen=True, kw_only=True)
class ViewMission:
    """Watch a stored mission, or without a store a mission that is flown as you watch.

    Examples:

        twin view run.zarr --speed-up 120
        twin view --vehicle seaglider --web
    """

    store: Annotated[Path | None, tyro.conf.Positional] = None
    """store (zarr) that holds the mission; without it a mission is flown live"""
    mission: int = 0
    """index of the mission in the store"""
    plan: str | None = None
    """live: shipped mission name, or the path of a mission TOML file; default: the shipped mission
    that suits the vehicle"""
    current: str | None = None
    """live: current, as in `twin simulate`; default: none"""
    floor: str | None = None
    """live: sea floor, as in `twin simulate`; default: none"""
    vehicle: str | None = None
    """live or for a log: vehicle by name or MJCF file (:PRESET after it); default: the shipped
    glider if live, the shipped vehicle of the log's type for a log"""
    camera: Literal["orbit", "side", "map", "chase"] = "orbit"
    """first view: orbit, side and map show the whole track; chase the glider at true scale"""
    speed_up: float | None = None
    """mission seconds per second; default: 60, with the chase camera 5"""
    start: Seconds | None = None
    """first mission time shown [s]"""
    end: Seconds | None = None
    """last mission time shown [s]"""
    colour: Literal["speed", "current", "error"] = "speed"
    """quantity that colours the track; error is that of the first of --tracks"""
    tracks: Path | None = None
    """dead-reckoned tracks to draw beside the true one: .nc, .zarr, .npz or .csv"""
    only: str | None = None
    """names of the tracks to draw, separated by commas; default: all tracks of the file"""
    seconds: Seconds | None = None
    """time after which the window closes or --web ends; default: stay open"""
    web: bool = False
    """serve a page for a browser, without a screen, to you alone, until Ctrl-C"""
    port: int | None = None
    """port of --web; default: 8080, or the next free port; 0 takes any free port"""

    def run(self, console: Console) -> int:
        """Open the window, or serve the page; return when it is closed."""
        if self.seconds is not None and not self.seconds > 0:
            raise InputError(f"--seconds {self.seconds:g} must be positive")
        if self.port is not None and not self.web:
            raise InputError("--port is of --web, which serves a page in place of the window")
        if self.store is not None:
            self._check_stored(self.store)
        return self._serve(console) if self.web else self._open(console)

    def _check_stored(self, store: Path) -> None:
        """Raise InputError for options of a live mission given with a store."""
        live = {"--plan": self.plan, "--current": self.current, "--floor": self.floor}
        if given := [name for name, value in live.items() if value is not None]:
            raise InputError(
                f"{', '.join(given)}: for a mission that is flown live; {store} holds missions as "
                "they were flown: leave it out, or leave out the store"
            )

    def _open(self, console: Console) -> int:
        """Open the window and return when it is closed."""
        from twin.show.render import require_screen

        require_screen()
        os.environ["MUJOCO_GL"] = "glfw"  # a window: MuJoCo must not look for EGL's functions
        from twin.show.render import KEYS, Live, RenderedFlight, Replay, Window

        shot = self._shot()
        flight: RenderedFlight
        if self.store is None:
            subject, scenario = self._live()
            flight = Live(scenario)
        else:
            subject = self._stored(self.store)
            flight = Replay(subject.trajectory)
        window = Window(subject, shot, flight, speed_up=self._speed)
        console.note("; ".join(f"{keys}: {what}" for keys, what in KEYS))
        rate = window.run(self.seconds)
        console.say(f"{subject.title}: closed, {rate:.0f} frames per second")
        return 0

    def _serve(self, console: Console) -> int:
        """Serve the page until Ctrl-C or for `seconds`."""
        import threading

        from twin.show.web import PORT, LiveMission, PageServer, assemble, page_text

        shot, live = self._shot(), None
        # the port first: a taken port is reported before the mission is read or flown
        with PageServer(self.port) as server:
            if self.port is None and server.port != PORT:
                console.note(f"port {PORT} is taken: this page is served at {server.port}")
            if self.store is None:
                subject, scenario = self._live()
                live = LiveMission(scenario, subject, shot, self._speed)
                text = assemble(live.mission, connect="'self'")
            else:
                subject = self._stored(self.store)
                text = page_text(subject, shot)
            server.show(text, live)
            console.say(f"{subject.title}: open {server.address} in a browser; Ctrl-C ends it")
            console.note(
                f"from another machine: ssh -L {server.port}:localhost:{server.port} THIS_MACHINE, "
                f"then http://localhost:{server.port}{server.path} there"
            )
            try:
                threading.Event().wait(self.seconds)
            except Ended:
                raise
            except KeyboardInterrupt:  # Ctrl-C is the normal end of serving
                pass
        return 0

    @property
    def _speed(self) -> float:
        """Speed-up: mission seconds per second."""
        if self.speed_up is not None:
            return self.speed_up
        return CHASE_SPEED_UP if self.camera == "chase" else SPEED_UP

    def _shot(self) -> Shot:
        from twin.show.render import Shot

        return Shot(
            camera=self.camera,
            speed_up=self._speed,
            start=self.start,
            end=self.end,
            colour=self.colour,
        )

    def _stored(self, store: Path) -> Subject:
        from twin.show.render import read_subject

        return read_subject(
            store, self.mission, vehicle=self.vehicle, tracks=self.tracks, names=self.only
        )

    def _live(self) -> tuple[Subject, Scenario]:
        """Fly the mission once without a picture, to find the size of the sea; and its scenario."""
        import twin
        from twin.physics import floor_table
        from twin.show.render import Subject

        if self.tracks is not None:
            raise InputError("--tracks needs a store: dead-reckoned tracks belong to its missions")
        scenario = twin.scenario_of(
            vehicle=self.vehicle or "glider",
            mission=self.plan,
            current=self.current,
            floor=self.floor,
        )
        floor = floor_table(scenario, scenario.run_time())
        trajectory = twin.simulate(scenario)
        subject = Subject(
            trajectory=trajectory,
            vehicle=scenario.vehicle,
            title=f"Mission {trajectory.provenance['mission']}, live",
            floor=floor if floor.size else None,
            faults=scenario.faults,
        )
        return subject, scenario
