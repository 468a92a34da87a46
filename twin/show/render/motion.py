"""Motion: puts the glider, the water, the ribbons and the arrows of a stage where they are."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.show.render import camera, sea
from twin.show.render.playback import Poses
from twin.show.render.ribbon import LADDER_STEP, ladder_arrow
from twin.show.render.shapes import DRIFT, LEVEL, SEABED, UNSEEN_GROUP, VEHICLE, WATER, Shape
from twin.show.render.stage import Stage
from twin.water.floor.lookup import floor_depth

Array = NDArray[np.float64]
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
            alpha[line.head.geom] = 1.0 if running else 0.0
            if not running:
                continue
            tip, clear = line.ribbon.at(time), 0.0
            if line.colour is None:
                tip = here
                if stage.chase:
                    tip, clear = here + self._tail(poses, index), stage.hull_length
            self._reshape(line.head.mesh, line.ribbon.head(time, tip, clear))

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
        model.geom_rgba[[arrow.geom for arrow in slots], 3] = 0.0
        for depth, start, vector in self._stage.ladder(poses, index):
            if np.linalg.norm(vector) <= SHORTEST_ARROW:
                continue
            arrow = slots[round(depth / LADDER_STEP) % len(slots)]
            model.geom_rgba[arrow.geom, 3] = 1.0
            model.geom_pos[arrow.geom] = start
            if not np.array_equal(self._shaped.get(arrow.mesh, ()), vector):
                self._shaped[arrow.mesh] = vector
                self._reshape(arrow.mesh, ladder_arrow(np.zeros(3), vector))


def drift_of(moved: Array, glider: Array) -> Array:
    """Where the cell of particles is, when the water has `moved` past the glider's place.

    Both in display units, shape (..., 3); the cell repeats, so the result lies within one.
    """
    return np.asarray((moved - glider) % sea.SNOW_BOX)
