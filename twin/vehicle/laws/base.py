"""Hull law: the force and moment of the water on the bare hull, and the registry of kinds.

The law is written twice, for the MuJoCo twin (`native_*`) and for the Fossen model (`fossen_*`):
two codes that share the coefficients and nothing else. Added mass is not part of it: its matrix
stands in the vehicle file, and both models treat it as Kirchhoff's equations say.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from twin import seams
from twin.registry import Registry
from twin.vehicle.changes import Uncertainty
from twin.version import PHYSICS_VERSION

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader


Array = NDArray[np.float64]
Kernel = Callable[..., Any]
UNIT_SPEED = 0.3
"""[m/s] at which a law that is not purely quadratic is evaluated: a glider's"""
Unrolled = tuple[tuple[str, ...], Mapping[str, Any]]
"""Nine expressions, X, Y, Z, K, M, N, -dK/dp, -dM/dq, -dN/dr, and the functions that they call."""


class Polar(NamedTuple):
    """Forces of a straight flow without sideslip over speed squared."""

    drag: float
    """[N s2/m2], along the flow"""
    lift: float
    """[N s2/m2], across it, up"""
    moment: float
    """[N m s2/m2] about the CB, nose up"""


def polar_of_wrench(wrench: Array, alpha: float) -> Polar:
    """Turn the wrench at UNIT_SPEED and an angle of attack [rad], shape (6,), into the flow."""
    ca, sa = math.cos(alpha), math.sin(alpha)
    x, z, m = wrench[[0, 2, 4]] / UNIT_SPEED**2
    return Polar(float(-x * ca - z * sa), float(x * sa - z * ca), float(m))


def straight_flow(alpha: float) -> Array:
    """Motion through the water at UNIT_SPEED and an angle of attack [rad], shape (6,)."""
    return np.array([math.cos(alpha), 0.0, math.sin(alpha), 0.0, 0.0, 0.0]) * UNIT_SPEED


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class HullLaw(abc.ABC):
    """Coefficients of one way to write the water's wrench on a hull."""

    kind: ClassVar[str] = ""
    """Name in vehicle files: `<text name="hull_law" data="...">`."""
    density_in_coefficients: ClassVar[bool] = True
    """True: the coefficients hold the vehicle's reference density, and both models scale the
    wrench by the water's density over it; False: the kernels use the density that they are given"""
    physics: ClassVar[int] = PHYSICS_VERSION
    """Version of the physics since which it flies as it does"""
    native_wrench: ClassVar[Kernel | None] = None
    """(values, density, u, v, w, p, q, r) -> X, Y, Z, K, M, N [N, N m] about the CB, body FRD"""
    native_rate_damping: ClassVar[Kernel | None] = None
    """(values, timestep, density, u, v, w, p, q, r) -> timestep * d(K, M, N)/d(p, q, r), each its
    own [kg m2]: what a time-centred step must not extrapolate"""
    native_rotary_damping: ClassVar[Kernel | None] = None
    """(values, density, u, v, w, p, q, r) -> symmetric part of -d(K, M, N)/d(p, q, r) [N m s] as
    pp, pq, qq, pr, qr, rr, body FRD: what a step solves for that is long beside it. It takes no
    more than it costs: without it the difference quotient of `native_wrench` does"""
    fossen_wrench: ClassVar[Kernel | None] = None
    """(values, density, u, v, w, p, q, r) -> X, Y, Z, K, M, N, in code of its own: a function of
    scalars, where `values` is an array or a tuple"""
    fossen_rate_damping: ClassVar[Kernel | None] = None
    """(values, density, u, v, w, p, q, r) -> -dK/dp, -dM/dq, -dN/dr [N m s], about: what a step of
    the Fossen model in lanes solves for. Without it difference quotients of `fossen_wrench` do"""
    not_in_lanes: ClassVar[str] = ""
    """Why the Fossen model does not fly it in lanes; empty: it does"""

    @classmethod
    @abc.abstractmethod
    def read(cls, reader: MjcfReader) -> Self:
        """The law of a vehicle file; raises VehicleError naming what is missing."""

    @abc.abstractmethod
    def values(self) -> Array:
        """Its coefficients as both kernels read them, shape (n,)."""

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of numbers that a file may hold for it, besides those that every law shares."""
        return tuple(field.name for field in dataclasses.fields(cls))

    def fossen_unrolled(self) -> Unrolled | None:
        """Wrench and rate damping as expressions, for a law that loops over its terms; else None.

        They are in c[0], c[1], ... (`values`), density, u, v, w, p, q, r.
        """
        return None

    def problems(self) -> list[tuple[str, str]]:
        """Pairs of a field's name and the rule that it breaks."""
        return []

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """The coefficients that the file cannot say exactly; () when the law names none."""
        return ()

    def scaled(self, factors: Mapping[str, float]) -> Self:
        """A copy with its coefficients times the factors, by the names of `uncertainties`."""
        return self

    def added_mass(self, reference_density: float) -> Array | None:
        """M_A (6, 6) when the law knows it from its geometry; None: the vehicle file says it."""
        return None

    def with_drag(self, factor: float) -> Self | None:
        """A copy with so many times the drag of a straight flow; None: it has no such number."""
        return None

    @property
    def turns_by_itself(self) -> bool:
        """Whether its hull turns with every part at rest, in a straight flow."""
        return False

    @property
    def valid_angle(self) -> float:
        """[rad] up to which flow angles its coefficients were identified."""
        return float(np.pi)

    def polar(self, alpha: float, density: float) -> Polar:
        """Drag, lift and pitch moment of the bare hull at an angle of attack [rad].

        Args:
          density: [kg/m3].
        """
        return polar_of_wrench(self.wrench(straight_flow(alpha), density), alpha)

    def wrench(self, nu_r: Array, density: float) -> Array:
        """Force [N] and moment [N m], shape (6,), at the motion through the water `nu_r`.

        Args:
          nu_r: surge, sway, heave [m/s], roll, pitch, yaw rate [rad/s], shape (6,), body FRD.
          density: [kg/m3].
        """
        kernel = type(self).fossen_wrench
        assert kernel is not None
        motion = np.asarray(nu_r, dtype=np.float64)
        return np.array(kernel(self.values(), float(density), *motion.tolist()))

    @classmethod
    def flaw(cls, name: str) -> str:
        """Clause that says what a kind lacks for both models; empty where it is whole."""
        needed = ("native_wrench", "native_rate_damping", "fossen_wrench")
        lacking = [kernel for kernel in needed if getattr(cls, kernel) is None]
        return f"it lacks `{lacking[0]}`" if lacking else ""


LAWS: Registry[type[HullLaw]] = seams.LAWS
"""Every hull law, by name."""
register = LAWS.add
"""Add a kind of one's own; usable as a decorator."""
