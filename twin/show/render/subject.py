"""Subject (the flight that a picture shows) and shot (camera, size, time and look of the picture).

The flight is a stored mission or a live simulation.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError, VehicleError, quoted, unknown_name
from twin.faults.base import Fault, fault_from_dict
from twin.frames import flip_quaternion as flip
from twin.frames import flip_vector, quaternion_to_euler
from twin.numbers import Array
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.physics.true_signals import from_log
from twin.records.attributes import SCENARIO
from twin.records.logged import LoggedTrajectory
from twin.records.reader import MissionStore
from twin.records.store import read_trajectory
from twin.records.tracks import NamedTrack, choose_tracks, read_tracks
from twin.records.trajectory import Trajectory
from twin.show.figures.page_layout import missions_caption
from twin.show.render import playback
from twin.show.render.playback import POSITION, Poses, poses
from twin.vehicle.vehicle import Vehicle, load_vehicle

CAMERAS = ("orbit", "side", "map", "chase")
COLOURS = ("speed", "current", "depth", "error")
DEFAULT_SECONDS = 20.0  # [s] length of a video without a given speed-up
SMALLEST, LARGEST = 64, 7680  # [pixel] sides of a picture; the largest is 8K UHD


@dataclasses.dataclass(frozen=True, kw_only=True)
class Subject:
    """Flight that a film or picture shows, with its vehicle, tracks, sea floor and faults."""

    trajectory: Trajectory
    vehicle: Vehicle
    tracks: tuple[NamedTrack, ...] = ()
    """Dead-reckoned tracks beside the true one"""
    title: str = ""
    floor: Array | None = None
    """Table of the mission's sea floor; None: the drawn floor is decoration"""
    faults: Sequence[Fault] = ()
    """Faults of the vehicle; a lost part is invisible from the fault's start on"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Shot:
    """Camera, size, speed and shown interval of the mission, for a film or picture."""

    camera: str = "orbit"
    """orbit (circles the track), side, map (from above) or chase (behind the glider)."""

    width: int = 1280
    """[pixel] Width of the picture."""

    height: int = 720
    """[pixel] Height of the picture."""

    fps: float = 30.0
    """Frames per second of a video."""

    speed_up: float | None = None
    """Mission seconds per video second; None makes the video DEFAULT_SECONDS long."""

    start: float | None = None
    """[s] First mission time shown; None is the mission's start."""

    end: float | None = None
    """[s] Last mission time shown; None is the mission's end."""

    colour: str | None = None
    """Quantity that colours the track: speed, current, depth, or error (of the first dead-reckoned
    track); None: speed, or depth in a log without speed."""

    exaggeration: float | None = None
    """Vertical / horizontal scale; None is automatic. The chase camera always has 1."""

    floor: float | None = None
    """[m] Depth of the picture's lower end; None: below the mission's sea floor, or without one a
    little below the deepest point."""

    hud: bool = True
    """Draw the strip of readouts, the labels and the legend."""

    inset: bool = True
    """Draw the close-up of the glider; never drawn with the chase camera."""

    def __post_init__(self) -> None:
        if self.camera not in CAMERAS:
            raise InputError(unknown_name("camera", self.camera, CAMERAS))
        if self.colour is not None and self.colour not in COLOURS:
            raise InputError(unknown_name("track colour", self.colour, COLOURS))
        for name, pixels in (("width", self.width), ("height", self.height)):
            if not SMALLEST <= pixels <= LARGEST:
                raise InputError(f"{name} {pixels} must be {SMALLEST} to {LARGEST} pixels")
        for name in ("fps", "speed_up", "exaggeration", "floor"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name.replace('_', '-')} {value} must be positive and finite")

    def part(self, time: Array) -> tuple[float, float]:
        """First and last mission time [s] shown, of a mission sampled at `time` [s].

        Raises:
          InputError: the interval lies outside the mission or is empty.
        """
        first, last = float(time[0]), float(time[-1])
        start = first if self.start is None else self.start
        end = last if self.end is None else self.end
        slack = 1e-6 * max(last - first, 1.0)
        if not (first - slack <= start < end <= last + slack):
            raise InputError(
                f"part {start:g} to {end:g} s must be inside the mission, {first:g} to {last:g} s, "
                "and end after it starts"
            )
        return max(start, first), min(end, last)

    def frame_times(self, time: Array) -> Array:
        """Mission times [s] of the video's frames, shape (frames,)."""
        start, end = self.part(time)
        speed_up = self.speed_up or (end - start) / DEFAULT_SECONDS
        frames = max(2, round((end - start) / speed_up * self.fps) + 1)
        return np.asarray(np.linspace(start, end, frames))

    def still_time(
        self, time: Array, at: float | None, known: NDArray[np.bool_] | None = None
    ) -> Array:
        """Mission time [s] of a still, shape (1,): `at`, or the end of the shown interval.

        Args:
          time: [s] times of the samples, (time,).
          at: [s] wanted time; None: the end of the shown interval.
          known: mask of samples with known position, (time,); the last of these replaces the end.
        """
        start, end = self.part(time)
        if at is None:
            if known is not None and (shown := time[known & (time >= start) & (time <= end)]).size:
                end = float(shown[-1])
            return np.array([end])
        if not start <= at <= end:
            raise InputError(f"time {at:g} s is outside the shown part, {start:g} to {end:g} s")
        return np.array([float(at)])


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
    """Read a mission of a store, with dead-reckoned tracks if there are any.

    For a log, the corrected track, the flight model's velocities and the measured attitude replace
    the true signals; see `twin.logs.logged_mission`.

    Args:
      missions: dives of a log that are shown as one; None shows `mission` alone.
      vehicle: name or file, for a log or for a store without vehicle; None takes the store's, see
        `MissionStore.vehicle`. The vehicle's flight model, if there is one, gives the velocities
        of a log.
      tracks: file of dead-reckoned tracks, as in `twin.records.tracks`.
      names: names of those tracks, separated by commas; None takes all.
      title: first line of the picture; None is made from the store.
      floor: draw the mission's sea floor, if it has one.

    Raises:
      StoreError, VehicleError, InputError: a file cannot be read, a log has no track, or a vehicle
        is given for a simulated mission whose store names its own.
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
    """Read dives of a log, and the vehicle to draw; raise StoreError if they have no track."""
    from twin.identify.logged_missions import start_vehicle
    from twin.logs.logged_mission import logged_trajectory

    try:
        trajectory = logged_trajectory(store, missions, vehicle)
    except VehicleError:  # the vehicle has no flight model: use its shape only
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
    """Table of the sea floor of a simulated mission; raise FloorError if its file is missing."""
    if not described.get("floor"):
        return None
    from twin.physics.scenario import scenario_from_dict

    scenario = scenario_from_dict(described)
    assert scenario.floor is not None
    return scenario.floor.compile(scenario.run_time(), scenario.place)


class RenderedFlight(Protocol):
    """Flight in a viewer; both types can go back in time, a simulation by flying again."""

    def at(self, time: float) -> Poses:
        """Pose at a mission time [s], one row."""


class Replay:
    """Flight of a recorded mission."""

    def __init__(self, trajectory: Trajectory):
        self._all = poses(trajectory, trajectory.time)

    def at(self, time: float) -> Poses:
        """Pose at a mission time [s], interpolated between two samples."""
        every, times = self._all, np.array([time])
        after = int(np.clip(np.searchsorted(every.time, time), 1, len(every.time) - 1))
        two = slice(after - 1, after + 1)
        ends = every.time[two]
        row: dict[str, Any] = {}
        for name, values in vars(every).items():
            if isinstance(values, np.ndarray):
                columns = values[two].reshape(2, -1).astype(float).T
                found = [np.interp(times, ends, column) for column in columns]
                row[name] = np.stack(found, axis=-1).reshape((1, *values.shape[1:]))
        row["quaternion"] = playback.interpolate_quaternion(times, ends, every.quaternion[two])
        if every.bridged is not None:
            row["bridged"] = row["bridged"] > 0.0
        return dataclasses.replace(every, **row | {"time": times})


def live_simulation(scenario: Scenario) -> Simulation:
    """Make a simulation for a live view; raise InputError for a navigated scenario."""
    if scenario.navigate is not None:
        raise InputError(
            "a live view flies by the truth: fly the navigated scenario first and show its "
            "trajectory"
        )
    with quiet_mujoco():
        return Simulation(scenario)


class Live:
    """Flight of a closed-loop simulation that is stepped while it is watched."""

    def __init__(self, scenario: Scenario):
        self._simulation = live_simulation(scenario)
        self._seen = (0.0, np.zeros(len(scenario.vehicle.parts)))
        """Time [s] of the last row, and the angle [rad] of each moving part at that time"""

    def at(self, time: float) -> Poses:
        """Pose at the last physics step before `time` [s].

        Raises:
          SimulationUnstable: the simulation diverged.
        """
        simulation, step = self._simulation, self._simulation.model.opt.timestep
        data = simulation.data
        if time < data.time - step:
            simulation.reset()
        # Take at least one step at time 0: the first step writes the first row of the log.
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
        joints = playback.moving_parts(logged)
        parts, _ = playback.part_motion(logged, joints, logged.time)
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
        """Angle [rad] of each moving part; a spinning part continues from its last angle."""
        before, angles = self._seen
        step = max(time - before, 0.0)  # after a jump back in time a spinning part keeps its angle
        spinning = np.array([playback.spins(joint) for joint in joints], bool)
        angles = np.where(spinning, np.resize(angles, len(joints)) + step * parts, parts)
        self._seen = (time, angles)
        return angles * [playback.turns(joint) or playback.spins(joint) for joint in joints]
