"""Painter: frames of a shot as arrays. One OpenGL context, one process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from twin.faults.base import Fault
from twin.records.logged import LoggedTrajectory
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory
from twin.show.render import camera
from twin.show.render.camera import View
from twin.show.render.canvas import Canvas, border, frame_of
from twin.show.render.graphics import Graphics, shown
from twin.show.render.hud import Hud
from twin.show.render.motion import Motion, drift_of
from twin.show.render.playback import Poses, poses
from twin.show.render.shapes import BACKDROP_GROUP, CLOSE_UP_GROUP, GLIDER_GROUPS, WATER_GROUP
from twin.show.render.shot import Shot
from twin.show.render.stage import Stage, build
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

INSET_EDGE = (150, 200, 220)


class Painter:
    """Paints frames of one shot; a context manager that releases its OpenGL context.

        with Painter(trajectory, vehicle, shot, times) as painter:
            pixels = painter.paint(0)

    A frame depends on its index only, not on those painted before it.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        vehicle: Vehicle,
        shot: Shot,
        times: Array,
        tracks: Sequence[NamedTrack] = (),
        title: str = "",
        floor: Array | None = None,
        faults: Sequence[Fault] = (),
    ):
        """`times` [s], shape (frames,), are the mission times of the frames; `floor` is the table
        of the mission's sea floor; what `faults` say is gone is not drawn from then on.

        Raises:
          InputError: the shot does not fit the trajectory.
          NoOpenGL: this machine cannot draw.
        """
        self.shot = shot
        self.poses: Poses = poses(trajectory, times)
        self.stage: Stage = build(trajectory, vehicle, shot, tracks, floor, faults)
        self._canvas = Canvas(width=shot.width, height=shot.height)
        self._frame = frame_of(shot)
        close_up = shot.inset and not self.stage.chase
        self._inset = self._canvas.inset if close_up else None
        self.option = shown(BACKDROP_GROUP, *GLIDER_GROUPS, WATER_GROUP)
        self._close_up = shown(CLOSE_UP_GROUP, *GLIDER_GROUPS)
        self._bearing = camera.follow(np.deg2rad(self.poses.heading), shot.fps)
        self._drift = self._drifts()
        self._fixed = self._fixed_view()
        notes = self._notes(title, _sources(trajectory))
        self._hud = Hud(self.stage, self.poses, self._canvas, notes) if shot.hud else None
        self.graphics = Graphics(self.stage.model, shot.width, shot.height)
        self._motion = Motion(self.stage, self.graphics.data, self.graphics.reshape)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.poses.time)

    def paint(self, index: int) -> Pixels:
        """Frame `index`, shape (height, width, 3); the array is the caller's."""
        graphics = self.graphics
        graphics.make_current()
        glider = self._motion.place(self.poses, index, self._drift[index])
        view = self.view(index)
        graphics.draw(view, self.option)
        if self._inset is not None:
            _, _, wide, high = self._inset
            close = camera.inset_view(glider, float(self._bearing[index]), wide / high)
            graphics.draw(close, self._close_up, self._inset)
        frame = graphics.read()
        if self._inset is not None:
            border(frame, self._inset, INSET_EDGE)
        if self._hud is not None:
            self._hud.draw(frame, index, view)
        return frame

    def view(self, index: int) -> View:
        """The main camera of frame `index`."""
        if self._fixed is not None:
            return self._fixed
        if self.stage.chase:
            return camera.chase_view(float(self._bearing[index]), self._frame)
        if self.frames == 1:
            phase = 0.5 + camera.ORBIT_STILL / camera.ORBIT_SWEEP
        else:
            phase = index / (self.frames - 1)
        return camera.orbit_view(self.stage.layout, phase, self._frame)

    def close(self) -> None:
        """Release the OpenGL context; the painter cannot be used any more."""
        self.graphics.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- what is worked out once ---------------------------------------------------------------

    def _drifts(self) -> Array:
        """Where the cell of particles is: they move with the water, past the glider. (frames, 3)"""
        moved = np.zeros((self.frames, 3))
        if not self.stage.snow:
            return moved
        current = np.nan_to_num(self.poses.current)
        steps = np.diff(self.poses.time)[:, None] * (current[1:] + current[:-1]) / 2
        moved[1:, :2] = np.cumsum(steps, axis=0) * [1.0, -1.0]
        return drift_of(moved, self.stage.layout.display(self.poses.position))

    def _fixed_view(self) -> View | None:
        """The view of a camera that does not move, or None."""
        if self.shot.camera == "side":
            return camera.side_view(self.stage.layout, self._frame)
        if self.shot.camera == "map":
            return camera.map_view(self.stage.layout, self._frame)
        return None

    def _notes(self, title: str, sources: Sequence[str]) -> list[str]:
        """The title, and what a reader must know: the scales, and what stands for the truth."""
        shot, layout = self.shot, self.stage.layout
        facts = []
        if self.frames > 1:
            span = float(self.poses.time[-1] - self.poses.time[0])
            speed_up = span / (self.frames - 1) * shot.fps
            facts.append(
                f"{speed_up:,.0f} × real time" if speed_up >= 10 else f"{speed_up:.2g} × real time"
            )
        if not self.stage.chase:
            if shot.camera != "map" and layout.exaggeration != 1.0:
                facts.append(f"depth × {layout.exaggeration:g}")
            if layout.scale < 1.0:
                facts.append(f"vehicle × {1 / layout.scale:.0f}")
        facts += sources
        return [title or "glider twin", *(["   ".join(facts)] if facts else [])]


def _sources(trajectory: Trajectory) -> list[str]:
    """What a log's picture shows in place of the truth: its track and its speed."""
    if not isinstance(trajectory, LoggedTrajectory):
        return []
    parts = [trajectory.sources.get("true_north", "")]
    if "true_surge" in trajectory.sources:
        parts.append(f"speed: {trajectory.sources['true_surge']}")
    return [part for part in parts if part]
