"""Vehicle: what an MJCF file says about a vehicle, read by name.

The file is the only place where a vehicle's numbers live. It is parsed here without MuJoCo, so
that the Fossen model shares the parameters with the MuJoCo twin but none of its code.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import warnings
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError, unknown_name
from twin.frames import flip_vector
from twin.vehicle.assembly import (
    Follower,
    MovingMass,
    followers,
    idle_parts,
    named_controls,
    read_masses,
    read_parts,
    read_steering,
)
from twin.vehicle.changes import changed, differences, renamed
from twin.vehicle.laws import LAWS, FlowFrame, HullLaw
from twin.vehicle.laws.flow_frame import is_flow_frame
from twin.vehicle.mjcf import USER, MjcfReader
from twin.vehicle.parts import Part, Pump
from twin.vehicle.parts.base import Losses
from twin.vehicle.parts.pump import CUBIC_CM
from twin.vehicle.presets import (
    PRESETS,
    SEPARATOR,
    apply_preset,
    assets_folder,
    shipped_files,
    split_preset,
    unknown_vehicle,
    vehicle_text,
)
from twin.version import PHYSICS_VERSION

Array = NDArray[np.float64]
USUAL_GLIDE = (math.radians(30.0), 0.3)
"""[rad], [kg] of vehicles whose files do not say: the Sea-Wing's"""
LEVEL = 1e-6
"""[m] that rounding may put the centre of gravity above the centre of buoyancy"""
IDENTIFIED = ("hull_and_water", "sensor_errors", "identification", "pump_position")
"""Names of what `twin identify` writes into a vehicle file for itself"""
SPREAD = "spread."
"""Begins the names of the `<text>` elements that say what the factory draws for the vehicle."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Vehicle:
    """A hull, the masses that move in it and its parts; SI units, body axes FRD about the CB."""

    name: str
    """Name of its file."""
    path: Path
    xml: str
    """The MJCF text that everything below was read from."""
    gravity: float
    """[m/s2]"""
    reference_density: float
    """[kg/m3], inside the dimensional coefficients; the neutral volume is mass / this."""
    hull_length: float
    """[m]"""
    hull_diameter: float
    """[m]"""
    hull_compressibility: float
    """[1/Pa], relative volume lost per pressure."""
    hull_thermal_expansion: float = 0.0
    """[1/K], relative volume gained per temperature of the hull."""
    hull_thermal_lag: float = 200.0
    """[s], by which the hull's temperature follows the water's."""
    hull_reference_temperature: float = 10.0
    """[degree_Celsius], of the hull at which it displaces its neutral volume."""
    static_mass: float
    """[kg]"""
    static_cg: Array
    """[m], shape (3,)"""
    static_inertia: Array
    """[kg m2], shape (3, 3), about the static block's own CG."""
    masses: tuple[MovingMass, ...]
    """The masses that slides and hinges move."""
    parts: tuple[Part, ...]
    """In the order of the file's actuators, hence of every command and activation."""
    law: HullLaw
    """The water's force on the hull."""
    added_mass: Array
    """M_A, shape (6, 6), kg, kg m, kg m2, positive definite or semi-definite."""
    added_mass_coupling: bool = True
    """False when the law's coefficients hold the added mass's own coupling (Munk moment) already"""
    imu_position: Array
    """[m], shape (3,)"""
    gps_position: Array
    """[m], shape (3,)"""
    pitch_pid: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the pitching part per pitch error: gain, over s, times s; per rad."""
    heading_pid: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the turning part per heading error: gain, over s, times s; per rad."""
    trim_pid: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of a battery beside an elevator per pitch error in a hover, likewise."""
    depth_pid: tuple[float, float, float] | None = None
    """Pitch, nose down [rad], per depth error on level ways [m]: gain, over s, times s; None: the
    file has none"""
    buoyancy_pid: tuple[float, float, float] | None = None
    """Volume of the pump [cm3] less per depth error in a hover [m], likewise"""
    control_period: float
    """[s]"""
    cruise_speed: float = 0.0
    """[m/s] through the water that a propeller drives it at when a mission does not say"""
    steering: Mapping[str, str]
    """Name of the part that guidance uses for what it steers: the words of
    `twin.vehicle.assembly.STEERING` that the vehicle has a part for."""
    followers: tuple[Follower, ...] = ()
    """Parts that go along with those of `steering`: `twin.vehicle.assembly.followers`."""
    idle: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Parts that guidance leaves at rest, and the part that does what each could do."""
    usual_glide: tuple[float, float] = USUAL_GLIDE
    """Pitch [rad] and net mass [kg] of a usual dive, magnitudes; the net mass is that of missions
    that do not say theirs."""
    rated_depth: float | None = None
    """[m] that it is built for; None: the file does not say"""
    usual_mission: str = ""
    """Shipped mission for it when nobody names one; empty: by its parts."""
    summary: str = ""
    """Description in one line."""
    source: str = ""
    """Where its numbers are from, in one line."""
    spreads: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Distributions of the factory in place of its table: "PAPER; FIELD" by parameter"""

    def __post_init__(self) -> None:
        steep, net_mass = self.usual_glide
        names = (
            "reference_density", "hull_length", "hull_diameter", "static_mass", "control_period",
            "hull_thermal_lag",
        )  # fmt: skip
        positive = {name: getattr(self, name) for name in names}
        positive |= {f"mass of body {mass.name!r}": mass.mass for mass in self.masses}
        positive |= {"usual_glide: net mass": net_mass}
        positive |= {} if self.rated_depth is None else {"rated_depth": self.rated_depth}
        for name, value in positive.items():
            self._require(value > 0, name, "positive")
        self._require(self.gravity > 0, "gravity", "downward along MuJoCo's z axis")
        self._require(0.0 < steep < math.pi / 2, "usual_glide: pitch", "between 0 and pi/2 rad")
        for name, most, unit in (
            ("hull_compressibility", 1e-8, "1/Pa, a hull has some 5e-10"),
            ("hull_thermal_expansion", 1e-3, "1/K, a hull has some 7e-5"),
        ):
            rule = f"from 0 to {most:g} {unit}"
            self._require(0 <= getattr(self, name) <= most, name, rule)
        wrong = [(f"{p.name}: {name}", rule) for p in self.parts for name, rule in p.problems()]
        for name, rule in (*wrong, *self.law.problems()):
            self._require(False, name, rule)
        symmetric = np.allclose(self.added_mass, self.added_mass.T, rtol=1e-9, atol=1e-12)
        self._require(symmetric, "added_mass", "a symmetric 6x6 matrix")
        smallest = np.linalg.eigvalsh(self.added_mass)[0]
        self._require(smallest >= -1e-9, "added_mass", "positive semi-definite")

    def _require(self, condition: bool, name: str, rule: str) -> None:
        if not condition:
            raise VehicleError(f"vehicle {self.name!r} ({self.path}): {name} must be {rule}")

    def _repr_html_(self) -> str:
        """A table and the hull from the side, for notebooks."""
        from twin.notebook import card, hull

        rows = {
            "vehicle": self.summary or self.name,
            "mass": f"{self.mass:.4g} kg",
            "hull law": self.law.kind,
            "parts": ", ".join(self.part_names),
        }
        places = {p.name: (p.position[0], p.position[2]) for p in self.parts}
        return card(self.name, rows, hull(self.hull_length, self.hull_diameter, places))

    @property
    def model(self) -> str:
        """Name of the MJCF's model, which a vehicle made from a shipped file keeps."""
        return ElementTree.fromstring(self.xml).get("model", "")

    @property
    def physics_version(self) -> int:
        """Version of the physics by which it flies: the latest of what it is made of."""
        return max(self.law.physics, *(part.physics for part in self.parts), PHYSICS_VERSION)

    # --- masses and volumes -----------------------------------------------------------------------

    @property
    def mass(self) -> float:
        """Total mass [kg], constant: the pump moves oil, not mass, across the hull."""
        return self.static_mass + sum(mass.mass for mass in self.masses)

    @property
    def neutral_volume(self) -> float:
        """Displaced volume [m3] with its pumps at neutral and at zero pressure."""
        return self.mass / self.reference_density

    @property
    def battery(self) -> MovingMass:
        """Its one moving mass; raises VehicleError when it has none or several."""
        if len(self.masses) != 1:
            held = ", ".join(mass.name for mass in self.masses) or "none"
            raise VehicleError(
                f"vehicle {self.name!r} has {len(self.masses)} moving masses ({held}); this needs "
                "a vehicle with exactly one"
            )
        return self.masses[0]

    @property
    def flow_frame(self) -> FlowFrame:
        """Its hull law, when it is the flow-frame one; VehicleError for vehicles of other laws."""
        if not is_flow_frame(self.law):
            raise VehicleError(
                f"vehicle {self.name!r} has the hull law {self.law.kind!r}; this needs a glider "
                f"with lift and drag coefficients (hull law {FlowFrame.kind!r})"
            )
        return self.law

    def moved_by(self, part: str) -> MovingMass:
        """The mass that a slide or hinge moves; raises VehicleError when it moves none."""
        for mass in self.masses:
            if part in (mass.slide, mass.hinge):
                return mass
        raise VehicleError(f"vehicle {self.name!r}: part {part!r} moves no mass")

    def pump_for_net_mass(self, net_mass: float) -> float:
        """Position of its pump [cm3] that makes it `net_mass` [kg] heavy at reference density.

        Raises:
          VehicleError: it has no pump.
        """
        return -net_mass / self.reference_density / CUBIC_CM + self._pump.neutral

    def net_mass_for_pump(self, pump: float) -> float:
        """Net buoyancy mass [kg] at reference density and zero pressure, positive = heavy."""
        return -(pump - self._pump.neutral) * CUBIC_CM * self.reference_density

    @property
    def net_mass_range(self) -> tuple[float, float]:
        """Lightest (negative) and heaviest net mass [kg] at the ends of the pump's travel."""
        return self.net_mass_for_pump(self._pump.high), self.net_mass_for_pump(self._pump.low)

    @property
    def _pump(self) -> Pump:
        part = self.steered("buoyancy")
        if not isinstance(part, Pump):
            raise VehicleError(
                f"vehicle {self.name!r} has no pump to make it heavy or light; its parts: "
                f"{', '.join(self.part_names) or 'none'}"
            )
        return part

    @property
    def metacentric_height(self) -> float:
        """[m], CB above CG with the moving masses hanging down; negative: it turns over."""
        moments = self.static_mass * float(self.static_cg[2])
        return (moments + sum(m.mass * m.eccentricity for m in self.masses)) / self.mass

    # --- parts ------------------------------------------------------------------------------------

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the parts, in their order."""
        return tuple(part.name for part in self.parts)

    def part(self, name: str) -> Part:
        """The part of that name; raises VehicleError that offers the nearest."""
        for part in self.parts:
            if part.name == name:
                return part
        raise VehicleError(unknown_name(f"part of vehicle {self.name!r}", name, self.part_names))

    def steered(self, control: str) -> Part | None:
        """The part that guidance uses for "pitch", "heading", "buoyancy" or "speed"; or None."""
        name = self.steering.get(control)
        return None if name is None else self.part(name)

    def steered_index(self, control: str) -> int | None:
        """Place among the parts of what `steered` gives; None: the vehicle has none."""
        name = self.steering.get(control)
        return None if name is None else self.part_names.index(name)

    def allocated(self, position: Array, leads: Collection[str] | None = None) -> Array:
        """Positions of all parts, shape (parts,), when those that steer stand as in `position`.

        A part that goes along with another has its share of that one's way from rest added, and
        stops at the ends of its travel. `leads`: names of the parts that others follow; None: all.
        """
        going = [f for f in self.followers if leads is None or f.lead in leads]
        if not going:
            return position
        found, names, rest = np.array(position, dtype=np.float64), self.part_names, self.rest
        for follower in going:
            lead, part = names.index(follower.lead), names.index(follower.part)
            found[part] += follower.weight * (position[lead] - rest[lead])
        return np.clip(found, self.actuator_min, self.actuator_max)

    @property
    def actuator_min(self) -> Array:
        """Lower ends of travel, shape (parts,), each in its part's unit."""
        return np.array([part.low for part in self.parts])

    @property
    def actuator_max(self) -> Array:
        """Upper ends of travel, shape (parts,)."""
        return np.array([part.high for part in self.parts])

    @property
    def actuator_lag(self) -> Array:
        """[s], shape (parts,), first-order lags."""
        return np.array([part.lag for part in self.parts])

    @property
    def actuator_rate(self) -> Array:
        """Largest rates, shape (parts,), each in its part's unit per second."""
        return np.array([part.rate for part in self.parts])

    @property
    def rest(self) -> Array:
        """Positions at which nothing drives or steers, shape (parts,)."""
        return np.array([part.rest for part in self.parts])

    # --- copies -----------------------------------------------------------------------------------

    def replace(self, **changes: Any) -> Vehicle:
        """A copy with other parameters; `xml` keeps describing the original.

        Takes fields of the vehicle and of its hull law (`drag=...`), `battery` with a mapping of
        fields of its moving mass, and the name of a part with a mapping of that part's fields.

        Raises:
          VehicleError: nothing has such a name (the nearest is offered), or a value is impossible.
        """
        own = {field.name for field in dataclasses.fields(self)}
        of_law = {field.name for field in dataclasses.fields(self.law)}
        mine: dict[str, Any] = {}
        law: dict[str, Any] = {}
        parts = {part.name: part for part in self.parts}
        for name, value in changes.items():
            if name in own:
                mine[name] = value
            elif name in of_law:
                law[name] = value
            elif name == "battery":
                mine["masses"] = (changed(self.battery, value),)
            elif name in parts:
                parts[name] = changed(parts[name], value)
                mine["parts"] = tuple(parts.values())
            else:
                known = sorted({*own, *of_law, *parts, "battery"})
                raise VehicleError(unknown_name(f"field of vehicle {self.name!r}", name, known))
        if law:
            mine["law"] = dataclasses.replace(mine.get("law", self.law), **law)
        return dataclasses.replace(self, **mine)

    def with_law(self, kind: str) -> Vehicle:
        """A copy whose water acts by another hull law, read from the same file.

        Raises:
          VehicleError: unknown law, or the file lacks what it needs.
        """
        if kind == self.law.kind:
            return self
        law = LAWS[kind].read(MjcfReader(self.xml, self.path))
        mass = law.added_mass(self.reference_density)
        return self.replace(law=law, **({} if mass is None else {"added_mass": mass}))

    def changes(self) -> dict[str, Any]:
        """Differences from the MJCF text, as JSON-able numbers, lists and mappings."""
        of_file = parse_vehicle(self.xml, self.path)
        original = of_file.with_law(self.law.kind)
        found = differences(self, original, leave=("name", "path", "xml", "law", "parts", "masses"))
        if original is not of_file:
            found["hull_law"] = self.law.kind
        found.update(differences(self.law, original.law))
        moved: tuple[Any, ...] = (*self.parts, *self.masses)
        for mine, theirs in zip(moved, (*original.parts, *original.masses), strict=True):
            if differing := differences(mine, theirs):
                found["battery" if isinstance(mine, MovingMass) else mine.name] = differing
        return found

    def with_changes(self, changes: Mapping[str, Any]) -> Vehicle:
        """A copy with what `changes` of another copy returned, also in its form of version 1."""
        changes = dict(changes)
        vehicle = self
        if "hull_law" in changes:
            vehicle = vehicle.with_law(changes.pop("hull_law"))
        return vehicle.replace(**renamed(changes, vehicle.part_names, (vehicle, vehicle.law)))


