"""Vehicle: the parameters of a vehicle, read by name from its MJCF file.

All numbers of a vehicle stand in that file. This module parses the file without MuJoCo, so that
the Fossen model shares the parameters with the MuJoCo twin but none of its code.
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
    thrust_weights,
)
from twin.vehicle.changes import changed, differences, renamed
from twin.vehicle.laws import LAWS, FlowFrame, HullLaw
from twin.vehicle.laws.flow_frame import is_flow_frame
from twin.vehicle.mjcf import USER, MjcfReader, field_texts
from twin.vehicle.parts import PARTS, Part, Pump, Thruster
from twin.vehicle.parts.base import Losses
from twin.vehicle.parts.pump import CUBIC_CM
from twin.vehicle.plain import without_plain
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
"""[rad], [kg] Pitch and net mass of a usual dive where the file gives none: the Sea-Wing's."""
LEVEL = 1e-6
"""[m] Rounding error allowed in the centre of gravity's height above the centre of buoyancy."""
IDENTIFIED = ("hull_and_water", "sensor_errors", "identification", "pump_position")
"""Names of the numbers and texts that `twin identify` adds to a vehicle file for its own use."""
OPTIONAL = {
    "depth_pid": 3, "buoyancy_pid": 3, "usual_glide": 2, "station_pid": 12, "rated_depth": 1
}  # fmt: skip
"""Count of numbers of what a file may leave out; a field's docstring says what then holds."""
SPREAD = "spread."
"""Prefix of the `<text>` elements that give the factory's distributions for this vehicle."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Vehicle:
    """Hull, moving masses and parts of a vehicle; SI units, body axes FRD about the CB."""

    name: str
    """Name of the vehicle file, without its suffix."""
    path: Path
    xml: str
    """MJCF text from which all fields below were read, without the set for plain MuJoCo."""
    gravity: float
    """[m/s2] Gravity, positive down."""
    reference_density: float
    """[kg/m3] Density inside the dimensional coefficients; neutral volume = mass / density."""
    hull_length: float
    """[m] Length of the hull."""
    hull_diameter: float
    """[m] Diameter of the hull."""
    hull_compressibility: float
    """[1/Pa] Relative volume lost per unit of pressure."""
    hull_thermal_expansion: float = 0.0
    """[1/K] Relative volume gained per kelvin of hull temperature."""
    hull_thermal_lag: float = 200.0
    """[s] Time constant with which the hull's temperature follows the water's."""
    hull_reference_temperature: float = 10.0
    """[degree_Celsius] Hull temperature at which the hull displaces its neutral volume."""
    static_mass: float
    """[kg] Mass of the static block: the hull without the moving masses."""
    static_cg: Array
    """[m] CG of the static block, shape (3,)."""
    static_inertia: Array
    """[kg m2] Inertia of the static block about its own CG, shape (3, 3)."""
    masses: tuple[MovingMass, ...]
    """Masses that slides and hinges move."""
    parts: tuple[Part, ...]
    """Parts in the order of the file's actuators, hence of commands and activations."""
    law: HullLaw
    """Law of the water's force and moment on the bare hull."""
    added_mass: Array
    """[kg, kg m, kg m2] Added mass M_A, shape (6, 6), positive definite or semi-definite."""
    added_mass_coupling: bool = True
    """False: the law's coefficients already contain the added mass's coupling (Munk moment)."""
    imu_position: Array
    """[m] Place of the IMU, shape (3,)."""
    gps_position: Array
    """[m] Place of the GPS antenna, shape (3,)."""
    pitch_pid: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Gains P, I [1/s], D [s]: pitch error [rad] to position of the pitching part."""
    heading_pid: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Gains P, I [1/s], D [s]: heading error [rad] to position of the turning part."""
    trim_pid: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Gains P, I [1/s], D [s]: pitch error in a hover [rad] to battery slide, next to an elevator
    that pitches the vehicle under way."""
    depth_pid: tuple[float, float, float] | None = None
    """Gains P, I [1/s], D [s]: depth error on level legs [m] to nose-down pitch [rad], or None."""
    buoyancy_pid: tuple[float, float, float] | None = None
    """Gains P, I [1/s], D [s]: depth error in a hover [m] to decrease of pump volume [cm3]."""
    station_pid: tuple[float, ...] | None = None
    """Gains P, I, D of horizontal force [N/m ...], vertical force, yaw moment [N m/rad ...] and of
    the moments that hold roll and pitch level, with which thrusters hold a pose; 12 numbers."""
    control_period: float
    """[s] Time between two control ticks of guidance."""
    cruise_speed: float = 0.0
    """[m/s] Speed through the water under propeller where the mission gives none."""
    steering: Mapping[str, str]
    """Part that guidance moves, by control of `twin.vehicle.assembly.STEERING`; a control without a
    part is absent."""
    followers: tuple[Follower, ...] = ()
    """Parts that move with those of `steering`: see `twin.vehicle.assembly.followers`."""
    idle: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Part that steers in place of each idle part, by the idle part's name."""
    usual_glide: tuple[float, float] = USUAL_GLIDE
    """[rad], [kg] Magnitudes of pitch and net mass in a usual dive; missions without a net mass
    take this one."""
    rated_depth: float | None = None
    """[m] Depth that the vehicle is built for; None: not in the file."""
    usual_mission: str = ""
    """Shipped mission for a user who names none; empty: chosen by the vehicle's parts."""
    summary: str = ""
    """Description in one line."""
    source: str = ""
    """Source of the numbers, in one line."""
    spreads: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Distributions of the factory's presets paper and field, "PAPER; FIELD", by parameter."""

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
        """Return a table and a side view of the hull for notebooks."""
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
        """Model name in the MJCF; a vehicle derived from a shipped file keeps it."""
        return ElementTree.fromstring(self.xml).get("model", "")

    @property
    def physics_version(self) -> int:
        """Version of the physics by which the vehicle flies: the latest of its law and parts."""
        return max(self.law.physics, *(part.physics for part in self.parts), PHYSICS_VERSION)

    # --- masses and volumes -----------------------------------------------------------------------

    @property
    def mass(self) -> float:
        """Total mass [kg], constant: the pump moves oil, but no mass leaves the vehicle."""
        return self.static_mass + sum(mass.mass for mass in self.masses)

    @property
    def neutral_volume(self) -> float:
        """Displaced volume [m3] with the pumps at neutral and at zero pressure."""
        return self.mass / self.reference_density

    @property
    def battery(self) -> MovingMass:
        """The only moving mass; raises VehicleError when the vehicle has none or several."""
        if len(self.masses) != 1:
            held = ", ".join(mass.name for mass in self.masses) or "none"
            raise VehicleError(
                f"vehicle {self.name!r} has {len(self.masses)} moving masses ({held}); this needs "
                "a vehicle with exactly one"
            )
        return self.masses[0]

    @property
    def flow_frame(self) -> FlowFrame:
        """Hull law if it is the flow-frame law; raises VehicleError for other laws."""
        if not is_flow_frame(self.law):
            raise VehicleError(
                f"vehicle {self.name!r} has the hull law {self.law.kind!r}; this needs a glider "
                f"with lift and drag coefficients (hull law {FlowFrame.kind!r})"
            )
        return self.law

    def moved_by(self, part: str) -> MovingMass:
        """Mass that a slide or hinge moves; raises VehicleError when it moves none."""
        for mass in self.masses:
            if part in (mass.slide, mass.hinge):
                return mass
        raise VehicleError(f"vehicle {self.name!r}: part {part!r} moves no mass")

    def pump_for_net_mass(self, net_mass: float) -> float:
        """Pump position [cm3] at which the vehicle has `net_mass` [kg] at its reference density.

        Raises:
          VehicleError: the vehicle has no pump.
        """
        return -net_mass / self.reference_density / CUBIC_CM + self._pump.neutral

    def net_mass_for_pump(self, pump: float) -> float:
        """Net mass [kg] at a pump position [cm3], reference density, zero pressure; + is heavy."""
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
        """Height [m] of CB above CG, moving masses hanging down; below 0 it turns over."""
        moments = self.static_mass * float(self.static_cg[2])
        return (moments + sum(m.mass * m.eccentricity for m in self.masses)) / self.mass

    # --- parts ------------------------------------------------------------------------------------

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the parts, in their order."""
        return tuple(part.name for part in self.parts)

    def part(self, name: str) -> Part:
        """Part with this name; raises VehicleError that offers the nearest name."""
        for part in self.parts:
            if part.name == name:
                return part
        raise VehicleError(unknown_name(f"part of vehicle {self.name!r}", name, self.part_names))

    def steered(self, control: str) -> Part | None:
        """Part that guidance moves for a control such as "pitch" (see `steering`), or None."""
        name = self.steering.get(control)
        return None if name is None else self.part(name)

    def steered_index(self, control: str) -> int | None:
        """Index among the parts of the part that `steered` returns; None: there is none."""
        name = self.steering.get(control)
        return None if name is None else self.part_names.index(name)

    @functools.cached_property
    def thrust_weights(self) -> Array | None:
        """Thrusts that give a wanted wrench, see `twin.vehicle.assembly.thrust_weights`."""
        return thrust_weights(self.parts)

    @property
    def holds_pose(self) -> bool:
        """True if thrusters push and turn the hull any way, and the file has gains for it."""
        return self.station_pid is not None and self.thrust_weights is not None

    def allocated(self, position: Array, leads: Collection[str] | None = None) -> Array:
        """Add the followers' displacements to the parts' positions `position`, shape (parts,).

        A follower moves by the gain `weight` times its lead's displacement, within its own travel.
        `leads`: names of the parts whose followers move; None: all.
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
        """First-order lags [s], shape (parts,)."""
        return np.array([part.lag for part in self.parts])

    @property
    def actuator_rate(self) -> Array:
        """Largest rates, shape (parts,), each in its part's unit per second."""
        return np.array([part.rate for part in self.parts])

    @property
    def rest(self) -> Array:
        """Positions at which no part propels or steers, shape (parts,)."""
        return np.array([part.rest for part in self.parts])

    # --- copies -----------------------------------------------------------------------------------

    def replace(self, **changes: Any) -> Vehicle:
        """Return a copy with other parameters; `xml` keeps describing the original.

        Accepts fields of the vehicle and of its hull law (`drag=...`), `battery` with a mapping of
        fields of the moving mass, and a part's name with a mapping of that part's fields.

        Raises:
          VehicleError: a name is unknown (the nearest is offered), or a value is impossible.
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
        """Return a copy with another hull law, read from the same file.

        Raises:
          VehicleError: the law is unknown, or the file lacks numbers that it needs.
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
        """Return a copy with the differences that `changes()` returned, now or in version 1."""
        changes = dict(changes)
        vehicle = self
        if "hull_law" in changes:
            vehicle = vehicle.with_law(changes.pop("hull_law"))
        return vehicle.replace(**renamed(changes, vehicle.part_names, (vehicle, vehicle.law)))


