"""Pictures: images from a camera of a model, drawn without a screen.

An image equals that of `dm_control.mujoco.Physics.render`, with the same arguments.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.show.render.context import claim_drawing, keep_current, new_context, release

FREE_CAMERA = -1
"""Number of the free camera, which looks at the middle of the model from outside."""


class Pictures:
    """Renderer of a model's images; `close` releases the OpenGL context."""

    def __init__(self, model: mujoco.MjModel):
        """Open a context for images up to the file's `<global offwidth offheight>`.

        Raises:
          NoOpenGL: this machine cannot draw.
        """
        self._model, largest = model, model.vis.global_
        with keep_current():
            self._context = new_context(largest.offwidth, largest.offheight)
            self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        self._closed = False

    def draw(
        self,
        data: mujoco.MjData,
        *,
        height: int = 240,
        width: int = 320,
        camera_id: int | str = FREE_CAMERA,
        depth: bool = False,
        segmentation: bool = False,
        scene_option: mujoco.MjvOption | None = None,
    ) -> NDArray[np.generic]:
        """Draw an image of the present state, first row on top.

        Args:
          height, width: [pixel]. camera_id: name or number of a camera, -1 is a free one.
          depth: draw distances from the camera [m], float32, shape (height, width).
          segmentation: draw number and `mjtObj` of the visible object, -1 for none, int32, shape
            (height, width, 2). Without either: colours, uint8, shape (height, width, 3).
          scene_option: MuJoCo's options for the visible elements.

        Raises:
          InputError: an unknown camera, a size that is too large, or depth and segmentation
            together. ForkedDrawing: this process was forked from one that has drawn.
        """
        claim_drawing()
        for name, size in (("height", height), ("width", width)):
            most = int(getattr(self._model.vis.global_, f"off{name}"))
            if not 0 < size <= most:
                raise InputError(
                    f"{name} {size}: give 1 to {most} pixels, or raise <global off{name}> in the "
                    "vehicle file"
                )
        if depth and segmentation:
            raise InputError("depth and segmentation are two pictures: ask for one of them")
        model = self._model
        view, scene = self._camera(camera_id), mujoco.MjvScene(model, _most_geoms(model))
        option, nothing = scene_option or mujoco.MjvOption(), mujoco.MjvPerturb()
        mujoco.mjv_updateScene(
            model, data, option, nothing, view, mujoco.mjtCatBit.mjCAT_ALL, scene
        )
        if segmentation:
            for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR):
                scene.flags[flag] = True
        place = mujoco.MjrRect(0, 0, width, height)
        colours, distances = np.empty((height, width, 3), np.uint8), np.empty((height, width), "f4")
        with keep_current():
            self._context.make_current()
            mujoco.mjr_render(place, scene, self._renderer)
            mujoco.mjr_readPixels(
                None if depth else colours, distances if depth else None, place, self._renderer
            )
        found: NDArray[np.generic] = colours
        if depth:  # the depth buffer is 0 at the near plane and 1 at the far one
            near, far = (
                end * model.stat.extent for end in (model.vis.map.znear, model.vis.map.zfar)
            )
            found = near / (1 - distances * (1 - near / far))
        elif segmentation:
            found = _labels(colours, scene)
        return found[::-1]

    def _camera(self, camera_id: int | str) -> mujoco.MjvCamera:
        model, view = self._model, mujoco.MjvCamera()
        names = [model.camera(k).name for k in range(model.ncam)]
        if isinstance(camera_id, str):
            if camera_id not in names:
                raise InputError(unknown_name("camera", camera_id, names))
            camera_id = names.index(camera_id)
        if not FREE_CAMERA <= camera_id < model.ncam:
            raise InputError(f"camera_id {camera_id}: give -1 to {model.ncam - 1}, or a name")
        if camera_id == FREE_CAMERA:
            mujoco.mjv_defaultFreeCamera(model, view)
        else:
            view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera_id
        return view

    def close(self) -> None:
        """Release the context; a second call does nothing."""
        if not self._closed:
            self._closed = True
            with keep_current():
                self._context.make_current()
                self._renderer.free()
                release(self._context)


def _most_geoms(model: mujoco.MjModel) -> int:
    """Upper bound on the geoms of a scene: every geom, site and decoration of a model."""
    return 1000 + 3 * (model.ngeom + model.nsite)


def _labels(colours: NDArray[np.uint8], scene: mujoco.MjvScene) -> NDArray[np.generic]:
    """Number and type of the object that each pixel's colour represents."""
    words = colours.astype(np.uint32) @ np.array([1, 2**8, 2**16], np.uint32)
    table = np.full((scene.ngeom + 1, 2), -1, np.int32)
    for geom in scene.geoms[: scene.ngeom]:
        if geom.segid != -1:
            table[geom.segid + 1] = geom.objid, geom.objtype
    return np.asarray(table[words])
