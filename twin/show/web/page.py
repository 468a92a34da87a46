"""Page: a mission as one HTML file that loads nothing else, with the data for its script."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path as File
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from twin.cli.text_table import printable
from twin.errors import InputError
from twin.geodesy import convergence, meridian_radius, normal_radius
from twin.records import coordinates
from twin.records.logged import AVERAGED, LoggedTrajectory, source_of
from twin.records.storage.whole import check_file_target, whole_file
from twin.records.trajectory import Trajectory
from twin.show.render import canvas, film, playback, ribbon, sea, stage
from twin.show.render.camera import SceneLayout
from twin.show.render.playback import POSITION, Scale, optional, signal
from twin.show.render.subject import Shot, Subject
from twin.show.web.channels import COLOURS, STEPS, Channels, read_channels, thin
from twin.show.web.solid import Body, Packed, pack, read_solid

Array = NDArray[np.float64]

ENDINGS = (".html", ".htm")
LARGEST = 5_000_000  # [byte] largest size of a page
ROWS = 80_000  # most samples of a page: a phone can still draw these
SCRIPTS = ("record", "marks", "space", "strip", "renderer", "track", "bodies", "scene", "controls",
           "page")  # fmt: skip
"""Names of the scripts, in order: each uses names of earlier scripts when it is loaded"""
STOPS = 48  # number of colours of the scale between which the page blends
PLACE_STEP, NORMAL_STEP, DEPTH_STEP = 1e-4, 0.01, 0.1
"""Rounding steps. PLACE_STEP: [m] corners. NORMAL_STEP: [1] normals. DEPTH_STEP: [m] floor"""
CURRENT = ("current_north", "current_east")
ARROW_SHARE = 0.13  # length of the strongest current's arrow over the block's, as in scene.js
TRACK_ROWS = 12_000  # most rows of all dead-reckoned tracks together


def save_page(path: File, subject: Subject, shot: Shot, at: float | None = None) -> int:
    """Write the page and return its size [byte].

    Args:
      at: [s] mission time that is shown first.

    Raises:
      InputError: the name does not end in .html, or the shot does not fit the mission.
      WriteError: another thing is at this path, or the disk refuses.
    """
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"page {path.name}: the ending must be {ENDINGS[0]}")
    check_file_target(path)
    content = page_text(subject, shot, at).encode()
    with whole_file(path) as place:
        place.write_bytes(content)
    return len(content)


def page_text(subject: Subject, shot: Shot, at: float | None = None, largest: int = LARGEST) -> str:
    """Make the HTML text, with samples thinned to at most `largest` bytes; see `channels.thin`.

    Raises:
      InputError: the shot does not fit the mission.
    """
    rows = ROWS
    while True:
        text = assemble(describe(subject, shot, rows, at))
        size = len(text.encode())
        if size <= largest or rows < 4:
            return text
        rows = int(0.95 * rows * largest / size)


def assemble(mission: Mapping[str, Any], *, connect: str = "'none'") -> str:
    """Fill the template with its style, its scripts and a mission.

    Args:
      connect: sources from which the script may fetch, as in a content security policy.
    """
    # "</script" would end the element, so that "<" is written as an escape in the JSON.
    data = json.dumps(mission, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    whole = {
        "connect": connect,
        "style": _file("page.css"),
        "script": "\n".join(_file(f"{name}.js") for name in SCRIPTS),
        "mission": data,
    }
    form, title = Markup(_file("page.html")), printable(str(mission["title"]))
    return form.format(title=title, **{name: Markup(text) for name, text in whole.items()})


def _file(name: str) -> str:
    return (files("twin.show.web") / name).read_text(encoding="utf-8").rstrip("\n")


def describe(subject: Subject, shot: Shot, rows: int, at: float | None = None) -> dict[str, Any]:
    """Describe a mission for the page's script.

    Args:
      shot: camera, part, colour, exaggeration and depth of the picture's lower end; the speed-up is
        the page's initial one.
      rows: most samples that are kept; see `channels.thin`.
      at: [s] mission time that is shown first.

    Raises:
      InputError: the shot or the time does not fit the mission, or it has no positions.
    """
    trajectory, time = subject.trajectory, subject.trajectory.time
    shown, paths = stage.shown_paths(subject, shot)
    camera = "side" if shot.camera == "side" else "orbit"  # map and chase use the orbit's block
    layout = stage.lay_out(paths, subject, shot, camera)
    values, scale = playback.track_values(trajectory, shot.colour, shown, subject.tracks)
    channels = read_channels(trajectory, shown, scale_share(values, scale), subject.floor, rows)
    current = _profile(trajectory, shown, layout, paths[0].points)
    few = playback.poses(trajectory, time[channels.kept[:1]])
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
    """Pack the channels for the page; with `still` water the current is left out."""
    return {
        name: pack(row, channels.steps[name])
        for name, row in channels.values.items()
        if not (still and name in CURRENT)
    }


def _opening(shot: Shot, trajectory: Trajectory, at: float | None) -> float:
    """[s] Mission time shown first: `at`, or the first time with a known position."""
    if at is not None:
        return float(shot.still_time(trajectory.time, at)[0])
    first, last = shot.part(trajectory.time)
    inside = (trajectory.time >= first) & (trajectory.time <= last)
    known = trajectory.time[inside & film.known_samples(trajectory)]
    return float(known[0]) if known.size else first


def _facts(trajectory: Trajectory) -> list[str]:
    """Texts that name the sources of a log's track, speed and current."""
    signals = {"track": "true_north", "speed": "true_surge", "current": "true_current_north"}
    words = {name: source_of(trajectory, signal, "") for name, signal in signals.items()}
    return [f"{name}: {source}" for name, source in words.items() if source]


