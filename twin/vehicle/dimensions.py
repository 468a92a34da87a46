"""Dimensions: a vehicle file made from length, diameter, mass and fins alone.

The vehicle is a slender hull of revolution with a propeller, a rudder and an elevator astern, in
body axes about the centre of buoyancy, which is amidships. Its numbers are a first guess for
`twin identify`:

- added mass: Lamb (1932, articles 114 and 115) for the spheroid of this length and diameter, per
  displaced mass, with Kirchhoff's coupling, which includes Munk's moment;
- drag ahead: 0.2 on the frontal area (Hoerner 1965, chapter 6, and published AUVs: 0.11 of REMUS
  100, 0.19 of Tethys);
- lift of the hull: 0.003 per degree times length over diameter on the diameter squared, at 0.65 of
  the length from the nose (Hoerner, as in Prestero 2001, section 4.3);
- cross flow: a cylinder's drag, 1.1 (Hoerner, page 3-9), along the whole length;
- fins: slope 3.12 per radian (Prestero, table 2.2), area 1/40 of length times diameter unless
  given, at 0.46 of the length behind the middle;
- screw: 0.7 diameters, thrust 0.16 rho n2 D4 at rest and none at an advance of 0.5 n D (n per s;
  Oosterveld and van Oossanen 1975, two blades);
- inertia: across the axis, the mean of an ellipsoid and a cylinder; along it, a cylinder; centre of
  gravity 0.05 diameters low.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.vehicle.vehicle import Vehicle, parse_vehicle

SEA = 1025.0
"""[kg/m3] Density of sea water."""
FRONTAL_DRAG, CROSS_FLOW_DRAG = 0.2, 1.1
HULL_LIFT, LIFT_PLACE = 0.003 * 180.0 / math.pi, -0.15
"""HULL_LIFT: [1/rad] lift slope / slenderness. LIFT_PLACE: lift ahead of the middle / length."""
FIN_LIFT, FIN_AREA, FIN_PLACE = 3.12, 1.0 / 40.0, -0.46
"""FIN_LIFT: [1/rad] lift slope. FIN_AREA: / (length * diameter). FIN_PLACE: as LIFT_PLACE."""
FIN_REACH = 0.75
"""Distance from the axis to the middle of a fin / diameter, for roll damping."""
SCREW, THRUST, FREE_ADVANCE = 0.7, 0.16, 0.5
"""SCREW: screw / hull diameter. THRUST: coefficient at rest. FREE_ADVANCE: ratio of zero thrust."""
LOW = 0.05
"""Depth of the centre of gravity below the axis / diameter."""
SLENDER = (3.0, 20.0)
"""Range of length / diameter in which the slender-hull formulas hold."""
NEUTRAL = (0.5, 1.5)
"""Limits of mass / mass of water in a cylinder of this length and diameter; a spheroid has 2/3, a
little more than the lower limit."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dimensions:
    """Sizes of a vehicle that can be measured on the quay, in m, kg and m2."""

    length: float
    diameter: float
    mass: float
    """[kg] Mass of the neutral vehicle with its flooding water."""
    fin_area: float = 0.0
    """[m2] Both blades of a rudder, or of an elevator; 0: length times diameter over 40."""
    fin_place: float = 0.0
    """[m] Place of the fins, negative behind the middle; 0: 0.46 of the length behind it."""
    screw: float = 0.0
    """[m] Diameter of the propeller; 0: 0.7 of the hull's."""
    density: float = SEA
    """[kg/m3] Density of the water in which the vehicle is about neutral: that of the runs where
    these have no CTD."""

    def __post_init__(self) -> None:
        for field in ("length", "diameter", "mass"):
            if not 0.0 < getattr(self, field) < math.inf:
                raise InputError(f"dimensions: {field} must be above 0")
        low, high = SLENDER
        slender = self.length / self.diameter
        if not low <= slender <= high:
            raise InputError(
                f"dimensions: length over diameter is {slender:.1f}; the laws of slender hulls "
                f"hold from {low:g} to {high:g}"
            )
        if not 950.0 <= self.density <= 1100.0:
            raise InputError(f"dimensions: water has 950 to 1100 kg/m3, not {self.density:g}")
        full = self.density * math.pi / 4.0 * self.diameter**2 * self.length
        if not NEUTRAL[0] * full <= self.mass <= NEUTRAL[1] * full:
            raise InputError(
                f"dimensions: a neutral hull of this length and diameter has "
                f"{NEUTRAL[0] * full:.3g} to {NEUTRAL[1] * full:.3g} kg, not {self.mass:g}: give "
                "m and kg, and the mass with the water that is in the hull"
            )
        for field, most, of in (
            ("fin_area", self.length * self.diameter, "m2, at most length times diameter"),
            ("screw", 2.0 * self.diameter, "m, at most two diameters of the hull"),
        ):
            if not 0.0 <= getattr(self, field) <= most:
                raise InputError(
                    f"dimensions: {field} = {getattr(self, field):g} must be from 0 to {most:.3g} "
                    f"({of})"
                )
        if not -0.5 * self.length <= self.fin_place <= 0.0:
            raise InputError(
                "dimensions: fin_place is ahead of the hull's middle, so between "
                f"{-0.5 * self.length:g} m and 0: fins astern"
            )

    @classmethod
    def of(cls, numbers: Mapping[str, float]) -> Dimensions:
        """Make dimensions from numbers by name.

        Raises:
          InputError: a name is unknown, or length, diameter or mass is missing or impossible.
        """
        fields = [field.name for field in dataclasses.fields(cls)]
        for name in numbers:
            if name not in fields:
                raise InputError(unknown_name("dimension", name, fields))
        missing = [name for name in ("length", "diameter", "mass") if name not in numbers]
        if missing:
            raise InputError(
                f"dimensions: {', '.join(missing)} missing; such as length=1.33 diameter=0.19 "
                "mass=30.5 [m, kg]"
            )
        return cls(**numbers)

    def vehicle(self, name: str = "dimensions") -> Vehicle:
        """Build the vehicle; its parts are `propeller`, `rudder` and `elevator`.

        A positive elevator pitches the nose down and a positive rudder turns to port, as in the
        shipped `remus` and `tethys`.
        """
        return parse_vehicle(self.xml(), Path(f"{name}.xml"))

    def added_mass(self) -> NDArray[np.float64]:
        """Added mass M_A [kg, kg m2] about the centre of buoyancy, shape (6, 6)."""
        along, across, turning = _lamb(self.length / self.diameter)
        square = (self.length**2 + self.diameter**2) / 20.0  # a spheroid's inertia per mass
        parts = [along, across, across, 0.0, turning * square, turning * square]
        return self.mass * np.diag(parts)

    def derivatives(self) -> dict[str, float]:
        """Derivatives of the hull with fins at rest, without the added-mass coupling; SI."""
        length, wide, pressure = self.length, self.diameter, 0.5 * self.density
        lift = pressure * wide**2 * HULL_LIFT * length / wide
        fin = pressure * FIN_LIFT * self._fin_area
        place, at = LIFT_PLACE * length, self._fin_place
        force = lift + fin
        moment, damping = lift * place + fin * at, lift * place**2 + fin * at**2
        side = pressure * CROSS_FLOW_DRAG * wide * length
        swing = pressure * CROSS_FLOW_DRAG * wide * length**4 / 32.0
        reach = FIN_REACH * wide
        return {
            "Xuu": -pressure * FRONTAL_DRAG * math.pi / 4.0 * wide**2,
            "Yuv": -force, "Zuw": -force, "Nuv": -moment, "Muw": moment,
            "Yur": -moment, "Zuq": moment, "Nur": -damping, "Muq": -damping,
            "Yvv": -side, "Zww": -side, "Nrr": -swing, "Mqq": -swing,
            "Kup": -2.0 * fin * reach**2,
            "Kpp": -pressure * CROSS_FLOW_DRAG * 2.0 * self._fin_area * reach**3,
        }  # fmt: skip

    @property
    def _fin_area(self) -> float:
        return self.fin_area or FIN_AREA * self.length * self.diameter

    @property
    def _fin_place(self) -> float:
        return self.fin_place or FIN_PLACE * self.length

    def xml(self) -> str:
        """MJCF text of the vehicle."""
        long, radius, mass = self.length, 0.5 * self.diameter, self.mass
        screw, at = self.screw or SCREW * self.diameter, self._fin_place
        swing = 0.5 * mass * (long**2 / 12.0 + radius**2 / 4.0 + (long**2 / 4.0 + radius**2) / 5.0)
        roll = 0.5 * mass * radius**2
        low = LOW * self.diameter
        numbers = {
            "reference_density": self.density, "hull_length": long, "hull_diameter": self.diameter,
            "hull_compressibility": 0.0, "pitch_pid": "0.8 0.1 1.5", "heading_pid": "0.5 0.01 1.5",
            "depth_pid": "0.15 0.003 0.1", "control_period": 0.2, "cruise_speed": 1.0,
            **self.derivatives(),
            "propeller.diameter": screw,
            "propeller.thrust_coefficient": THRUST / (2.0 * math.pi) ** 2,
            "propeller.zero_thrust_advance": FREE_ADVANCE / (2.0 * math.pi),
        }  # fmt: skip
        for fin, axis in (("rudder", "0 0 -1"), ("elevator", "0 -1 0")):
            numbers |= {f"{fin}.axis": axis, f"{fin}.area": self._fin_area, f"{fin}.in_hull": 1.0}
            numbers |= {f"{fin}.lift_slope": FIN_LIFT, f"{fin}.stall_angle": 1.5}
        rows = "\n".join(" ".join(f"{x:.10g}" for x in row) for row in self.added_mass())
        said = " ".join(f"{n}={x:g}" for n, x in dataclasses.asdict(self).items() if x)
        numbers = {"added_mass": f"\n{rows}", **numbers}
        custom = "\n".join(
            f'    <numeric name="{name}" data="{x if isinstance(x, str) else f"{x:.10g}"}"/>'
            for name, x in numbers.items()
        )
        sites = {
            "cb": "0 0 0", "imu": "0 0 0", "gps": f"0 0 {self.diameter:.6g}",
            "propeller": f"{-0.5 * long - 0.1 * screw:.6g} 0 0",
            "rudder": f"{at:.6g} 0 0", "elevator": f"{at:.6g} 0 0",
        }  # fmt: skip
        placed = "\n".join(f'      <site name="{n}" pos="{p}"/>' for n, p in sites.items())
        thick = f"{0.5 * long:.6g} {radius:.6g} {radius:.6g}"
        return _FILE.format(
            said=said, custom=custom, sites=placed, low=-low, mass=mass, roll=roll, swing=swing,
            inner=swing - mass * low**2, size=thick,
        )  # fmt: skip


