"""Painter: renders a shot's frames to arrays with MuJoCo's renderer in an offscreen context."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np

from twin.records.logged import source_of
from twin.show.render import camera, context, hud, ribbon, sea, shapes
from twin.show.render.camera import Array, View
from twin.show.render.canvas import Canvas, Pixels, border, frame_of
from twin.show.render.playback import Poses, poses
from twin.show.render.shapes import Shape
from twin.show.render.stage import Stage, build
from twin.show.render.subject import Shot, Subject
from twin.water.floor.lookup import floor_depth

INSET_EDGE = (150, 200, 220)
MOST_GEOMS = 4000  # most geoms of a scene: a mission of many days has some hundred ribbon chunks
OFF = ("SHADOW", "SKYBOX", "HAZE", "REFLECTION")  # effects that the stage does not use
TAIL = 0.47
"""Distance from the glider's middle back to the ribbon's end over hull length, chase camera"""
SHORTEST_ARROW = 0.02  # [m] least length of a drawn arrow beside the glider


class Painter:
    """Painter of one shot's frames; a context manager that releases its OpenGL context.

        with Painter(subject, shot, times) as painter:
            pixels = painter.paint(0)

    A frame depends only on its index, not on the frames painted before.
    """

    def __init__(self, subject: Subject, shot: Shot, times: Array):
        """Build the scene; `times` [s], shape (frames,), are the mission times of the frames.

        Raises:
          InputError: the shot does not fit the trajectory.
          NoOpenGL: this machine cannot draw.
        """
        self.shot = shot
        self.poses: Poses = poses(subject.trajectory, times)
        self.stage: Stage = build(subject, shot)
        canvas = Canvas(width=shot.width, height=shot.height)
        self._frame = frame_of(shot)
        self._inset = canvas.inset if shot.inset and not self.stage.chase else None
        self.option = shown(shapes.BACKDROP_GROUP, shapes.WATER_GROUP)
        self._close_up = shown(shapes.CLOSE_UP_GROUP)
        self._bearing = camera.follow(np.deg2rad(self.poses.heading), shot.fps)
        self._drift = self._drifts()
        notes = self._notes(subject)
        self._hud = hud.Hud(self.stage, self.poses, canvas, notes) if shot.hud else None
        self.model = self.stage.model
        self.data, self.scene = mujoco.MjData(self.model), mujoco.MjvScene(self.model, MOST_GEOMS)
        for name in OFF:
            self.scene.flags[mujoco.mjtRndFlag.__members__[f"mjRND_{name}"]] = 0
        self._perturb, self._camera = mujoco.MjvPerturb(), mujoco.MjvCamera()
        self._whole = mujoco.MjrRect(0, 0, shot.width, shot.height)
        self._buffer = np.zeros((shot.height, shot.width, 3), np.uint8)
        self._context = context.new_context(shot.width, shot.height)
        self._renderer = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        self._motion = Motion(self.stage, self.data, self._reshape)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.poses.time)

    def paint(self, index: int) -> Pixels:
        """Paint frame `index` into a new array, shape (height, width, 3)."""
        self._context.make_current()
        glider = self._motion.place(self.poses, index, self._drift[index])
        view = self.view(index)
        self._draw(view, self.option)
        if self._inset is not None:
            _, _, wide, high = self._inset
            close = camera.inset_view(glider, float(self._bearing[index]), wide / high)
            self._draw(close, self._close_up, self._inset)
        mujoco.mjr_readPixels(self._buffer, None, self._whole, self._renderer)
        frame = np.ascontiguousarray(self._buffer[::-1])
        if self._inset is not None:
            border(frame, self._inset, INSET_EDGE)
        if self._hud is not None:
            self._hud.draw(frame, index, view)
        return frame

    def view(self, index: int) -> View:
        """View of the main camera in frame `index`."""
        if self.stage.chase:
            return camera.chase_view(float(self._bearing[index]), self._frame)
        phase = None if self.frames == 1 else index / (self.frames - 1)
        return camera.block_view(self.shot.camera, self.stage.layout, self._frame, phase)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._context.make_current()
        self._renderer.free()
        context.release(self._context)

    def _draw(
        self, view: View, option: mujoco.MjvOption, box: tuple[int, int, int, int] | None = None
    ) -> None:
        """Draw the model's present state, into a box (left, top, width, height) [pixel] or all."""
        every = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(
            self.model, self.data, option, self._perturb, self._camera, every, self.scene
        )
        aim(self.scene, view)
        place = self._whole
        if box is not None:
            left, top, wide, high = box
            place = mujoco.MjrRect(left, self._whole.height - top - high, wide, high)
        mujoco.mjr_render(place, self.scene, self._renderer)

    def _reshape(self, mesh: int, shape: Shape) -> None:
        write_mesh(self.model, mesh, shape)
        mujoco.mjr_uploadMesh(self.model, self._renderer, mesh)

    def _drifts(self) -> Array:
        """Positions of the particles' cell, (frames, 3), which drifts with the water."""
        moved = np.zeros((self.frames, 3))
        if not self.stage.snow:
            return moved
        current = np.nan_to_num(self.poses.current)
        steps = np.diff(self.poses.time)[:, None] * (current[1:] + current[:-1]) / 2
        moved[1:, :2] = np.cumsum(steps, axis=0) * [1.0, -1.0]
        return drift_of(moved, self.stage.layout.display(self.poses.position))

    def _notes(self, subject: Subject) -> list[str]:
        """Title, and a line of scales and of the sources of a log's track and speed."""
        layout, facts = self.stage.layout, []
        if self.frames > 1:
            span = float(self.poses.time[-1] - self.poses.time[0])
            speed_up = span / (self.frames - 1) * self.shot.fps
            facts.append(f"{speed_up:{',.0f' if speed_up >= 10 else '.2g'}} × real time")
        if not self.stage.chase:
            if self.shot.camera != "map" and layout.exaggeration != 1.0:
                facts.append(f"depth × {layout.exaggeration:g}")
            if layout.scale < 1.0:
                facts.append(f"vehicle × {1 / layout.scale:.0f}")
        for signal, label in (("true_north", ""), ("true_surge", "speed: ")):
            if word := source_of(subject.trajectory, signal, ""):
                facts.append(label + word)
        return [subject.title or "glider twin", *(["   ".join(facts)] if facts else [])]


