"""Forces of the Fossen model: hull, parts, restoring forces, net buoyancy.

Body axes FRD about the CB, SI units. The effects of hull laws and types of part are in their own
files (`twin.vehicle.laws`, `twin.vehicle.parts`), in code that the MuJoCo twin does not share.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from twin.compiled import dispatch, jit
from twin.fossen.terms import hung_mass, strain, with_mass
from twin.numbers import Array
from twin.vehicle.laws import LAWS
from twin.vehicle.parts import PARTS, BatteryHinge
from twin.vehicle.parts.base import VALUES
from twin.vehicle.vehicle import Vehicle

_NONE = np.zeros(0)
MASS_COLUMNS = 15
"""Columns of a moving mass: mass [kg], its place forward and below [m], indices of its slide and of
its hinge among the parts (-1: none), neutral position of the hinge, inertia 9."""
PART_COLUMNS = 5
"""Columns of a part: code of its type, place 3, number of values; then its values."""


class ForceParameters(NamedTuple):
    """Numbers of a `Vehicle` for the compiled equations; same names, units and frames."""

    gravity: float
    reference_density: float
    mass: float
    neutral_volume: float
    hull_length: float
    hull_diameter: float
    hull_compressibility: float
    hull_thermal_expansion: float
    hull_thermal_lag: float
    hull_reference_temperature: float
    static_mass: float
    static_cg: Array
    static_inertia: Array
    masses: Array
    """Moving masses, (masses, MASS_COLUMNS)."""
    parts: Array
    """Parts, (parts, PART_COLUMNS + VALUES)."""
    added_mass: Array
    coupling: float
    """1: the coupling by added mass acts; 0: the law already contains it."""
    law: float
    """Code of the type of hull law."""
    law_scaled: float
    """1: the law's coefficients contain the reference density; 0: the law uses the water's."""
    law_values: Array
    density_depth: Array
    density_value: Array
    temperature_depth: Array
    """[m] Depths of the temperature table; empty: the water's temperature is unknown."""
    temperature_value: Array
    """[degC] Temperatures of the water."""


def parameters_of(
    vehicle: Vehicle,
    density_depth: Array,
    density_value: Array,
    temperature_depth: Array = _NONE,
    temperature_value: Array = _NONE,
) -> ForceParameters:
    """Gather the vehicle's numbers and tables of the water over depth [m].

    The tables are density [kg/m3], and in-situ temperature [degree_Celsius] where known.
    """

    def array(values: object) -> Array:
        return np.array(values, dtype=np.float64, order="C")

    masses = np.zeros((len(vehicle.masses), MASS_COLUMNS))
    for row, mass in zip(masses, vehicle.masses, strict=True):
        drives = [
            -1.0 if name is None else float(vehicle.part_names.index(name))
            for name in (mass.slide, mass.hinge)
        ]
        hinge = None if mass.hinge is None else vehicle.part(mass.hinge)
        hung = hinge.neutral if isinstance(hinge, BatteryHinge) else 0.0
        row[:6] = mass.mass, mass.neutral_x, mass.eccentricity, *drives, hung
        row[6:] = np.ravel(mass.inertia)
    # one width for all types: a kernel that reads too far reads zeros
    parts = np.zeros((len(vehicle.parts), PART_COLUMNS + VALUES))
    for row, part in zip(parts, vehicle.parts, strict=True):
        values = part.values()
        row[:PART_COLUMNS] = PARTS.code(part.kind), *part.position, len(values)
        row[PART_COLUMNS : PART_COLUMNS + len(values)] = values
    first = ForceParameters._fields[: ForceParameters._fields.index("static_cg")]
    of_hull: dict[str, Any] = {name: float(getattr(vehicle, name)) for name in first}
    for name in ("static_cg", "static_inertia", "added_mass"):
        of_hull[name] = array(getattr(vehicle, name))
    return ForceParameters(
        **of_hull,
        masses=masses,
        parts=parts,
        coupling=float(vehicle.added_mass_coupling),
        law=float(LAWS.code(vehicle.law.kind)),
        law_scaled=float(vehicle.law.density_in_coefficients),
        law_values=array(vehicle.law.values()),
        density_depth=array(density_depth),
        density_value=array(density_value),
        temperature_depth=array(temperature_depth),
        temperature_value=array(temperature_value),
    )


_MOTION = ("u", "v", "w", "p", "q", "r")
_NOTHING = (0.0,) * 6


def _dispatch(name: str, arguments: tuple[str, ...], kinds: Any, nothing: Any) -> Any:
    kernel = f"fossen_{name.partition('_')[2]}"
    return dispatch(name, arguments, lambda: kinds.kernels(kernel), nothing, module=__name__)


law_wrench = _dispatch("law_wrench", ("values", "density", *_MOTION), LAWS, _NOTHING)
"""(code, values, density, u, v, w, p, q, r) -> X, Y, Z, K, M, N of the hull."""
part_wrench = _dispatch(
    "part_wrench", ("values", "place", "position", *_MOTION, "density", "depth"), PARTS, _NOTHING
)
"""(code, values, place, position, motion, density, depth) -> X, Y, Z, K, M, N of a part."""
part_volume = _dispatch("part_volume", ("values", "position"), PARTS, 0.0)
"""(code, values, position) -> volume that a part displaces [cm3]."""
part_mass = _dispatch("part_mass", ("values", "position"), PARTS, 0.0)
"""(code, values, position) -> point mass [kg] that a part adds at its place."""


