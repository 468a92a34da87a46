"""Vehicle part: the interface that every type has, and the table of types.

A part is an actuator of the vehicle file with one activation, its position. The position follows
the command by d(position)/dt = clip((command - position) / lag, -rate, rate) within its travel.
The effect on the vehicle is written twice, for the MuJoCo twin (`native_*`) and for the Fossen
model (`fossen_*`); the two codes share only the parameters.
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
"""Any, in place of `twin.vehicle.vehicle.Vehicle`, whose module imports this one."""
VALUES = 24
"""Largest number of parameters that the kernels of a part read."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Losses:
    """Losses of drives and electronics; `twin.vehicle.consumption` gives the sources."""

    hotel_power: float = 0.3
    """[W] Electronics and sensors at all times: 0.29 in a Seaglider's dive"""
    surface_power: float = 0.0
    """[W] Additional power at the surface: radio, GPS, air pump"""
    payload_power: float = 0.0
    """[W] Sensors while they sample; a simulated vehicle's always do"""
    pump_efficiency: float = 0.36
    """Hydraulic over electrical power of the pump: 0.36 in that Seaglider's dive"""
    hull_vacuum: float = 3e4
    """[Pa] Vacuum inside the hull below sea-level pressure; the pump works against it too"""
    pump_loss: float = 0.0
    """[Pa] Energy lost per volume pumped out, at any depth: motor and gear"""
    pump_return: float = 0.0
    """[Pa] Energy used per volume let in: valve, or a motor that brakes the flow"""
    screw_efficiency: float = 0.4
    """Mechanical over electrical power of the battery's drives"""
    rail_friction: float = 0.1
    """[1] Friction of the sliding battery, divided by its weight"""
    bearing_torque: float = 0.2
    """[N m] Friction of the turning battery"""
    propeller_efficiency: float = 0.7
    """Mechanical over electrical power of a propeller's motor and gear"""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"consumption: {name} = {value} must be 0 or more")
            if name.endswith("_efficiency") and not 0.0 < value <= 1.0:
                raise InputError(f"consumption: {name} must be above 0 and at most 1")


