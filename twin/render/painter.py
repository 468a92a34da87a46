"""Painter: frames of a shot as arrays. One OpenGL context, one process."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.render import camera, sea
from twin.render.arrows import ladder_arrow
from twin.render.camera import View
from twin.render.canvas import Canvas, border
from twin.render.graphics import Graphics, shown
from twin.render.hud import Hud
from twin.render.props import (
    BACKDROP_GROUP,
    CLOSE_UP_GROUP,
    DRIFT,
    LEVEL,
    VEHICLE,
    WATER,
    WATER_GROUP,
)
from twin.render.replay import Poses, poses
from twin.render.shot import Shot
from twin.render.stage import Stage, build
from twin.render.tracks import NamedTrack
from twin.trajectory import Trajectory
from twin.vehicle import Vehicle

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

GLIDER_GROUPS = (1, 2)
"""Outside and inside of the glider"""
TAIL = 0.47
"""Where the ribbon ends behind the glider's middle, chase camera, over the hull's length"""
SHORTEST_ARROW = 0.02
"""[m] below which an arrow beside the glider is left out"""
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
    ):
        """`times` [s], shape (frames,), are the mission times of the frames.

        Raises:
          InputError: the shot does not fit the trajectory.
          NoOpenGL: this machine cannot draw.
        """
        self.shot = shot
        self.poses: Poses = poses(trajectory, times)
        self.stage: Stage = build(trajectory, vehicle, shot, tracks)
        model = self.stage.model
        self._canvas = Canvas(width=shot.width, height=shot.height)
        close_up = shot.inset and not self.stage.chase
        self._inset = self._canvas.inset if close_up else None
        self.option = shown(BACKDROP_GROUP, *GLIDER_GROUPS, WATER_GROUP)
        self._close_up = shown(CLOSE_UP_GROUP, *GLIDER_GROUPS)
        self._alpha = model.geom_rgba[:, 3].copy()
        self._hull = model.joint(f"{VEHICLE}hull").qposadr[0]
        self._battery = [model.joint(f"{VEHICLE}{n}").qposadr[0] for n in ("shift", "rotation")]
        self._mocap = {name: int(model.body(name).mocapid[0]) for name in (WATER, LEVEL, DRIFT)}
        self._bearing = camera.follow(np.deg2rad(self.poses.heading), shot.fps)
        self._drift = self._drifts()
        self._fixed = self._fixed_view()
        notes = self._notes(title)
        self._hud = Hud(self.stage, self.poses, self._canvas, notes) if shot.hud else None
        self.graphics = Graphics(model, shot.width, shot.height)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.poses.time)

    def paint(self, index: int) -> Pixels:
        """Frame `index`, shape (height, width, 3); the array is the caller's."""
        graphics = self.graphics
        graphics.make_current()
        glider = self._pose(index)
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
            return camera.chase_view(float(self._bearing[index]), self._frame())
        if self.frames == 1:
            phase = 0.5 + camera.ORBIT_STILL / camera.ORBIT_SWEEP
        else:
            phase = index / (self.frames - 1)
        return camera.orbit_view(self.stage.layout, phase, self._frame())

    def close(self) -> None:
        """Release the OpenGL context; the painter cannot be used any more."""
        self.graphics.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    # -- one frame -----------------------------------------------------------------------------

    def _pose(self, index: int) -> Array:
        """Put the glider, the water and the ribbons where they are; the glider's display point."""
        stage, data = self.stage, self.graphics.data
        here = stage.layout.display(self.poses.position[index])
        shift = here if stage.chase else np.zeros(3)
        data.qpos[self._hull : self._hull + 3] = here - shift
        data.qpos[self._hull + 3 : self._hull + 7] = self.poses.quaternion[index]
        data.qpos[self._battery] = self.poses.battery[index]
        data.mocap_pos[self._mocap[WATER]] = -shift
        data.mocap_pos[self._mocap[LEVEL]] = [0.0, 0.0, -shift[2]]
        data.mocap_pos[self._mocap[DRIFT]] = self._drift[index]
        self._reveal(index, here)
        self._place_arrows(index)
        if stage.chase or self._inset is not None:
            depth = float(self.poses.position[index, 2])
            depth -= camera.CHASE_HEIGHT if stage.chase else 0.0
            stage.model.geom_rgba[stage.bands, :3] = sea.backdrop_colours(depth)
        mujoco.mj_kinematics(stage.model, data)
        mujoco.mj_camlight(stage.model, data)
        return here - shift

    def _reveal(self, index: int, here: Array) -> None:
        """Show the ribbons up to now; the true one ends at the glider, or at its tail."""
        stage, time = self.stage, float(self.poses.time[index])
        alpha = stage.model.geom_rgba[:, 3]
        for line in stage.lines:
            done = int(np.searchsorted(line.ribbon.chunk_ends(), time, side="right"))
            alpha[line.chunks[:done]] = self._alpha[line.chunks[:done]]
            alpha[line.chunks[done:]] = 0.0
            running = done < len(line.chunks) and time > line.ribbon.time[0]
            alpha[line.head.geom] = 1.0 if running else 0.0
            if not running:
                continue
            tip, clear = line.ribbon.at(time), 0.0
            if line.colour is None:
                tip = here
                if stage.chase:
                    tip, clear = here + self._tail(index), stage.hull_length
            self.graphics.reshape(line.head.mesh, line.ribbon.head(time, tip, clear))

    def _tail(self, index: int) -> Array:
        """From the glider's middle to its tail, in display units, shape (3,)."""
        backward = np.array([-TAIL * self.stage.hull_length, 0.0, 0.0])
        tail = np.zeros(3)
        mujoco.mju_rotVecQuat(tail, backward, self.poses.quaternion[index])
        return tail

    def _place_arrows(self, index: int) -> None:
        """Shape the current's arrows beside the glider."""
        model, ladder = self.stage.model, self.stage.ladder(self.poses, index)
        for i, arrow in enumerate(self.stage.arrows):
            used = i < len(ladder) and bool(np.linalg.norm(ladder[i][2]) > SHORTEST_ARROW)
            model.geom_rgba[arrow.geom, 3] = 1.0 if used else 0.0
            if used:
                _, start, vector = ladder[i]
                self.graphics.reshape(arrow.mesh, ladder_arrow(start, vector))

    # -- what is worked out once ---------------------------------------------------------------

    def _drifts(self) -> Array:
        """Where the cell of particles is: they move with the water, past the glider. (frames, 3)"""
        moved = np.zeros((self.frames, 3))
        if not self.stage.snow:
            return moved
        current = np.nan_to_num(self.poses.current)
        steps = np.diff(self.poses.time)[:, None] * (current[1:] + current[:-1]) / 2
        moved[1:, :2] = np.cumsum(steps, axis=0) * [1.0, -1.0]
        relative = moved - self.stage.layout.display(self.poses.position)
        return np.asarray(relative % sea.SNOW_BOX)

    def _frame(self) -> camera.Frame:
        if self.shot.hud:
            return self._canvas.frame
        return camera.Frame(aspect=self.shot.width / self.shot.height)

    def _fixed_view(self) -> View | None:
        """The view of a camera that does not move, or None."""
        if self.shot.camera == "side":
            return camera.side_view(self.stage.layout, self._frame())
        if self.shot.camera == "map":
            return camera.map_view(self.stage.layout, self._frame())
        return None

    def _notes(self, title: str) -> list[str]:
        """The title, and the scales that a reader must know."""
        shot, layout = self.shot, self.stage.layout
        facts = []
        if self.frames > 1:
            span = float(self.poses.time[-1] - self.poses.time[0])
            facts.append(f"{span / (self.frames - 1) * shot.fps:.3g} × real time")
        if not self.stage.chase:
            if shot.camera != "map" and layout.exaggeration != 1.0:
                facts.append(f"depth × {layout.exaggeration:g}")
            if layout.scale < 1.0:
                facts.append(f"glider × {1 / layout.scale:.0f}")
        return [title or "glider twin", *(["   ".join(facts)] if facts else [])]
