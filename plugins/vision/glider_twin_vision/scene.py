"""Scene: pictures of a vehicle with markers by MuJoCo, through a lens, water, motion and noise.

Light of colour J at range r arrives as J exp(-c r) + B (1 - exp(-c r)), with attenuation c and
backscatter B (Schechner and Karpel 2004). Visibility V is the range at which 2 % of a contrast is
left (Koschmieder), so c = 3.91 / V in green. Red is attenuated more, as in coastal water (ours).
"""

from __future__ import annotations

import dataclasses
import math
from types import TracebackType
from typing import Any, Self

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from glider_twin_vision.lens import Lens
from glider_twin_vision.markers import MODULES, Board, plate
from twin import Vehicle
from twin.frames import FLIP
from twin.show.render import new_context

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
Picture = NDArray[np.float32]
CONTRAST_LEFT = 0.02
"""[1] Part of a contrast that is left at the range of visibility"""
COLOURS = np.array([1.5, 1.0, 0.95])
"""[1] Attenuation of red, green and blue over that of green (ours, coastal water)"""
BACKSCATTER = np.array([0.10, 0.36, 0.42])
"""[1] Colour of the water's own light (ours)"""
HIDDEN_GROUP = 5
"""Group of geoms that MuJoCo does not draw"""
NEAR, FAR = 0.05, 60.0
"""[m] Range of the rendered depths"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Water:
    """Water between camera and vehicle, and what exposure and electronics add."""

    visibility: float = 8.0
    """[m] Range at which 2 % of a contrast is left"""
    exposure: float = 0.015
    """[s] Time that blurs a moving picture"""
    noise: float = 0.012
    """[1] Standard deviation of a pixel's noise at full brightness; in the dark it is half"""


