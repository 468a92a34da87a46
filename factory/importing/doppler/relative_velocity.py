"""Relative velocity: the motion of a hull past the water and past the bottom, ensemble by ensemble.

Axes are forward, starboard, down of the Doppler log, whose mount may tilt against the hull. The log
measures how water and bottom move past it; the hull's velocity is the opposite. Signs of beams
are those of "ADCP coordinate transformation" (Teledyne RDI): beam 1 to beam 2 is X, beam 4 to
beam 3 is Y, and Z points to the transducer.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.doppler.pd0 import Array, Ensembles
from twin.frames import euler_to_matrix

Mask = NDArray[np.bool_]

FLATTEST = 0.2
"""Smallest vertical part of a beam's direction; flatter beams reach no other depth."""
NEAR, MOST_CELLS = 6.0, 10
"""NEAR: [m] range of cells that show the hull's own water. MOST_CELLS: maximum number of these."""
BEAM, INSTRUMENT, SHIP, EARTH = range(4)
"""Axes of a file's velocities, by bits of the transform."""
LEVEL, CONVEX, UPWARD = 4, 8, 128
"""LEVEL: bit of `transform`: tilts are used. CONVEX, UPWARD: bits of `system`: a convex transducer,
beams that look up."""
CARRIED = ("time", "depth", "heading", "pitch", "roll", "sound_speed", "beam_angle")
"""Quantities that are taken from the file unchanged."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RelativeVelocity:
    """Velocities of the hull in the Doppler log's axes, and their quality, in time order.

    `time` [s, unix], `depth` [m], `heading`, `pitch`, `roll`, `beam_angle` [degree] and
    `sound_speed` [m/s] are those of the file, (ensembles,).
    """

    time: Array
    depth: Array
    heading: Array
    pitch: Array
    roll: Array
    sound_speed: Array
    beam_angle: Array
    water: Array
    """[m/s] Past the water, (ensembles, cells, 3); NaN where a component is missing."""
    error: Array
    """[m/s] Difference of what two pairs of beams say, (ensembles, cells)."""
    good: Array
    """[%] Pings that gave a velocity, (ensembles, cells)."""
    correlation: Array
    """[count] Of the worst beam, (ensembles, cells)."""
    echo: Array
    """[count] Of the worst beam above the lowest echo of the file, (ensembles, cells)."""
    cells: Array
    """All cells, (ensembles, cells, 8): `water`, `error`, `good`, `correlation`, `echo`, and range
    [m] along the axis, positive down. Beams of a file in beam axes meet at the cell's depth."""
    bottom: Array
    """[m/s] Past the bottom, (ensembles, 3)."""
    altitude: Array
    """[m] Height above the bottom, (ensembles,)."""
    turned: Mask
    """True where velocities were turned back from level axes to the hull's, (ensembles,)."""

    def __len__(self) -> int:
        return len(self.time)


def relative_velocity(
    layouts: Sequence[Ensembles], *, level: bool | None = None
) -> RelativeVelocity:
    """Turn the velocities of a file into the Doppler log's axes.

    Args:
      level: whether ship axes are level; None takes what the file says.
    """
    echoes = np.concatenate([one["echo"].ravel() for one in layouts])
    floor = np.nanpercentile(echoes, 1.0) if np.isfinite(echoes).any() else 0.0
    most = max(one["velocity"].shape[1] for one in layouts)
    parts = [_of_layout(one, float(floor), level, most) for one in layouts]
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(whole["time"], kind="stable")
    order = order[np.isfinite(whole["time"][order])]
    return RelativeVelocity(**{name: values[order] for name, values in whole.items()})


def axes_of(one: Ensembles) -> NDArray[np.int64]:
    """Axes of the velocities of each ensemble."""
    return one["transform"].astype(np.int64) >> 3 & 3


def _bit(values: Array, bit: int) -> Mask:
    return (values.astype(np.int64) & bit) > 0


def _of_layout(one: Ensembles, floor: float, level: bool | None, most: int) -> dict[str, Array]:
    """Fields of `RelativeVelocity` of one layout, cells padded to `MOST_CELLS` and to `most`."""
    axes = axes_of(one)
    tilts = _bit(one["transform"], LEVEL) if level is None else np.full(len(axes), level)
    turned = (tilts & (axes == SHIP)) | (axes == EARTH)
    altitude = one["bottom_range"].mean(axis=1)
    first, cell = one["first_cell"][:, None], one["cell"][:, None]
    middle = first + cell * np.arange(one["velocity"].shape[1])
    upward = _bit(one["system"], UPWARD)
    clear = np.where(upward, one["depth"], np.nan_to_num(altitude, nan=np.inf))
    clear *= np.cos(np.radians(one["beam_angle"]))  # beyond it side lobes meet bottom or surface
    clear = middle + 0.5 * cell < clear[:, None]
    beams = (axes == BEAM)[:, None]

    def fields(of: Array, seen: Mask, size: int) -> Array:
        velocity, pings, correlation, echo = of[:, :, :size]
        water = _hull_axes(one, velocity, axes, turned)
        good = np.where(beams, pings.min(axis=-1), pings[..., 0] + pings[..., 3])
        reach = np.where(upward[:, None], -middle, middle)[:, :size]
        quality = [good, correlation.min(axis=-1), echo.min(axis=-1) - floor, reach]
        found = np.full((len(axes), size, 8), np.nan)
        found[:, : water.shape[1], :4] = np.where(seen[:, :size, None], water, np.nan)
        found[:, : water.shape[1], 4:] = np.stack(quality, axis=-1)
        return found

    every = np.stack([one[n] for n in ("velocity", "good", "correlation", "echo")])
    near = fields(every, (middle <= np.maximum(NEAR, first)) & clear, MOST_CELLS)
    every = np.where(beams[..., None], _at_depths(one, every, middle), every)
    return {
        **{name: one[name] for name in CARRIED},
        **{n: near[..., 3 + k] for k, n in enumerate(("error", "good", "correlation", "echo"))},
        "water": near[..., :3],
        "cells": fields(every, clear, most),
        "bottom": _hull_axes(one, one["bottom_velocity"][:, None], axes, turned)[:, 0, :3],
        "altitude": altitude,
        "turned": turned,
    }


