"""Live: a mission that is flown while its page shows it, at so many mission seconds per second."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, SimulationUnstable
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.records.trajectory import Trajectory
from twin.show.render.scale import track_values
from twin.show.render.shot import Shot, Subject
from twin.show.render.subject import live_simulation
from twin.show.web.channels import read_channels
from twin.show.web.scene import describe, pack_channels, scale_share

FIRST = 2
"""Samples with which the page begins"""
LONGEST = 0.5
"""[s] of computing in one answer, so that a fast mission does not keep the page waiting"""
SLICE = 200
"""Steps between two looks at the clock"""


class LiveMission:
    """A closed-loop simulation that goes on while somebody asks for its samples.

    It begins with the first question, so that whoever opens the page sees it from the start.
    """

    def __init__(self, scenario: Scenario, subject: Subject, shot: Shot, speed_up: float):
        """
        Args:
          subject: the same mission flown once beforehand: it tells how large the sea must be.
          speed_up: mission seconds per second.

        Raises:
          InputError: the scenario is navigated, or the shot shows only a part.
        """
        self._simulation = live_simulation(scenario)
        if shot.start is not None or shot.end is not None:
            raise InputError("--start and --end are for a stored mission; a live one begins at 0 s")
        self._subject, self._shot, self._speed = subject, shot, speed_up
        whole = np.ones(len(subject.trajectory.time), bool)
        self._scale = track_values(subject.trajectory, shot.colour, whole, ())[1]
        self.mission = self._describe()
        # the first flight may have ended before its longest time; a step more completes its samples
        flown = float(subject.trajectory.time[-1]) / self._simulation.model.opt.timestep
        self._steps = min(self._simulation.steps, round(flown) + 2)
        self._still = self.mission["profile"] is None
        self._begun: float | None = None
        self._turn = threading.Lock()
        self._problem = ""

    def _describe(self) -> dict[str, Any]:
        """The page's mission: all of the scene, the first samples, and where it will end."""
        trajectory = self._subject.trajectory
        mission = describe(self._subject, self._shot, len(trajectory.time))
        mission["channels"] = self._channels(trajectory, 0, FIRST, still=mission["profile"] is None)
        mission["live"] = {
            "end": float(trajectory.time[-1]),
            "depth": float(trajectory["true_depth"].max()),
        }
        mission["opening"] |= {"time": float(trajectory.time[0]), "speed": self._speed}
        mission["notes"] = ["The mission is flown while this page shows it."]
        return mission

    def rows(self, first: int) -> dict[str, Any]:
        """The samples from number `first` on that are flown by now, and whether more will come."""
        with self._turn:
            running = self._fly()
            # the last sample is complete a step after its time
            count = len(self._simulation.rows) - running
            flown = self._simulation.trajectory() if count > max(first, 1) else None
        if self._problem:
            return {"running": False, "problem": self._problem}
        if flown is None:
            return {"running": running}
        return {
            "running": running,
            "channels": self._channels(flown, first, count, still=self._still),
        }

    def _fly(self) -> bool:
        """Step to where the clock is; whether the mission still goes on."""
        now = time.monotonic()
        if self._begun is None:
            self._begun = now
        simulation = self._simulation
        timestep = simulation.model.opt.timestep
        due = (now - self._begun) * self._speed
        try:
            with quiet_mujoco():
                while simulation.data.time < due and not self._over:
                    ahead = int((due - simulation.data.time) / timestep) + 1
                    left = self._steps - round(simulation.data.time / timestep)
                    simulation.step(max(1, min(ahead, SLICE, left)))
                    if time.monotonic() - now > LONGEST:
                        # computing is slower than the clock: the mission goes as fast as it can
                        self._begun = time.monotonic() - simulation.data.time / self._speed
                        break
            if simulation.failed:
                simulation.trajectory()
        except SimulationUnstable as error:
            self._problem = str(error)
        return not self._over

    @property
    def _over(self) -> bool:
        simulation = self._simulation
        done = round(simulation.data.time / simulation.model.opt.timestep) >= self._steps
        return done or simulation.failed or bool(self._problem)

    def _channels(
        self, trajectory: Trajectory, first: int, count: int, *, still: bool
    ) -> dict[str, Any]:
        """Samples `first` to `count` of a trajectory, packed."""
        shown: NDArray[np.bool_] = np.zeros(len(trajectory.time), bool)
        shown[first:count] = True
        values, _ = track_values(trajectory, self._shot.colour, shown, ())
        channels = read_channels(
            trajectory, shown, scale_share(values, self._scale), self._subject.floor, count
        )
        return pack_channels(channels, still=still)
