"""`twin view`: a stored mission, or one that is flown now, in MuJoCo's interactive viewer."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from twin.cli.console import Console
from twin.errors import InputError

if TYPE_CHECKING:
    from twin.render.film import Subject
    from twin.render.flight import Flight


@dataclass(frozen=True, kw_only=True)
class View:
    """Watch a stored mission, or without a store a mission that is flown as you watch."""

    store: Annotated[Path | None, tyro.conf.Positional] = None
    """store (zarr) that holds the mission; without it a mission is flown live"""
    mission: int = 0
    """index of the mission in the store"""
    plan: str | None = None
    """live: shipped mission name, or the path of a mission TOML file; default: the shipped one that
    suits the vehicle"""
    current: str = "none"
    """live: current, as in `twin simulate`"""
    floor: str = "none"
    """live: sea floor of a depth, as in `twin simulate`"""
    vehicle: str | None = None
    """vehicle by name or MJCF file (:PRESET behind it); default: the store's own, live the
    shipped glider"""
    camera: Literal["orbit", "side", "map", "chase"] = "orbit"
    """first view of the whole track; chase shows the glider in open water at true scale"""
    speed_up: float | None = None
    """mission seconds per second; default: 60, with the chase camera 5"""
    start: float | None = None
    """first mission time shown [s]"""
    end: float | None = None
    """last mission time shown [s]"""
    colour: Literal["speed", "current", "error"] = "speed"
    """what colours the track; error is the first track's of --tracks"""
    tracks: Path | None = None
    """dead-reckoned tracks to draw beside the true one: .nc, .zarr, .npz or .csv"""
    only: str | None = None
    """names of the tracks to draw, separated by commas; default: all of the file"""
    seconds: float | None = None
    """close the window after so many seconds; default: it stays open"""

    def run(self, console: Console) -> int:
        """Open the window; returns when it is closed."""
        from twin.render.screen import require_screen

        if self.seconds is not None and not self.seconds > 0:
            raise InputError(f"--seconds {self.seconds:g} must be positive")
        require_screen()
        os.environ["MUJOCO_GL"] = "glfw"  # a window: MuJoCo must not look for EGL's functions
        from twin.render.shot import Shot
        from twin.render.window import KEYS, Window

        speed_up = self.speed_up
        if speed_up is None:
            speed_up = CHASE_SPEED_UP if self.camera == "chase" else SPEED_UP
        shot = Shot(
            camera=self.camera,
            speed_up=speed_up,
            start=self.start,
            end=self.end,
            colour=self.colour,
        )
        subject, flight = self._live() if self.store is None else self._replay(self.store)
        window = Window(subject, shot, flight, speed_up=speed_up)
        console.note("; ".join(f"{keys}: {what}" for keys, what in KEYS))
        rate = window.run(self.seconds)
        console.say(f"{subject.title}: closed, {rate:.0f} frames per second")
        return 0

    def _replay(self, store: Path) -> tuple[Subject, Flight]:
        from twin.render.flight import Replay
        from twin.render.subject import read_subject

        subject = read_subject(
            store, self.mission, vehicle=self.vehicle, tracks=self.tracks, names=self.only
        )
        return subject, Replay(subject.trajectory)

    def _live(self) -> tuple[Subject, Flight]:
        """Flown once without a picture, which takes a moment, to know how large the sea must be."""
        from twin.mission.shipped import load_mission_for
        from twin.physics.scenario import Scenario
        from twin.physics.simulation import simulate
        from twin.physics.tables import floor_table
        from twin.render.film import Subject
        from twin.render.flight import Live
        from twin.vehicle.vehicle import load_vehicle
        from twin.water.current.spec import parse_current
        from twin.water.floor import parse_floor

        if self.tracks is not None:
            raise InputError("--tracks needs a store: dead-reckoned tracks belong to its missions")
        vehicle = load_vehicle(self.vehicle or "glider")
        plan = load_mission_for(vehicle, self.plan)
        scenario = Scenario(
            vehicle=vehicle,
            plan=plan,
            current=parse_current(self.current),
            floor=parse_floor(self.floor),
        )
        title = f"Mission {plan.name}, live"
        floor = floor_table(scenario, scenario.run_time())
        subject = Subject(
            trajectory=simulate(scenario),
            vehicle=vehicle,
            title=title,
            floor=floor if floor.size else None,
        )
        return subject, Live(scenario)


SPEED_UP, CHASE_SPEED_UP = 60.0, 5.0
"""Mission seconds per second when none are asked for"""
