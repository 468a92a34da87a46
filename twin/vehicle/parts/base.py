"""What every kind of vehicle part says of itself: one interface for batteries, pumps and fins.

A part is an actuator of the vehicle file with one activation: its position, which follows the
command by d(position)/dt = clip((command - position) / lag, -rate, rate) inside its travel. What
it does to the vehicle is written twice, for the MuJoCo twin (`native_*`) and for the Fossen model
(`fossen_*`): two codes that share the parameters and nothing else.

The registry of vehicle parts, and what a kind must have to be one.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin import seams
from twin.registry import Registry
from twin.vehicle.changes import LAG_SPREAD, Uncertainty
from twin.version import PHYSICS_VERSION

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader


Array = NDArray[np.float64]
Kernel = Callable[..., Any]

VALUES = 24
"""Most parameters of a part that its kernels read."""


class Moved(Protocol):
    """What a part must know of the mass that it moves."""

    @property
    def mass(self) -> float:
        """[kg]"""

    @property
    def eccentricity(self) -> float:
        """[m] of its CG below the axis."""


class Carrier(Protocol):
    """What a part must know of the vehicle that carries it; see `twin.vehicle.vehicle.Vehicle`."""

    @property
    def gravity(self) -> float:
        """[m/s2]"""

    @property
    def reference_density(self) -> float:
        """[kg/m3]"""

    def moved_by(self, part: str) -> Moved:
        """The mass that a slide or hinge moves."""

    def pump_for_net_mass(self, net_mass: float) -> float:
        """Position of its pump [cm3] for a net mass [kg]."""


LOSSES = (
    "pump_efficiency", "hull_vacuum", "screw_efficiency", "rail_friction", "bearing_torque",
    "propeller_efficiency", "hotel_power", "surface_power", "payload_power", "pump_loss",
    "pump_return",
)  # fmt: skip
"""Names of a file's numbers that say what its drives and electronics take"""


