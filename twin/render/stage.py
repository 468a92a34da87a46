"""Stage: the MuJoCo model of a picture. The glider, the block of water, tracks and arrows.

The glider is attached to a world of its own; everything that belongs to the water hangs on mocap
bodies (`water`; `level` for what follows the glider horizontally; `drift` for particles), so that
the chase camera can move the sea past the glider instead of the glider through kilometres, where
the graphics' single precision would make it shake.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.plot.current import mean_profile
from twin.render import palette, shapes
from twin.render.layout import Layout, nice_step, plan, ticks
from twin.render.replay import closed, optional, signal
from twin.render.ribbon import TEXELS, Ribbon, simplify
from twin.render.shapes import Shape
from twin.render.shot import Shot
from twin.render.tracks import NamedTrack
from twin.errors import InputError
from twin.trajectory import Trajectory
from twin.vehicle import Vehicle

Array = NDArray[np.float64]

VEHICLE = "vehicle/"
"""Prefix of the attached glider's names"""
BACKDROP_GROUP, CLOSE_UP_GROUP, WATER_GROUP = 0, 3, 5
"""Geom groups; the glider's own are 1 and 2, its fluid geoms 4 stay hidden."""
BANDS, WALL_BANDS = 96, 96
"""Steps of the colour gradients of backdrop and walls: fine enough that the eye sees none"""
AMBIENT, HEADLIGHT, SUN = 0.36, 0.40, 0.58
"""Light from everywhere, from the camera and from above, over full light"""
RIBBON_RADIUS = 0.055
"""[display units] of the true track; the glider's hull has 0.11"""
CHASE_RADIUS = 0.020
OTHER_SHARE = 0.75
"""Radius of other tracks over that of the true one"""
FUTURE_SHARE = 0.28
RELIEF = 26
"""Grid cells of sea floor and surface along each side"""
RELIEF_SHARE = 0.05
"""Largest height of the floor's relief over the block's depth"""
WAVE_SHARE = 0.0035
"""Height of the drawn waves over the block's length"""
ARROWS = 11
"""Current arrows in a profile, about"""
ARROW_SHARE = 0.11
"""Length of the strongest current's arrow over the block's length"""
CHASE_FADE = 90.0
"""[m] at which surface and floor fade out for the chase camera"""
FADES = 14
SNOW_BOX, SNOW_COUNT, SNOW_SIZE = 14.0, 260, 0.010
"""[m] of the cube of drifting particles, their number and radius [m]: our choice, for motion"""
SNOW_FASTEST = 12.0
"""Speed-up from which particles would only flicker"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Line:
    """A track on the stage: its ribbon and the geoms that show it."""

    name: str
    ribbon: Ribbon
    colour: Array | None
    """RGB; None for the true track, which is coloured by `Stage.scale`"""
    chunks: list[int]
    """Geom ids, one per chunk"""
    head: int
    """Geom id"""
    head_mesh: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scale:
    """What the track's colours mean."""

    label: str
    low: float
    high: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Label:
    """A text at a point of the scene."""

    text: str
    point: Array
    """Display units, shape (3,)"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stage:
    """The compiled scene and what is needed to move it."""

    model: mujoco.MjModel
    layout: Layout
    chase: bool
    lines: list[Line]
    scale: Scale
    depth_ticks: Array
    """[m]"""
    distance_ticks: Array
    """[m] along the block, from its first corner"""
    grid_step: float
    """[m] between the map's grid lines"""
    profile: tuple[Array, Array]
    """Depths [m] (n,) and north, east current [m/s] (n, 2) of the arrows"""
    arrow_scale: float
    """[display units per m/s]"""
    backdrop: list[int]
    """Geom ids of the bands whose colour follows the glider's depth, from below to above"""
    snow: int | None
    """Geom id of the particles"""
    hull_length: float


def build(
    trajectory: Trajectory,
    vehicle: Vehicle,
    shot: Shot,
    tracks: Sequence[NamedTrack] = (),
) -> Stage:
    """Build and compile the scene of a shot.

    Raises:
      InputError: the shot's part or colour does not fit the trajectory.
    """
    return _Builder(trajectory, vehicle, shot, tracks).build()


