"""Painter: frames of a shot as arrays. One OpenGL context, one process."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.render import camera, palette, sea
from twin.render.camera import View
from twin.render.canvas import Canvas, border
from twin.render.context import new_context, release
from twin.render.hud import Hud
from twin.render.props import DRIFT, LEVEL, VEHICLE, WATER
from twin.render.replay import Poses, poses
from twin.render.shot import Shot
from twin.render.stage import Stage, build
from twin.render.tracks import NamedTrack
from twin.trajectory import Trajectory
from twin.vehicle import Vehicle

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

TAIL = 0.47
"""Where the ribbon ends behind the glider's middle, chase camera, over the hull's length"""
SHORTEST_ARROW = 0.02
"""[m]"""
INSET_EDGE = (150, 200, 220)
MOST_GEOMS = 4000


class Painter:
    """Paints frames of one shot; a context manager that releases its OpenGL context.

    with Painter(trajectory, vehicle, shot, times) as painter:
        pixels = painter.paint(0)
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
        self._context = new_context(shot.width, shot.height)
        self._closed = False
        self._data = mujoco.MjData(model)
        self._scene = mujoco.MjvScene(model, MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = (1, 1, 1, 0, 0, 1)
        self._option.sitegroup[:] = 0
        self._close_up = mujoco.MjvOption()
        self._close_up.geomgroup[:] = (0, 1, 1, 1, 0, 0)
        self._close_up.sitegroup[:] = 0
        self._perturb, self._camera = mujoco.MjvPerturb(), mujoco.MjvCamera()
        self._graphics = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._graphics)
        self._whole = mujoco.MjrRect(0, 0, shot.width, shot.height)
        self._buffer = np.zeros((shot.height, shot.width, 3), np.uint8)
        self._shown = np.zeros(len(self.stage.lines), int)
        self._rgba = model.geom_rgba.copy()
        self._hull = model.joint(f"{VEHICLE}hull").qposadr[0]
        self._battery = [model.joint(f"{VEHICLE}{n}").qposadr[0] for n in ("shift", "rotation")]
        self._mocap = {name: int(model.body(name).mocapid[0]) for name in (WATER, LEVEL, DRIFT)}
        heading = np.deg2rad(self.poses.heading)
        self._bearing = camera.follow(heading, shot.fps)
        notes = self._notes(title) if shot.hud else []
        self._hud = Hud(self.stage, self.poses, self._canvas, notes) if shot.hud else None

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.poses.time)

    def paint(self, index: int) -> Pixels:
        """Frame `index`, shape (height, width, 3); the array is the caller's."""
        self._context.make_current()
        centre = self._pose(index)
        view = self._view(index)
        self._draw(index, view, self._option, self._whole, extra=True)
        if self._inset is not None:
            left, top, wide, high = self._inset
            box = mujoco.MjrRect(left, self.shot.height - top - high, wide, high)
            close = camera.inset_view(centre, float(self._bearing[index]), wide / high)
            self._draw(index, close, self._close_up, box, extra=False)
        mujoco.mjr_readPixels(self._buffer, None, self._whole, self._graphics)
        frame = np.ascontiguousarray(self._buffer[::-1])
        if self._inset is not None:
            border(frame, self._inset, INSET_EDGE)
        if self._hud is not None:
            self._hud.draw(frame, index, view)
        return frame

    def close(self) -> None:
        """Release the OpenGL context; the painter cannot be used any more."""
        if not self._closed:
            self._closed = True
            self._context.make_current()
            self._graphics.free()
            release(self._context)

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
        stage, data = self.stage, self._data
        here = stage.layout.display(self.poses.position[index])
        shift = here if stage.chase else np.zeros(3)
        data.qpos[self._hull : self._hull + 3] = here - shift
        data.qpos[self._hull + 3 : self._hull + 7] = self.poses.quaternion[index]
        data.qpos[self._battery] = self.poses.battery[index]
        data.mocap_pos[self._mocap[WATER]] = -shift
        data.mocap_pos[self._mocap[LEVEL]] = [0.0, 0.0, -shift[2]]
        data.mocap_pos[self._mocap[DRIFT]] = self._drift(index)
        self._reveal(index, here)
        if stage.chase or self._inset is not None:
            self._daylight(float(self.poses.position[index, 2]))
        mujoco.mj_kinematics(stage.model, data)
        mujoco.mj_camlight(stage.model, data)
        return here - shift

    def _drift(self, index: int) -> Array:
        """Where the cell of particles is: they move with the water, so against the glider."""
        if not self.stage.snow:
            return np.zeros(3)
        time = self.poses.time[: index + 1]
        current = np.nan_to_num(self.poses.current[: index + 1])
        moved = np.zeros(3)
        if len(time) > 1:
            steps = np.diff(time)[:, None] * (current[1:] + current[:-1]) / 2
            moved[:2] = steps.sum(axis=0) * [1.0, -1.0]
        relative = moved - self.stage.layout.display(self.poses.position[index])
        return relative % sea.SNOW_BOX

    def _reveal(self, index: int, here: Array) -> None:
        """Show the ribbons up to now; the true one ends at the glider's tail."""
        stage, time = self.stage, float(self.poses.time[index])
        model = stage.model
        forward = np.zeros(3)
        mujoco.mju_rotVecQuat(forward, np.array([1.0, 0.0, 0.0]), self.poses.quaternion[index])
        for line in stage.lines:
            ends = line.ribbon.chunk_ends()
            done = int(np.searchsorted(ends, time, side="right"))
            for i, geom in enumerate(line.chunks):
                model.geom_rgba[geom, 3] = self._rgba[geom, 3] if i < done else 0.0
            tip, clear = line.ribbon.at(time), 0.0
            if line.colour is None and stage.chase:
                tip, clear = here - TAIL * stage.hull_length * forward, stage.hull_length
            elif line.colour is None:
                tip = here
            running = done < len(line.chunks) and time > line.ribbon.time[0]
            model.geom_rgba[line.head, 3] = 1.0 if running else 0.0
            if running:
                self._reshape(line.head_mesh, line.ribbon.head(time, tip, clear).vertices)

    def _reshape(self, mesh: int, vertices: Array) -> None:
        """New vertices for a mesh that lies in its body's frame."""
        model = self.stage.model
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        model.mesh_vert[start : start + count] = vertices
        mujoco.mjr_uploadMesh(model, self._graphics, mesh)

    def _daylight(self, depth: float) -> None:
        """Colour the backdrop for a glider at `depth` [m]."""
        depth -= camera.CHASE_HEIGHT if self.stage.chase else 0.0
        self.stage.model.geom_rgba[self.stage.bands, :3] = sea.backdrop_colours(depth)

    def _view(self, index: int) -> View:
        shot, layout = self.shot, self.stage.layout
        bare = camera.Frame(aspect=shot.width / shot.height)
        frame = self._canvas.frame if shot.hud else bare
        if shot.camera == "chase":
            return camera.chase_view(float(self._bearing[index]), frame)
        if shot.camera == "side":
            return camera.side_view(layout, frame)
        if shot.camera == "map":
            return camera.map_view(layout, frame)
        if self.frames == 1:
            phase = 0.5 + camera.ORBIT_STILL / camera.ORBIT_SWEEP
        else:
            phase = index / (self.frames - 1)
        return camera.orbit_view(layout, phase, frame)

    def _draw(
        self,
        index: int,
        view: View,
        option: mujoco.MjvOption,
        box: mujoco.MjrRect,
        *,
        extra: bool,
    ) -> None:
        stage, scene = self.stage, self._scene
        mujoco.mjv_updateScene(
            stage.model, self._data, option, self._perturb, self._camera,
            mujoco.mjtCatBit.mjCAT_ALL, scene,
        )  # fmt: skip
        if extra and stage.chase:
            self._ladder(index)
        half_width, low, high = view.frustum()
        for eye in scene.camera:
            eye.pos[:], eye.forward[:], eye.up[:] = view.position, view.forward, view.up
            eye.orthographic = int(view.parallel)
            eye.frustum_center, eye.frustum_width = view.centre(), half_width
            eye.frustum_bottom, eye.frustum_top = low, high
            eye.frustum_near, eye.frustum_far = view.near, view.far
        mujoco.mjr_render(box, scene, self._graphics)

    def _ladder(self, index: int) -> None:
        """Arrows of the current profile beside the glider, at round depths."""
        scene = self._scene
        for _, point, vector in self.stage.ladder(self.poses, index):
            if np.linalg.norm(vector) < SHORTEST_ARROW or scene.ngeom >= scene.maxgeom:
                continue
            geom = scene.geoms[scene.ngeom]
            mujoco.mjv_initGeom(
                geom, mujoco.mjtGeom.mjGEOM_ARROW, np.zeros(3), np.zeros(3), np.zeros(9),
                np.array([*palette.CURRENT, 0.85], np.float32),
            )  # fmt: skip
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, 0.035, point, point + vector)
            geom.emission = 0.4
            scene.ngeom += 1

    # -- layout of the picture -----------------------------------------------------------------

    def _notes(self, title: str) -> list[str]:
        shot, layout = self.shot, self.stage.layout
        facts = []
        if self.frames > 1:
            rate = float(self.poses.time[-1] - self.poses.time[0]) / (self.frames - 1) * shot.fps
            facts.append(f"{rate:.3g} × real time")
        if not self.stage.chase:
            if shot.camera != "map" and layout.exaggeration != 1.0:
                facts.append(f"depth × {layout.exaggeration:g}")
            if layout.scale < 1.0:
                facts.append(f"glider × {1 / layout.scale:.0f}")
        return [title or "glider twin", "   ".join(facts)] if facts else [title or "glider twin"]