class Losses(Protocol):
    """What the drives of a vehicle lose; see `twin.vehicle.consumption.Consumption`."""

    @property
    def pump_efficiency(self) -> float:
        """Hydraulic over electrical power of a pump."""

    @property
    def pump_loss(self) -> float:
        """[Pa] energy over the volume that is pumped out, at any depth."""

    @property
    def pump_return(self) -> float:
        """[Pa] energy over the volume that is let in."""

    @property
    def hull_vacuum(self) -> float:
        """[Pa] below the sea-level pressure inside the hull."""

    @property
    def screw_efficiency(self) -> float:
        """Mechanical over electrical power of a battery's drive."""

    @property
    def rail_friction(self) -> float:
        """Friction over weight of a sliding mass."""

    @property
    def bearing_torque(self) -> float:
        """[N m] friction of a turning mass."""

    @property
    def propeller_efficiency(self) -> float:
        """Mechanical over electrical power of a propeller's motor."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quantity:
    """How a store shows a part's position."""

    unit: str
    """as CF writes it"""
    scale: float
    """stored value per unit of the position: 180 / pi where a store has degrees"""
    long_name: str
    """without the part's name"""
    limits: tuple[float, float] | None = None
    """lowest and highest stored value that any such part can have, not only this vehicle's; None:
    those of its unit"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """One actuated part of a vehicle; `name` is that of its actuator in the file."""

    kind: ClassVar[str] = ""
    """Name of the kind in vehicle files."""
    unit: ClassVar[str] = ""
    """of its position, as a person writes it"""
    quantity: ClassVar[Quantity]
    physics: ClassVar[int] = PHYSICS_VERSION
    """Version of the physics since which it flies as it does"""
    joint: ClassVar[str | None] = None
    """MJCF type of the joint that it drives, None: it acts at a site"""
    one_way: ClassVar[bool] = False
    """True: its position never rises again"""
    spins: ClassVar[bool] = False
    """True: its position is a rate [rad/s], and it is drawn turned by the integral of it"""
    turn: ClassVar[int] = 50
    """Place in the order in which random manoeuvres draw a command for each part."""

    name: str
    low: float
    """end of its travel, in `unit`"""
    high: float
    """end of its travel, in `unit`"""
    lag: float
    """[s] of its first-order response"""
    rate: float
    """largest rate, in `unit` per second"""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[m], body FRD about the CB: where it acts"""

    # --- from the vehicle file ------------------------------------------------------------------

    @classmethod
    def read(cls, reader: MjcfReader, actuator: Element, name: str) -> Self:
        """The part of an actuator; raises VehicleError naming what is missing or wrong."""
        low, high = reader.vector(actuator, "actrange", 2)
        lag, rate = reader.vector(actuator, "dynprm", 2)
        common = {"low": low, "high": high, "lag": lag, "rate": rate}
        return cls(
            name=name,
            position=cls._place(reader, actuator),
            **{key: float(value) for key, value in common.items()},
            **cls.own_parameters(reader, name),
        )

    @classmethod
    def _place(cls, reader: MjcfReader, actuator: Element) -> tuple[float, float, float]:
        if cls.joint is not None:
            return (0.0, 0.0, 0.0)
        x, y, z = (float(value) for value in reader.place(actuator.get("site", "")))
        return (x, y, z)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Fields that only this kind has, from the `<numeric name="NAME.field">` elements."""
        return {}

    def problems(self) -> list[tuple[str, str]]:
        """What is wrong with it: pairs of a field's name and the rule that it breaks."""
        found = []
        if not self.lag > 0.0:
            found.append(("lag (dynprm)", "positive"))
        if not self.rate > 0.0:
            found.append(("rate (dynprm)", "positive"))
        if not self.low < self.high:
            found.append(("actrange", "an increasing pair"))
        return found

    # --- what it does ---------------------------------------------------------------------------

    def values(self) -> tuple[float, ...]:
        """Its parameters as both models' kernels read them, at most VALUES."""
        return ()

    native_volume: ClassVar[Kernel | None] = None
    """(values, position) -> displaced volume added [cm3]; None: none"""
    native_mass: ClassVar[Kernel | None] = None
    """(values, position) -> point mass [kg] added at its place; None: none"""
    native_wrench: ClassVar[Kernel | None] = None
    """(values, place (3), position, u, v, w, p, q, r, density, depth) -> X, Y, Z, K, M, N about
    the CB, body FRD; the motion is that through the water at the CB, the depth [m] that of its
    place. None: none"""
    fossen_volume: ClassVar[Kernel | None] = None
    """As `native_volume`."""
    fossen_mass: ClassVar[Kernel | None] = None
    """As `native_mass`."""
    fossen_wrench: ClassVar[Kernel | None] = None
    """As `native_wrench`, in code of its own: a function of scalars, where `values` and `place` are
    arrays or tuples."""

    def displaced(self, position: float) -> float:
        """Volume [m3] that it adds to the neutral one at a position; 0 without a kernel."""
        kernel = type(self).fossen_volume
        return 0.0 if kernel is None else 1e-6 * float(kernel(self._numbers[0], position))

    def wrench(self, position: float, nu_r: Array, density: float, depth: float) -> Array:
        """Force [N] and moment [N m] about the CB at a position, shape (6,); 0 without a kernel.

        Args:
          nu_r: motion through the water at the CB, shape (6,), body FRD [m/s, rad/s].
          density: [kg/m3]. depth: [m] of its place.
        """
        kernel = type(self).fossen_wrench
        if kernel is None:
            return np.zeros(6)
        motion = np.asarray(nu_r, dtype=np.float64).tolist()
        return np.array(kernel(*self._numbers, position, *motion, density, depth))

    @functools.cached_property
    def _numbers(self) -> tuple[Array, Array]:
        """`values` and `position` as kernels read them."""
        return np.array(self.values()), np.array(self.position)

    # --- what guidance may do with it -----------------------------------------------------------

    def controls(self) -> tuple[str, ...]:
        """What guidance can use it for: of "pitch", "heading", "buoyancy", "speed"."""
        return ()

    @property
    def rest(self) -> float:
        """The position at which it neither drives nor steers."""
        return min(max(0.0, self.low), self.high)

    @property
    def failsafe(self) -> float:
        """The position that it takes when nobody commands any more: one that brings the vehicle up,
        or rest."""
        return self.rest

    @property
    def working(self) -> float:
        """The position about which it works while the vehicle goes ahead."""
        return self.rest

    def effectiveness(self) -> Array:
        """Wrench per unit of its position at 1 m/s ahead, deep in water of 1000 kg/m3, shape (6,).

        In N and N m, body FRD about the CB, about the position at which it works; 0 without a
        kernel.
        """
        ahead, step = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.01 * (self.high - self.low)
        more, less = (self.wrench(self.working + x, ahead, 1e3, 1e3) for x in (step, -step))
        return np.asarray((more - less) / (2.0 * step))

    def sense(self, axis: str) -> float:
        """+1 when a larger position raises pitch or turns to starboard, -1 when it does not."""
        return 1.0

    def mirrored(self) -> float | None:
        """What the mirror port to starboard makes of its position: 1 or -1 times it.

        None: the vehicle has no mirror image of it, or its kind does not say.
        """
        return None

    # --- what its file cannot say exactly -------------------------------------------------------

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Its lag and largest rate; kinds with an encoder or coefficients add theirs."""
        return (
            Uncertainty(
                name="lag",
                field="lag",
                spread=LAG_SPREAD,
                long_name=f"factor on the lag of the {self.name}",
                why="lags are rarely published",
            ),
            Uncertainty(
                name="rate",
                field="rate",
                spread=LAG_SPREAD,
                long_name=f"factor on the largest rate of the {self.name}",
                why="largest rates are rarely published",
            ),
        )

    # --- what it takes --------------------------------------------------------------------------

    def energy(
        self,
        vehicle: Carrier,
        before: ArrayLike,
        after: ArrayLike,
        losses: Losses,
        *,
        depth: ArrayLike,
        pitch: ArrayLike,
        duration: ArrayLike,
    ) -> Array:
        """Electrical energy [J] of short moves between two positions; 0 unless a kind says.

        Everything is a number or one per move, shape (n,). depth: [m]. pitch: [rad].
        duration: [s]. A kind that `spins` is also given `speed`: [m/s] of surge through the water.
        """
        return np.zeros(np.shape(after))

    # --- what is drawn and shown ----------------------------------------------------------------

    @property
    def drawn_axis(self) -> tuple[float, float, float] | None:
        """Unit vector, body FRD, about which pictures turn the body of the file that has its name.

        None: they turn none; what drives a joint moves with its joint.
        """
        return None

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """A random command for a manoeuvre that is `heavy` (1 dives, -1 climbs)."""
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return float(middle + 0.5 * half * rng.uniform(-1.0, 1.0))

    def text(self, value: float) -> str:
        """A position as a person reads it, with its unit."""
        if self.unit == "rad":
            return f"{math.degrees(value):.1f} deg"
        return f"{value:.4g} {self.unit}"

    def told(self, time: Array, positions: Array) -> dict[str, str]:
        """How it moved, as a person reads it after a flight: a row's name and text.

        Args:
          time: [s], shape (n,). positions: in stored units, shape (n,).
        """
        low, high = float(positions.min()), float(positions.max())
        unit = self.quantity.unit
        return {f"{self.name} (min, max)": f"{low:z.4g}, {high:z.4g} {unit}"}

    @classmethod
    def flaw(cls, name: str) -> str:
        """What a kind lacks: each effect must be there for both models."""
        if not isinstance(getattr(cls, "quantity", None), Quantity):
            return "it lacks `quantity`: how a store shows its position"
        shared = {field.name for field in dataclasses.fields(Part)}
        own = [field.name for field in dataclasses.fields(cls) if field.name not in shared]
        if own and cls.values is Part.values:
            return f"it lacks `values`: by it {', '.join(own)} reach its kernels"
        for effect in ("volume", "mass", "wrench"):
            native, fossen = (getattr(cls, f"{model}_{effect}") for model in ("native", "fossen"))
            if (native is None) != (fossen is None):
                absent = f"{'fossen' if fossen is None else 'native'}_{effect}"
                return f"it lacks `{absent}`: both models must have its {effect}, in own code"
        return ""


PARTS: Registry[type[Part]] = seams.PARTS
"""Every vehicle part, by name."""

register = PARTS.add
"""Add a kind of one's own; usable as a decorator."""
