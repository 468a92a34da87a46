"""Hull law: the water's force and moment on the bare hull, and the table of its types.

Each law is written twice, for the MuJoCo twin (`native_*`) and for the Fossen model (`fossen_*`).
The two codes share only the coefficients. Added mass is no part of a law: its matrix stands in the
vehicle file, and both models treat it by Kirchhoff's equations.
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
"""[m/s] Speed, a glider's, at which a law that is not purely quadratic is evaluated."""
Unrolled = tuple[tuple[str, ...], Mapping[str, Any]]
"""Nine expressions X, Y, Z, K, M, N, -dK/dp, -dM/dq, -dN/dr, and the functions that they call."""


class Polar(NamedTuple):
    """Forces and moment in a straight flow without sideslip, divided by speed squared."""

    drag: float
    """[N s2/m2] Force along the flow."""
    lift: float
    """[N s2/m2] Force across the flow, positive up."""
    moment: float
    """[N m s2/m2] Moment about the CB, positive nose up."""


def polar_of_wrench(wrench: Array, alpha: float) -> Polar:
    """Turn a wrench at UNIT_SPEED, shape (6,), into flow axes at an angle of attack [rad]."""
    ca, sa = math.cos(alpha), math.sin(alpha)
    x, z, m = wrench[[0, 2, 4]] / UNIT_SPEED**2
    return Polar(float(-x * ca - z * sa), float(x * sa - z * ca), float(m))


def straight_flow(alpha: float) -> Array:
    """Motion through the water at UNIT_SPEED and an angle of attack [rad], shape (6,)."""
    return np.array([math.cos(alpha), 0.0, math.sin(alpha), 0.0, 0.0, 0.0]) * UNIT_SPEED


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class HullLaw(abc.ABC):
    """Coefficients of one formula for the water's wrench on a hull."""

    kind: ClassVar[str] = ""
    """Name in vehicle files: `<text name="hull_law" data="...">`."""
    density_in_coefficients: ClassVar[bool] = True
    """True: the coefficients contain the vehicle's reference density, and both models scale the
    wrench by the water's density over it. False: the kernels use their argument `density`."""
    physics: ClassVar[int] = PHYSICS_VERSION
    """Version of the physics since which the law's values are unchanged."""
    native_wrench: ClassVar[Kernel | None] = None
    """(values, density, u, v, w, p, q, r) -> X, Y, Z, K, M, N [N, N m] about the CB, body FRD."""
    native_rate_damping: ClassVar[Kernel | None] = None
    """(values, timestep, density, u, v, w, p, q, r) -> timestep * d(K, M, N)/d(p, q, r), diagonal
    elements [kg m2]. A time-centred step does not extrapolate this part."""
    native_rotary_damping: ClassVar[Kernel | None] = None
    """(values, density, u, v, w, p, q, r) -> symmetric part of -d(K, M, N)/d(p, q, r) [N m s] as
    pp, pq, qq, pr, qr, rr, body FRD. Long time steps solve for it implicitly. It is optional and
    only saves time: without it the step takes difference quotients of `native_wrench`."""
    fossen_wrench: ClassVar[Kernel | None] = None
    """(values, density, u, v, w, p, q, r) -> X, Y, Z, K, M, N, written independently of
    `native_wrench`: a function of scalars, where `values` is an array or a tuple."""
    fossen_rate_damping: ClassVar[Kernel | None] = None
    """(values, density, u, v, w, p, q, r) -> approximate -dK/dp, -dM/dq, -dN/dr [N m s], which the
    batched Fossen model solves for. Without it difference quotients of `fossen_wrench` serve."""
    not_in_lanes: ClassVar[str] = ""
    """Reason why the batched Fossen model cannot fly the law; empty: it can."""

    @classmethod
    @abc.abstractmethod
    def read(cls, reader: MjcfReader) -> Self:
        """Read the law from a vehicle file; raises VehicleError naming a missing number."""

    @abc.abstractmethod
    def values(self) -> Array:
        """Coefficients in the order in which both kernels read them, shape (n,)."""

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of numbers that a file may hold for this law, besides those that all laws share."""
        return tuple(field.name for field in dataclasses.fields(cls))

    def fossen_unrolled(self) -> Unrolled | None:
        """Wrench and rate damping as expressions, for a law that loops over its terms; else None.

        The expressions' variables are c[0], c[1], ... (`values`), density, u, v, w, p, q, r.
        """
        return None

    def problems(self) -> list[tuple[str, str]]:
        """Pairs of a field's name and the rule that it breaks."""
        return []

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Coefficients that the file cannot give exactly; () when the law names none."""
        return ()

    def scaled(self, factors: Mapping[str, float]) -> Self:
        """Return a copy with coefficients times the factors, by the names of `uncertainties`."""
        return self

    def added_mass(self, reference_density: float) -> Array | None:
        """M_A (6, 6) when the law derives it from its geometry; None: the vehicle file gives it."""
        return None

    def with_drag(self, factor: float) -> Self | None:
        """Return a copy with the straight-flow drag times `factor`; None: not possible."""
        return None

    @property
    def turns_by_itself(self) -> bool:
        """True when the hull turns in a straight flow with every part at rest."""
        return False

    @property
    def valid_angle(self) -> float:
        """[rad] Largest flow angle at which the coefficients were identified."""
        return float(np.pi)

    def polar(self, alpha: float, density: float) -> Polar:
        """Drag, lift and pitch moment of the bare hull at an angle of attack [rad].

        Args:
          density: [kg/m3].
        """
        return polar_of_wrench(self.wrench(straight_flow(alpha), density), alpha)

    def wrench(self, nu_r: Array, density: float) -> Array:
        """Force [N] and moment [N m], shape (6,), at the motion `nu_r` through the water.

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
        """Clause that names the kernel a type lacks; empty when the type is complete."""
        needed = ("native_wrench", "native_rate_damping", "fossen_wrench")
        lacking = [kernel for kernel in needed if getattr(cls, kernel) is None]
        return f"it lacks `{lacking[0]}`" if lacking else ""


LAWS: Registry[type[HullLaw]] = seams.LAWS
"""All hull laws by name."""
register = LAWS.add
"""Register your own type of hull law; usable as a decorator."""
