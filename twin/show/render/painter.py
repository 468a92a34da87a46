"""Painter: frames of a shot as arrays, by MuJoCo's renderer on one offscreen context."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.records.logged import LoggedTrajectory
from twin.records.trajectory import Trajectory
from twin.show.render import camera
from twin.show.render.camera import View
from twin.show.render.canvas import Canvas, border, frame_of
from twin.show.render.context import new_context, release
from twin.show.render.hud import Hud
from twin.show.render.motion import Motion, drift_of
from twin.show.render.playback import Poses, poses
from twin.show.render.shapes import (
    BACKDROP_GROUP,
    CLOSE_UP_GROUP,
    GLIDER_GROUPS,
    WATER_GROUP,
    Shape,
)
from twin.show.render.shot import Shot, Subject
from twin.show.render.stage import Stage, build

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

INSET_EDGE = (150, 200, 220)


MOST_GEOMS = 4000
"""Geoms of a scene: a mission of many days has some hundred ribbon chunks."""
OFF = ("SHADOW", "SKYBOX", "HAZE", "REFLECTION")
"""Effects that the stage does not use"""


class Painter:
    """Paints frames of one shot; a context manager that releases its OpenGL context.

        with Painter(subject, shot, times) as painter:
            pixels = painter.paint(0)

    A frame depends on its index only, not on those painted before it.
    """

    def __init__(self, subject: Subject, shot: Shot, times: Array):
        """`times` [s], shape (frames,), are the mission times of the frames.

        Raises:
          InputError: the shot does not fit the trajectory.
          NoOpenGL: this machine cannot draw.
        """
        self.shot = shot
        self.poses: Poses = poses(subject.trajectory, times)
        self.stage: Stage = build(subject, shot)
        self._canvas = Canvas(width=shot.width, height=shot.height)
        self._frame = frame_of(shot)
        close_up = shot.inset and not self.stage.chase
        self._inset = self._canvas.inset if close_up else None
        self.option = shown(BACKDROP_GROUP, *GLIDER_GROUPS, WATER_GROUP)
        self._close_up = shown(CLOSE_UP_GROUP, *GLIDER_GROUPS)
        self._bearing = camera.follow(np.deg2rad(self.poses.heading), shot.fps)
        self._drift = self._drifts()
        self._fixed: View | None = None
        notes = self._notes(subject.title, _sources(subject.trajectory))
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
        if self.stage.chase:
            return camera.chase_view(float(self._bearing[index]), self._frame)
        if self._fixed is not None:
            return self._fixed
        phase = None if self.frames == 1 else index / (self.frames - 1)
        view = camera.block_view(self.shot.camera, self.stage.layout, self._frame, phase)
        if self.shot.camera != "orbit":
            self._fixed = view
        return view

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


class Graphics:
    """Draws views of a model into a picture; `close` releases the OpenGL context."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int):
        """`width` and `height` [pixel] of the picture.

        Raises:
          NoOpenGL: this machine cannot draw.
        """
        self.model, self.data = model, mujoco.MjData(model)
        self.scene = mujoco.MjvScene(model, MOST_GEOMS)
        for name in OFF:
            self.scene.flags[mujoco.mjtRndFlag.__members__[f"mjRND_{name}"]] = 0
        self._perturb, self._camera = mujoco.MjvPerturb(), mujoco.MjvCamera()
        self._whole = mujoco.MjrRect(0, 0, width, height)
        self._buffer = np.zeros((height, width, 3), np.uint8)
        self._closed = False
        self._context = new_context(width, height)
        self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)

    def make_current(self) -> None:
        """Draw into this context from now on."""
        self._context.make_current()

    def draw(
        self,
        view: View,
        option: mujoco.MjvOption,
        box: tuple[int, int, int, int] | None = None,
    ) -> None:
        """Draw the model as it stands.

        Args:
          option: what to show.
          box: left, top, width, height [pixel] of the part to draw into; None is all.
        """
        mujoco.mjv_updateScene(
            self.model,
            self.data,
            option,
            self._perturb,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self.scene,
        )
        aim(self.scene, view)
        place = self._whole
        if box is not None:
            left, top, wide, high = box
            place = mujoco.MjrRect(left, self._whole.height - top - high, wide, high)
        mujoco.mjr_render(place, self.scene, self._renderer)

    def read(self) -> Pixels:
        """A copy of the picture, (height, width, 3), first row on top."""
        mujoco.mjr_readPixels(self._buffer, None, self._whole, self._renderer)
        return np.ascontiguousarray(self._buffer[::-1])

    def reshape(self, mesh: int, shape: Shape) -> None:
        """Give a mesh new vertices, normals and texture coordinates, in the frame of its geom."""
        write_mesh(self.model, mesh, shape)
        mujoco.mjr_uploadMesh(self.model, self._renderer, mesh)

    def close(self) -> None:
        """Release the context; nothing can be drawn any more. A second call does nothing."""
        if not self._closed:
            self._closed = True
            self._context.make_current()
            self._renderer.free()
            release(self._context)


def write_mesh(model: mujoco.MjModel, mesh: int, shape: Shape) -> None:
    """Give a mesh new vertices, normals and texture coordinates; the graphics are not told."""
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    model.mesh_vert[first : first + count] = shape.vertices
    first, count = model.mesh_normaladr[mesh], model.mesh_normalnum[mesh]
    model.mesh_normal[first : first + count] = shape.normals
    if shape.coordinates is not None:
        first, count = model.mesh_texcoordadr[mesh], model.mesh_texcoordnum[mesh]
        model.mesh_texcoord[first : first + count] = shape.coordinates


def aim(scene: mujoco.MjvScene, view: View) -> None:
    """Make both eyes of a scene see `view`."""
    half_width, low, high = view.frustum()
    for eye in scene.camera:
        eye.pos[:], eye.forward[:], eye.up[:] = view.position, view.forward, view.up
        eye.orthographic = int(view.parallel)
        eye.frustum_center, eye.frustum_width = view.centre(), half_width
        eye.frustum_bottom, eye.frustum_top = low, high
        eye.frustum_near, eye.frustum_far = view.near, view.far


def shown(*groups: int) -> mujoco.MjvOption:
    """Visualisation options that show these geom groups and no sites."""
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[list(groups)] = 1
    option.sitegroup[:] = 0
    return option
