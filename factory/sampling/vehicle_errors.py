"""Vehicle errors: how the real vehicle differs from the one that guidance assumes."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from factory.sampling.draw import Parameters
from factory.sampling.vehicle_parameters import ADDED_MASS
from twin.physics.start import Ballast
from twin.vehicle.parts import Part
from twin.vehicle.vehicle import Vehicle

BALLAST_FRACTION = 0.5
"""A vehicle is ballasted neutral at this part of its deepest turning depth, as pilots do, so that
dive and climb share what the stratification costs."""
GRAM, MILLIMETRE = 1e-3, 1e-3


def spread_vehicle(nominal: Vehicle, parameters: Parameters) -> Vehicle:
    """`nominal` with the drawn coefficients, CG, compressibility and fields of its parts."""
    value = parameters.number
    law = nominal.law
    factors = {u.name: value(f"vehicle.{u.name}") for u in law.uncertainties()}
    factor = {cell: value(f"vehicle.added_mass_{name}") for name, (_, cell) in ADDED_MASS.items()}
    added_mass = nominal.added_mass.copy()
    for i in range(6):
        for j in range(i, 6):
            if added_mass[i, j]:
                added_mass[i, j] *= _coupled(factor, i, j)
                added_mass[j, i] = added_mass[i, j]
    cg = [0.0, MILLIMETRE * value("vehicle.cg_y_mm"), MILLIMETRE * value("vehicle.cg_z_mm")]
    return nominal.replace(
        law=law.scaled(factors),
        added_mass=added_mass,
        static_cg=nominal.static_cg + np.array(cg),
        hull_compressibility=nominal.hull_compressibility + value("vehicle.compressibility"),
        **{part.name: _fields(part, parameters) for part in nominal.parts},
    )


def _coupled(factor: Mapping[tuple[int, int], float], i: int, j: int) -> float:
    """What an added mass is multiplied by: a coupling without a factor of its own goes with the two
    motions that it couples, so that the matrix stays positive."""
    own = factor.get((i, j))
    return math.sqrt(factor[i, i] * factor[j, j]) if own is None else own


def believed_vehicle(nominal: Vehicle, parameters: Parameters) -> Vehicle:
    """`nominal` with what guidance knows of the drawn coefficients."""
    known = {
        u.name: parameters.number(f"vehicle.{u.name}")
        for u in nominal.law.uncertainties()
        if u.known
    }
    if all(known[u.name] == u.certain for u in nominal.law.uncertainties() if u.known):
        return nominal
    return nominal.replace(law=nominal.law.scaled(known))


def _fields(part: Part, parameters: Parameters) -> dict[str, float]:
    """The fields of a part that are drawn, times their factors."""
    return {
        u.field: getattr(part, u.field) * parameters.number(f"vehicle.{part.name}_{u.name}")
        for u in part.uncertainties()
        if u.field is not None
    }


def ballast_of(nominal: Vehicle, parameters: Parameters) -> Ballast:
    """How the vehicle was weighed: neutral where pilots do it, but for a glider's error."""
    heavy = 0.0
    if nominal.steered("buoyancy") is not None:
        heavy = GRAM * parameters.number("vehicle.ballast_g")
    return Ballast(depth=BALLAST_FRACTION * parameters.deepest_m, heavy=heavy)


def encoder_zeros(nominal: Vehicle, parameters: Parameters) -> dict[str, float]:
    """Where the parts are when their encoders say 0, in the parts' units."""
    return {
        part.name: u.scale * parameters.number(f"vehicle.{part.name}_{u.name}")
        for part in nominal.parts
        for u in part.uncertainties()
        if u.field is None
    }
