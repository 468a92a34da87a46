"""Props: the MuJoCo spec of a scene, and how meshes are put into it.

Everything that belongs to the water hangs on mocap bodies (`water`; `level` for what follows the
glider horizontally; `seabed` for the floor under it; `drift` for particles), so that the chase
camera can move the sea past the glider instead of the glider through kilometres, where the
graphics' single precision would make it shake.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.render.shapes import Shape

Array = NDArray[np.float64]

VEHICLE = "vehicle/"
"""Prefix of the attached glider's names"""
BACKDROP_GROUP, CLOSE_UP_GROUP, WATER_GROUP = 0, 3, 5
"""Geom groups; the glider's own are 1 and 2, its fluid geoms 4 stay hidden."""
WORLD, WATER, LEVEL, SEABED, DRIFT = "world", "water", "level", "seabed", "drift"
"""Bodies that props hang on"""
AMBIENT, HEADLIGHT, SUN = 0.36, 0.40, 0.58
"""Light from everywhere, from the camera and from above, over full light"""
MATERIALS = {
    "flat": (1.0 - AMBIENT - HEADLIGHT / 2, 0.0),
    "lit": (0.3, 0.2),
    "glow": (0.55, 0.1),
    "matte": (0.0, 0.0),
}
"""Emission and specular; `flat` shows its colour as it is, under the light of the mean angle"""
SAMPLES = 4
"""Samples per pixel against jagged edges"""


SLICES, STACKS = 24, 6
"""Facets of round geoms around and along; more cost time on a CPU and show nothing"""


class Props:
    """A spec with the glider, lights and water bodies, to which meshes are added."""

    def __init__(self, vehicle_xml: str, width: int, height: int):
        """`width` and `height` [pixel] are the largest picture's."""
        self.spec = mujoco.MjSpec()
        self.spec.modelname = "stage"
        visual = self.spec.visual
        visual.global_.offwidth, visual.global_.offheight = width, height
        visual.quality.offsamples = SAMPLES
        visual.quality.shadowsize = 0
        visual.quality.numslices, visual.quality.numstacks = SLICES, STACKS
        visual.headlight.ambient = [AMBIENT] * 3
        visual.headlight.diffuse = [HEADLIGHT] * 3
        visual.headlight.specular = [0.0] * 3
        # Straight down, so that it leaves the walls' colours alone, as it would in the sea.
        self.spec.worldbody.add_light(
            name="sun",
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            dir=[0.0, 0.0, -1.0],
            diffuse=[SUN] * 3,
            specular=[0.3] * 3,
            ambient=[0.0] * 3,
            castshadow=False,
        )
        for name, (emission, specular) in MATERIALS.items():
            self.spec.add_material(name=name, emission=emission, specular=specular, shininess=0.4)
        self._attach(mujoco.MjSpec.from_string(vehicle_xml))
        self._bodies = {WORLD: self.spec.worldbody}
        for name in (WATER, LEVEL, SEABED, DRIFT):
            self._bodies[name] = self.spec.worldbody.add_body(name=name, mocap=True)

    def add(
        self,
        name: str,
        shape: Shape,
        colour: Array,
        *,
        alpha: float = 1.0,
        material: str = "flat",
        group: int = WATER_GROUP,
        body: str = WATER,
    ) -> str:
        """Add a mesh and its geom, both of this name; returns the name."""
        textured: dict[str, Any] = {}
        if shape.coordinates is not None:
            textured["usertexcoord"] = shape.coordinates.astype(np.float32).ravel()
        self.spec.add_mesh(
            name=name,
            uservert=shape.vertices.astype(np.float32).ravel(),
            userface=shape.faces.astype(np.int32).ravel(),
            usernormal=shape.normals.astype(np.float32).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            **textured,
        )
        self._bodies[body].add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=material,
            rgba=[*(float(c) for c in colour), alpha],
            group=group,
            contype=0,
            conaffinity=0,
            mass=0,
        )
        return name

    def add_row_texture(self, name: str, colours: Array, *, emission: float) -> None:
        """A material whose texture is one row of colours (n, 3); see `Shape.coordinates`."""
        pixels = np.repeat((255 * colours).astype(np.uint8)[None], 2, axis=0)
        texture = self.spec.add_texture(
            name=name,
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            width=len(colours),
            height=2,
            nchannel=3,
        )
        texture.data = pixels.tobytes()
        material = self.spec.add_material(
            name=name, emission=emission, specular=0.15, shininess=0.3
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name

    def _attach(self, glider: mujoco.MjSpec) -> None:
        """Attach the glider's hull without what only its physics needs."""
        unseen = (glider.keys, glider.sensors, glider.actuators, glider.cameras, glider.lights)
        for item in [item for items in unseen for item in items]:
            glider.delete(item)
        # MuJoCo warns about each setting in which two models differ; the stage's own count here.
        pairs: list[tuple[Any, Any]] = [(self.spec.option, glider.option)]
        for name in ("global_", "quality", "headlight", "map", "scale", "rgba"):
            pairs.append((getattr(self.spec.visual, name), getattr(glider.visual, name)))
        for ours, theirs in pairs:
            for name in dir(ours):
                if not name.startswith("_"):
                    setattr(theirs, name, getattr(ours, name))
        self.spec.worldbody.add_frame().attach_body(glider.body("hull"), VEHICLE, "")
