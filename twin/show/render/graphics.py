"""Graphics: MuJoCo's renderer on one model and one offscreen context."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.show.render.camera import View
from twin.show.render.context import new_context, release
from twin.show.render.shapes import Shape

Pixels = NDArray[np.uint8]

MOST_GEOMS = 4000
"""Geoms of a scene: a mission of many days has some hundred ribbon chunks."""
OFF = ("SHADOW", "SKYBOX", "HAZE", "REFLECTION")
"""Effects that the stage does not use"""


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