def write_mesh(model: mujoco.MjModel, mesh: int, shape: Shape) -> None:
    """Write vertices, normals and texture coordinates of a mesh into the model, not to the GPU."""
    given = {"vert": shape.vertices, "normal": shape.normals, "texcoord": shape.coordinates}
    for kind, values in given.items():
        if values is not None:
            first = getattr(model, f"mesh_{kind}adr")[mesh]
            getattr(model, f"mesh_{kind}")[first : first + len(values)] = values


def aim(scene: mujoco.MjvScene, view: View) -> None:
    """Set both cameras of a scene (left and right eye) to `view`."""
    centre, half_width, low, high = view.frustum()
    for eye in scene.camera:
        eye.pos[:], eye.forward[:], eye.up[:] = view.position, view.forward, view.up
        eye.orthographic = int(view.parallel)
        eye.frustum_center, eye.frustum_width = centre, half_width
        eye.frustum_bottom, eye.frustum_top = low, high
        eye.frustum_near, eye.frustum_far = view.near, view.far


def shown(*groups: int) -> mujoco.MjvOption:
    """Visualisation options that show the glider, these geom groups and no sites."""
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[[*shapes.GLIDER_GROUPS, *groups]] = 1
    option.sitegroup[:] = 0
    return option


Reshape = Callable[[int, Shape], None]
"""Function that gives the mesh of an id a new shape, in its geom's frame; the faces stay"""


