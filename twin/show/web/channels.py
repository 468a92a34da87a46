"""Channels: time series of a mission for the page, and the choice of the samples that are kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.records.trajectory import Trajectory
from twin.show.render.playback import Poses, poses, signal, spins, told, turns
from twin.water.floor.lookup import floor_depths

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STEPS = {
    "time": 1e-3, "north": 0.01, "east": 0.01, "depth": 0.01,
    "roll": 0.01, "pitch": 0.01, "heading": 0.01,
    "surge": 1e-4, "speed": 1e-4, "ground_speed": 1e-4, "net_mass": 1e-4, "pumped": 0.1,
    "current_north": 1e-4, "current_east": 1e-4, "bottom": 0.05, "colour": 1.0, "gap": 1.0,
}  # fmt: skip
"""Rounding step of each channel: s, m, degree, m/s, kg, cm3; colour in 250ths of its scale"""
SLIDE_STEP, TURN_STEP, SPIN_STEP = 1e-5, 1e-4, 1e-3  # [m], [rad], [rad/s] steps of moving parts
COLOURS = 250  # steps of the colour scale


class Channels(NamedTuple):
    """Time series for the page, and the result of their thinning."""

    values: dict[str, Array]
    """Values by channel, shape (n,): the known channels of STEPS, and the moving parts; units of
    `Poses`, headings in [0, 360)"""
    steps: dict[str, float]  # rounding step of each channel
    kept: Integers  # index of each row among the samples of the mission, shape (n,)
    samples: int  # number of samples of the mission in the shown interval
    lost: dict[str, float]
    """[m] Largest error of linear interpolation between the kept samples, for depth and position;
    0 if all samples are kept"""


def read_channels(
    trajectory: Trajectory,
    shown: NDArray[np.bool_],
    colour: Array,
    floor: Array | None,
    most: int,
) -> Channels:
    """Read the channels of an interval of a mission, in at most `most` rows.

    Args:
      shown: mask of the samples of the interval, (time,).
      colour: colours of those samples, 0 to 1, NaN unknown, (shown,).
      floor: table of the sea floor.

    Raises:
      InputError: the mission has no position signals.
    """
    inside = np.flatnonzero(shown)
    position = np.stack([signal(trajectory, n)[inside] for n in ("north", "east", "depth")], -1)
    time = trajectory.time[inside]
    chosen = thin(position[:, 2], most)
    kept = inside[chosen]
    found = poses(trajectory, trajectory.time[kept])
    values = {
        "time": time[chosen],
        **dict(zip(("north", "east", "depth"), found.position.T, strict=True)),
        **_motion(trajectory, found, kept),
        "colour": np.rint(colour[chosen] * COLOURS),
    }
    if found.bridged is not None and found.bridged.any():
        values["gap"] = found.bridged.astype(float)
    if floor is not None:
        values["bottom"] = np.asarray(floor_depths(floor, *found.position[:, :2].T.copy()))
    parts = dict(zip(found.joints, found.parts.T, strict=True))
    steps = {name: STEPS[name] for name in values} | {
        name: SPIN_STEP if spins(name) else TURN_STEP if turns(name) else SLIDE_STEP
        for name in parts
    }
    return Channels(values | parts, steps, kept, len(inside), _lost(time, position, chosen))


def _motion(trajectory: Trajectory, found: Poses, kept: Integers) -> dict[str, Array]:
    """Channels of attitude, velocities, buoyancy and current, without unknown channels.

    The page's script needs an attitude. If the mission has none, `found` has one along the track,
    and the page lists it as `unknown`.
    """
    ground = np.hypot(*(told(trajectory, f"velocity_{n}")[kept] for n in ("north", "east")))
    measured = {
        "surge": told(trajectory, "surge")[kept],
        "speed": found.speed,
        "ground_speed": ground,
        "net_mass": found.net_mass,
        "current_north": found.current[:, 0],
        "current_east": found.current[:, 1],
    }
    if "net_mass" in found.unknown and found.pumped is not None:
        measured["pumped"] = found.pumped
    attitude = {"roll": found.roll, "pitch": found.pitch, "heading": found.heading % 360.0}
    return attitude | {name: row for name, row in measured.items() if np.isfinite(row).any()}


def thin(depth: Array, most: int) -> Integers:
    """Choose at most `most` samples and return their indices, (n,); all if they fit.

    Otherwise the mission is cut into intervals with equal numbers of samples. The shallowest and
    the deepest sample of each are kept, so that turns stay, and the first and the last of all.
    """
    count = len(depth)
    if count <= most:
        return np.arange(count)
    parts = max((most - 2) // 2, 1)
    edges = np.linspace(0, count, parts + 1).astype(int)
    long = int(np.diff(edges).max())
    rows = np.minimum(edges[:-1, None] + np.arange(long), edges[1:, None] - 1)
    cut = depth[rows]
    picks = [rows[np.arange(parts), f(cut, axis=1)] for f in (np.argmin, np.argmax)]
    return np.unique(np.concatenate([[0], *picks, [count - 1]]))


def _lost(time: Array, position: Array, chosen: Integers) -> dict[str, float]:
    """[m] Largest distances of the samples from linear interpolation between chosen samples."""
    if len(chosen) == len(time):
        return {"depth": 0.0, "position": 0.0}
    north, east, depth = (np.interp(time, time[chosen], p[chosen]) - p for p in position.T)
    largest = (float(np.nanmax(away)) for away in (np.abs(depth), np.hypot(north, east)))
    return dict(zip(("depth", "position"), largest, strict=True))
