"""Vehicle: what an MJCF file says about a glider, read by name.

The file is the only place where a glider's numbers live. It is parsed here without MuJoCo, so
that the Fossen model shares the parameters with the MuJoCo twin but none of its code.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError, unknown_name
from twin.frames import flip_vector
from twin.vehicle.assets import assets_folder
from twin.vehicle.mjcf import MjcfReader

Array = NDArray[np.float64]

ACTUATORS = ("shift", "rotation", "pump")
CUBIC_CM = 1e-6  # [m3]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Vehicle:
    """A glider's parameters: SI units, body axes forward-starboard-down (FRD) about the CB."""

    name: str
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
    static_mass: float
    """[kg]"""
    static_cg: Array
    """[m], shape (3,)"""
    static_inertia: Array
    """[kg m2], shape (3, 3), about the static block's own CG."""
    movable_mass: float
    """[kg]"""
    movable_inertia: Array
    """[kg m2], shape (3, 3), about the movable block's own CG at rotation 0."""
    movable_neutral_x: float
    """[m], axial position at shift 0."""
    movable_eccentricity: float
    """[m], distance of the movable CG below the axis at rotation 0."""
    added_mass: Array
    """M_A, shape (6, 6), kg, kg m, kg m2, positive definite or semi-definite."""
    drag: tuple[float, float]
    """K_D0 [kg/m], K_D [kg/m/rad2]"""
    lift: tuple[float, float]
    """K_L0 [kg/m], K_alpha [kg/m/rad]"""
    side_force: tuple[float]
    """K_beta [kg/m/rad]"""
    roll_moment: tuple[float, float]
    """K_MR [kg/rad], K_p [kg s/rad]"""
    pitch_moment: tuple[float, float, float]
    """K_M0 [kg], K_M [kg/rad], K_q [kg s/rad2]"""
    yaw_moment: tuple[float, float]
    """K_MY [kg/rad], K_r [kg s/rad2]"""
    linear_angle: float
    """[rad], the published law holds as printed up to this flow angle."""
    blend_angle: float
    """[rad], the cross-flow law holds from this flow angle on."""
    rate_damping_min_speed: float
    """[m/s], rate damping uses at least this speed."""
    actuator_min: Array
    """Shape (3,): shift [m], rotation [rad], pump [cm3]."""
    actuator_max: Array
    """Shape (3,), as `actuator_min`."""
    actuator_lag: Array
    """[s], shape (3,), first-order lag."""
    actuator_rate: Array
    """Shape (3,): largest rates [m/s], [rad/s], [cm3/s]."""
    imu_position: Array
    """[m], shape (3,)"""
    gps_position: Array
    """[m], shape (3,)"""
    pitch_pid: tuple[float, float, float]
    """Shift per pitch error: [m/rad], [m/(rad s)], [m s/rad]."""
    heading_pid: tuple[float, float, float]
    """Rotation per heading error: [1], [1/s], [s]."""
    control_period: float
    """[s]"""

    def __post_init__(self) -> None:
        for name in ("reference_density", "hull_length", "hull_diameter", "static_mass"):
            self._require(getattr(self, name) > 0, name, "positive")
        for name in ("movable_mass", "control_period"):
            self._require(getattr(self, name) > 0, name, "positive")
        self._require(self.gravity > 0, "gravity", "downward along MuJoCo's z axis")
        self._require(self.hull_compressibility >= 0, "hull_compressibility", "at least 0")
        self._require(self.rate_damping_min_speed >= 0, "rate_damping_min_speed", "at least 0")
        self._require(
            0 < self.linear_angle < self.blend_angle <= math.pi / 2,
            "linear_angle, blend_angle",
            "ordered as 0 < linear_angle < blend_angle <= pi/2",
        )
        symmetric = np.allclose(self.added_mass, self.added_mass.T, rtol=1e-9, atol=1e-12)
        self._require(symmetric, "added_mass", "a symmetric 6x6 matrix")
        smallest = np.linalg.eigvalsh(self.added_mass)[0]
        self._require(smallest >= -1e-9, "added_mass", "positive semi-definite")
        self._require(bool((self.actuator_lag > 0).all()), "actuator lag (dynprm)", "positive")
        self._require(bool((self.actuator_rate > 0).all()), "actuator rate (dynprm)", "positive")
        ordered = bool((self.actuator_min < self.actuator_max).all())
        self._require(ordered, "actuator actrange", "an increasing pair")

    def _require(self, condition: bool, name: str, rule: str) -> None:
        if not condition:
            raise VehicleError(f"vehicle {self.name!r} ({self.path}): {name} must be {rule}")

    @property
    def mass(self) -> float:
        """Total mass [kg], constant: the pump moves oil, not mass, across the hull."""
        return self.static_mass + self.movable_mass

    @property
    def neutral_volume(self) -> float:
        """Displaced volume [m3] at pump 0 and zero pressure."""
        return self.mass / self.reference_density

    def movable_position(self, shift: float, rotation: float) -> Array:
        """CG of the movable block [m], shape (3,), at `shift` [m] and `rotation` [rad].

        Positive rotation puts it to port (Zhang et al. 2013).
        """
        ecc = self.movable_eccentricity
        lateral, vertical = -ecc * math.sin(rotation), ecc * math.cos(rotation)
        return np.array([self.movable_neutral_x + shift, lateral, vertical])

    def pump_for_net_mass(self, net_mass: float) -> float:
        """Pumped volume [cm3] that makes the glider `net_mass` [kg] heavy at reference density."""
        return -net_mass / self.reference_density / CUBIC_CM

    def net_mass_for_pump(self, pump: float) -> float:
        """Net buoyancy mass [kg] at reference density and zero pressure, positive = heavy."""
        return -pump * CUBIC_CM * self.reference_density

    def replace(self, **changes: object) -> Vehicle:
        """A copy with other parameters; `xml` keeps describing the original."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    def changes(self) -> dict[str, Any]:
        """The fields that differ from the MJCF text, as JSON-able numbers and lists."""
        original = parse_vehicle(self.xml, self.path)
        found: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            mine, theirs = getattr(self, field.name), getattr(original, field.name)
            if field.name not in ("name", "path", "xml") and not np.array_equal(mine, theirs):
                found[field.name] = np.asarray(mine).tolist()
        return found

    def with_changes(self, changes: Mapping[str, Any]) -> Vehicle:
        """A copy with what `changes` of another copy returned."""
        typed = {
            name: np.array(value)
            if isinstance(getattr(self, name), np.ndarray)
            else tuple(value)
            if isinstance(value, list)
            else value
            for name, value in changes.items()
        }
        return self.replace(**typed)


def load_vehicle(vehicle: str | Path = "glider") -> Vehicle:
    """Read a vehicle by the name of a shipped file ("glider") or by the path of an MJCF file.

    Raises:
      VehicleError: unknown name, unreadable file, missing or wrong element (named).
    """
    text = str(vehicle)
    if text.endswith(".xml") or "/" in text:
        path = Path(text)
        if not path.is_file():
            raise VehicleError(f"no vehicle file at {path}; give an existing MJCF file or a name")
    elif text in vehicle_names():
        path = assets_folder() / f"{text}.xml"
    else:
        raise VehicleError(unknown_name("vehicle", text, vehicle_names()) + " or a path to an .xml")
    try:
        xml = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise VehicleError(f"cannot read vehicle file {path}: {error}") from error
    return parse_vehicle(xml, path)


def vehicle_names() -> list[str]:
    """Names of the shipped vehicles."""
    return sorted(path.stem for path in assets_folder().glob("*.xml"))


@functools.lru_cache(maxsize=16)
def parse_vehicle(xml: str, path: Path) -> Vehicle:
    """Build a `Vehicle` from MJCF text; `path` names it in errors."""
    reader = MjcfReader(xml, path)
    hull, battery = reader.body("hull"), reader.body("battery")
    movable_cg = reader.vector(battery, "pos", 3) + reader.inertial(battery, "pos")
    static_cg = reader.inertial(hull, "pos")
    if not np.allclose(reader.inertial(battery, "pos")[:2], 0, atol=1e-12):
        reader.fail(
            "body 'battery' <inertial pos>", "on its own vertical axis: '0 0 -eccentricity'"
        )
    actuators = [reader.actuator(name) for name in ACTUATORS]
    ranges = np.array([reader.vector(a, "actrange", 2) for a in actuators])
    dynamics = np.array([reader.vector(a, "dynprm", 2) for a in actuators])
    numeric = reader.numeric
    gravity = reader.vector(reader.one("option"), "gravity", 3, default="0 0 -9.81")
    return Vehicle(
        name=reader.root.get("model", path.stem),
        path=path,
        xml=xml,
        gravity=-float(gravity[2]),
        reference_density=numeric("reference_density", 1)[0],
        hull_length=numeric("hull_length", 1)[0],
        hull_diameter=numeric("hull_diameter", 1)[0],
        hull_compressibility=numeric("hull_compressibility", 1)[0],
        static_mass=float(reader.inertial(hull, "mass")[0]),
        static_cg=flip_vector(static_cg),
        static_inertia=reader.inertia(hull),
        movable_mass=float(reader.inertial(battery, "mass")[0]),
        movable_inertia=reader.inertia(battery),
        movable_neutral_x=float(movable_cg[0]),
        movable_eccentricity=-float(movable_cg[2]),
        added_mass=np.array(numeric("added_mass", 36)).reshape(6, 6),
        drag=numeric("drag", 2),
        lift=numeric("lift", 2),
        side_force=numeric("side_force", 1),
        roll_moment=numeric("roll_moment", 2),
        pitch_moment=numeric("pitch_moment", 3),
        yaw_moment=numeric("yaw_moment", 2),
        linear_angle=numeric("linear_angle", 1)[0],
        blend_angle=numeric("blend_angle", 1)[0],
        rate_damping_min_speed=numeric("rate_damping_min_speed", 1)[0],
        actuator_min=ranges[:, 0],
        actuator_max=ranges[:, 1],
        actuator_lag=dynamics[:, 0],
        actuator_rate=dynamics[:, 1],
        imu_position=flip_vector(reader.vector(reader.site("imu"), "pos", 3)),
        gps_position=flip_vector(reader.vector(reader.site("gps"), "pos", 3)),
        pitch_pid=numeric("pitch_pid", 3),
        heading_pid=numeric("heading_pid", 3),
        control_period=numeric("control_period", 1)[0],
    )
