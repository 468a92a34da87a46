"""Tabulated current: a plain Python function as a table that compiled flights can read."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from twin.errors import CurrentError
from twin.water.current import checks
from twin.water.current.axes import Origin
from twin.water.current.base import TABLE, Current
from twin.water.current.grid import Grid
from twin.water.current.sampler import Floats

Velocity = Callable[[float, float, float, float], Sequence[float]]
"""Function (t [s], north [m], east [m], depth [m]) -> north, east and optionally down [m/s]."""
AXES: Mapping[str, tuple[str, tuple[float, ...]]] = {
    "time": ("s", (0.0, 977.0, 20_011.0, 150_001.0)),
    "depth": ("m", (0.0, 11.0, 137.0, 811.0)),
    "north": ("m", (0.0, -3_001.0, 207.0, 20_011.0)),
    "east": ("m", (0.0, 2_003.0, -307.0, -15_013.0)),
}
"""Unit of each axis, and test places that show whether a function varies along the axis."""
INTERVALS = 8
"""Intervals of each axis at first; random test places find narrower features."""
CHECKED = 500
"""Number of random places at which the table is compared with the function."""
MOST_NODES = 20_000
"""Maximum number of nodes of a table, because a store holds the table with each mission."""


@dataclass(frozen=True, kw_only=True)
class Tabulated(Current):
    """Velocities on a rectilinear grid, linear between nodes, held beyond the first and last."""

    kind: ClassVar[str] = TABLE

    time: tuple[float, ...] = (0.0,)
    """[s] Times since the mission's start, ascending."""
    depth: tuple[float, ...] = (0.0,)
    """[m] Depths, positive down, ascending."""
    north: tuple[float, ...] = (0.0,)
    """[m] Distances north of the mission's start, ascending."""
    east: tuple[float, ...] = (0.0,)
    """[m] Distances east of the mission's start, ascending."""
    velocity_m_s: tuple[float, ...]
    """[m/s] North, east, down at the nodes, shape (time, depth, north, east, 3), flattened."""

    def __post_init__(self) -> None:
        for name in (*AXES, "velocity_m_s"):
            values = np.asarray(getattr(self, name), dtype=np.float64).ravel()
            if not (values.size and np.isfinite(values).all()):
                raise CurrentError(f"table: {name} must hold finite numbers")
            if name in AXES and (np.diff(values) <= 0.0).any():
                raise CurrentError(f"table: {name} must ascend")
            object.__setattr__(self, name, tuple(values.tolist()))
        nodes = math.prod(self.shape)
        if len(self.velocity_m_s) != 3 * nodes:
            raise CurrentError(
                f"table: {len(self.velocity_m_s)} velocities for {nodes} nodes of three numbers"
            )

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Numbers of nodes along time, depth, north and east."""
        return len(self.time), len(self.depth), len(self.north), len(self.east)

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make one record of a flat grid."""
        axes = [np.array(getattr(self, name)) for name in AXES]
        values = np.array(self.velocity_m_s).reshape(*self.shape, 3)
        return [Grid.box_record(axes[0], axes[1], axes[2], axes[3], values)]


def tabulated(
    function: Velocity, ranges: Mapping[str, Sequence[float]], tolerance: float
) -> Tabulated:
    """Tabulate a function for `Current.from_function`, which has the arguments."""
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise CurrentError(f"from_function: tolerance must be above 0 m/s, not {tolerance}")
    nodes = {name: _first_nodes(name, ranges.get(name)) for name in AXES}
    _check_constant(function, nodes)
    known: dict[tuple[float, ...], tuple[float, ...]] = {}

    def at(axes: Mapping[str, Floats]) -> Floats:
        """Velocities of the function on a grid, shape (time, depth, north, east, 3)."""
        mesh = np.meshgrid(*(axes[name] for name in AXES), indexing="ij")
        places = list(map(tuple, np.stack([m.ravel() for m in mesh], axis=1).tolist()))
        for place in places:
            if place not in known:
                known[place] = _velocity(function, place)
        return np.array([known[p] for p in places]).reshape(*mesh[0].shape, 3)

    while True:
        values, off = at(nodes), dict.fromkeys(nodes, 0.0)
        for k, (name, axis) in enumerate(nodes.items()):
            if axis.size > 1:
                between = at({**nodes, name: 0.5 * (axis[1:] + axis[:-1])})
                linear = 0.5 * (np.delete(values, 0, k) + np.delete(values, -1, k))
                off[name] = float(np.abs(between - linear).max())
        worst = max(off, key=lambda name: off[name])
        if off[worst] <= tolerance:
            break
        axis = nodes[worst]
        nodes[worst] = np.sort(np.concatenate([axis, 0.5 * (axis[1:] + axis[:-1])]))
        if math.prod(axis.size for axis in nodes.values()) > MOST_NODES:
            raise CurrentError(
                f"from_function: a table within {tolerance:g} m/s needs more than {MOST_NODES} "
                f"nodes (it is off by {off[worst]:.2g} m/s along {worst}): give narrower ranges or "
                "a larger tolerance, or write a kind with a compiled kernel"
            )
    _check_between(function, nodes, values, tolerance)
    return Tabulated(
        **{name: tuple(axis.tolist()) for name, axis in nodes.items()},
        velocity_m_s=tuple(values.ravel().tolist()),
    )


