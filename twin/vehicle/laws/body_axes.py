"""Body-axes law: hydrodynamic derivatives about the CB, linear, quadratic and cross-coupled.

The notation is SNAME's: `Xuu`, `Yuv`, `Nur`, ... name the axis of the force (X, Y, Z) or moment
(K, M, N) and the velocities (u, v, w, p, q, r) that multiply the derivative. A derivative of

- one velocity is linear: Xu u;
- one velocity twice is quadratic drag, c x |x|, odd as drag must be: Yvv v |v|, Mww w |w|; only in
  X, where the sign of a velocity across the hull cannot matter, it is c x x: Xvv v v, Xqq q q
  (Xuu stays u |u|);
- two velocities is their product: Yuv u v, Mpr p r.

A derivative of u and another velocity, outside of X, has two parts. The coupling by added mass
(Munk's moment u v, Yudot u r) is bilinear, does no work and stays as printed. The rest is lift and
damping of hull and fins, which resist the motion in any flow direction, so it takes |u|: Kup u p as
printed would accelerate the roll of a hull moving astern. Published sets were measured ahead
(u > 0), where both forms are equal; astern they are an extrapolation.

(Prestero 2001, Verification of a six-degree of freedom simulation model for the REMUS autonomous
underwater vehicle, eqs. 4.48 to 4.53.) Derivatives are dimensional and contain the water's density.
Files whose derivatives include the coupling by added mass (Xwq = -Zwdot, Munk's Muw, ...) have
`<numeric name="added_mass_coupling" data="0"/>`; otherwise both models add it from M_A.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from twin.compiled import inline, jit
from twin.compiled.elementary import scalar
from twin.errors import VehicleError, unknown_name
from twin.vehicle.changes import Uncertainty, coefficient
from twin.vehicle.laws.base import HullLaw, Unrolled

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

Array = NDArray[np.float64]
AXES, VELOCITIES = "XYZKMN", "uvwpqr"
PRODUCT, SQUARE, LINEAR, LIFT = 0.0, 1.0, 2.0, 3.0
TERM = 5
"""Number of values that describe a term: axis, first and second velocity, type, coefficient."""


@jit
def native_wrench(c, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Sum the terms; an axis or velocity index above 5 adds nothing."""
    x, y, z, l, m, n = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(c.size // TERM):
        at = TERM * k
        first = _pick(int(c[at + 1]), u, v, w, p, q, r)
        kind = c[at + 3]
        if kind == PRODUCT:
            value = c[at + 4] * first * _pick(int(c[at + 2]), u, v, w, p, q, r)
        elif kind == LIFT:
            value = c[at + 4] * abs(first) * _pick(int(c[at + 2]), u, v, w, p, q, r)
        elif kind == SQUARE:
            value = c[at + 4] * first * abs(first)
        else:
            value = c[at + 4] * first
        axis = int(c[at])
        if axis == 0:
            x += value
        elif axis == 1:
            y += value
        elif axis == 2:
            z += value
        elif axis == 3:
            l += value
        elif axis == 4:
            m += value
        elif axis == 5:
            n += value
    return x, y, z, l, m, n


@inline
def _pick(index, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    if index == 0:
        return u
    if index == 1:
        return v
    if index == 2:
        return w
    if index == 3:
        return p
    if index == 4:
        return q
    if index == 5:
        return r
    return 0.0


@jit
def native_rate_damping(c, timestep, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Time step times dK/dp, dM/dq, dN/dr."""
    k, m, n = 0.0, 0.0, 0.0
    for term in range(c.size // TERM):
        at = TERM * term
        axis, i, j, kind = int(c[at]), int(c[at + 1]), int(c[at + 2]), c[at + 3]
        if axis < 3:
            continue
        slope = 0.0
        if kind == LINEAR:
            slope = c[at + 4] if i == axis else 0.0
        elif kind == SQUARE:
            slope = 2.0 * c[at + 4] * abs(_pick(i, u, v, w, p, q, r)) if i == axis else 0.0
        elif kind == LIFT:
            slope = c[at + 4] * abs(_pick(i, u, v, w, p, q, r)) if j == axis else 0.0
        else:
            if i == axis:
                slope += c[at + 4] * _pick(j, u, v, w, p, q, r)
            if j == axis:
                slope += c[at + 4] * _pick(i, u, v, w, p, q, r)
        if axis == 3:
            k += slope
        elif axis == 4:
            m += slope
        else:
            n += slope
    return timestep * k, timestep * m, timestep * n


@scalar
def _damped(kind, coefficient, first, second):  # type: ignore[no-untyped-def]
    """One summand of D(nu_r) nu_r: its matrix element times the second velocity."""
    factor = coefficient * first
    if kind == LINEAR:
        factor = coefficient
    elif kind in (SQUARE, LIFT):
        factor = coefficient * abs(first)
    return factor * second


@jit
def fossen_wrench(c, density, u, v, w, p, q, r):  # type: ignore[no-untyped-def]
    """Wrench -D(nu_r) nu_r, summed row by row of the matrix D (Fossen 2011, section 6.4)."""
    tau, nu = np.zeros(6), np.array([u, v, w, p, q, r])
    for k in range(c.size // TERM):
        axis, i, j = int(c[TERM * k]), int(c[TERM * k + 1]), int(c[TERM * k + 2])
        tau[axis] += _damped(c[TERM * k + 3], c[TERM * k + 4], nu[i], nu[j])
    return tau[0], tau[1], tau[2], tau[3], tau[4], tau[5]


def term(name: str, coefficient: float) -> tuple[float, float, float, float, float]:
    """Numbers of one derivative, such as "Xuu", in the order of TERM.

    Raises:
      VehicleError: no derivative has this name; the nearest is offered.
    """
    if name not in NAMES:
        raise VehicleError(unknown_name("derivative", name, NAMES))
    axis = AXES.index(name[0])
    places = [VELOCITIES.index(letter) for letter in name[1:]]
    kind = LINEAR
    if len(places) == 2:
        even = name[0] == "X" and name != "Xuu"
        kind = SQUARE if places[0] == places[1] and not even else PRODUCT
    return (float(axis), float(places[0]), float(places[-1]), kind, float(coefficient))


def lifting(name: str) -> bool:
    """True for a derivative of u and another velocity: lift or damping in a flow along the hull."""
    return name[0] != "X" and len(name) == 3 and name.count("u") == 1


def added_mass_coupling(added_mass: Array) -> tuple[tuple[str, float], ...]:
    """Derivatives with u, by name, that Kirchhoff's equations give for M_A (6, 6) in SI.

    Force -omega x h_1 and moment -omega x h_2 - v x h_1 with (h_1, h_2) = M_A nu (Lamb 1932,
    article 124), such as Nuv = -(Y_vdot - X_udot) with its sign: Munk's moment.
    """

    def wrenches(nu: Array) -> Array:
        """Wrenches at velocities (..., 6)."""
        impulse = nu @ added_mass.T
        h, moment_of = impulse[:, :3], impulse[:, 3:]
        force = -np.cross(nu[:, 3:], h)
        moment = -np.cross(nu[:, 3:], moment_of) - np.cross(nu[:, :3], h)
        return np.concatenate([force, moment], axis=1)

    unit = np.eye(6)
    single = wrenches(unit)
    return tuple(
        (f"{axis}u{VELOCITIES[k]}", float(value))
        for k, both in enumerate(wrenches(unit[0] + unit[1:]) - single[0] - single[1:], 1)
        for axis, value in zip(AXES, both, strict=True)
        if axis != "X" and value != 0.0
    )


NAMES = tuple(
    axis + "".join(velocities)
    for axis in AXES
    for order in (1, 2)
    for velocities in itertools.product(VELOCITIES, repeat=order)
)
"""All possible names of derivatives."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class BodyAxes(HullLaw):
    """Hydrodynamic derivatives in body axes, as AUV papers print them."""

    kind: ClassVar[str] = "body-axes"
    physics: ClassVar[int] = 4
    native_wrench = staticmethod(native_wrench)
    native_rate_damping = staticmethod(native_rate_damping)
    fossen_wrench = staticmethod(fossen_wrench)

    derivatives: tuple[tuple[str, float], ...]
    """Name and coefficient of each derivative [SI: kg/m for Xuu, kg for Yur, kg m2 for Nrr]."""
    coupling: tuple[tuple[str, float], ...] = ()
    """Name and coefficient of the added-mass coupling that the derivatives with u contain; the
    rest of such a derivative takes |u|."""

    @classmethod
    def read(cls, reader: MjcfReader) -> Self:
        """Read every `<numeric>` element that has a derivative's name.

        If the file sets `added_mass_coupling` to 0, the derivatives contain the coupling by M_A.
        """
        found = tuple(
            (name, reader.numeric(name, 1)[0]) for name in reader.numerics if name in NAMES
        )
        if not found:
            reader.fail(
                "the hull law 'body-axes'", "given by derivatives such as <numeric name='Xuu' .../>"
            )
        if reader.number("added_mass_coupling", default=1.0) != 0.0:
            return cls(derivatives=found)
        added_mass = np.array(reader.numeric("added_mass", 36)).reshape(6, 6)
        return cls(derivatives=found, coupling=added_mass_coupling(added_mass))

    def with_drag(self, factor: float) -> Self | None:
        """Return a copy with Xuu times the factor; None: the file has no Xuu."""
        if not any(name == "Xuu" for name, _ in self.derivatives):
            return None
        found = tuple((n, x * factor if n == "Xuu" else x) for n, x in self.derivatives)
        return dataclasses.replace(self, derivatives=found)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """All possible names of derivatives."""
        return NAMES

    def problems(self) -> list[tuple[str, str]]:
        """Report drag that would propel, and a derivative given under both letter orders."""
        found = []
        seen: dict[tuple[str, ...], str] = {}
        for name, value in self.derivatives:
            own = set(name[1:]) == {VELOCITIES[AXES.index(name[0])]}  # Xu, Xuu
            if own and value > 0.0:
                found.append((name, "at most 0: drag never drives"))
            key = (name[0], *sorted(name[1:]))
            if key in seen:
                found.append(
                    (f"{name} and {seen[key]}", "one derivative: they are the same product")
                )
            seen[key] = name
        return found

    def values(self) -> Array:
        """Five numbers for each term, in the order of TERM; shape (5 n,)."""
        return self._values

    @functools.cached_property
    def _values(self) -> Array:
        own = dict(self.coupling)
        rows = []
        for name, value in self.derivatives:
            if not lifting(name):
                rows.append(term(name, value))
                continue
            bilinear = own.get(name, own.get(name[0] + name[:0:-1], 0.0))
            axis, first, second, _, rest = term(name, value - bilinear)
            if name[1] != "u":
                first, second = second, first
            rows.append((axis, first, second, LIFT, rest))
            if bilinear != 0.0:
                rows.append(term(name, bilinear))
        values = np.array(rows, dtype=np.float64).ravel()
        values.flags.writeable = False
        return values

    def fossen_unrolled(self) -> Unrolled:
        """Terms of `fossen_wrench` and the drag of each rate as expressions, loops unrolled."""
        sums: dict[int, list[str]] = {axis: ["0.0"] for axis in range(6)}
        damping: dict[int, list[str]] = {axis: ["0.0"] for axis in (3, 4, 5)}
        for k, (axis, i, j, kind, _) in enumerate(self._values.reshape(-1, TERM)):
            first, second = VELOCITIES[int(i)], VELOCITIES[int(j)]
            number = f"c[{TERM * k + 4}]"
            sums[int(axis)].append(f"_damped({kind}, {number}, {first}, {second})")
            if axis >= 3 and j == axis:
                slope = 2.0 if kind == SQUARE else 1.0
                damping[int(axis)].append(f"{slope} * _damped({kind}, {number}, {first}, 1.0)")
        wrench = [" + ".join(found) for found in sums.values()]
        damped = [f"-({' + '.join(found)})" for found in damping.values()]
        return (*wrench, *damped), {"_damped": _damped}

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """One factor for each derivative of the file, under the derivative's name."""
        return tuple(coefficient(name, f"derivative {name}") for name, _ in self.derivatives)

    def scaled(self, factors: Mapping[str, float]) -> Self:
        """Return a copy with the derivatives times the factors of the same names."""
        found = tuple((name, value * factors[name]) for name, value in self.derivatives)
        return dataclasses.replace(self, derivatives=found)