def _at_depths(one: Ensembles, values: Array, middle: Array) -> Array:
    """Interpolate beams to the depths of the cells' middles (Ott 2002, J. Atmos. Oceanic Technol.
    19, 1738-1741): beams of a pitched hull reach one depth at different ranges. `values` are
    (quantities, ensembles, cells, beams), `middle` [m] the cells' ranges, (ensembles, cells).
    """
    count, last = len(middle), middle.shape[1] - 1
    unit, axes = np.broadcast_to(np.eye(4), (count, 4, 4)), np.full(count, BEAM)
    # beam velocity = direction . hull velocity: the inverse of beams-to-hull has directions as rows
    beams = np.linalg.inv(np.swapaxes(_hull_axes(one, unit, axes, axes != BEAM), 1, 2))[..., :3]
    roll, pitch = np.radians(one["roll"]), np.radians(one["pitch"])
    steep = np.abs(np.einsum("tbj,tj->tb", beams, euler_to_matrix(roll, pitch, 0.0 * roll)[:, 2]))
    steep = np.where(steep > FLATTEST, steep, np.nan)[:, None]
    axis = np.cos(roll) * np.cos(pitch) * np.cos(np.radians(one["beam_angle"]))
    first, cell, axis = (each[:, None, None] for each in (one["first_cell"], one["cell"], axis))
    at = (middle[..., None] * axis / steep - first) / cell
    inside = (at > -0.5) & (at < last + 0.5)
    at = np.where(inside, np.clip(at, 0.0, last), 0.0)
    low = np.floor(at).astype(np.int64)
    ends = [np.take_along_axis(values, np.minimum(k, last)[None], 2) for k in (low, low + 1)]
    mixed = ends[0] * (1.0 + low - at) + np.where(at > low, ends[1], 0.0) * (at - low)
    return np.where(inside, mixed, np.nan)


def _hull_axes(one: Ensembles, velocity: Array, axes: NDArray[np.int64], turned: Mask) -> Array:
    """Hull's velocity forward, starboard, down, and the error velocity, (ensembles, cells, 4).

    Args:
      velocity: as the file has it, (ensembles, cells, 4).
      turned: whether velocities are in level axes.
    """
    beams = (axes == BEAM)[:, None, None]
    xyz = np.where(beams, _of_beams(one, velocity), velocity)
    # an instrument that looks up is turned about its Y axis
    flip = np.where(_bit(one["system"], UPWARD), -1.0, 1.0)[:, None]
    cosine, sine = (f(np.radians(one["alignment"]))[:, None] for f in (np.cos, np.sin))
    x, y, z = xyz[..., 0] * flip, xyz[..., 1], xyz[..., 2] * flip
    own = np.stack([x * sine - y * cosine, -y * sine - x * cosine, z], axis=-1)
    # ship: starboard, forward, up; earth: east, north, up
    outer = np.stack([-velocity[..., 1], -velocity[..., 0], velocity[..., 2]], axis=-1)
    heading = np.where(axes == EARTH, one["heading"], 0.0)
    angles = (np.where(turned, a, 0.0) for a in (one["roll"], one["pitch"], heading))
    back = np.einsum("tji,tcj->tci", euler_to_matrix(*map(np.radians, angles)), outer)
    inside = (axes <= INSTRUMENT)[:, None, None]
    return np.concatenate([np.where(inside, own, back), xyz[..., 3:]], axis=-1)


def _of_beams(one: Ensembles, velocity: Array) -> Array:
    """Velocity of the water along the instrument's X, Y, Z, and the error velocity."""
    angle = np.radians(one["beam_angle"])[:, None]
    side, along = 1.0 / (2.0 * np.sin(angle)), 1.0 / (4.0 * np.cos(angle))
    convex = np.where(_bit(one["system"], CONVEX), 1.0, -1.0)[:, None]
    b1, b2, b3, b4 = np.moveaxis(velocity, -1, 0)
    error = side / np.sqrt(2.0) * (b1 + b2 - b3 - b4)
    x, y = convex * side * (b1 - b2), convex * side * (b4 - b3)
    return np.stack([x, y, along * (b1 + b2 + b3 + b4), error], axis=-1)