@jit
def _six(a, b, c, d, e, f):  # type: ignore[no-untyped-def]
    found = np.empty(6)
    found[0], found[1], found[2], found[3], found[4], found[5] = a, b, c, d, e, f
    return found


@jit
def damping_wrench(p: ForceParameters, nu_r: Array, density: float) -> Array:
    """Wrench -D(nu_r) nu_r of the hull: force [N], moment [N m] about the CB, shape (6,), body FRD.

    The water's `density` [kg/m3] scales coefficients that contain the reference density.
    """
    u, v, w, a, b, c = nu_r
    tau = _six(*law_wrench(int(p.law), p.law_values, density, u, v, w, a, b, c))
    if p.law_scaled != 0.0:
        tau *= density / p.reference_density
    return tau


@jit
def parts_wrench(
    p: ForceParameters, positions: Array, nu_r: Array, density: float, depth: float, down: Array
) -> Array:
    """Force and moment of all parts about the CB, shape (6,); `down` (3,) in body axes."""
    total = np.zeros(6)
    u, v, w, a, b, c = nu_r
    for k in range(p.parts.shape[0]):
        row = p.parts[k]
        place = row[1:4]
        there = depth + place[0] * down[0] + place[1] * down[1] + place[2] * down[2]
        values, code = row[PART_COLUMNS:], int(row[0])
        total += _six(
            *part_wrench(code, values, place, positions[k], u, v, w, a, b, c, density, there)
        )
    return total


@jit
def pumped(p: ForceParameters, positions: Array):  # type: ignore[no-untyped-def]
    """Return (volume [cm3], its first moment (3,) [cm3 m] about the CB) that the parts displace."""
    volume, lever = 0.0, np.zeros(3)
    for k in range(p.parts.shape[0]):
        row = p.parts[k]
        own = part_volume(int(row[0]), row[PART_COLUMNS:], positions[k])
        volume += own
        lever += own * row[1:4]
    return volume, lever


@jit
def carried(p: ForceParameters, positions: Array):  # type: ignore[no-untyped-def]
    """All masses at these positions of the parts: (mass, first moment, inertia 6) about the CB."""
    nothing, still = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cg, own = p.static_cg, lower(p.static_inertia)
    body = with_mass((0.0, nothing, still), p.static_mass, (cg[0], cg[1], cg[2]), own)
    for k in range(p.masses.shape[0]):
        row = p.masses[k]
        shift = positions[int(row[3])] if row[3] >= 0.0 else 0.0
        roll = positions[int(row[4])] - row[5] if row[4] >= 0.0 else 0.0
        place, turned = hung_mass(row[1], row[2], shift, roll, lower(row[6:].reshape((3, 3))))
        body = with_mass(body, row[0], place, turned)
    for k in range(p.parts.shape[0]):
        row = p.parts[k]
        extra = part_mass(int(row[0]), row[PART_COLUMNS:], positions[k])
        body = with_mass(body, extra, (row[1], row[2], row[3]), still)
    return body


@jit
def lower(inertia: Array):  # type: ignore[no-untyped-def]
    """Lower triangle of a symmetric (3, 3), as a tuple for `terms`."""
    i = inertia
    return i[0, 0], i[1, 0], i[1, 1], i[2, 0], i[2, 1], i[2, 2]


@jit
def _profile(depths: Array, values: Array, depth: float) -> float:
    """Value of a table over depth, linear between its rows, constant beyond its ends."""
    last = depths.size - 1
    if depth <= depths[0]:
        return values[0]
    if depth >= depths[last]:
        return values[last]
    row = np.searchsorted(depths, depth)
    part = (depth - depths[row - 1]) / (depths[row] - depths[row - 1])
    return values[row - 1] + part * (values[row] - values[row - 1])


@jit
def density_at(p: ForceParameters, depth: float) -> float:
    """Density [kg/m3] of the water at `depth` [m]."""
    return _profile(p.density_depth, p.density_value, depth)


@jit
def temperature_at(p: ForceParameters, depth: float) -> float:
    """In-situ temperature [degC] of the water; the hull's reference if it is unknown."""
    if p.temperature_depth.size == 0:
        return p.hull_reference_temperature
    return _profile(p.temperature_depth, p.temperature_value, depth)


@jit
def displaced_mass(p: ForceParameters, depth: float, volume: float, hull: float = np.nan) -> float:
    """Mass of the water that the fully immersed hull displaces [kg]; `volume` of parts in cm3.

    The hull shrinks in proportion to the pressure of water of the reference density, and grows with
    its temperature `hull` [degC]; NaN means the reference temperature.
    """
    pressure = p.reference_density * p.gravity * max(depth, 0.0)
    warmer = 0.0 if np.isnan(hull) else hull - p.hull_reference_temperature
    stretch = strain(p.hull_compressibility, pressure, p.hull_thermal_expansion, warmer)
    return density_at(p, depth) * (p.neutral_volume + 1e-6 * volume) * stretch
