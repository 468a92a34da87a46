"""Window: MuJoCo's interactive viewer on the scene of a shot.

Stage and motion are those of pictures and films. The mouse turns, shifts and zooms the camera as in
every MuJoCo viewer. MuJoCo's own keys keep their meaning; this window uses the keys that MuJoCo
leaves free: the digits from 6, the arrows, Space, Backspace, = and -.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import queue
import threading
import time
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from twin.extras import preload_triton
from twin.show.render import camera, canvas, context, hud, painter, playback, sea, shapes, stage
from twin.show.render.subject import RenderedFlight, Shot, Subject

SPACE, BACKSPACE, RIGHT, LEFT, MINUS, EQUAL = 32, 259, 262, 263, 45, 61  # key codes of GLFW
VIEWS = {54: "orbit", 55: "side", 56: "map", 57: "follow"}  # keys 6 to 9 and the camera's modes
KEYS = (
    ("Space", "pause"),
    ("= -", "faster, slower"),
    ("right left", "forward, back"),
    ("Backspace", "from the start"),
    ("6 7 8 9", "orbit, side, map, follow"),
)
FASTER = 2.0  # factor of the speed-up for one key press
JUMP = 0.02  # fraction of the mission that an arrow key skips
FOLLOW_DISTANCE, FOLLOW_ELEVATION = 9.0, -18.0
"""Camera behind the glider. FOLLOW_DISTANCE: [display units]. FOLLOW_ELEVATION: [degree]"""
CLOSING = 5.0  # [s] longest wait for the window to close
MARGIN = 1.12
"""Distance of the camera as a multiple of the least that shows all: the window may be narrow"""
REFRESH = 60.0  # [1/s] largest frame rate
MOVED = 0.02
"""[display units] Smallest change of a mesh that the viewer receives; each update costs a frame"""


class Window:
    """Scene of one flight in MuJoCo's passive viewer."""

    def __init__(self, subject: Subject, shot: Shot, flight: RenderedFlight, *, speed_up: float):
        """
        Args:
          subject: flight whose trajectory sets the size of the scene and the ribbon.
          flight: flight that gives the glider's pose, recorded or live.
          speed_up: mission seconds per second.

        Raises:
          InputError: the shot does not fit the trajectory.
        """
        self._subject, self._flight, self._speed = subject, flight, speed_up
        self._shot = dataclasses.replace(shot, inset=False, hud=False, speed_up=speed_up)
        self._stage = stage.build(subject, self._shot)
        self._first, self._last = self._shot.part(subject.trajectory.time)
        self._data = mujoco.MjData(self._stage.model)
        self._motion = painter.Motion(self._stage, self._data, self._reshape)
        self._keys: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._changed: set[int] = set()
        self._time, self._paused, self._closing = self._first, False, False
        self._mode = "follow" if self._stage.chase else self._shot.camera
        self._heading: float | None = None
        self._water = np.zeros(3)
        model, chase = self._stage.model, self._stage.chase
        model.vis.global_.fovy = math.degrees(2 * (camera.WIDE if chase else camera.NARROW))
        radius = sea.OPEN_RADIUS if chase else sea.backdrop_radius(self._stage.layout)
        model.stat.extent, model.stat.center = 1.0, np.zeros(3)
        model.vis.map.znear, model.vis.map.zfar = 0.05, 6.0 * radius

    def run(self, seconds: float | None = None) -> float:
        """Show the flight until the window is closed, or for `seconds`; return frames per second.

        Raises:
          NoScreen: MuJoCo could not open the window.
          SimulationUnstable: a live flight diverged.
        """
        self._move(0.0)
        with self._open() as handle:
            option = painter.shown(shapes.BACKDROP_GROUP, shapes.WATER_GROUP)
            handle.opt.geomgroup[:], handle.opt.sitegroup[:] = option.geomgroup, 0
            self._aim(handle)
            begun = before = time.perf_counter()
            frames = 0
            while handle.is_running() and not self._closing:
                now = time.perf_counter()
                if seconds is not None and now - begun >= seconds:
                    break
                frames += 1
                self._obey(handle)
                row = self._move(now - before)
                before = now
                for mesh in self._changed:
                    handle.update_mesh(mesh)
                self._changed.clear()
                self._follow(handle, row)
                handle.set_texts(self._texts(row))
                handle.sync()
                time.sleep(max(0.0, 1.0 / REFRESH - (time.perf_counter() - now)))
            return frames / max(time.perf_counter() - begun, 1e-9)

    def close(self) -> None:
        """End `run`, from another thread."""
        self._closing = True

    @contextlib.contextmanager
    def _open(self) -> Iterator[Any]:
        preload_triton()
        import mujoco.viewer

        before = set(threading.enumerate())
        try:
            handle = mujoco.viewer.launch_passive(
                self._stage.model,
                self._data,
                key_callback=self._keys.put,
                show_left_ui=False,
                show_right_ui=False,
            )
        except RuntimeError as error:  # on macOS MuJoCo needs the interpreter mjpython
            raise context.NoScreen(f"MuJoCo opens no window: {error}") from error
        drawing = [thread for thread in threading.enumerate() if thread not in before]
        try:
            with handle:
                yield handle
        finally:
            # The viewer's thread draws until the window is gone: wait before OpenGL is shut down.
            for thread in drawing:
                thread.join(CLOSING)

    def _obey(self, handle: Any) -> None:
        """Carry out the keys that were pressed since the last frame."""
        with contextlib.suppress(queue.Empty):
            while True:
                key = self._keys.get_nowait()
                jump = JUMP * (self._last - self._first)
                if key == SPACE:
                    over = self._time >= self._last
                    self._paused = not (over or self._paused)
                    self._time = self._first if over else self._time
                elif key in (EQUAL, MINUS):
                    self._speed *= FASTER if key == EQUAL else 1.0 / FASTER
                elif key in (LEFT, RIGHT):
                    moved = self._time + (jump if key == RIGHT else -jump)
                    self._time = min(max(moved, self._first), self._last)
                elif key == BACKSPACE:
                    self._time = self._first
                elif key in VIEWS:
                    self._mode = VIEWS[key]
                    self._aim(handle)

    def _move(self, elapsed: float) -> playback.Poses:
        """Advance the scene by `elapsed` [s] of real time and return the new pose."""
        ahead = 0.0 if self._paused else elapsed * self._speed
        self._time = min(self._time + ahead, self._last)
        row = self._flight.at(self._time)
        if self._stage.snow:
            self._water[:2] += ahead * np.nan_to_num(row.current[0]) * [1.0, -1.0]
        here = self._stage.layout.display(row.position[0])
        self._here = self._motion.place(row, 0, painter.drift_of(self._water, here))
        return row

    def _reshape(self, mesh: int, shape: shapes.Shape) -> None:
        """Write a mesh whose change is visible, and mark it for the next update of the viewer."""
        model = self._stage.model
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        before = model.mesh_vert[first : first + count]
        if np.abs(before - shape.vertices).max() > MOVED:
            painter.write_mesh(model, mesh, shape)
            self._changed.add(mesh)

    def _aim(self, handle: Any) -> None:
        """Place the free camera for the present mode."""
        layout, mode, cam = self._stage.layout, self._mode, handle.cam
        frame = canvas.frame_of(self._shot)
        self._heading = None
        with handle.lock():
            cam.type = mujoco.mjtCamera.mjCAMERA_FREE
            if mode == "follow":
                heading = float(self._flight.at(self._time).heading[0])
                cam.azimuth = 180.0 - (heading + math.degrees(camera.CHASE_BEARING))
                cam.elevation, cam.lookat[:] = FOLLOW_ELEVATION, self._here
                cam.distance = camera.CHASE_DISTANCE if self._stage.chase else FOLLOW_DISTANCE
            elif mode == "map":
                half = camera.map_view(layout, frame).half_height
                cam.azimuth, cam.elevation = 0.0, -90.0
                cam.lookat[:] = layout.display(layout.centre)
                cam.distance = MARGIN * half / math.tan(camera.NARROW)
            else:
                view = camera.block_view(mode, layout, frame, None)
                cam.azimuth = math.degrees(math.atan2(view.forward[1], view.forward[0]))
                cam.elevation = math.degrees(math.asin(view.forward[2]))
                distance = (layout.corners().mean(axis=0) - view.position) @ view.forward
                cam.lookat[:] = view.position + distance * view.forward
                cam.distance = MARGIN * distance

    def _follow(self, handle: Any, row: playback.Poses) -> None:
        """In mode `follow`, centre the glider and turn with it, besides the mouse's turns."""
        if self._mode != "follow":
            return
        heading = float(row.heading[0])
        turned = 0.0 if self._heading is None else heading - self._heading
        self._heading = heading
        with handle.lock():
            handle.cam.lookat[:] = self._here
            handle.cam.azimuth -= (turned + 180.0) % 360.0 - 180.0

    def _texts(self, row: playback.Poses) -> list[tuple[int, int, str, str]]:
        """Texts of the window: title upper left, readouts lower left, keys lower right."""
        font, places = int(mujoco.mjtFontScale.mjFONTSCALE_100), mujoco.mjtGridPos
        items = [(item.name, _plain(item.value)) for item in hud.readouts(row, 0)]
        state = "paused" if self._paused else f"{self._speed:g} x real time"
        items.append(("SPEED-UP", state if self._time < self._last else "end"))
        return [
            (font, int(place), "\n".join(a for a, _ in rows), "\n".join(v for _, v in rows))
            for place, rows in (
                (places.mjGRID_TOPLEFT, [(self._subject.title, "")]),
                (places.mjGRID_BOTTOMLEFT, items),
                (places.mjGRID_BOTTOMRIGHT, KEYS),
            )
        ]


def _plain(text: str) -> str:
    """Replace special characters by ASCII, the only characters in the viewer's font."""
    for sign, plain in (("−", "-"), ("°", " deg"), ("▼", "heavy"), ("▲", "light"), ("–", "-")):
        text = text.replace(sign, plain)
    return text