class Move(NamedTuple):
    """Short moves of a part; each field is a number or has one value per move, shape (n,)."""

    before: ArrayLike
    """Position before the move, in the part's unit."""
    after: ArrayLike
    depth: ArrayLike
    """[m] Depth of the vehicle."""
    pitch: ArrayLike
    """[rad] Pitch of the vehicle."""
    duration: ArrayLike
    """[s] Duration of the move."""
    speed: ArrayLike = 0.0
    """[m/s] Surge through the water."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quantity:
    """Unit, scale and limits with which a store holds a part's position."""

    unit: str
    """Unit as CF writes it."""
    scale: float
    """Stored value per unit of the position: 180 / pi if a store has degrees."""
    long_name: str
    """Description without the part's name."""
    limits: tuple[float, float] | None = None
    """Lowest and highest stored value for all parts of the type, not only this vehicle's; None:
    the limits of the unit."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """One actuated part of a vehicle; `name` is the name of its actuator in the file."""

    kind: ClassVar[str] = ""
    """Name of the type in vehicle files."""
    unit: ClassVar[str] = ""
    """Unit of the position, as a person writes it."""
    quantity: ClassVar[Quantity]
    physics: ClassVar[int] = PHYSICS_VERSION
    """Version of the physics since which the part's effect is unchanged."""
    joint: ClassVar[str | None] = None
    """MJCF type of the joint that the part moves; None: it acts at a site."""
    one_way: ClassVar[bool] = False
    """True: the position never rises again."""
    spins: ClassVar[bool] = False
    """True: the position is a rate [rad/s]; pictures turn the part by its integral."""
    turn: ClassVar[int] = 50
    """Rank by which random manoeuvres sample the parts' commands, lowest first."""

    name: str
    low: float
    """Lower end of the travel, in `unit`."""
    high: float
    """Upper end of the travel, in `unit`."""
    lag: float
    """[s] Time constant of the first-order response."""
    rate: float
    """Largest rate, in `unit` per second."""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[m] Place where the part acts, body FRD about the CB."""

    # --- from the vehicle file ------------------------------------------------------------------

    @classmethod
    def read(cls, reader: MjcfReader, actuator: Element, name: str) -> Self:
        """Read the part of an actuator; raises VehicleError naming a missing or wrong number."""
        low, high = reader.vector(actuator, "actrange", 2).tolist()
        lag, rate = reader.vector(actuator, "dynprm", 2).tolist()
        own = dict(cls.own_parameters(reader, name))
        if cls.joint is None:
            own["position"] = tuple(reader.place(actuator.get("site", "")).tolist())
        return cls(name=name, low=low, high=high, lag=lag, rate=rate, **own)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """Fields that only this type has, from the `<numeric name="NAME.field">` elements."""
        return {}

    def problems(self) -> list[tuple[str, str]]:
        """Pairs of a field's name and the rule that it breaks."""
        rules = (
            ("lag (dynprm)", self.lag > 0.0, "positive"),
            ("rate (dynprm)", self.rate > 0.0, "positive"),
            ("actrange", self.low < self.high, "an increasing pair"),
        )
        return [(name, rule) for name, kept, rule in rules if not kept]

    # --- effect on the vehicle --------------------------------------------------------------------

    def values(self) -> tuple[float, ...]:
        """Parameters in the order in which both models' kernels read them, at most VALUES."""
        return ()

    native_volume: ClassVar[Kernel | None] = None
    """(values, position) -> displaced volume added [cm3]; None: no effect."""
    native_mass: ClassVar[Kernel | None] = None
    """(values, position) -> point mass [kg] added at the part's place; None: no effect."""
    native_wrench: ClassVar[Kernel | None] = None
    """(values, place (3), position, u, v, w, p, q, r, density, depth) -> X, Y, Z, K, M, N about
    the CB, body FRD. The motion is the CB's through the water; the depth [m] is the place's.
    None: no effect."""
    fossen_volume: ClassVar[Kernel | None] = None
    """Fossen model's `native_volume`, in separate code."""
    fossen_mass: ClassVar[Kernel | None] = None
    """Fossen model's `native_mass`, in separate code."""
    fossen_wrench: ClassVar[Kernel | None] = None
    """Fossen model's `native_wrench`, in separate code: a function of scalars, where `values` and
    `place` are arrays or tuples."""

    def displaced(self, position: float) -> float:
        """Volume [m3] added to the neutral one at a position; 0 without a kernel."""
        kernel = type(self).fossen_volume
        return 0.0 if kernel is None else 1e-6 * float(kernel(self._numbers[0], position))

    def wrench(self, position: float, nu_r: Array, density: float, depth: float) -> Array:
        """Force [N] and moment [N m] about the CB at a position, shape (6,); 0 without a kernel.

        Args:
          nu_r: motion through the water at the CB, shape (6,), body FRD [m/s, rad/s].
          density: [kg/m3]. depth: [m] of the part's place.
        """
        kernel = type(self).fossen_wrench
        if kernel is None:
            return np.zeros(6)
        motion = np.asarray(nu_r, dtype=np.float64).tolist()
        return np.array(kernel(*self._numbers, position, *motion, density, depth))

    @functools.cached_property
    def _numbers(self) -> tuple[Array, Array]:
        """`values` and `position` as arrays for the kernels."""
        return np.array(self.values()), np.array(self.position)

    # --- use by guidance --------------------------------------------------------------------------

    def controls(self) -> tuple[str, ...]:
        """Controls that the part can serve: of "pitch", "heading", "buoyancy", "speed"."""
        return ()

    @property
    def rest(self) -> float:
        """Position at which the part neither propels nor steers."""
        return min(max(0.0, self.low), self.high)

    @property
    def failsafe(self) -> float:
        """Position without commands: one that brings the vehicle up, or rest."""
        return self.rest

    @property
    def working(self) -> float:
        """Position around which the part works while the vehicle moves ahead."""
        return self.rest

    def effectiveness(self) -> Array:
        """Wrench per unit of position at 1 m/s ahead, deep in water of 1000 kg/m3, shape (6,).

        In N and N m per `unit`, body FRD about the CB, around the `working` position; 0 without a
        kernel.
        """
        ahead, step = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.01 * (self.high - self.low)
        more, less = (self.wrench(self.working + x, ahead, 1e3, 1e3) for x in (step, -step))
        return np.asarray((more - less) / (2.0 * step))

    def sense(self, axis: str) -> float:
        """+1 when a larger position raises pitch or turns to starboard, else -1."""
        return 1.0

    def mirrored(self) -> float | None:
        """Factor on the position when port and starboard are swapped: 1 or -1.

        None: the vehicle has no mirror image of the part, or the type does not define it.
        """
        return None

    # --- numbers that the file cannot give exactly ------------------------------------------------

    def uncertainties(self) -> tuple[Uncertainty, ...]:
        """Lag and largest rate; types with an encoder or coefficients add theirs."""
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

    # --- energy -----------------------------------------------------------------------------------

    def energy(self, vehicle: Carrier, move: Move, losses: Losses) -> Array:
        """Electrical energy [J] of short moves, shape of the moves; 0 unless a type defines it."""
        return np.zeros(np.shape(move.after))

    # --- random commands and display --------------------------------------------------------------

    @property
    def drawn_axis(self) -> tuple[float, float, float] | None:
        """Unit vector, body FRD, about which pictures turn the part's body in the vehicle file.

        None: pictures turn no body. A part on a joint needs none, as its body moves with the joint.
        """
        return None

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Sample a command for a manoeuvre; `heavy` is 1 in a dive and -1 in a climb."""
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return float(middle + 0.5 * half * rng.uniform(-1.0, 1.0))

    def text(self, value: float) -> str:
        """Text of a position for a person, with its unit."""
        if self.unit == "rad":
            return f"{math.degrees(value):.1f} deg"
        return f"{value:.4g} {self.unit}"

    def told(self, time: Array, positions: Array) -> dict[str, str]:
        """Summary rows of the part's motion after a flight: name and text.

        Args:
          time: [s], shape (n,). positions: in stored units, shape (n,).
        """
        low, high = float(positions.min()), float(positions.max())
        unit = self.quantity.unit
        return {f"{self.name} (min, max)": f"{low:z.4g}, {high:z.4g} {unit}"}

    @classmethod
    def flaw(cls, name: str) -> str:
        """Clause that names what a type lacks: each effect needs a kernel for both models."""
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
"""All types of vehicle part by name."""
register = PARTS.add
"""Register your own type of part; usable as a decorator."""