class _Builder:
    """Collects the scene's parts; one use."""

    def __init__(
        self,
        trajectory: Trajectory,
        vehicle: Vehicle,
        shot: Shot,
        tracks: Sequence[NamedTrack],
    ):
        self.shot, self.vehicle = shot, vehicle
        self.chase = shot.camera == "chase"
        first, last = shot.part(trajectory.time)
        shown = (trajectory.time >= first) & (trajectory.time <= last)
        if shown.sum() < 2:
            raise InputError(f"part {first:g} to {last:g} s holds fewer than 2 samples")
        self.time = trajectory.time[shown]
        self.span = (first, last)
        path = np.stack([signal(trajectory, n) for n in ("north", "east", "depth")], axis=-1)
        self.path = path[shown]
        self.others = self._other_paths(tracks)
        self.layout = plan(
            [self.path, *(p for _, _, p in self.others)],
            hull_length=vehicle.hull_length,
            floor=shot.floor,
            exaggeration=shot.exaggeration,
            camera=shot.camera,
        )
        self.values, self.scale = self._colour_values(trajectory, shown, tracks)
        current = [optional(trajectory, f"current_{n}", 0.0)[shown] for n in ("north", "east")]
        self.current = np.stack(current, axis=-1)
        self.spec = mujoco.MjSpec()
        self.water: mujoco.MjsBody
        self.level: mujoco.MjsBody
        self.drift: mujoco.MjsBody
        self.finished: dict[str, Shape] = {}
        self.line_parts: list[tuple[str, Ribbon, Array | None]] = []

    def _other_paths(self, tracks: Sequence[NamedTrack]) -> list[tuple[str, Array, Array]]:
        """Dead-reckoned tracks within the part, at the true depth: name, time, NED path."""
        found = []
        for track in tracks:
            inside = (track.time >= self.span[0]) & (track.time <= self.span[1])
            if inside.sum() < 2:
                raise InputError(f"track {track.name!r} has fewer than 2 samples in the shown part")
            time = track.time[inside]
            depth = np.interp(time, self.time, self.path[:, 2])
            path = np.column_stack([track.north[inside], track.east[inside], depth])
            found.append((track.name, time, path))
        return found

    def _colour_values(
        self, trajectory: Trajectory, shown: NDArray[np.bool_], tracks: Sequence[NamedTrack]
    ) -> tuple[Array, Scale]:
        """The quantity that colours the true track, on the part's samples, and its scale."""
        if self.shot.colour == "error":
            if not tracks:
                raise InputError(
                    "colouring by error needs a dead-reckoned track: give --tracks FILE"
                )
            north, east = tracks[0].at(self.time)
            values = np.hypot(north - self.path[:, 0], east - self.path[:, 1])
            high = float(np.nanmax(values)) if np.isfinite(values).any() else 1.0
            label = f"position error of {tracks[0].name} [m]"
            return values, Scale(label=label, low=0.0, high=max(high, 1e-3))
        if self.shot.colour == "current":
            parts, label = ("current_north", "current_east"), "current speed [m/s]"
        else:
            parts, label = ("surge", "sway", "heave"), "speed through water [m/s]"
        columns = [trajectory.signals.get(f"true_{name}") for name in parts]
        if any(c is None or not np.isfinite(c).any() for c in columns):
            raise InputError(
                f"cannot colour by {self.shot.colour}: this mission does not record it"
            )
        squares = [np.square(closed(trajectory.time, c)) for c in columns if c is not None]
        values = np.sqrt(np.sum(squares, axis=0))[shown]
        low, high = (float(v) for v in np.percentile(values, [2.0, 98.0]))
        # A colour scale of noise would say nothing: round it outwards to a readable step.
        step = nice_step(max(high - low, 0.02) / 4)
        low, high = step * math.floor(low / step + 1e-9), step * math.ceil(high / step - 1e-9)
        return values, Scale(label=label, low=low, high=max(high, low + step))

    # -- the scene -----------------------------------------------------------------------------

    def build(self) -> Stage:
        self._world()
        backdrop = self._backdrop("backdrop", BACKDROP_GROUP, daylight=self.chase)
        if not self.chase and self.shot.inset:
            backdrop = self._backdrop("close_up", CLOSE_UP_GROUP, daylight=True)
        if self.chase:
            self._open_water()
        elif self.shot.camera == "map":
            self._chart()
        else:
            self._block()
        depths, profile, arrow_scale = self._arrows()
        snow = self._snow()
        self._ribbons()
        model = self.spec.compile()
        self._finish(model)
        return Stage(
            model=model,
            layout=self.layout,
            chase=self.chase,
            lines=[self._line(model, i) for i in range(len(self.line_parts))],
            scale=self.scale,
            depth_ticks=self._depth_ticks(),
            grid_step=self._grid_step(),
            distance_ticks=ticks(0.0, float(self.layout.size[0]), about=5),
            profile=(depths, profile),
            arrow_scale=arrow_scale,
            backdrop=[model.geom(name).id for name in backdrop],
            snow=model.geom("snow").id if snow else None,
            hull_length=self.vehicle.hull_length,
        )

    def _world(self) -> None:
        """Visual settings, lights, the glider and the water's body."""
        spec = self.spec
        spec.modelname = "stage"
        visual = spec.visual
        visual.global_.offwidth, visual.global_.offheight = self.shot.width, self.shot.height
        visual.quality.offsamples = 4
        visual.quality.shadowsize = 0
        visual.headlight.ambient = [AMBIENT] * 3
        visual.headlight.diffuse = [HEADLIGHT] * 3
        visual.headlight.specular = [0.0] * 3
        # Straight down, so that it leaves the walls' colours alone, as it would in the sea.
        spec.worldbody.add_light(
            name="sun",
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            dir=[0.0, 0.0, -1.0],
            diffuse=[SUN] * 3,
            specular=[0.3] * 3,
            ambient=[0.0] * 3,
            castshadow=False,
        )
        glider = mujoco.MjSpec.from_string(self.vehicle.xml)
        unseen = (glider.keys, glider.sensors, glider.actuators, glider.cameras, glider.lights)
        for item in [item for items in unseen for item in items]:
            glider.delete(item)
        _copy_settings(spec, glider)
        spec.worldbody.add_frame().attach_body(glider.body("hull"), VEHICLE, "")
        self.water = spec.worldbody.add_body(name="water", mocap=True)
        self.level = spec.worldbody.add_body(name="level", mocap=True)
        self.drift = spec.worldbody.add_body(name="drift", mocap=True)
        flat = 1.0 - AMBIENT - HEADLIGHT / 2
        for name, emission, specular in (
            ("flat", flat, 0.0),
            ("lit", 0.3, 0.2),
            ("matte", 0.0, 0.0),
        ):
            spec.add_material(name=name, emission=emission, specular=specular, shininess=0.4)

    def _add(
        self,
        name: str,
        shape: Shape,
        colour: Array,
        *,
        alpha: float = 1.0,
        material: str = "flat",
        group: int = WATER_GROUP,
        body: mujoco.MjsBody | None = None,
    ) -> str:
        """A geom of a mesh; returns its name."""
        keywords = {}
        if shape.coordinates is not None:
            keywords["usertexcoord"] = shape.coordinates.astype(np.float32).ravel()
        self.spec.add_mesh(
            name=name,
            uservert=shape.vertices.astype(np.float32).ravel(),
            userface=shape.faces.astype(np.int32).ravel(),
            usernormal=shape.normals.astype(np.float32).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            **keywords,
        )
        (body or self.water).add_geom(
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

    def _backdrop(self, name: str, group: int, *, daylight: bool) -> list[str]:
        """A sphere around everything, in bands whose colours make a gradient."""
        size = self.layout.size * self.layout.factors
        radius = 700.0 if self.chase else 6.0 * float(np.linalg.norm(size)) + 60.0
        edges = np.linspace(-math.pi / 2, math.pi / 2, BANDS + 1)
        return [
            self._add(
                f"{name}_{i}",
                shapes.band(radius, float(low), float(high)),
                backdrop_colour((low + high) / 2, 0.0, daylight=daylight),
                group=group,
                body=self.spec.worldbody,
            )
            for i, (low, high) in enumerate(zip(edges[:-1], edges[1:], strict=True))
        ]

    def _block(self) -> None:
        """Walls coloured by depth with ticks, the sea surface and the floor."""
        layout = self.layout
        corners = layout.corners()
        bottom = float(corners[4, 2])
        edges = np.linspace(0.0, bottom, WALL_BANDS + 1)
        walls = [(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        inward = _inward(walls[0], corners[:4].mean(axis=0))
        walls = walls if inward else [(b, a) for a, b in walls]
        for i, (top, low) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
            strips = [_wall_strip(a, b, top, low) for a, b in walls]
            colour = palette.water_colour((i + 0.5) / WALL_BANDS)
            self._add(f"wall_{i}", shapes.merge(strips), colour)
        self._grid(walls, bottom)
        self._surface_and_floor(bottom)

    def _chart(self) -> None:
        """The map's ground: sea floor in the colour of deep water, with a grid of round metres."""
        corners = self.layout.corners()
        bottom = float(corners[4, 2])
        self._floor(bottom, palette.water_colour(0.62))
        size = self.layout.size * self.layout.factors
        width = 0.0013 * float(size[:2].max())
        step = self._grid_step()
        height = bottom * (1.0 - 1.5 * RELIEF_SHARE)
        lines = []
        for axis in (0, 1):
            low, high = self.layout.low, self.layout.high
            for value in step * np.arange(
                math.ceil(low[axis] / step), math.floor(high[axis] / step) + 1
            ):
                ends = np.array([low, high])
                ends[:, axis] = value
                ends[:, 2] = 0.0
                lines.append(_flat_strip(self.layout.display_block(ends), width, height))
        if lines:
            self._add("grid", shapes.merge(lines), np.array([0.8, 0.93, 1.0]), alpha=0.22)
        rim = [_flat_strip(corners[[i, (i + 1) % 4]], 2 * width, height) for i in range(4)]
        self._add("rim", shapes.merge(rim), np.array([1.0, 1.0, 1.0]), alpha=0.6)

    def _grid_step(self) -> float:
        """[m] between the map's grid lines."""
        return nice_step(float(self.layout.size[:2].max()) / 6)

    def _grid(self, walls: list[tuple[Array, Array]], bottom: float) -> None:
        """Lines on the walls: depth ticks, distance ticks and the block's edges."""
        layout = self.layout
        width = 0.004 * abs(bottom) + 0.012
        lines = []
        for depth in self._depth_ticks():
            z = -depth * layout.factors[2]
            lines += [_wall_strip(a, b, z + width / 2, z - width / 2, lift=0.02) for a, b in walls]
        self._add("depth_lines", shapes.merge(lines), np.array([0.9, 0.97, 1.0]), alpha=0.38)
        rims = [_wall_strip(a, b, 0.0, -2 * width, lift=0.02) for a, b in walls]
        self._add("rim", shapes.merge(rims), np.array([1.0, 1.0, 1.0]), alpha=0.75)

    def _surface_and_floor(self, bottom: float) -> None:
        self._floor(bottom, palette.SAND)
        size = self.layout.size * self.layout.factors
        waves = _terrain(RELIEF + 1, seed=11, rough=0.9) * WAVE_SHARE * float(size[:2].max())
        above = self._sheet(waves)
        self._add("surface", above, palette.GLASS, alpha=0.24, material="lit")
        below = dataclasses.replace(above, faces=above.faces[:, ::-1], normals=-above.normals)
        self._add("surface_below", below, palette.GLASS, alpha=0.22, material="lit")
        shadow = self._shadow(bottom)
        if shadow is not None:
            self._add("shadow", shadow, palette.SAND * 0.22, alpha=0.75)

    def _floor(self, bottom: float, colour: Array) -> None:
        """The sea floor, its relief fading out towards the block's edges."""
        fade = np.sin(np.pi * np.linspace(0.0, 1.0, RELIEF + 1)) ** 0.5
        relief = RELIEF_SHARE * abs(bottom) * np.outer(fade, fade)
        sheet = self._sheet(bottom + relief * _terrain(RELIEF + 1, seed=7))
        self._add("floor", sheet, colour, material="matte")

    def _sheet(self, height: Array) -> Shape:
        """A sheet over the block, `height` (n, n) in display units."""
        layout = self.layout
        count = len(height)
        # Block y runs to the right of x, display y to the left: count it from the far side.
        x = np.linspace(layout.low[0], layout.high[0], count) * layout.scale
        y = -np.linspace(layout.high[1], layout.low[1], count) * layout.scale
        origin, ahead = layout.display_block(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
        forward = (ahead - origin) / layout.scale
        left = np.array([-forward[1], forward[0], 0.0])
        turn = np.column_stack([forward, left, [0.0, 0.0, 1.0]])
        shape = shapes.relief(x, y, height, turn)
        return dataclasses.replace(shape, vertices=shape.vertices + [origin[0], origin[1], 0.0])

    def _shadow(self, bottom: float) -> Shape | None:
        """The track's projection on the floor: a flat band."""
        nodes = self.layout.display(self.path)
        nodes[:, 2] = bottom * (1.0 - 1.2 * RELIEF_SHARE)
        keep = simplify(nodes, RIBBON_RADIUS)
        nodes = nodes[keep]
        if len(nodes) < 2 or np.ptp(nodes[:, :2], axis=0).max() < RIBBON_RADIUS:
            return None
        side, _ = shapes.tube_frame(nodes)
        wide = 0.9 * RIBBON_RADIUS * side
        count = len(nodes)
        i = np.arange(count - 1)
        faces = np.concatenate(
            [np.stack([i, i + count, i + 1], -1), np.stack([i + 1, i + count, i + count + 1], -1)]
        )
        both = np.concatenate([faces, faces[:, ::-1]])
        return Shape(
            vertices=np.concatenate([nodes - wide, nodes + wide]),
            faces=both,
            normals=np.tile([0.0, 0.0, 1.0], (2 * count, 1)),
        )

    def _open_water(self) -> None:
        """Surface and floor as rings around the glider that fade with distance."""
        floor = -float(self.layout.high[2])
        radii = CHASE_FADE * np.linspace(0.0, 1.0, FADES + 1) ** 1.4
        for i in range(FADES):
            fade = (1.0 - (i + 0.5) / FADES) ** 1.3
            inner, outer = max(float(radii[i]), 0.01), float(radii[i + 1])
            colour = np.array([0.75, 0.97, 1.0])
            for name, up in (("surface", False), ("surface_above", True)):
                self._add(
                    f"{name}_{i}",
                    shapes.ring(inner, outer, 0.0, up=up),
                    colour,
                    alpha=0.55 * fade,
                    body=self.level,
                )
            self._add(
                f"floor_{i}",
                shapes.ring(inner, outer, floor, up=True),
                palette.SAND * 0.45,
                alpha=fade,
                body=self.level,
            )

    def _depth_ticks(self) -> Array:
        found = ticks(0.0, float(self.layout.high[2]), about=5)
        return found[found > 0]

    # -- current, particles, tracks ------------------------------------------------------------

    def _arrows(self) -> tuple[Array, Array, float]:
        """The mean current profile as arrows on a mast, or only its figures for the chase."""
        deepest = max(float(self.path[:, 2].max()), 1.0)
        centres, means = mean_profile(np.clip(self.path[:, 2], 0.0, None), *self.current.T)
        profile = np.stack(means, axis=-1)
        strongest = float(np.hypot(*profile.T).max(initial=0.0))
        if strongest < 1e-4:
            return np.zeros(0), np.zeros((0, 2)), 0.0
        if self.chase:
            return centres, profile, 2.2 / strongest
        layout = self.layout
        step = nice_step(deepest / ARROWS)
        depths = np.arange(step / 2, deepest, step)
        columns = [np.interp(depths, centres, c) for c in profile.T]
        values = np.stack(columns, axis=-1)
        length = float(layout.size[:2].max() * layout.scale)
        arrow_scale = ARROW_SHARE * length / strongest
        foot = self._mast()
        parts = []
        radius = 0.0028 * length
        for depth, (north, east) in zip(depths, values, strict=True):
            start = layout.display(np.array([foot[0], foot[1], depth]))
            vector = arrow_scale * np.array([north, -east, 0.0])
            if np.linalg.norm(vector) > 2 * radius:
                thickness = min(radius, float(np.linalg.norm(vector)) / 12)
                parts.append(shapes.arrow(start, start + vector, thickness))
        top, low = (layout.display(np.array([*foot, d])) for d in (0.0, float(layout.high[2])))
        mast = shapes.cone(low, top, 0.7 * radius, 0.7 * radius, 8)
        self._add("mast", mast, np.array([0.85, 0.92, 0.96]), material="lit")
        if parts:
            self._add("current_arrows", shapes.merge(parts), palette.CURRENT, material="lit")
        return depths, values, arrow_scale

    def _mast(self) -> Array:
        """North, east [m] of the corner region of the block that the track leaves most free."""
        layout = self.layout
        x, y = layout.size[:2]
        inset = 0.16
        xs = (layout.low[0] + inset * x, layout.high[0] - inset * x)
        ys = (layout.low[1] + 0.22 * y, layout.high[1] - 0.22 * y)
        corners = np.array([(a, b, 0.0) for a in xs for b in ys])
        inside = layout.to_block(self.path[:: max(1, len(self.path) // 500)])
        gap = np.linalg.norm(inside[None, :, :2] - corners[:, None, :2], axis=-1).min(axis=1)
        return np.asarray(layout.to_ned(corners[int(np.argmax(gap))])[:2])

    def _snow(self) -> bool:
        """Particles for the chase camera at a watchable speed; they repeat in each direction."""
        shot = self.shot
        if not self.chase:
            return False
        first, last = self.span
        if (shot.speed_up or (last - first)) > SNOW_FASTEST:
            return False
        rng = np.random.default_rng(5)
        centres = rng.uniform(-SNOW_BOX, SNOW_BOX, size=(SNOW_COUNT, 3))
        # One cell of particles in 8 copies: moved by less than a cell, it looks endless.
        cell = centres / 2 + SNOW_BOX / 2
        copies = (
            np.concatenate([cell + SNOW_BOX * np.array(o) for o in np.ndindex(2, 2, 2)]) - SNOW_BOX
        )
        sizes = np.tile(SNOW_SIZE * rng.uniform(0.4, 1.0, SNOW_COUNT), 8)
        self._add(
            "snow",
            merge_grains(copies, sizes),
            np.array([0.85, 0.95, 1.0]),
            alpha=0.55,
            body=self.drift,
        )
        return True

    def _ribbons(self) -> None:
        radius = CHASE_RADIUS if self.chase else RIBBON_RADIUS
        self._texture()
        entries = [("truth", self.time, self.path, radius, None)]
        for i, (name, time, path) in enumerate(self.others):
            colour = palette.OTHER_TRACKS[i % len(palette.OTHER_TRACKS)]
            entries.append((name, time, path, radius * OTHER_SHARE, colour))
        for index, (name, time, path, thickness, colour) in enumerate(entries):
            nodes = self.layout.display(path)
            keep = simplify(nodes, 0.3 * thickness)
            ribbon = Ribbon(time=time[keep], nodes=nodes[keep], radius=thickness, span=self.span)
            self.line_parts.append((name, ribbon, colour))
            material = "track" if colour is None else "lit"
            rgb = np.ones(3) if colour is None else colour
            for i in range(len(ribbon.starts())):
                self._add(f"line_{index}_{i}", ribbon.chunk(i), rgb, material=material)
            head = ribbon.head(float(time[-1]), nodes[-1])
            self._add(f"head_{index}", head, rgb, material=material)
            self.finished[f"head_{index}"] = head
            if colour is None and not self.chase:
                thin = dataclasses.replace(ribbon, radius=FUTURE_SHARE * thickness)
                parts = [
                    dataclasses.replace(thin.chunk(i), coordinates=None)
                    for i in range(len(thin.starts()))
                ]
                self._add("future", shapes.merge(parts), palette.FUTURE, alpha=0.55)

    def _texture(self) -> None:
        """The colours along the true track as a one-row texture, and its material."""
        grid = np.linspace(*self.span, TEXELS)
        colours = palette.track_colours(
            np.interp(grid, self.time, self.values), self.scale.low, self.scale.high
        )
        pixels = np.repeat((255 * colours).astype(np.uint8)[None], 2, axis=0)
        texture = self.spec.add_texture(
            name="track", type=mujoco.mjtTexture.mjTEXTURE_2D, width=TEXELS, height=2, nchannel=3
        )
        texture.data = pixels.tobytes()
        material = self.spec.add_material(name="track", emission=0.55, specular=0.15, shininess=0.3)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "track"

    def _finish(self, model: mujoco.MjModel) -> None:
        """Give reshaped meshes the body's frame: MuJoCo moved them to their own centre."""
        for name in self.finished:
            geom = model.geom(name).id
            model.geom_pos[geom] = 0.0
            model.geom_quat[geom] = [1.0, 0.0, 0.0, 0.0]

    def _line(self, model: mujoco.MjModel, index: int) -> Line:
        name, ribbon, colour = self.line_parts[index]
        count = len(ribbon.starts())
        return Line(
            name=name,
            ribbon=ribbon,
            colour=colour,
            chunks=[model.geom(f"line_{index}_{i}").id for i in range(count)],
            head=model.geom(f"head_{index}").id,
            head_mesh=model.mesh(f"head_{index}").id,
        )


def _copy_settings(source: mujoco.MjSpec, target: mujoco.MjSpec) -> None:
    """Make the file's physics and visual settings those of the stage, which alone count here.

    MuJoCo warns about each difference when it attaches one model to another.
    """
    parts = [(source.option, target.option)]
    for name in ("global_", "quality", "headlight", "map", "scale", "rgba"):
        parts.append((getattr(source.visual, name), getattr(target.visual, name)))
    for ours, theirs in parts:
        for name in dir(ours):
            if not name.startswith("_"):
                setattr(theirs, name, getattr(ours, name))


def backdrop_colour(elevation: float, depth: float, *, daylight: bool) -> Array:
    """Colour of the backdrop at an elevation [rad]; under water, `depth` [m], or dark. Shape (3,)."""
    rise = math.sin(elevation)
    # The sun lights what faces up, which is the backdrop's lower half; it must not look lit.
    dim = 1.0 / (1.0 + SUN * max(-rise, 0.0))
    if not daylight:
        blend = 0.5 + 0.5 * math.tanh(2.2 * rise)
        return dim * (
            palette.BACKDROP_BOTTOM + blend * (palette.BACKDROP_TOP - palette.BACKDROP_BOTTOM)
        )
    # Looking up is looking at shallower, brighter water; looking down the reverse.
    seen = depth - 70.0 * rise
    return dim * palette.ambient_colour(seen) * (1.0 + 0.25 * max(rise, 0.0))


def merge_grains(centres: Array, sizes: Array) -> Shape:
    """Octahedra at `centres` (n, 3) with radii `sizes` (n,)."""
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = np.array(
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    )
    vertices = (centres[:, None] + sizes[:, None, None] * corners).reshape(-1, 3)
    index = (faces[None] + 6 * np.arange(len(centres))[:, None, None]).reshape(-1, 3)
    return Shape(vertices=vertices, faces=index, normals=np.tile(corners, (len(centres), 1)))


def _inward(wall: tuple[Array, Array], centre: Array) -> bool:
    """True when a strip from wall[0] to wall[1] faces `centre`."""
    strip = _wall_strip(*wall, 0.0, -1.0)
    return bool(strip.normals[0] @ (centre - wall[0]) > 0)


def _wall_strip(a: Array, b: Array, top: float, low: float, lift: float = 0.0) -> Shape:
    """A strip of the wall from corner `a` to `b` between two heights, moved in by `lift`."""
    corners = np.array([[a[0], a[1], low], [b[0], b[1], low], [b[0], b[1], top], [a[0], a[1], top]])
    strip = shapes.quad(corners)
    return dataclasses.replace(strip, vertices=strip.vertices + lift * strip.normals)


def _flat_strip(ends: Array, width: float, height: float) -> Shape:
    """A level strip between two points (2, 3), seen from above, at a height."""
    along = ends[1, :2] - ends[0, :2]
    across = width / 2 * np.array([-along[1], along[0]]) / np.linalg.norm(along)
    corners = [
        ends[0, :2] - across,
        ends[1, :2] - across,
        ends[1, :2] + across,
        ends[0, :2] + across,
    ]
    return shapes.quad(np.column_stack([corners, np.full(4, height)]))


def _terrain(cells: int, *, seed: int, rough: float = 0.55) -> Array:
    """Smooth random heights between -1 and 1, the same for the same seed. Shape (cells, cells).

    Decoration, not bathymetry: sums of waves of halving length.
    """
    rng = np.random.default_rng(seed)
    u = np.linspace(0.0, 1.0, cells)
    heights = np.zeros((cells, cells))
    for octave in range(4):
        for _ in range(4):
            angle, phase = rng.uniform(0, 2 * np.pi, 2)
            waves = 2 * np.pi * 1.3 * 2**octave
            across = np.cos(angle) * u[:, None] + np.sin(angle) * u[None, :]
            heights += rough**octave * np.sin(waves * across + phase)
    return heights / np.abs(heights).max()