class Scene:
    """Vehicle with its markers in a pool, drawn without a screen; a context manager."""

    scale = 2
    """Pixels of the drawn picture for one of the lens's, a side"""

    def __init__(self, vehicle: Vehicle, board: Board, lens: Lens, *, floor: float = 8.0) -> None:
        """Compile the scene; `floor` [m] is the depth of the pool.

        Raises:
          NoOpenGL: no backend draws on this machine.
        """
        self.lens, self._size = lens, (self.scale * lens.width, self.scale * lens.height)
        x, y = (
            (np.arange(n) - 0.5 * (n - 1)) / lens.widened[0, 0] for n in (lens.width, lens.height)
        )
        self._slant = np.sqrt(1.0 + x**2 + y[:, None] ** 2).astype(np.float32)
        spec = mujoco.MjSpec.from_string(vehicle.xml)
        spec.visual.global_.offwidth, spec.visual.global_.offheight = self._size
        spec.visual.map.znear, spec.visual.map.zfar, spec.stat.extent = NEAR, FAR, 1.0
        spec.visual.quality.offsamples = 4
        _pool(spec, floor)
        hull = spec.body("hull")
        for number, corners in enumerate(board.corners(board.side * MODULES / (MODULES - 2))):
            _add_plate(hull, spec, number, corners * FLIP)
        eye = spec.worldbody.add_body(name="eye", mocap=True)
        focal = self.scale * lens.widened[1, 1]
        fovy = math.degrees(2.0 * math.atan(0.5 * self._size[1] / focal))
        eye.add_camera(name="eye", fovy=fovy)
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        self._gl = new_context(*self._size)
        self._context: Any = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene: Any = mujoco.MjvScene(self._model, 500)
        self._camera, self._option = mujoco.MjvCamera(), mujoco.MjvOption()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = self._model.camera("eye").id
        self._option.sitegroup[:] = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:  # fmt: skip
        self._context.free()
        self._gl.free()

    def hide(self, hidden: NDArray[np.bool_]) -> None:
        """Leave out the plates where a mask, (markers,), is true, from the next picture on."""
        for number, gone in enumerate(hidden):
            geom = self._model.geom(f"marker_{number}").id
            self._model.geom_group[geom] = HIDDEN_GROUP if gone else 1

    def draw(self, eye: tuple[Array, Array], body: tuple[Array, Array]) -> tuple[Picture, Picture]:
        """Draw what the widened pinhole sees: colours 0 to 1, (h, w, 3), and ranges [m], (h, w).

        Args:
          eye: [m] place of the camera, north-east-down, and the matrix from its axes to these.
          body: the same of the vehicle, from body axes.
        """
        data = self._data
        place = self._model.joint("hull").qposadr[0]
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, (FLIP[:, None] * body[1] * FLIP).ravel())
        data.qpos[place : place + 3], data.qpos[place + 3 : place + 7] = body[0] * FLIP, quaternion
        mujoco.mju_mat2Quat(quaternion, (FLIP[:, None] * eye[1] * FLIP).ravel())
        data.mocap_pos[0], data.mocap_quat[0] = eye[0] * FLIP, quaternion
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_camlight(self._model, data)
        self._gl.make_current()
        mujoco.mjv_updateScene(
            self._model,
            data,
            self._option,
            None,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        width, height = self._size
        colours, depths = (
            np.empty((height, width, 3), np.uint8),
            np.empty((height, width), np.float32),
        )
        rect = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(colours, depths, rect, self._context)
        colours, depths = colours[::-1], depths[:: -self.scale, :: self.scale]
        small = cv2.resize(
            colours, (width // self.scale, height // self.scale), None, 0, 0, cv2.INTER_AREA
        )
        ahead = NEAR * FAR / (FAR - depths.clip(0.0, 1.0) * (FAR - NEAR))
        return small.astype(np.float32) / 255.0, ahead * self._slant

    def picture(
        self, eye: tuple[Array, Array], body: tuple[Array, Array], water: Water,
        rng: np.random.Generator, motion: tuple[float, float] = (0.0, 0.0),
    ) -> Pixels:  # fmt: skip
        """Take a picture, RGB, (height, width, 3).

        Args:
          motion: [pixel/s] velocity of the vehicle in the picture, right and down.
        """
        seen = self.lens.bend(np.dstack(self.draw(eye, body)))
        seen = veiled(seen[..., :3], seen[..., 3], water.visibility)
        seen = blurred(seen, (motion[0] * water.exposure, motion[1] * water.exposure))
        spread = water.noise * (0.5 + 0.5 * seen)
        noisy = seen + spread * rng.standard_normal(seen.shape, dtype=np.float32)
        return np.asarray(np.clip(255.0 * noisy, 0.0, 255.0).astype(np.uint8))


def veiled(colours: Picture, ranges: Picture, visibility: float) -> Picture:
    """Colours, (..., 3), after ranges [m], (...), of water with a visibility [m]."""
    attenuation = -math.log(CONTRAST_LEFT) / visibility * COLOURS
    left = np.exp(-ranges[..., None] * attenuation.astype(np.float32))
    found = colours * left + BACKSCATTER.astype(np.float32) * (1.0 - left)
    return np.asarray(found, np.float32)


def blurred(picture: Picture, shift: tuple[float, float]) -> Picture:
    """Blur a picture along a shift [pixel], right and down, during its exposure."""
    length = math.hypot(*shift)
    if length < 0.3:
        return picture
    steps, half = np.linspace(-0.5, 0.5, 32), math.ceil(0.5 * length) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for x, y in zip(half + steps * shift[0], half + steps * shift[1], strict=True):
        i, j = int(y), int(x)
        for di, wi in ((0, 1.0 - (y - i)), (1, y - i)):
            for dj, wj in ((0, 1.0 - (x - j)), (1, x - j)):
                kernel[i + di, j + dj] += wi * wj / steps.size
    return np.asarray(cv2.filter2D(picture, -1, kernel, borderType=cv2.BORDER_REPLICATE))


def _pool(spec: Any, floor: float) -> None:
    """Add a tiled floor and daylight from above."""
    rng = np.random.default_rng(3)
    tiles = (170 + 22 * rng.standard_normal((64, 64, 1)) + np.array([-40, 0, 10])).clip(0, 255)
    tiles = np.kron(tiles, np.ones((8, 8, 1)))
    tiles[::8], tiles[:, ::8] = 90, 90
    _textured(spec, "tiles", tiles.astype(np.uint8), texrepeat=[4, 4])
    spec.worldbody.add_geom(
        name="pool", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[40, 40, 1], pos=[0, 0, -floor],
        material="tiles", contype=0, conaffinity=0,
    )  # fmt: skip


def _textured(spec: Any, name: str, picture: Pixels, **look: Any) -> None:
    """Add a material of this name with a picture, RGB, (n, n, 3)."""
    texture = spec.add_texture(
        name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=len(picture), height=len(picture),
        nchannel=3,
    )  # fmt: skip
    texture.data = picture.tobytes()
    material = spec.add_material(name=name, **look)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def _add_plate(hull: Any, spec: Any, number: int, corners: Array) -> None:
    """Add the printed plate of a marker, corners (4, 3) in MuJoCo's hull axes."""
    name = f"marker_{number}"
    print_ = np.repeat(plate(number, 32)[..., None], 3, axis=-1)
    shown = (30 + print_.astype(float) * (205.0 / 255.0)).astype(np.uint8)
    _textured(spec, name, shown, emission=0.15, specular=0.1)
    faces = np.array([[0, 3, 2], [0, 2, 1]], np.int32)
    spec.add_mesh(
        name=name, uservert=corners.ravel(), userface=faces.ravel(),
        usertexcoord=[0, 0, 1, 0, 1, 1, 0, 1], inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )  # fmt: skip
    hull.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name, mass=0,
        contype=0, conaffinity=0, group=1,
    )  # fmt: skip
