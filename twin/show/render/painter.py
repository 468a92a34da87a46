"""Painter: frames of a shot as arrays, by MuJoCo's renderer on one offscreen context."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.records.logged import LoggedTrajectory
from twin.records.trajectory import Trajectory
from twin.show.render import camera, sea
from twin.show.render.camera import View
from twin.show.render.canvas import Canvas, border, frame_of
from twin.show.render.context import new_context, release
from twin.show.render.hud import Hud
from twin.show.render.playback import Poses, poses
from twin.show.render.ribbon import LADDER_STEP, ladder_arrow
from twin.show.render.shapes import (
    BACKDROP_GROUP,
    CLOSE_UP_GROUP,
    DRIFT,
    GLIDER_GROUPS,
    LEVEL,
    SEABED,
    UNSEEN_GROUP,
    VEHICLE,
    WATER,
    WATER_GROUP,
    Shape,
)
from twin.show.render.shot import Shot, Subject
from twin.show.render.stage import Stage, build
from twin.water.floor.lookup import floor_depth

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


Reshape = Callable[[int, Shape], None]
"""Gives the mesh of this id a new shape, in the frame of its geom; the faces stay"""

TAIL = 0.47
"""Where the ribbon ends behind the glider's middle, chase camera, over the hull's length"""
SHORTEST_ARROW = 0.02
"""[m] below which an arrow beside the glider is left out"""


class Motion:
    """Moves one stage; what it shows depends on the given pose only."""

    def __init__(self, stage: Stage, data: mujoco.MjData, reshape: Reshape):
        self._stage, self._data, self._reshape = stage, data, reshape
        self._shaped: dict[int, Array] = {}
        model = stage.model
        self._alpha = model.geom_rgba[:, 3].copy()
        self._groups = model.geom_group.copy()
        self._hull = model.joint(f"{VEHICLE}hull").qposadr[0]
        self._addresses: dict[str, int] = {
            model.joint(joint).name.removeprefix(VEHICLE): int(model.jnt_qposadr[joint])
            for joint in range(model.njnt)
        }
        self._mocap = {
            name: int(model.body(name).mocapid[0]) for name in (WATER, LEVEL, SEABED, DRIFT)
        }

    def place(self, poses: Poses, index: int, drift: Array) -> Array:
        """Show a row of `poses`; returns the glider's display point, shape (3,).

        Args:
          drift: place of the cell of particles (3,), display units; see `drift_of`.
        """
        stage, data = self._stage, self._data
        here = stage.layout.display(poses.position[index])
        shift = here if stage.chase else np.zeros(3)
        data.qpos[self._hull : self._hull + 3] = here - shift
        data.qpos[self._hull + 3 : self._hull + 7] = poses.quaternion[index]
        for joint, position in zip(poses.joints, poses.parts[index], strict=True):
            if joint in self._addresses:  # a part may move without being drawn so
                data.qpos[self._addresses[joint]] = position
        self._turn(poses, index)
        for since, geoms in stage.gone:
            lost = float(poses.time[index]) >= since
            stage.model.geom_group[geoms] = UNSEEN_GROUP if lost else self._groups[geoms]
        data.mocap_pos[self._mocap[WATER]] = -shift
        data.mocap_pos[self._mocap[LEVEL]] = [0.0, 0.0, -shift[2]]
        data.mocap_pos[self._mocap[DRIFT]] = drift
        self._place_ground(poses.position[index])
        self._reveal(poses, index, here)
        self._place_arrows(poses, index)
        if stage.bands_follow:
            depth = float(poses.position[index, 2])
            depth -= camera.CHASE_HEIGHT if stage.chase else 0.0
            stage.model.geom_rgba[stage.bands, :3] = sea.backdrop_colours(depth, len(stage.bands))
        mujoco.mj_kinematics(stage.model, data)
        mujoco.mj_camlight(stage.model, data)
        return here - shift

    def _place_ground(self, position: Array) -> None:
        """Put the floor under the glider at `position` NED [m], fading with its distance."""
        stage = self._stage
        if stage.floor is None or not stage.ground:
            return
        altitude = float(floor_depth(stage.floor, position[0], position[1]) - position[2])
        self._data.mocap_pos[self._mocap[SEABED]] = [0.0, 0.0, -altitude]
        alpha = self._alpha[stage.ground] * sea.clearness(altitude)
        stage.model.geom_rgba[stage.ground, 3] = alpha

    def _turn(self, poses: Poses, index: int) -> None:
        """Turn fins and propellers about their axes on the hull; a picture has the true angle."""
        turn, found = np.zeros(4), np.zeros(4)
        for part, angle in zip(poses.joints, poses.angles[index], strict=True):
            drawn = self._stage.turned.get(part)
            if drawn is not None:
                mujoco.mju_axisAngle2Quat(turn, drawn.axis, angle)
                mujoco.mju_mulQuat(found, turn, drawn.rest)
                self._stage.model.body_quat[drawn.body] = found

    def _reveal(self, poses: Poses, index: int, here: Array) -> None:
        """Show the ribbons up to now; the true one ends at the glider, or at its tail."""
        stage, time = self._stage, float(poses.time[index])
        alpha = stage.model.geom_rgba[:, 3]
        for line in stage.lines:
            done = int(np.searchsorted(line.ribbon.chunk_ends(), time, side="right"))
            alpha[line.chunks[:done]] = self._alpha[line.chunks[:done]]
            alpha[line.chunks[done:]] = 0.0
            running = done < len(line.chunks) and time > line.ribbon.time[0]
            alpha[line.head] = 1.0 if running else 0.0
            if not running:
                continue
            tip, clear = line.ribbon.at(time), 0.0
            if line.colour is None:
                tip = here
                if stage.chase:
                    tip, clear = here + self._tail(poses, index), stage.hull_length
            mesh = int(stage.model.geom_dataid[line.head])
            self._reshape(mesh, line.ribbon.head(time, tip, clear))

    def _tail(self, poses: Poses, index: int) -> Array:
        """From the glider's middle to its tail, in display units, shape (3,)."""
        backward = np.array([-TAIL * self._stage.hull_length, 0.0, 0.0])
        tail = np.zeros(3)
        mujoco.mju_rotVecQuat(tail, backward, poses.quaternion[index])
        return tail

    def _place_arrows(self, poses: Poses, index: int) -> None:
        """Place the current's arrows beside the glider; one whose depth is new gets its shape."""
        model, slots = self._stage.model, self._stage.arrows
        if not slots:
            return
        model.geom_rgba[slots, 3] = 0.0
        for depth, start, vector in self._stage.ladder(poses, index):
            if np.linalg.norm(vector) <= SHORTEST_ARROW:
                continue
            geom = slots[round(depth / LADDER_STEP) % len(slots)]
            model.geom_rgba[geom, 3] = 1.0
            model.geom_pos[geom] = start
            if not np.array_equal(self._shaped.get(geom, ()), vector):
                self._shaped[geom] = vector
                self._reshape(int(model.geom_dataid[geom]), ladder_arrow(np.zeros(3), vector))


def drift_of(moved: Array, glider: Array) -> Array:
    """Where the cell of particles is, when the water has `moved` past the glider's place.

    Both in display units, shape (..., 3); the cell repeats, so the result lies within one.
    """
    return np.asarray((moved - glider) % sea.SNOW_BOX)
