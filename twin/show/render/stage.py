"""Stage: the compiled scene of a shot, with the glider, the sea, tracks and arrows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.frames import flip_vector
from twin.records.logged import source_of
from twin.records.tracks import NamedTrack
from twin.show.render import canvas, sea, shapes
from twin.show.render import ribbon as arrows
from twin.show.render.camera import Array, SceneLayout, plan
from twin.show.render.playback import POSITION, Poses, Scale, optional, signal, track_values
from twin.show.render.ribbon import TEXELS, ArrowProfile, Ribbon, simplify
from twin.show.render.shapes import BACKDROP_GROUP, CLOSE_UP_GROUP, VEHICLE, Props
from twin.show.render.subject import Shot, Subject
from twin.vehicle.vehicle import Vehicle

RADIUS, CHASE_RADIUS = 0.055, 0.020  # [display units] radius of the true track; the hull has 0.11
OTHER_SHARE, FUTURE_SHARE = 0.6, 0.28
"""Radius over the true track's. OTHER_SHARE: of other tracks. FUTURE_SHARE: of the track to come"""
SNOW_FASTEST = 12.0  # largest speed-up with particles, which would only flicker beyond


class Path(NamedTuple):
    """A track within the shown interval."""

    name: str
    time: Array  # [s], shape (n,)
    points: Array  # north, east, depth [m], shape (n, 3)
    colour: Array | None  # RGB; None for the true track, which a signal colours


class TurnedBody(NamedTuple):
    """A body that turns with the part of its name."""

    body: int
    rest: Array  # quaternion of the body on the hull in the vehicle file, shape (4,)
    axis: Array  # unit vector, MuJoCo's hull axes, through the body's origin, shape (3,)


class Line(NamedTuple):
    """A track on the stage: its ribbon and the geoms that show it."""

    name: str
    colour: Array | None  # RGB; None for the true track
    ribbon: Ribbon
    chunks: list[int]  # geom ids, one per chunk
    head: int  # geom id of the end, whose mesh is given new vertices for each frame


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stage:
    """Compiled scene, and the ids and tables that move it."""

    model: mujoco.MjModel
    layout: SceneLayout
    chase: bool
    lines: list[Line]  # the true track first
    scale: Scale
    current: ArrowProfile
    bands: list[int]  # geom ids of the backdrop round the glider, from below to above
    bands_follow: bool  # their colour follows the glider's depth
    snow: bool  # True if the scene has particles
    current_name: str  # name of `current` in the legend
    floor: Array | None  # table of the mission's sea floor; None: the drawn floor is decoration
    ground: list[int]  # geom ids of the floor that follows the glider, chase camera
    arrows: list[int]
    """Geom ids of the current's arrows beside the glider, chase camera; reshaped in each frame"""
    hull_length: float  # [m]
    turned: dict[str, TurnedBody]
    """Visible fins and propellers, by the names of their parts"""
    gone: list[tuple[float, list[int]]]  # mission time [s] of each loss, and the lost geoms' ids

    def ladder(self, poses: Poses, index: int) -> list[tuple[float, Array, Array]]:
        """Arrows beside the glider at one frame; see `arrows.ladder`."""
        depth, heading = float(poses.position[index, 2]), float(poses.heading[index])
        floor = float(self.layout.high[2])
        return arrows.ladder(self.current, depth, math.radians(heading), floor)


def build(subject: Subject, shot: Shot) -> Stage:
    """Build and compile the scene of a shot.

    Raises:
      InputError: the shot's interval or colour does not fit the trajectory.
    """
    trajectory, vehicle, floor = subject.trajectory, subject.vehicle, subject.floor
    first, last = shot.part(trajectory.time)
    shown, paths = shown_paths(subject, shot)
    true = paths[0]
    layout = lay_out(paths, subject, shot, shot.camera)
    velocity = [optional(trajectory, f"current_{n}", 0.0)[shown] for n in ("north", "east")]
    current = arrows.profile(true.points[:, 2], np.stack(velocity, axis=-1))
    values, scale = track_values(trajectory, shot.colour, shown, subject.tracks)

    props = Props(vehicle.xml, shot.width, shot.height)
    chase = shot.camera == "chase"
    radius = sea.OPEN_RADIUS if chase else sea.backdrop_radius(layout)
    count = sea.OPEN_BANDS if chase else sea.BANDS
    bands = sea.add_backdrop(props, "backdrop", BACKDROP_GROUP, radius, light=chase, bands=count)
    ground: list[str] = []
    ladder: list[str] = []
    if chase:
        ground = sea.add_open_water(props, layout, floor)
        ladder = arrows.add_ladder(props)
    else:
        if shot.inset:
            bands = sea.add_backdrop(props, "close_up", CLOSE_UP_GROUP, radius, light=True)
        if shot.camera == "map":
            sea.add_chart(props, layout, floor)
        else:
            sea.add_block(props, layout, floor, true.points, cut=shot.camera == "side")
        arrows.add_mast(props, layout, current, true.points)
    snow = chase and (shot.speed_up or last - first) <= SNOW_FASTEST
    if snow:
        sea.add_snow(props)
    ribbons = _add_paths(props, paths, layout, (first, last), values, scale, chase=chase)

    model = props.spec.compile()
    chunks = [named_geoms(model, [f"line_{i}_"]) for i in range(len(paths))]
    return Stage(
        model=model,
        layout=layout,
        chase=chase,
        lines=[
            Line(path.name, path.colour, ribbon, chunks[i], _reshaped(model, f"head_{i}"))
            for i, (path, ribbon) in enumerate(zip(paths, ribbons, strict=True))
        ],
        scale=scale,
        current=current,
        current_name=source_of(trajectory, "true_current_north", "current"),
        bands=[model.geom(name).id for name in bands],
        bands_follow=chase or shot.inset,
        snow=snow,
        floor=floor,
        ground=[model.geom(name).id for name in ground],
        arrows=[_reshaped(model, name) for name in ladder],
        hull_length=vehicle.hull_length,
        turned=turned_bodies(model, vehicle),
        gone=[
            (fault.start, named_geoms(model, fault.gone, VEHICLE))
            for fault in subject.faults
            if fault.gone
        ],
    )


