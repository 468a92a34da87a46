"""Driven unknowns: parameters of a propelled vehicle that runs can tell, and their spreads.

Coefficients are factors on those of the vehicle file that a fit starts from, and have the file's
own names: a derivative of the hull law such as Xuu, the lift slope of a fin, the thrust of the
screw. Spreads are those by which published sets of one vehicle differ: Prestero's thesis has two
values for the drag of REMUS 100 (table 8.2: adjusted by a factor of 2.4) and MBARI two for the
fins, the cross flow and the damping of Tethys (`assets/tethys.xml`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import partial

from twin.errors import InputError
from twin.identify.calibration import Calibration
from twin.identify.unknowns import UnknownParameter, choose
from twin.vehicle.laws import BodyAxes
from twin.vehicle.laws.body_axes import added_mass_coupling
from twin.vehicle.parts import Fin, Part, Propeller
from twin.vehicle.vehicle import Vehicle, parse_vehicle

DEGREE = math.pi / 180.0
DERIVATIVES = {
    "Xuu": ("drag straight ahead", 0.3),
    "Yuv": ("side force of sideslip, hull and fins at rest", 0.3),
    "Zuw": ("lift of the angle of attack, hull and fins at rest", 0.3),
    "Nuv": ("yaw moment of sideslip, Munk's and that of the fins at rest", 0.3),
    "Muw": ("pitch moment of the angle of attack, likewise", 0.3),
    "Nur": ("yaw damping that grows with the speed", 0.5),
    "Muq": ("pitch damping that grows with the speed", 0.5),
    "Yvv": ("drag of the cross flow, sideways", 0.5),
    "Zww": ("drag of the cross flow, downwards", 0.5),
    "Nrr": ("yaw damping by the cross flow", 0.5),
    "Mqq": ("pitch damping by the cross flow", 0.5),
    "Yur": ("side force of turning at speed", 0.3),
    "Zuq": ("lift of pitching at speed", 0.3),
    "Nvv": ("yaw moment of the cross flow", 0.3),
    "Mww": ("pitch moment of the cross flow", 0.3),
    "Xvv": ("drag of sideslip", 0.1),
    "Xww": ("drag of the angle of attack", 0.1),
    "Xvr": ("added mass sideways in a turn, along the hull", 0.1),
    "Xwq": ("added mass downwards while pitching, along the hull", 0.1),
}
"""Of the law in body axes: what it is, and the spread of its factor's logarithm. Runs hardly tell
the last eight; held at a file's wrong numbers they would make thrust and drag wrong, and too sure,
for what they take off the speed in a turn"""
ADDED_MASSES = (
    (0, "surge", "mass along the hull", 0.3),
    (1, "sway", "mass sideways", 0.1),
    (2, "heave", "mass downwards", 0.1),
    (4, "pitch", "inertia in pitch", 0.1),
    (5, "yaw", "inertia in yaw", 0.1),
)
"""Place in the matrix, name, meaning, and the spread of the factor's logarithm: strip theory and an
ellipsoid of a hull's size differ by a tenth across, by more along it"""
THRUST_SPREAD, LIFT_SPREAD = 0.2, 0.3
"""Of the factors' logarithms"""
NEUTRAL_SPREAD = 2.0
"""[deg] by which fins sit askew"""
PLACE_SPREAD = 3.0
"""[mm] along the hull of a centre of gravity after trimming"""
ARM_SPREAD = 0.3
"""of the righting arm's logarithm"""
UNSURE = 3.0
"""Times as much is open of a vehicle that was made of its dimensions alone"""


def driven(vehicle: Vehicle) -> bool:
    """Whether a propeller drives it: it is identified by its runs, not by a glider's dives."""
    return vehicle.steered("speed") is not None


