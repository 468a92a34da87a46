"""Consumption: electrical energy that a vehicle's parts and electronics use.

Each part computes the energy of its own moves. Pumping oil out against the sea costs the work p dV;
letting it in costs the energy of a valve. A battery's screw works against friction and the
battery's weight. No energy is recovered. The pressure is that of water at the vehicle's reference
density and gravity.

Vehicle files may give their own numbers and sources. The default hotel load and pump efficiency are
from a Seaglider's account of a dive to 704 m (SG249, dive 10, 12 April 2024, NANOOS, basestation3
file p2490010.nc). `DEVICE_SECS` times `DEVICE_MAMPS` of Core, LPSleep, Compass, GPS and the sensor
controller with its CTD at 14.8 V is 3.96 kJ in 13 560 s. The pump used 4.69 kJ at 12.6 V for 236
cm3 at 700 m. The other defaults are our own estimates for small gliders.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError, UnknownName, VehicleError
from twin.vehicle.mjcf import MjcfReader
from twin.vehicle.parts.base import Losses, Move
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]
HOTEL = "hotel"
"""Name of the electronics' share, beside the names of the parts."""
AFLOAT = 1.5
"""[m] Depth above which a vehicle counts as at the surface, as in imported logs."""
ENERGY = "true_energy_"
"""Prefix of energy signals: `true_energy_pump` is the energy of the part `pump`."""


class Consumption(Losses):
    """Losses of the parts and power of the electronics, with the energies that follow from them."""

    @classmethod
    def of(cls, vehicle: Vehicle) -> Consumption:
        """Read the consumption from the `<numeric>` elements of a vehicle's file, with defaults.

        Raises:
          VehicleError: a number in the file cannot be used.
        """
        return _of_file(vehicle.xml, vehicle.path)

    def shares(
        self,
        vehicle: Vehicle,
        before: Array,
        after: Array,
        *,
        depth: ArrayLike,
        pitch: ArrayLike,
        duration: ArrayLike,
        speed: ArrayLike = 0.0,
    ) -> dict[str, Array]:
        """Energy [J] of short moves: of the electronics as `hotel`, and of each part by name.

        Args:
          before, after: positions of the parts, in their order and units, shape (..., parts).
          depth: [m]. pitch: [rad]. duration: [s]. Each is a number or has one value per move.
          speed: [m/s] of surge through the water, for turning screws.
        """
        afloat = np.asarray(depth) < AFLOAT
        power = self.hotel_power + self.payload_power + self.surface_power * afloat
        shares = {HOTEL: np.broadcast_to(power * np.asarray(duration), after.shape[:-1])}
        for i, part in enumerate(vehicle.parts):
            move = Move(before[..., i], after[..., i], depth, pitch, duration, speed)
            shares[part.name] = np.asarray(part.energy(vehicle, move, self))
        return shares

    def signals(
        self, vehicle: Vehicle, signals: Mapping[str, Array], time: Array
    ) -> dict[str, Array]:
        """Energy [J] used since the start by the electronics and by each part, shape (time,).

        Names are `true_energy_hotel` and `true_energy_PART`. Between two samples each part moves
        on a straight line.

        Args:
          signals: signals of `needed_signals`, shape (time,), from a trajectory or a stored
            mission: true_depth [m], true_pitch [degree], true_surge [m/s] where a screw turns, and
            true_PART of each part in its stored unit.
          time: [s], shape (time,).

        Raises:
          UnknownName: a signal is missing.
        """
        for name in needed_signals(vehicle):
            if name not in signals:
                raise UnknownName("signal of this mission", name, signals)

        def read(name: str) -> Array:
            return np.asarray(signals[f"true_{name}"], float)

        def middle(values: Array) -> Array:
            return np.asarray(0.5 * (values[1:] + values[:-1]))

        columns = [read(part.name) / part.quantity.scale for part in vehicle.parts]
        positions = np.stack([np.zeros(len(time)), *columns], axis=1)[:, 1:]
        shares = self.shares(
            vehicle, positions[:-1], positions[1:],
            depth=middle(read("depth")), pitch=middle(np.deg2rad(read("pitch"))),
            duration=np.diff(time),
            speed=middle(read("surge")) if _spins(vehicle) else 0.0,
        )  # fmt: skip
        return {
            ENERGY + name: np.concatenate([np.zeros(min(len(time), 1)), np.cumsum(share)])
            for name, share in shares.items()
        }


def _spins(vehicle: Vehicle) -> bool:
    return any(part.spins for part in vehicle.parts)


def needed_signals(vehicle: Vehicle) -> list[str]:
    """Names of the signals that `Consumption.signals` reads."""
    surge = ["true_surge"] if _spins(vehicle) else []
    return ["true_depth", "true_pitch", *surge, *(f"true_{name}" for name in vehicle.part_names)]


@functools.lru_cache(maxsize=16)
def _of_file(xml: str, path: Path) -> Consumption:
    reader = MjcfReader(xml, path)
    fields = [field.name for field in dataclasses.fields(Losses)]
    given = {name: reader.number(name) for name in fields if name in reader.numerics}
    try:
        return Consumption(**given)
    except InputError as error:
        raise VehicleError(f"vehicle file {path}: {error}") from error


def cost_of_transport(vehicle: Vehicle, energy: ArrayLike, distance: ArrayLike) -> Any:
    """Energy [J] / (weight * distance [m]), dimensionless; infinite without progress.

    Takes numbers, or arrays of one shape.
    """
    progress = np.maximum(distance, 0.0)
    with np.errstate(divide="ignore"):
        return np.divide(energy, vehicle.mass * vehicle.gravity * progress)
