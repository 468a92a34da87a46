"""Vehicle part: the interface that every kind has, and the registry of kinds.

A part is an actuator of the vehicle file with one activation: its position, which follows the
command by d(position)/dt = clip((command - position) / lag, -rate, rate) inside its travel. What
it does to the vehicle is written twice, for the MuJoCo twin (`native_*`) and for the Fossen model
(`fossen_*`): two codes that share the parameters and nothing else.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin import seams
from twin.errors import InputError
from twin.registry import Registry
from twin.vehicle.changes import LAG_SPREAD, Uncertainty
from twin.version import PHYSICS_VERSION

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader

Array = NDArray[np.float64]
Kernel = Callable[..., Any]
Carrier = Any
"""A `twin.vehicle.vehicle.Vehicle`, whose file imports this one."""
VALUES = 24
"""Most parameters of a part that its kernels read."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Losses:
    """Losses of drives and electronics; `twin.vehicle.consumption` has the sources."""

    hotel_power: float = 0.3
    """[W] electronics and sensors, all the time: 0.29 in a Seaglider's dive"""
    surface_power: float = 0.0
    """[W] beside it at the surface: radio, GPS, air pump"""
    payload_power: float = 0.0
    """[W] of sensors while they sample; a simulated vehicle's always do"""
    pump_efficiency: float = 0.36
    """hydraulic over electrical power of the pump: 0.36 in that dive"""
    hull_vacuum: float = 3e4
    """[Pa] below the sea-level pressure inside the hull; the pump works against it too"""
    pump_loss: float = 0.0
    """[Pa] energy over the volume that is pumped out, at any depth: motor and gear"""
    pump_return: float = 0.0
    """[Pa] energy over the volume that is let in: valve, or the motor that holds it back"""
    screw_efficiency: float = 0.4
    """mechanical over electrical power of the battery's drives"""
    rail_friction: float = 0.1
    """friction over weight of the sliding battery"""
    bearing_torque: float = 0.2
    """[N m] friction of the turning battery"""
    propeller_efficiency: float = 0.7
    """mechanical over electrical power of a propeller's motor and gear"""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"consumption: {name} = {value} must be 0 or more")
            if name.endswith("_efficiency") and not 0.0 < value <= 1.0:
                raise InputError(f"consumption: {name} must be above 0 and at most 1")


class Move(NamedTuple):
    """Short moves of a part, each field a number or one per move, shape (n,)."""

    before: ArrayLike
    """position, in the part's unit"""
    after: ArrayLike
    depth: ArrayLike
    """[m]"""
    pitch: ArrayLike
    """[rad]"""
    duration: ArrayLike
    """[s]"""
    speed: ArrayLike = 0.0
    """[m/s] of surge through the water"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quantity:
    """Quantity by which a store shows a part's position."""

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
        low, high = reader.vector(actuator, "actrange", 2).tolist()
        lag, rate = reader.vector(actuator, "dynprm", 2).tolist()
        own = dict(cls.own_parameters(reader, name))
        if cls.joint is None:
            own["position"] = tuple(reader.place(actuator.get("site", "")).tolist())
        return cls(name=name, low=low, high=high, lag=lag, rate=rate, **own)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Fields that only this kind has, from the `<numeric name="NAME.field">` elements."""
        return {}

    def problems(self) -> list[tuple[str, str]]:
        """Pairs of a field's name and the rule that it breaks."""
        rules = (
            ("lag (dynprm)", self.lag > 0.0, "positive"),
            ("rate (dynprm)", self.rate > 0.0, "positive"),
            ("actrange", self.low < self.high, "an increasing pair"),
        )
        return [(name, rule) for name, kept, rule in rules if not kept]

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
        """Controls that guidance can use it for: of "pitch", "heading", "buoyancy", "speed"."""
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
        """Factor on its position in the mirror port to starboard: 1 or -1.

        None: the vehicle has no mirror image of it, or its kind does not say.
        """
        return None

    # --- what its file cannot say exactly -------------------------------------------------------

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Its lag and largest rate; kinds with an encoder or coefficients add theirs."""
        return tuple(
            Uncertainty(
                name=field,
                field=field,
                spread=LAG_SPREAD,
                long_name=f"factor on the {words} of the {self.name}",
                why=f"{words}s are rarely published",
            )
            for field, words in (("lag", "lag"), ("rate", "largest rate"))
        )

    # --- what it takes --------------------------------------------------------------------------

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Electrical energy [J] of short moves, shape of the moves; 0 unless a kind says."""
        return np.zeros(np.shape(move.after))

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
        """Summary of its motion after a flight: a row's name and text.

        Args:
          time: [s], shape (n,). positions: in stored units, shape (n,).
        """
        low, high = float(positions.min()), float(positions.max())
        unit = self.quantity.unit
        return {f"{self.name} (min, max)": f"{low:z.4g}, {high:z.4g} {unit}"}

    @classmethod
    def flaw(cls, name: str) -> str:
        """Clause that says what a kind lacks: each effect must be there for both models."""
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