def load_vehicle(vehicle: str | Path = "glider") -> Vehicle:
    """Read a vehicle by the name of a shipped file ("glider") or by the path of an MJCF file.

    Behind either, ":PRESET" chooses one of the file's other sets of numbers ("tethys:gazebo").

    Raises:
      VehicleError: unknown name or preset, unreadable file, missing or wrong element (named).
    """
    text, preset = split_preset(str(vehicle))
    if text.endswith(".xml") or "/" in text:
        path = Path(text)
        if not path.is_file():
            raise VehicleError(f"no vehicle file at {path}; give an existing MJCF file or a name")
    elif text in shipped_files():
        path = assets_folder() / f"{text}.xml"
    else:
        raise VehicleError(unknown_vehicle(str(vehicle)))
    xml = vehicle_text(path)
    if preset:
        derived = apply_preset(xml, path, preset)
        if derived != xml:
            xml, path = derived, path.with_name(f"{path.stem}{SEPARATOR}{preset}.xml")
    return parse_vehicle(xml, path)


@functools.lru_cache(maxsize=16)
def parse_vehicle(xml: str, path: Path) -> Vehicle:
    """Build a `Vehicle` from MJCF text; `path` names it in errors."""
    reader = MjcfReader(xml, path)
    hull = reader.body("hull")
    numeric, number = reader.numeric, reader.number
    parts = read_parts(reader)
    kind = reader.text("hull_law", FlowFrame.kind)
    if kind not in LAWS:
        raise VehicleError(f"vehicle file {path}: {unknown_name('hull_law', kind, LAWS)}")
    law = LAWS[kind].read(reader)
    reference_density = number("reference_density")
    added_mass = law.added_mass(reference_density)
    if added_mass is None:
        added_mass = np.array(numeric("added_mass", 36)).reshape(6, 6)
    gravity = reader.vector(reader.one("option"), "gravity", 3, default="0 0 -9.81")
    steering = read_steering(reader, parts)
    alone = named_controls(reader)
    shared = followers(parts, steering, alone)
    fields: dict[str, Any] = {
        f"{axis}_pid": numeric(f"{axis}_pid", 3)
        for axis in ("pitch", "heading", "trim")
        if axis in steering
    }
    for name, size in (("depth_pid", 3), ("buoyancy_pid", 3), ("usual_glide", 2)):
        if name in reader.numerics:
            fields[name] = numeric(name, size)
    if "rated_depth" in reader.numerics:
        fields["rated_depth"] = number("rated_depth")
    for name in ("hull_length", "hull_diameter", "hull_compressibility", "control_period"):
        fields[name] = number(name)
    for name in ("hull_thermal_expansion", "hull_thermal_lag", "hull_reference_temperature"):
        fields[name] = number(name, default=getattr(Vehicle, name))
    for name in ("usual_mission", "summary", "source"):
        fields[name] = reader.text(name, "")
    vehicle = Vehicle(
        name=path.stem,
        path=path,
        xml=xml,
        gravity=-float(gravity[2]),
        reference_density=reference_density,
        static_mass=float(reader.inertial(hull, "mass")[0]),
        static_cg=flip_vector(reader.inertial(hull, "pos")),
        static_inertia=reader.inertia(hull),
        masses=read_masses(reader, parts),
        parts=parts,
        law=law,
        added_mass=added_mass,
        added_mass_coupling=number("added_mass_coupling", default=1.0) != 0.0,
        imu_position=reader.place("imu"),
        gps_position=reader.place("gps"),
        cruise_speed=number("cruise_speed") if "speed" in steering else 0.0,
        steering=steering,
        followers=shared,
        idle=idle_parts(parts, steering, shared, alone),
        spreads={
            name.removeprefix(SPREAD): element.get("data", "")
            for name, element in reader.texts.items()
            if name.startswith(SPREAD)
        },
        **fields,
    )
    _refuse_unknown(reader)
    if vehicle.metacentric_height < -LEVEL:
        warnings.warn(
            f"vehicle {vehicle.name!r} ({path}): its centre of gravity is "
            f"{-1e3 * vehicle.metacentric_height:.2g} mm above its centre of buoyancy, so that it "
            "turns over at rest; vehicles have it some millimetres below (<inertial pos> of body "
            "'hull', the place of the moving mass)",
            RuntimeWarning,
            stacklevel=2,
        )
    return vehicle


def _refuse_unknown(reader: MjcfReader) -> None:
    """Raise VehicleError for a misspelt number or text; those of other hull laws may be there."""
    others = [name for law in LAWS.values() for name in law.names()]
    loops = ("pitch_pid", "heading_pid", "trim_pid", "depth_pid", "buoyancy_pid")
    known = ("added_mass", "cruise_speed", "rated_depth", "usual_glide", PRESETS)
    losses = [field.name for field in dataclasses.fields(Losses)]
    right = (*known, *loops, *IDENTIFIED, *losses, *others)
    reader.refuse_unknown(right, (SPREAD, SEPARATOR, USER))