def named_geoms(model: mujoco.MjModel, beginnings: Sequence[str], prefix: str = "") -> list[int]:
    """Ids of the geoms whose names begin with `prefix` and one of `beginnings`."""
    starts = tuple(f"{prefix}{one}" for one in beginnings)
    return [k for k in range(model.ngeom) if (model.geom(k).name or "").startswith(starts)]


def shown_paths(subject: Subject, shot: Shot) -> tuple[NDArray[np.bool_], list[Path]]:
    """Mask of the samples that a shot shows, and the tracks in its interval, the true track first.

    Raises:
      InputError: the interval does not fit the trajectory or a track.
    """
    trajectory = subject.trajectory
    first, last = shot.part(trajectory.time)
    shown = (trajectory.time >= first) & (trajectory.time <= last)
    if shown.sum() < 2:
        raise InputError(f"part {first:g} to {last:g} s holds fewer than 2 samples")
    points = np.stack([signal(trajectory, name)[shown] for name in POSITION], axis=-1)
    true = Path("truth", trajectory.time[shown], points, None)
    return shown, [true, *(_beside(track, i, true) for i, track in enumerate(subject.tracks))]


def lay_out(paths: list[Path], subject: Subject, shot: Shot, camera: str) -> SceneLayout:
    """Layout of the block of water around the paths, down to the shot's or the mission's floor."""

    def down_to(bottom: float | None) -> SceneLayout:
        return plan(
            [path.points for path in paths],
            hull_length=subject.vehicle.hull_length,
            floor=bottom,
            exaggeration=shot.exaggeration,
            camera=camera,
            frame=canvas.frame_of(shot),
        )

    layout = down_to(shot.floor)
    if subject.floor is not None and shot.floor is None:
        layout = down_to(sea.block_depth(subject.floor, layout))
    return layout


def turned_bodies(
    model: mujoco.MjModel, vehicle: Vehicle, prefix: str = VEHICLE
) -> dict[str, TurnedBody]:
    """Bodies that show the turning of the vehicle's parts; a part without a body is invisible.

    `prefix` precedes the vehicle file's names in the model.
    """
    found = {}
    for part in vehicle.parts:
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{prefix}{part.name}")
        if body >= 0 and part.drawn_axis is not None:
            axis = flip_vector(np.array(part.drawn_axis))
            found[part.name] = TurnedBody(body, model.body_quat[body].copy(), axis)
    return found


def _beside(track: NamedTrack, index: int, true: Path) -> Path:
    """Path of a dead-reckoned track in the interval, at the true depth, coloured by its `index`.

    Raises:
      InputError: the track has fewer than 2 samples there.
    """
    inside = (track.time >= true.time[0]) & (track.time <= true.time[-1])
    if inside.sum() < 2:
        raise InputError(f"track {track.name!r} has fewer than 2 samples in the shown part")
    time = track.time[inside]
    depth = np.interp(time, true.time, true.points[:, 2])
    points = np.column_stack([track.north[inside], track.east[inside], depth])
    return Path(track.title, time, points, canvas.OTHER_TRACKS[index % len(canvas.OTHER_TRACKS)])


def _add_paths(
    props: Props,
    paths: list[Path],
    layout: SceneLayout,
    span: tuple[float, float],
    values: Array,
    scale: Scale,
    *,
    chase: bool,
) -> list[Ribbon]:
    """Add the ribbons of all paths and return them; `values` at its samples colour the first."""
    grid = np.linspace(*span, TEXELS)
    colours = canvas.track_colours(np.interp(grid, paths[0].time, values), scale.low, scale.high)
    props.add_row_texture("track", colours, emission=0.55)
    thickness = CHASE_RADIUS if chase else RADIUS
    ribbons = []
    for index, path in enumerate(paths):
        radius = thickness if path.colour is None else OTHER_SHARE * thickness
        nodes = layout.display(path.points)
        keep = simplify(nodes, 0.3 * radius)
        ribbon = Ribbon(time=path.time[keep], nodes=nodes[keep], radius=radius, span=span)
        ribbons.append(ribbon)
        colour, material = (np.ones(3), "track") if path.colour is None else (path.colour, "glow")
        for i, chunk in enumerate(ribbon.chunks()):
            props.add(f"line_{index}_{i}", chunk, colour, material=material)
        head = ribbon.head(float(ribbon.time[-1]), ribbon.nodes[-1])
        props.add(f"head_{index}", head, colour, material=material)
    if not chase:
        thin = dataclasses.replace(ribbons[0], radius=FUTURE_SHARE * thickness)
        props.add("future", shapes.merge(thin.chunks()), canvas.FUTURE, alpha=0.55)
    return ribbons


def _reshaped(model: mujoco.MjModel, name: str) -> int:
    """Id of a geom, which is put into its body's frame: MuJoCo had centred it on its mesh."""
    geom = int(model.geom(name).id)
    model.geom_pos[geom] = 0.0
    model.geom_quat[geom] = [1.0, 0.0, 0.0, 0.0]
    model.geom_sameframe[geom] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE  # the geom may move
    return geom
