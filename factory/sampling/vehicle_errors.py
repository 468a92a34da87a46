"""Vehicle errors: how the real vehicle differs from the one that guidance assumes.

Randomiser: vehicle and water of a control task's episode, drawn from the table of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from factory.sampling.distribution import Distribution, Fixed
from factory.sampling.draw import Parameters
from factory.sampling.mission_water import build_current, build_density
from factory.sampling.parameters import BOTTOM, declared, override, parameter_table
from factory.sampling.vehicle_parameters import ADDED_MASS
from twin.errors import InputError
from twin.physics.ballast import Ballast
from twin.suite.conditions import Conditions
from twin.vehicle.parts import Part
from twin.vehicle.vehicle import Vehicle
from twin.water.current.axes import Origin

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


GROUPS = ("vehicle", "current", "water")
"""Groups of the table that conditions are made of"""
CALM: Mapping[str, Distribution] = {
    "current.speed": Fixed(0.0),
    "water.stratified": Fixed(0.0),
}
"""What `table` has in place of preset paper's: still water of the reference density"""


class _Task(Parameters):
    """Parameters of an episode that has no segments."""

    depth = 0.0
    """[m] down to which the task goes"""

    @property
    def deepest_m(self) -> float:
        """The task's depth limit [m]."""
        return self.depth


class TableRandomiser:
    """Draws from distributions by parameter."""

    def __init__(
        self,
        distributions: Mapping[str, Distribution],
        *,
        vehicle: Vehicle,
        depth: float,
        duration: float,
    ):
        """For a vehicle in episodes of `duration` [s] down to `depth` [m]."""
        self.distributions = dict(distributions)
        self._vehicle, self._depth, self._duration = vehicle, depth, duration

    def draw(self, random: np.random.RandomState) -> Conditions:
        """See `twin.suite.conditions.Randomiser`."""
        rng = np.random.default_rng(random.randint(2**31))
        values = {name: drawn.draw(rng) for name, drawn in self.distributions.items()}
        parameters = _Task(duration_s=self._duration, values=values, segments=())
        object.__setattr__(parameters, "depth", self._depth)
        return Conditions(
            vehicle=spread_vehicle(self._vehicle, parameters),
            ballast=ballast_of(self._vehicle, parameters),
            encoder_zeros=encoder_zeros(self._vehicle, parameters),
            current=build_current(parameters),
            origin=Origin(
                latitude_deg=parameters.number("water.latitude"),
                longitude_deg=parameters.number("water.longitude"),
            ),
            density=build_density(parameters),
        )


def table(
    changes: Mapping[str, str | float], *, vehicle: Vehicle, depth: float, duration: float
) -> TableRandomiser:
    """What is named is drawn, everything else is as the vehicle file says, in still water.

    Raises:
      InputError: no such parameter, one that tasks do not use, or a bad distribution.
    """
    return _made("paper", CALM, changes, vehicle=vehicle, depth=depth, duration=duration)


def field(
    changes: Mapping[str, str | float], *, vehicle: Vehicle, depth: float, duration: float
) -> TableRandomiser:
    """What preset field draws of vehicle and water, with changes.

    Raises:
      InputError: as `table`.
    """
    return _made("field", {}, changes, vehicle=vehicle, depth=depth, duration=duration)


def _made(
    spread: str,
    base: Mapping[str, Distribution],
    changes: Mapping[str, str | float],
    *,
    vehicle: Vehicle,
    depth: float,
    duration: float,
) -> TableRandomiser:
    rows = parameter_table(vehicle)
    for name in changes:
        if name in rows and name.partition(".")[0] not in GROUPS:
            raise InputError(
                f"{name} belongs to a mission: a task draws only {', '.join(GROUPS)} parameters"
            )
    found = override({**declared(spread, rows), **base}, changes)
    used = {name: d for name, d in found.items() if name.partition(".")[0] in GROUPS}
    used.setdefault(BOTTOM, Fixed(math.nan))  # surveys have a sea floor instead, tasks neither
    return TableRandomiser(used, vehicle=vehicle, depth=depth, duration=duration)