def _lamb(slenderness: float) -> tuple[float, float, float]:
    """Added-mass ratios of a prolate spheroid: added mass along and across its axis / displaced
    mass, and added inertia / the displaced water's inertia (Lamb 1932, articles 114 and 115)."""
    square = 1.0 - 1.0 / slenderness**2
    e = math.sqrt(square)
    logarithm = math.log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - square) / e**3 * (0.5 * logarithm - e)
    beta = 1.0 / square - (1.0 - square) / (2.0 * e**3) * logarithm
    turning = square**2 * (beta - alpha)
    turning /= (2.0 - square) * (2.0 * square - (2.0 - square) * (beta - alpha))
    return alpha / (2.0 - alpha), beta / (2.0 - beta), turning


_FILE = """<!-- A vehicle of which nothing was known but {said}: its numbers are those of
     twin/vehicle/dimensions.py until twin identify puts others in their place. -->
<mujoco model="dimensions">
  <compiler angle="radian" autolimits="true" inertiafromgeom="false" balanceinertia="false"/>
  <option timestep="0.01" integrator="discrete" gravity="0 0 -9.81" density="0" viscosity="0">
    <flag autoreset="disable"/>
  </option>
  <custom>
    <text name="summary" data="from dimensions alone: {said}"/>
    <text name="hull_law" data="body-axes"/>
    <text name="propeller.kind" data="propeller"/>
    <text name="rudder.kind" data="fin"/>
    <text name="elevator.kind" data="fin"/>
{custom}
  </custom>
  <worldbody>
    <light name="sun" mode="trackcom" pos="0 0 40" dir="0.15 0.1 -1" directional="true"/>
    <body name="hull" pos="0 0 0">
      <freejoint name="hull"/>
      <inertial pos="0 0 {low:.6g}" mass="{mass:.10g}" diaginertia="{roll:.10g} {inner:.10g} {swing:.10g}"/>
      <geom name="hull" type="ellipsoid" size="{size}" mass="0" contype="0" conaffinity="0"/>
      <geom name="fluid_hull" type="ellipsoid" size="{size}" fluidshape="ellipsoid" fluidcoef="0.10 0.005 1.0 0.2 0.0" mass="0" group="4" contype="0" conaffinity="0"/>
{sites}
      <camera name="chase" mode="track" pos="-1.8 1.1 0.8" xyaxes="-0.52 -0.85 0 0.34 -0.21 0.92"/>
      <camera name="side" mode="track" pos="-0.05 -2.0 0.08" xyaxes="1 0 0 0 0 1"/>
    </body>
  </worldbody>
  <actuator>
    <general name="propeller" site="propeller" gear="0 0 1 0 0 0" dyntype="user" actdim="1" dynprm="0.2 300" gaintype="fixed" gainprm="0" biastype="none" ctrlrange="0 300" actearly="true" actlimited="true" actrange="0 300"/>
    <general name="rudder" site="rudder" gear="0 0 1 0 0 0" dyntype="user" actdim="1" dynprm="0.15 1" gaintype="fixed" gainprm="0" biastype="none" ctrlrange="-0.26 0.26" actearly="true" actlimited="true" actrange="-0.26 0.26"/>
    <general name="elevator" site="elevator" gear="0 0 1 0 0 0" dyntype="user" actdim="1" dynprm="0.15 1" gaintype="fixed" gainprm="0" biastype="none" ctrlrange="-0.26 0.26" actearly="true" actlimited="true" actrange="-0.26 0.26"/>
  </actuator>
  <sensor>
    <framepos name="cb_position" objtype="site" objname="cb"/>
    <framequat name="imu_attitude" objtype="site" objname="imu"/>
    <gyro name="imu_gyro" site="imu"/>
    <accelerometer name="imu_accelerometer" site="imu"/>
    <framepos name="gps_position" objtype="site" objname="gps"/>
  </sensor>
</mujoco>
"""  # noqa: E501  (elements of MJCF stand in one line)
