"""Scene: everything that the page's script needs to know of a mission, as JSON takes it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.geodesy import convergence, meridian_radius, normal_radius
from twin.records.coordinates import (
    NOMINAL,
    START_LATITUDE,
    START_LONGITUDE,
    START_TIME,
    unix_seconds,
)
from twin.records.logged import AVERAGED, LoggedTrajectory, source_of
from twin.records.trajectory import Trajectory
from twin.show.render import canvas, sea
from twin.show.render.film import known_samples
from twin.show.render.playback import POSITION, Scale, poses, spins, track_values, turns
from twin.show.render.ribbon import STILL, free_place, mast_depths, profile
from twin.show.render.scene_geometry import SceneLayout
from twin.show.render.shot import Shot, Subject
from twin.show.render.stage import Path, lay_out, shown_paths
from twin.show.web.channels import (
    COLOURS,
    STEPS,
    Channels,
    current_profile,
    read_channels,
    thin,
)
from twin.show.web.solid import Body, Packed, pack, read_solid

Array = NDArray[np.float64]

STOPS = 48
"""Colours of the scale that the page blends between"""
PLACE_STEP, NORMAL_STEP, DEPTH_STEP = 1e-4, 0.01, 0.1
"""Rounding of the vehicle's corners [m], of normals [1] and of the floor's depths [m]"""
CURRENT = ("current_north", "current_east")
ARROW_SHARE = 0.13
"""Length of the strongest current's arrow over the block's, as in scene.js"""
TRACK_ROWS = 12_000
"""Of all dead-reckoned tracks together"""


def describe(subject: Subject, shot: Shot, rows: int, at: float | None = None) -> dict[str, Any]:
    """The mission of a page.

    Args:
      shot: camera, part, colour, exaggeration and depth of the picture's lower end; the speed-up is
        what the page begins with.
      rows: samples kept at most; see `channels.thin`.
      at: [s] mission time that is shown first.

    Raises:
      InputError: the shot or the time does not fit the mission, or it has no positions.
    """
    trajectory, time = subject.trajectory, subject.trajectory.time
    shown, paths = shown_paths(subject, shot)
    camera = "side" if shot.camera == "side" else "orbit"  # the chase needs no block of its own
    layout = lay_out(paths, subject, shot, camera)
    values, scale = track_values(trajectory, shot.colour, shown, subject.tracks)
    channels = read_channels(trajectory, shown, scale_share(values, scale), subject.floor, rows)
    current = _profile(trajectory, shown, layout, paths[0].points)
    few = poses(trajectory, time[channels.kept[:1]])
    return {
        "title": subject.title,
        "facts": _facts(trajectory),
        "notes": _notes(trajectory, channels, subject),
        "unix": _unix(trajectory),
        "place": _place(trajectory),
        "opening": {
            "camera": shot.camera,
            "time": _opening(shot, trajectory, at),
            "speed": shot.speed_up,
        },
        "channels": pack_channels(channels, still=current is None),
        "unknown": sorted(few.unknown),
        "parts": [{"name": name, "kind": _kind(name)} for name in few.joints],
        "scale": _scale(scale, gaps=bool(np.isnan(channels.values["colour"]).any())),
        "vehicle": {
            "length": subject.vehicle.hull_length,
            "bodies": [_body(body) for body in read_solid(subject.vehicle, subject.faults)],
        },
        "block": {
            "azimuth": layout.azimuth,
            "low": layout.low.tolist(),
            "high": layout.high.tolist(),
            "stretch": layout.exaggeration,
        },
        "floor": _floor(subject.floor, layout),
        "profile": current,
        "tracks": _tracks(paths[1:]),
        "palette": _palette(),
    }


def pack_channels(channels: Channels, *, still: bool) -> dict[str, Packed]:
    """As the page takes them; in still water without the current."""
    return {
        name: pack(row, channels.steps[name])
        for name, row in channels.values.items()
        if not (still and name in CURRENT)
    }


def _opening(shot: Shot, trajectory: Trajectory, at: float | None) -> float:
    """`at`, or the first moment at which the place is known."""
    if at is not None:
        return float(shot.still_time(trajectory.time, at)[0])
    first, last = shot.part(trajectory.time)
    inside = (trajectory.time >= first) & (trajectory.time <= last)
    known = trajectory.time[inside & known_samples(trajectory)]
    return float(known[0]) if known.size else first


def _facts(trajectory: Trajectory) -> list[str]:
    """Whose track and speed it is, of a log."""
    words = {
        "track": source_of(trajectory, "true_north", ""),
        "speed": source_of(trajectory, "true_surge", ""),
        "current": source_of(trajectory, "true_current_north", ""),
    }
    return [f"{name}: {source}" for name, source in words.items() if source]


def _notes(trajectory: Trajectory, channels: Channels, subject: Subject) -> list[str]:
    """What a reader of the page must know about its figures."""
    notes = []
    kept, samples = len(channels.kept), channels.samples
    if kept < samples:
        notes.append(
            f"{kept} of {samples} samples are in this page, every turn of a dive among them. "
            f"Straight lines between them differ from the others by {channels.lost['depth']:.1f} m "
            f"of depth and {channels.lost['position']:.1f} m of position at most."
        )
    else:
        notes.append(f"All {samples} samples are in this page, with straight lines between them.")
    notes.append(
        f"Rounded to {STEPS['depth']:g} m, {STEPS['pitch']:g} degree and "
        f"{1000 * STEPS['speed']:g} mm/s."
    )
    if isinstance(trajectory, LoggedTrajectory) and trajectory.unflown:
        notes.append(f"Without a flight model, by the log's own track: {trajectory.unflown}.")
    if subject.floor is None:
        notes.append("The mission has no sea floor: the block ends below its deepest point.")
    return notes


def _unix(trajectory: Trajectory) -> float | None:
    """Unix time [s] of mission time 0; None where the date is unknown or only nominal."""
    if "date" in str(trajectory.provenance.get(NOMINAL, "")):
        return None
    seconds = unix_seconds(trajectory.provenance.get(START_TIME))
    return float(seconds) if np.isfinite(seconds) else None


def _place(trajectory: Trajectory) -> dict[str, Any] | None:
    """What the page makes latitudes and longitudes of, as `geographic_position` has them; None
    where the place is unknown or only nominal.
    """
    said = trajectory.provenance
    if START_LATITUDE not in said or "place" in str(said.get(NOMINAL, "")):
        return None
    latitude = float(said[START_LATITUDE])
    logged = isinstance(trajectory, LoggedTrajectory)
    return {
        "latitude": latitude,
        "longitude": float(said[START_LONGITUDE]),
        "meridian": meridian_radius(latitude),
        "normal": normal_radius(latitude),
        "convergence": None if logged else convergence(latitude),
    }


def _kind(part: str) -> str:
    return "spins" if spins(part) else "turns" if turns(part) else "slides"


def scale_share(values: Array, scale: Scale) -> Array:
    """Where values lie on a colour scale, 0 to 1; NaN stays."""
    return np.clip((values - scale.low) / (scale.high - scale.low), 0.0, 1.0)


def _scale(scale: Scale, *, gaps: bool) -> dict[str, Any]:
    """The colour scale; `gaps`: some of the track has no colour of it."""
    colours = canvas.track_colours(np.linspace(0.0, 1.0, STOPS), 0.0, 1.0)
    return {
        "label": scale.label,
        "ends": scale.ends,
        "gaps": gaps,
        "steps": COLOURS,
        "colours": np.round(colours, 4).tolist(),
    }


def _body(body: Body) -> dict[str, Any]:
    tints, which = np.unique(np.round(body.colours, 4), axis=0, return_inverse=True)
    return {
        "parent": body.parent,
        "position": body.position.tolist(),
        "quaternion": body.quaternion.tolist(),
        "moves": body.moves,
        "until": body.until if np.isfinite(body.until) else None,
        "corners": pack(body.corners, PLACE_STEP),
        "normals": pack(body.normals, NORMAL_STEP),
        "tints": tints.tolist(),
        "tint": pack(which.ravel().astype(float), 1.0),
    }


def _floor(table: Array | None, layout: SceneLayout) -> dict[str, Any] | None:
    """Depths over the block, where the floor is in sight."""
    if table is None:
        return None
    found = sea.floor_grid(table, layout)
    if found.min() >= layout.high[2]:
        return None
    return {"count": len(found), "depths": pack(found, DEPTH_STEP)}


def _profile(
    trajectory: Trajectory, shown: NDArray[np.bool_], layout: SceneLayout, path: Array
) -> dict[str, Any] | None:
    """The mean current against depth and the strongest of all samples; None in still water or where
    nobody knows it.
    """
    depth, velocity = current_profile(trajectory, shown)
    found = profile(depth, velocity)
    strongest = float(np.hypot(*velocity.T).max())
    if strongest < STILL:
        return None
    name = source_of(trajectory, "true_current_north", "current")
    return {
        "name": name,
        "averaged": name == AVERAGED,
        "mast": [] if name == AVERAGED else mast_depths(found),
        "foot": free_place(layout, path, ARROW_SHARE).tolist(),
        "strongest": strongest,
        "depth": found.depth.tolist(),
        "north": found.velocity[:, 0].tolist(),
        "east": found.velocity[:, 1].tolist(),
    }


def _tracks(paths: Sequence[Path]) -> list[dict[str, Any]]:
    most = TRACK_ROWS // max(len(paths), 1)
    found = []
    for path in paths:
        assert path.colour is not None
        kept = thin(path.points[:, 2], most)
        rows = {"time": path.time, **dict(zip(POSITION, path.points.T, strict=True))}
        packed = {name: pack(row[kept], STEPS[name]) for name, row in rows.items()}
        found.append({"name": path.name, "colour": path.colour.tolist(), **packed})
    return found


def _palette() -> dict[str, Any]:
    colours = {
        "water": canvas.WATER,
        "surface": canvas.SURFACE_LIGHT,
        "deep": canvas.DEEP_LIGHT,
        "top": canvas.BACKDROP_TOP,
        "bottom": canvas.BACKDROP_BOTTOM,
        "horizon": canvas.HORIZON,
        "zenith": canvas.ZENITH,
        "sand": canvas.SAND,
        "future": canvas.FUTURE,
        "current": canvas.CURRENT,
    }
    lengths = {"fade": canvas.LIGHT_DEPTH, "reach": sea.REACH}
    return {name: colour.tolist() for name, colour in colours.items()} | lengths