def driven_parameters(vehicle: Vehicle, unsure: float = 1.0) -> tuple[UnknownParameter, ...]:
    """Parameters that can be estimated of a vehicle: the numbers that its file has.

    Args:
      vehicle: to start from.
      unsure: times the usual spreads, but that of the trim.

    Raises:
      InputError: no propeller, or another hull law than that in body axes, by name.
    """
    driving, law = vehicle.steered("speed"), vehicle.law
    if not isinstance(driving, Propeller):
        raise InputError(
            f"vehicle {vehicle.name!r} has no propeller (parts: {', '.join(vehicle.part_names)}): "
            "a buoyancy glider is identified by its depth rate"
        )
    if not isinstance(law, BodyAxes):
        raise InputError(
            f"vehicle {vehicle.name!r} has the hull law {law.kind!r}: under a propeller only "
            f"{BodyAxes.kind!r} is identified; start from remus or tethys (--vehicle)"
        )
    factors = [
        _factor(name, what, spread, partial(_derivative, name), partial(_set_derivative, name))
        for name, (what, spread) in DERIVATIVES.items()
        if dict(law.derivatives).get(name)
    ]
    factors += [
        _factor(
            f"added_mass_{name}",
            f"added {what}",
            spread,
            partial(_added_mass, k),
            partial(_set_added_mass, k),
        )
        for k, name, what, spread in ADDED_MASSES
        if vehicle.added_mass[k, k] > 0.0
    ]
    factors.append(_of_part(driving, "thrust_coefficient", "thrust at rest", THRUST_SPREAD))
    if unsure > 1.0 and driving.zero_thrust_advance > 0.0:
        what = "advance without thrust"
        factors.append(_of_part(driving, "zero_thrust_advance", what, THRUST_SPREAD))
    for control in ("heading", "pitch"):
        part = vehicle.steered(control)
        if isinstance(part, Fin):
            factors.append(_of_part(part, "lift_slope", "lift of a deflection", LIFT_SPREAD))
            factors.append(_neutral(part.name))
    factors.append(
        UnknownParameter(
            name="cg_x",
            unit="mm",
            meaning="centre of gravity ahead of the centre of buoyancy, parts at rest",
            spread=PLACE_SPREAD,
            get=lambda c: 1e3 * _first_moment(c.vehicle) / c.vehicle.mass,
            set=lambda c, x: _moved(c, 0, 1e-3 * x * c.vehicle.mass - _first_moment(c.vehicle)),
        )
    )
    if vehicle.metacentric_height > 0.0:
        factors.append(
            UnknownParameter(
                name="righting_arm",
                unit="mm",
                meaning="centre of gravity below the centre of buoyancy",
                spread=ARM_SPREAD,
                logarithmic=True,
                get=lambda c: 1e3 * c.vehicle.metacentric_height,
                set=lambda c, x: _moved(
                    c, 2, (1e-3 * x - c.vehicle.metacentric_height) * c.vehicle.mass
                ),
            )
        )
    (trim,) = choose(["neutral_density"])  # a glider's, as well known
    return (trim, *(dataclasses.replace(p, spread=unsure * p.spread) for p in factors))


def _factor(
    name: str,
    what: str,
    spread: float,
    get: Callable[[Vehicle], float],
    put: Callable[[Calibration, float], Calibration],
) -> UnknownParameter:
    """A factor on a number of the vehicle file."""

    def own(calibration: Calibration) -> float:
        return get(parse_vehicle(calibration.vehicle.xml, calibration.vehicle.path))

    return UnknownParameter(
        name=name,
        unit="1",
        meaning=f"{what}, over the vehicle file's",
        spread=spread,
        logarithmic=True,
        get=lambda c: get(c.vehicle) / own(c),
        set=lambda c, x: put(c, x * own(c)),
    )


def _derivative(name: str, vehicle: Vehicle) -> float:
    assert isinstance(vehicle.law, BodyAxes)
    return dict(vehicle.law.derivatives)[name]


def _set_derivative(name: str, calibration: Calibration, value: float) -> Calibration:
    assert isinstance(calibration.vehicle.law, BodyAxes)
    numbers = dict(calibration.vehicle.law.derivatives) | {name: value}
    return calibration.with_vehicle(derivatives=tuple(numbers.items()))


def _added_mass(k: int, vehicle: Vehicle) -> float:
    return float(vehicle.added_mass[k, k])


def _set_added_mass(k: int, calibration: Calibration, value: float) -> Calibration:
    matrix, law = calibration.vehicle.added_mass.copy(), calibration.vehicle.law
    matrix[k, k] = value
    assert isinstance(law, BodyAxes)
    coupled = {"coupling": added_mass_coupling(matrix)} if law.coupling else {}
    return calibration.with_vehicle(added_mass=matrix, **coupled)


def _of_part(part: Part, field: str, what: str, spread: float) -> UnknownParameter:
    name = part.name
    return _factor(
        f"{name}.{field}",
        f"{what} of the {name}",
        spread,
        lambda v: float(getattr(v.part(name), field)),
        lambda c, x: c.with_vehicle(**{name: {field: x}}),
    )


def _neutral(name: str) -> UnknownParameter:
    """Reading of a fin in line with the hull."""

    def get(calibration: Calibration) -> float:
        fin = calibration.vehicle.part(name)
        assert isinstance(fin, Fin)
        return fin.neutral / DEGREE

    return UnknownParameter(
        name=f"{name}.neutral",
        unit="degree",
        meaning=f"reading of the {name} in line with the hull",
        spread=NEUTRAL_SPREAD,
        get=get,
        set=lambda c, x: c.with_vehicle(**{name: {"neutral": x * DEGREE}}),
    )


def _first_moment(vehicle: Vehicle) -> float:
    """[kg m] of all masses along the hull, parts at 0."""
    moved = sum(m.mass * m.neutral_x for m in vehicle.masses)
    return vehicle.static_mass * float(vehicle.static_cg[0]) + moved


def _moved(calibration: Calibration, axis: int, moment: float) -> Calibration:
    """The hull's centre of gravity moved along an axis by a moment [kg m]."""
    place = calibration.vehicle.static_cg.copy()
    place[axis] += moment / calibration.vehicle.static_mass
    return calibration.with_vehicle(static_cg=place)
