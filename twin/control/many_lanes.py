"""Many lanes: vehicles in the batched Fossen engine, with the measurements of `Physics`.

The vehicles are lanes in blocks of `twin.fossen.lanes`, which threads share. A vehicle flies here
as in `twin.simulate` with engine="lanes", bit for bit, whatever flies in the other lanes.
"""

from __future__ import annotations

import concurrent.futures
import itertools
import os
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.control.conditions import Conditions, water_of
from twin.errors import InputError, VehicleError
from twin.fossen import lanes as ln
from twin.fossen.lane_block import AT, LANES, PART, PARTS_AT, empty_block
from twin.fossen.structure import structure_of
from twin.numbers import Array
from twin.physics.lanes import column, joined, refuse_obstacles
from twin.physics.model_block import Tables
from twin.physics.start import Start
from twin.vehicle.vehicle import Vehicle

WIDTH = LANES[-1]


def _row(name: str, offset: int, text: str, *, width: int = 0) -> Callable[[ManyLanes], Array]:
    """Make a measurement: one number of each vehicle, (count,), or a vector if `width` is not 0."""

    def measured(self: ManyLanes) -> Array:
        first = AT[name] + offset
        return self._vector(first, width) if width else self._get(first)

    measured.__doc__ = text
    return measured


class ManyLanes:
    """`count` vehicles of one structure; measurements have the vehicle as their first axis."""

    def __init__(self, vehicle: Vehicle, count: int, *, timestep: float, threads: int = 0):
        """Make room for `count` vehicles.

        Args:
          vehicle: vehicle of the file, with the hydrodynamics to use.
          timestep: [s]. threads: as in `twin.control.many.ManyPhysics`.

        Raises:
          InputError: `count` is below 1, or the vehicle's file has obstacles.
          VehicleError: the batched engine cannot fly the vehicle.
        """
        if count < 1:
            raise InputError(f"{count} vehicles: give at least 1")
        refuse_obstacles(vehicle)
        self.vehicle, self.count, self.timestep = vehicle, count, timestep
        self._structure, self._numbers = structure_of(vehicle)
        parts, blocks = self._structure.parts, -(-count // WIDTH)
        self._rate = self._structure.rate(WIDTH)
        words = self._structure.size * WIDTH
        self._blocks = empty_block(blocks * words).reshape(blocks, words)
        self._rows = self._blocks.reshape(blocks, self._structure.size, WIDTH)
        self._counts = np.zeros((blocks, WIDTH, len(ln.COUNTS)))
        self._fresh = np.zeros((blocks, WIDTH), np.bool_)
        still = column(self._structure, self._numbers, vehicle, Start(), np.zeros(0))
        self._rows[...] = still[None, :, None]
        self._travel: tuple[Array, Array] | None = None
        """Lower ends and lengths of the parts' travel, (count, parts) each; None: outdated since a
        vehicle was placed."""
        self._tables = [Tables()] * (blocks * WIDTH)
        self._tables_changed = True
        self._first = {name: PARTS_AT + PART.index(name) * parts for name in PART}
        threads = min(threads or os.cpu_count() or 1, blocks)
        ends = np.linspace(0, blocks, threads + 1).round().astype(int).tolist()
        self._shares = list(itertools.pairwise(ends))
        self._pool = concurrent.futures.ThreadPoolExecutor(threads) if threads > 1 else None

    # --- beginning and going on ---------------------------------------------------------------

    def place(
        self,
        at: tuple[int, ...],
        start: Start,
        *,
        vehicle: Vehicle,
        conditions: Conditions | None,
        duration: float,
    ) -> None:
        """Write the start of a vehicle, like `twin.control.many.ManyPhysics.place`.

        Raises:
          VehicleError: the real vehicle has parts or a hull law of another type.
        """
        (index,) = at
        structure, numbers, real = self._structure, self._numbers, self.vehicle
        tables = Tables()
        if conditions is not None:
            real = conditions.vehicle or real
            if not conditions.only_current:
                ballast = conditions.ballast
                volume = (
                    None if ballast is None else ballast.neutral_volume(real, conditions.density)
                )
                structure, numbers = structure_of(
                    real, neutral_volume=volume, zeros=conditions.encoder_zeros
                )
                if structure != self._structure:
                    raise VehicleError(
                        f"vehicle {real.name!r} is drawn with other kinds of parts or another hull "
                        f"law than {vehicle.name!r}, beside which it would fly in lanes"
                    )
            tables = water_of(conditions, real, duration)
        block, lane = divmod(index, WIDTH)
        self._rows[block, :, lane] = column(structure, numbers, real, start, tables.temperature)
        self._counts[block, lane] = 0.0
        self._fresh[block, lane] = True
        self._travel = None
        if tables.words or self._tables[index].words:
            self._tables[index], self._tables_changed = tables, True

    def settle(self, which: NDArray[np.bool_]) -> None:
        """Update measurements after new starts."""
        if self._tables_changed:
            tables, self._tables_changed = self._tables, False
            self._water = [
                *joined([table.current for table in tables]),
                *joined([table.density for table in tables]),
                *joined([table.temperature for table in tables]),
                *joined([np.zeros(0)] * len(tables)),  # no sea floor
            ]
        self._go_on(0)
        self._fresh[...] = False

    def set_control(self, commands: ArrayLike) -> None:
        """Command the parts, in their order and units, shape (count, parts)."""
        wanted = np.asarray(commands, float)
        for k in range(self._structure.parts):
            self._put(self._first["command"] + k, wanted[:, k])

    def step(self, steps: int, which: NDArray[np.bool_]) -> None:
        """Advance the vehicles of the mask `which`, (count,), by `steps` physics steps."""
        self._put(AT["alive"], (which & ~self.failed()).astype(float))
        self._go_on(steps)

    def _go_on(self, steps: int) -> None:
        def share(first: int, last: int) -> None:
            places = slice(first * WIDTH, last * WIDTH + 1)
            at = [array[places] if array.dtype == np.int64 else array for array in self._water]
            blocks = self._blocks[first:last]
            ln.go_on(
                blocks, WIDTH, blocks.ctypes.data, self._rate.address, self._structure.parts,
                self.timestep, steps, self._fresh[first:last], self._counts[first:last], *at,
            )  # fmt: skip

        if self._pool is None:
            share(*self._shares[0])
        else:
            list(self._pool.map(lambda ends: share(*ends), self._shares))

    def failed(self) -> NDArray[np.bool_]:
        """Mask of the vehicles whose state is no longer finite since their start, (count,)."""
        found: NDArray[np.bool_] = self._counts[:, :, ln.FAILED].reshape(-1)[: self.count] != 0.0
        return found

    # --- measurements -------------------------------------------------------------------------

    def _put(self, row: int, values: Array) -> None:
        full, rest = divmod(self.count, WIDTH)
        self._rows[:full, row] = values[: full * WIDTH].reshape(full, WIDTH)
        if rest:
            self._rows[full, row, :rest] = values[full * WIDTH :]

    def _get(self, row: int) -> Array:
        """One row of the blocks: a number of each vehicle, (count,)."""
        return np.array(self._rows[:, row]).reshape(-1)[: self.count]

    def _vector(self, row: int, width: int) -> Array:
        """Consecutive rows of the blocks as a vector of each vehicle, (count, width)."""
        rows = np.array(self._rows[:, row : row + width].transpose(0, 2, 1), order="C")
        return rows.reshape(-1, width)[: self.count]

    time = _row("time", 0, "Time since the start [s], (count,).")
    north = _row("state", 0, "Position north of the origin [m], (count,).")
    east = _row("state", 1, "Position east of the origin [m], (count,).")
    depth = _row("state", 2, "Depth of the CB [m], (count,).")
    roll = _row("euler", 0, "Roll [rad], positive starboard down, (count,).")
    pitch = _row("euler", 1, "Pitch [rad], positive nose up, (count,).")
    heading = _row("euler", 2, "Heading [rad] in [0, 2 pi), (count,).")
    depth_rate = _row("rate", 2, "Vertical velocity [m/s], positive down, (count,).")
    net_buoyancy = _row("net_mass", 0, "Net buoyancy mass [kg], immersed, positive = heavy.")
    immersion = _row("immersion", 0, "Immersed fraction of the hull [1], (count,).")
    velocity_over_ground = _row("rate", 0, "Velocity over ground [m/s], NED, (count, 3).", width=3)
    velocity_through_water = _row("state", 7, "Surge, sway, heave [m/s], FRD, (count, 3).", width=3)
    rates = _row("state", 10, "Roll, pitch, yaw rate [rad/s], FRD, shape (count, 3).", width=3)
    current = _row("current", 0, "Velocity of the water at the CB [m/s], NED, (count, 3).", width=3)

    def speed(self) -> Array:
        """Speed through the water [m/s], (count,)."""
        found: Array = np.linalg.norm(self.velocity_through_water(), axis=1)
        return found

    def activation(self) -> Array:
        """Positions of the parts, in their order and units, shape (count, parts)."""
        return self._vector(self._first["now"], self._structure.parts)

    def actuators(self) -> Array:
        """Positions of the parts as fractions of their travel, -1 to 1, shape (count, parts)."""
        if self._travel is None:
            low = self._vector(self._first["low"], self._structure.parts)
            high = self._vector(self._first["high"], self._structure.parts)
            self._travel = low, high - low
        low, travel = self._travel
        fractions = self.activation()
        fractions -= low
        fractions *= 2.0
        fractions /= travel
        fractions -= 1.0
        return fractions