class Motion:
    """Motion of one stage: moves its bodies, ribbons and arrows to a given pose."""

    def __init__(self, stage: Stage, data: mujoco.MjData, reshape: Reshape):
        self._stage, self._data, self._reshape = stage, data, reshape
        model = stage.model
        self._alpha, self._groups = model.geom_rgba[:, 3].copy(), model.geom_group.copy()
        self._addresses = {
            model.joint(joint).name.removeprefix(shapes.VEHICLE): int(model.jnt_qposadr[joint])
            for joint in range(model.njnt)
        }

    def place(self, poses: Poses, index: int, drift: Array) -> Array:
        """Move the stage to a row of `poses`; return the glider's display point, shape (3,).

        Args:
          drift: position of the particles' cell (3,), display units; see `drift_of`.
        """
        stage, model, data = self._stage, self._stage.model, self._data
        here = stage.layout.display(poses.position[index])
        shift = here if stage.chase else np.zeros(3)
        hull = self._addresses["hull"]
        data.qpos[hull : hull + 7] = [*(here - shift), *poses.quaternion[index]]
        turn, found = np.zeros(4), np.zeros(4)
        rows = zip(poses.joints, poses.parts[index], poses.angles[index], strict=True)
        for part, position, angle in rows:  # a part's motion may be invisible
            if part in self._addresses:
                data.qpos[self._addresses[part]] = position
            if (drawn := stage.turned.get(part)) is not None:  # turn the body by its true angle
                mujoco.mju_axisAngle2Quat(turn, drawn.axis, angle)
                mujoco.mju_mulQuat(found, turn, drawn.rest)
                model.body_quat[drawn.body] = found
        for since, geoms in stage.gone:
            lost = float(poses.time[index]) >= since
            model.geom_group[geoms] = shapes.UNSEEN_GROUP if lost else self._groups[geoms]
        level = [0.0, 0.0, -shift[2]]
        places = {shapes.WATER: -shift, shapes.LEVEL: level, shapes.DRIFT: drift}
        if stage.floor is not None and stage.ground:  # the sea floor fades with distance
            north, east, depth = poses.position[index]
            altitude = float(floor_depth(stage.floor, north, east) - depth)
            places[shapes.SEABED] = [0.0, 0.0, -altitude]
            alpha = self._alpha[stage.ground] * sea.clearness(altitude)
            model.geom_rgba[stage.ground, 3] = alpha
        for name, place in places.items():
            data.mocap_pos[model.body(name).mocapid[0]] = place
        self._reveal(poses, index, here)
        self._place_arrows(poses, index)
        if stage.bands_follow:
            depth = float(poses.position[index, 2])
            depth -= camera.CHASE_HEIGHT if stage.chase else 0.0
            model.geom_rgba[stage.bands, :3] = sea.backdrop_colours(depth, len(stage.bands))
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        return here - shift

    def _reveal(self, poses: Poses, index: int, here: Array) -> None:
        """Show the ribbons up to the frame's time; the true one ends at the glider or its tail."""
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
            tip, clear = here if line.colour is None else line.ribbon.at(time), 0.0
            if line.colour is None and stage.chase:
                tail, clear = np.zeros(3), stage.hull_length
                backward = np.array([-TAIL * stage.hull_length, 0.0, 0.0])
                mujoco.mju_rotVecQuat(tail, backward, poses.quaternion[index])
                tip = here + tail
            mesh = int(stage.model.geom_dataid[line.head])
            self._reshape(mesh, line.ribbon.head(time, tip, clear))

    def _place_arrows(self, poses: Poses, index: int) -> None:
        """Place the current's arrows beside the glider; each depth keeps its geom."""
        model, slots = self._stage.model, self._stage.arrows
        model.geom_rgba[slots, 3] = 0.0
        for depth, start, vector in self._stage.ladder(poses, index) if slots else ():
            if np.linalg.norm(vector) > SHORTEST_ARROW:
                geom = slots[round(depth / ribbon.LADDER_STEP) % len(slots)]
                model.geom_rgba[geom, 3] = 1.0
                model.geom_pos[geom] = start
                self._reshape(int(model.geom_dataid[geom]), ribbon.ladder_arrow(vector))


def drift_of(moved: Array, glider: Array) -> Array:
    """Position of the particles' cell relative to the glider, when the water has `moved`.

    All are in display units, shape (..., 3). The cell repeats, so the result is modulo its size.
    """
    return np.asarray((moved - glider) % sea.SNOW_BOX)