def load_vehicle(vehicle: str | Path = "glider") -> Vehicle:
    """Read a vehicle by the name of a shipped file ("glider") or by the path of an MJCF file.

    ":PRESET" after either chooses another set of numbers in the file ("tethys:gazebo").

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
    """Build a `Vehicle` from MJCF text; `path` only names the file in errors."""
    return read_vehicle(MjcfReader(without_plain(xml, path), path, gather=True))


def read_vehicle(reader: MjcfReader) -> Vehicle:
    """Build a `Vehicle`; VehicleError names all that a gathering reader's file lacks."""
    try:
        return _read(reader)
    except (VehicleError, ArithmeticError, np.linalg.LinAlgError):
        if reader.lacking:  # made-up values led to this error
            _refuse(reader)
        raise


def _read(reader: MjcfReader) -> Vehicle:
    path, numeric, number = reader.path, reader.numeric, reader.number
    hull = reader.body("hull")
    kind = reader.text("hull_law", FlowFrame.kind)
    if kind not in LAWS:
        raise VehicleError(f"vehicle file {path}: {unknown_name('hull_law', kind, LAWS)}")
    law = LAWS[kind].read(reader)
    reference_density = number("reference_density")
    added_mass = law.added_mass(reference_density)
    if added_mass is None:
        added_mass = np.array(numeric("added_mass", 36)).reshape(6, 6)
    gravity = reader.vector(reader.one("option"), "gravity", 3, default="0 0 -9.81")
    fields: dict[str, Any] = {
        "static_mass": float(reader.inertial(hull, "mass")[0]),
        "static_cg": flip_vector(reader.inertial(hull, "pos")),
        "static_inertia": reader.inertia(hull),
        "added_mass_coupling": number("added_mass_coupling", default=1.0) != 0.0,
        "imu_position": reader.place("imu"),
        "gps_position": reader.place("gps"),
    }
    for name, size in OPTIONAL.items():
        if values := numeric(name, size, ()):
            fields[name] = values if size > 1 else values[0]
    for name in ("hull_length", "hull_diameter", "hull_compressibility", "control_period"):
        fields[name] = number(name)
    for name in ("hull_thermal_expansion", "hull_thermal_lag", "hull_reference_temperature"):
        fields[name] = number(name, default=getattr(Vehicle, name))
    for name in ("usual_mission", "summary", "source"):
        fields[name] = reader.text(name, "")
    parts = read_parts(reader)
    masses = read_masses(reader, parts)
    steering = read_steering(reader, parts)
    assigned = named_controls(reader)
    if "speed" in steering or any(isinstance(part, Thruster) for part in parts):
        fields["cruise_speed"] = number("cruise_speed")
    given = reader.numerics
    for axis in ("pitch", "heading", "trim"):
        if axis in steering and (f"{axis}_pid" in given or "station_pid" not in given):
            fields[f"{axis}_pid"] = numeric(f"{axis}_pid", 3)
    following = followers(parts, steering, assigned)
    _refuse(reader)
    vehicle = Vehicle(
        name=path.stem,
        path=path,
        xml=reader.xml,
        gravity=-float(gravity[2]),
        reference_density=reference_density,
        masses=masses,
        parts=parts,
        law=law,
        added_mass=added_mass,
        steering=steering,
        followers=following,
        idle=idle_parts(parts, steering, following, assigned),
        spreads={
            name.removeprefix(SPREAD): element.get("data", "")
            for name, element in reader.texts.items()
            if name.startswith(SPREAD)
        },
        **fields,
    )
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