def _first_nodes(name: str, given: Sequence[float] | None) -> Floats:
    if given is None:
        return np.zeros(1)
    low, high = (checks.finite("from_function", name, one, AXES[name][0]) for one in given)
    if not low < high:
        raise CurrentError(f"from_function: {name} must be (low, high), not ({low:g}, {high:g})")
    return np.linspace(low, high, INTERVALS + 1)


def _velocity(function: Velocity, place: tuple[float, ...]) -> tuple[float, float, float]:
    """Call the function at a time, depth, north and east, and check its result."""
    t, depth, north, east = place
    where = f"at t={t:g} s, north={north:g} m, east={east:g} m, depth={depth:g} m"
    try:
        answer = [float(one) for one in function(t, north, east, depth)]
    except Exception as error:  # a user's function may raise anything
        raise CurrentError(
            f"from_function: the function fails {where}: {type(error).__name__}: {error}; it takes "
            "t, north, east, depth and returns north, east and perhaps down [m/s]"
        ) from error
    if len(answer) not in (2, 3):
        raise CurrentError(
            f"from_function: the function gives {len(answer)} numbers {where}: return north, east "
            "and perhaps down [m/s]"
        )
    found = [checks.speed("from_function", f"velocity {where}", one) for one in answer]
    return found[0], found[1], found[2] if found[2:] else 0.0


def _check_constant(function: Velocity, nodes: Mapping[str, Floats]) -> None:
    """Raise CurrentError when a function varies along an axis that has no range."""
    middle = {name: float(axis[axis.size // 2]) for name, axis in nodes.items()}
    for name, (unit, places) in AXES.items():
        if nodes[name].size > 1:
            continue
        asked = [_velocity(function, tuple({**middle, name: x}.values())) for x in places]
        if len(set(asked)) > 1:
            raise CurrentError(
                f"from_function: the function varies with {name}: give the range of the mission, "
                f"{name}=(low, high) [{unit}]"
            )


def _check_between(
    function: Velocity, nodes: Mapping[str, Floats], values: Floats, tolerance: float
) -> None:
    """Compare the table with the function at random places, the same at each call."""
    wide = [name for name, axis in nodes.items() if axis.size > 1]
    if not wide:
        return
    random = np.random.default_rng(0)
    places = {
        name: random.uniform(axis[0], axis[-1], CHECKED) if axis.size > 1 else np.zeros(CHECKED)
        for name, axis in nodes.items()
    }
    squeezed = values.reshape(*(nodes[name].size for name in wide), 3)
    table = RegularGridInterpolator([nodes[name] for name in wide], squeezed)
    linear = table(np.stack([places[name] for name in wide], axis=1))
    for k, place in enumerate(zip(*(column.tolist() for column in places.values()), strict=True)):
        off = float(np.abs(linear[k] - _velocity(function, place)).max())
        if off > 2.0 * tolerance:
            t, depth, north, east = place
            raise CurrentError(
                f"from_function: the table is off by {off:.2g} m/s at t={t:g} s, north={north:g} "
                f"m, east={east:g} m, depth={depth:g} m: something there is narrower than "
                f"{INTERVALS} intervals of the ranges; give narrower ranges"
            )
