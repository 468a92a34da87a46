"""Subject: the flight that a picture shows, from a stored mission or from physics that runs now."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError, VehicleError, quoted
from twin.faults.base import fault_from_dict
from twin.frames import flip_quaternion as flip
from twin.frames import flip_vector, quaternion_to_euler
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.physics.true_signals import from_log
from twin.records.attributes import SCENARIO
from twin.records.logged import LoggedTrajectory
from twin.records.reader import MissionStore
from twin.records.store import read_trajectory
from twin.records.tracks import choose_tracks, read_tracks
from twin.records.trajectory import Trajectory
from twin.show.figures.page_layout import missions_caption
from twin.show.render.playback import (
    POSITION,
    Poses,
    interpolate_quaternion,
    moving_parts,
    part_positions,
    poses,
    spins,
    turns,
)
from twin.show.render.shot import Subject
from twin.vehicle.vehicle import Vehicle, load_vehicle

Array = NDArray[np.float64]


def read_subject(
    store: Path,
    mission: int = 0,
    *,
    missions: Sequence[int] | None = None,
    vehicle: str | None = None,
    tracks: Path | None = None,
    names: str | None = None,
    title: str | None = None,
    floor: bool = True,
) -> Subject:
    """A mission of a store, with dead-reckoned tracks if there are any.

    Of a log the corrected track, the flight model's velocities and the measured attitude stand for
    the truth; see `twin.logs.logged_mission`.

    Args:
      missions: dives of a log that are shown as one; None shows `mission` alone.
      vehicle: of a log, or of a store that does not say its vehicle: name or file; None takes the
        store's, see `MissionStore.vehicle`. Its flight model, if it has one, tells the velocities
        of a log.
      tracks: file as in `twin.records.tracks`.
      names: of those tracks, separated by commas; None takes all.
      title: first line of the picture; None is made from the store.
      floor: draw the sea floor of the mission where it has one.

    Raises:
      StoreError, VehicleError, InputError: something cannot be read, or a log has no track; a
        vehicle is given for a simulated mission whose store says its own.
    """
    found = MissionStore(store)
    found.check_filled()
    described = found.json(SCENARIO) if SCENARIO in found.attributes else {}
    drawn = None if vehicle is None else load_vehicle(vehicle)
    trajectory: Trajectory
    if found.logged:
        chosen = [mission] if missions is None else list(missions)
        trajectory, drawn = _logged(store, chosen, vehicle, drawn)
        caption = missions_caption(found, chosen, None)
    elif missions is not None:
        raise InputError(
            f"several missions together are for logs: each mission of {store} is a flight of its "
            "own"
        )
    else:
        if drawn is not None and found.says_vehicle:
            raise InputError(
                f"--vehicle is for logs: store {store} has its own vehicle: {found.vehicle.name}; "
                "leave --vehicle out"
            )
        trajectory = read_trajectory(store, mission)
        name = (described.get("plan") or {}).get("name")
        caption = f"Mission {name}" if name else f"{found.path.stem}, mission {mission}"
    return Subject(
        trajectory=trajectory,
        vehicle=found.vehicle if drawn is None else drawn,
        tracks=() if tracks is None else tuple(choose_tracks(read_tracks(tracks, mission), names)),
        title=caption if title is None else title,
        floor=_floor(described) if floor else None,
        faults=tuple(fault_from_dict(one) for one in described.get("faults", ())),
    )


def _logged(
    store: Path, missions: list[int], vehicle: str | None, drawn: Vehicle | None
) -> tuple[LoggedTrajectory, Vehicle | None]:
    """The dives of a log with their track, and the vehicle to draw; raises StoreError without."""
    from twin.identify.start_values import start_vehicle
    from twin.logs.logged_mission import logged_trajectory

    try:
        trajectory = logged_trajectory(store, missions, vehicle)
    except VehicleError:  # only drawn: its flight has no model
        trajectory = logged_trajectory(store, missions)
    lacking = [name for name in POSITION if f"true_{name}" not in trajectory]
    if lacking:
        raise StoreError(
            f"store {store}: mission {missions[0]} lacks {' and '.join(lacking)}: it has no "
            f"flight model ({trajectory.unflown}), no track of its own and no two fixes; "
            f"`twin plot {quoted(store)} --figure log` shows what was measured"
        )
    if drawn is None and trajectory.vehicle is not None:
        drawn = start_vehicle(store)
    return trajectory, drawn


def _floor(described: dict[str, Any]) -> Array | None:
    """The sea floor that the mission of `twin simulate` had; raises FloorError if it is gone."""
    if not described.get("floor"):
        return None
    from twin.physics.scenario import scenario_from_dict

    scenario = scenario_from_dict(described)
    assert scenario.floor is not None
    return scenario.floor.compile(scenario.run_time(), scenario.place)


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
        ends = every.time[two]
        row: dict[str, Any] = {}
        for name, values in vars(every).items():
            if isinstance(values, np.ndarray):
                columns = values[two].reshape(2, -1).astype(float).T
                found = [np.interp(times, ends, column) for column in columns]
                row[name] = np.stack(found, axis=-1).reshape((1, *values.shape[1:]))
        row["time"] = times
        row["quaternion"] = interpolate_quaternion(times, ends, every.quaternion[two])
        if every.bridged is not None:
            row["bridged"] = row["bridged"] > 0.0
        return dataclasses.replace(every, **row)


def live_simulation(scenario: Scenario) -> Simulation:
    """A simulation for a live view; raises InputError for a navigated scenario."""
    if scenario.navigate is not None:
        raise InputError(
            "a live view flies by the truth: fly the navigated scenario first and show its "
            "trajectory"
        )
    with quiet_mujoco():
        return Simulation(scenario)


class Live:
    """A closed-loop simulation that is stepped as it is watched."""

    def __init__(self, scenario: Scenario):
        self._simulation = live_simulation(scenario)
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