def _refuse(reader: MjcfReader) -> None:
    """Raise VehicleError for what is missing or misspelt; numbers of other hull laws may stand."""
    if reader.lacking and not reader.actuators():
        reader.lack("actuator", "for each part: without one the vehicle drifts")
    free = ("freejoint", "joint[@type='free']")
    if all(reader.body("hull").find(joint) is None for joint in free):
        reader.lack("freejoint", "in body 'hull'")
    others = [name for law in LAWS.values() for name in law.names()]
    known = ("added_mass", "cruise_speed", "pitch_pid", "heading_pid", "trim_pid", PRESETS)
    losses = [field.name for field in dataclasses.fields(Losses)]
    right = (*known, *OPTIONAL, *IDENTIFIED, *losses, *others)
    reader.refuse(right, (SPREAD, SEPARATOR, USER), lambda: number_texts(reader))


def number_texts(reader: MjcfReader) -> dict[str, str]:
    """Docstrings of the fields that hold a file's numbers, by the numbers' names."""
    law = LAWS.get(reader.text("hull_law", FlowFrame.kind), FlowFrame)
    found = {**field_texts(Vehicle), **field_texts(law)}
    for actuator in reader.actuators():
        name = actuator.get("name", "")
        if kind := PARTS.get(reader.text(f"{name}.kind", "")):
            found |= {f"{name}.{field}": text for field, text in field_texts(kind).items()}
    return found