def _notes(trajectory: Trajectory, channels: Channels, subject: Subject) -> list[str]:
    """Notes that a reader of the page needs about its figures."""
    kept, samples = len(channels.kept), channels.samples
    exact = f"All {samples} samples are in this page, with straight lines between them."
    if kept < samples:
        exact = (
            f"{kept} of {samples} samples are in this page, every turn of a dive among them. "
            f"Straight lines between them differ from the others by {channels.lost['depth']:.1f} m "
            f"of depth and {channels.lost['position']:.1f} m of position at most."
        )
    metres, degrees, speed = (STEPS[name] for name in ("depth", "pitch", "speed"))
    notes = [exact, f"Rounded to {metres:g} m, {degrees:g} degree and {1000 * speed:g} mm/s."]
    if isinstance(trajectory, LoggedTrajectory) and trajectory.unflown:
        notes.append(f"Without a flight model, by the log's own track: {trajectory.unflown}.")
    if subject.floor is None:
        notes.append("The mission has no sea floor: the block ends below its deepest point.")
    return notes


def _unix(trajectory: Trajectory) -> float | None:
    """Unix time [s] of mission time 0; None if the date is unknown or only nominal."""
    if "date" in str(trajectory.provenance.get(coordinates.NOMINAL, "")):
        return None
    seconds = coordinates.unix_seconds(trajectory.provenance.get(coordinates.START_TIME))
    return float(seconds) if np.isfinite(seconds) else None


def _place(trajectory: Trajectory) -> dict[str, Any] | None:
    """Constants by which the page computes latitude and longitude, to second order in distance;
    None if the place is unknown or only nominal.
    """
    said = trajectory.provenance
    if coordinates.START_LATITUDE not in said or "place" in str(said.get(coordinates.NOMINAL, "")):
        return None
    latitude = float(said[coordinates.START_LATITUDE])
    logged = isinstance(trajectory, LoggedTrajectory)
    return {
        "latitude": latitude,
        "longitude": float(said[coordinates.START_LONGITUDE]),
        "meridian": meridian_radius(latitude),
        "normal": normal_radius(latitude),
        "convergence": None if logged else convergence(latitude),
    }


def _kind(part: str) -> str:
    return "spins" if playback.spins(part) else "turns" if playback.turns(part) else "slides"


def scale_share(values: Array, scale: Scale) -> Array:
    """Position of values on a colour scale, 0 to 1; NaN stays."""
    return np.clip((values - scale.low) / (scale.high - scale.low), 0.0, 1.0)


def _scale(scale: Scale, *, gaps: bool) -> dict[str, Any]:
    """Colour scale for the page; `gaps`: parts of the track have unknown values."""
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
    """Depths of the sea floor over the block; None if the floor is below the block."""
    if table is None:
        return None
    found = sea.floor_grid(table, layout)
    if found.min() >= layout.high[2]:
        return None
    return {"count": len(found), "depths": pack(found, DEPTH_STEP)}


def _profile(
    trajectory: Trajectory, shown: NDArray[np.bool_], layout: SceneLayout, path: Array
) -> dict[str, Any] | None:
    """Mean current against depth, and the strongest speed of all samples; None in still water or
    for an unknown current.
    """
    velocity = np.stack([optional(trajectory, name, 0.0)[shown] for name in CURRENT], axis=-1)
    found = ribbon.profile(signal(trajectory, "depth")[shown], velocity)
    strongest = float(np.hypot(*velocity.T).max())
    if strongest < ribbon.STILL:
        return None
    name = source_of(trajectory, "true_current_north", "current")
    return {
        "name": name,
        "averaged": name == AVERAGED,
        "mast": [] if name == AVERAGED else ribbon.mast_depths(found),
        "foot": ribbon.free_place(layout, path, ARROW_SHARE).tolist(),
        "strongest": strongest,
        "depth": found.depth.tolist(),
        "north": found.velocity[:, 0].tolist(),
        "east": found.velocity[:, 1].tolist(),
    }


def _tracks(paths: Sequence[stage.Path]) -> list[dict[str, Any]]:
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
        "water": canvas.WATER, "surface": canvas.SURFACE_LIGHT, "deep": canvas.DEEP_LIGHT,
        "top": canvas.BACKDROP_TOP, "bottom": canvas.BACKDROP_BOTTOM,
        "horizon": canvas.HORIZON, "zenith": canvas.ZENITH,
        "sand": canvas.SAND, "future": canvas.FUTURE, "current": canvas.CURRENT,
    }  # fmt: skip
    lengths = {"fade": canvas.LIGHT_DEPTH, "reach": sea.REACH}
    return {name: colour.tolist() for name, colour in colours.items()} | lengths
