"""Flight: where the glider is at a mission time, from a record or from physics that runs now."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.frames import flip_quaternion as flip
from twin.frames import flip_vector, quaternion_to_euler
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.physics.true_signals import from_log
from twin.records.trajectory import Trajectory
from twin.show.render.playback import (
    Poses,
    interpolate_quaternion,
    moving_parts,
    part_positions,
    poses,
    spins,
    turns,
)

Array = NDArray[np.float64]


class RenderedFlight(Protocol):
    """What a viewer shows; both kinds go back in time, a simulation by flying again."""

    def at(self, time: float) -> Poses:
        """One row: the pose at a mission time [s]."""


class Replay:
    """A recorded mission."""

    def __init__(self, trajectory: Trajectory):
        self._all = poses(trajectory, trajectory.time)

    def at(self, time: float) -> Poses:
        """Interpolated between two samples."""
        every = self._all
        after = int(np.clip(np.searchsorted(every.time, time), 1, len(every.time) - 1))
        two, times = slice(after - 1, after + 1), np.array([time])

        def between(values: Array) -> Array:
            rows = values[two].reshape(2, -1)
            found = [np.interp(times, every.time[two], column) for column in rows.T]
            return np.stack(found, axis=-1).reshape((1, *values.shape[1:]))

        return Poses(
            time=times,
            joints=every.joints,
            quaternion=interpolate_quaternion(times, every.time[two], every.quaternion[two]),
            **{
                name: between(getattr(every, name))
                for name in ("position", "parts", "angles", "roll", "pitch", "heading", "speed")
            },
            net_mass=between(every.net_mass),
            current=between(every.current),
            pumped=None if every.pumped is None else between(every.pumped),
            bridged=None if every.bridged is None else between(every.bridged.astype(float)) > 0.0,
            unknown=every.unknown,
        )


class Live:
    """A closed-loop simulation that is stepped as it is watched."""

    def __init__(self, scenario: Scenario):
        if scenario.navigate is not None:
            raise InputError(
                "a live view flies by the truth: fly the navigated scenario first and show its "
                "trajectory"
            )
        with quiet_mujoco():
            self._simulation = Simulation(scenario)
        self._seen = (0.0, np.zeros(len(scenario.vehicle.parts)))
        """Time [s] of the last row, and how far [rad] each spinning part had turned by then"""

    def at(self, time: float) -> Poses:
        """The physics' own state at the last step before `time`.

        Raises:
          SimulationUnstable: the simulation left the finite numbers.
        """
        simulation, step = self._simulation, self._simulation.model.opt.timestep
        data = simulation.data
        if time < data.time - step:
            simulation.reset()
        # One step at least: the first one writes the first row of the log.
        steps = max(int((time - data.time) / step + 1e-9), int(data.time == 0.0))
        if steps > 0:
            with quiet_mujoco():
                simulation.step(steps)
        if simulation.failed:
            simulation.trajectory()
        return self._row()

    def _row(self) -> Poses:
        simulation = self._simulation
        data = simulation.data
        logged = from_log(simulation.rows[-1:], simulation.scenario.vehicle)
        roll, pitch, heading = quaternion_to_euler(flip(data.qpos[3:7]))
        joints = moving_parts(logged)
        parts = part_positions(logged, joints, logged.time)
        current = [logged[f"true_current_{name}"][0] for name in ("north", "east")]
        return Poses(
            time=np.array([data.time]),
            position=flip_vector(data.qpos[:3])[None],
            quaternion=data.qpos[None, 3:7].copy(),
            joints=joints,
            parts=parts,
            angles=self._turned(float(data.time), joints, parts[0])[None],
            roll=np.rad2deg([roll]),
            pitch=np.rad2deg([pitch]),
            heading=np.mod(np.rad2deg([heading]), 360.0),
            speed=np.linalg.norm(logged.v_rel, axis=-1),
            net_mass=logged["true_net_mass"],
            current=np.array([current]),
        )

    def _turned(self, time: float, joints: tuple[str, ...], parts: Array) -> Array:
        """Angle [rad] of each moving part; a spinning one goes on from the last row's."""
        before, angles = self._seen
        step = max(time - before, 0.0)  # after a jump back it goes on from where it was
        angles = np.resize(angles, len(joints))
        for place, joint in enumerate(joints):
            angles[place] = angles[place] + step * parts[place] if spins(joint) else parts[place]
        self._seen = (time, angles)
        return angles * [turns(joint) or spins(joint) for joint in joints]
