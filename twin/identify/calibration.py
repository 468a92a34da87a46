"""Calibration: a vehicle's parameters together with the errors of its sensors and hull.

Sensors are mounted at an angle, and a hull shrinks in the cold. A calibration adds these numbers to
the vehicle's own parameters; both are written into one MJCF file.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError
from twin.vehicle.laws import FlowFrame
from twin.vehicle.laws.flow_frame import is_flow_frame
from twin.vehicle.parts.pump import CUBIC_CM
from twin.vehicle.vehicle import IDENTIFIED, Vehicle, load_vehicle
from twin.water.density import SEA_COMPRESSIBILITY

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

HULL_NUMERIC, SENSOR_NUMERIC, PROVENANCE, PUMP_NUMERIC = IDENTIFIED
"""Names of the file's elements for numbers that `Vehicle` lacks. PUMP_NUMERIC is read from files of
earlier versions and never written."""
ALUMINIUM_EXPANSION = 7.1e-5
"""[1/K] Expansion of a hull's volume: three times the 23.6e-6 of aluminium alloys; the Seaglider
basestation has 7.05e-5."""
THERMAL_LAG = 200.0
"""[s] Lag of the hull's temperature behind the water's; fitted to a Slocum in a thermocline of
14 K (docs/howto/identify.md)"""
REFERENCE_TEMPERATURE = 10.0
"""[degree_Celsius] Temperature at which the hull has its neutral volume"""
CYCLES = ("heading_cos", "heading_sin", "heading_cos2", "heading_sin2")
"""Names of the four numbers of `Calibration.heading_cycles`"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Calibration:
    """Vehicle and errors of its sensors: all numbers that identification can estimate."""

    vehicle: Vehicle
    """The vehicle, whose `reference_density` is the trim: the density in which it is neutral at
    pump 0, pressure 0 and `REFERENCE_TEMPERATURE`"""
    water_density: float
    """[kg/m3] Density of the sea at the surface, for logs that do not measure it"""
    thermal_expansion: float = ALUMINIUM_EXPANSION
    """[1/K] Relative growth of the hull's volume with temperature; used if a log has temperature"""
    thermal_lag: float = THERMAL_LAG
    """[s] First-order lag of the hull's temperature behind the water's"""
    pitch_scale: float = 1.0
    """[1] Factor on the measured pitch: true pitch = scale * measured + offset"""
    pitch_offset: float = 0.0
    """[rad] Offset of the pitch in the same equation"""
    heading_offset: float = 0.0
    """[rad] True minus measured heading, mean over all headings"""
    heading_cycles: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """[rad] Coefficients of cos, sin of the heading (hard iron) and of twice the heading (soft)"""
    errors: Mapping[str, Sequence[float]] | None = None
    """Independent errors of one standard deviation each, by parameter in its unit; None without an
    identification, or with one of an earlier version"""

    def true_pitch(self, measured: Array) -> Array:
        """Pitch [rad] of the hull from the sensor's [rad]."""
        return self.pitch_scale * measured + self.pitch_offset

    def true_heading(self, measured: Array) -> Array:
        """Heading [rad] of the hull from the compass's [rad]; the deviation is a function of the
        measured heading."""
        c1, s1, c2, s2 = self.heading_cycles
        deviation = c1 * np.cos(measured) + s1 * np.sin(measured)
        deviation = deviation + c2 * np.cos(2 * measured) + s2 * np.sin(2 * measured)
        return measured + self.heading_offset + deviation

    def sea_density(self, depth: Array) -> Array:
        """In-situ density [kg/m3] at a depth [m] for logs without it: one water, compressed."""
        pressure = self.water_density * self.vehicle.gravity * np.maximum(depth, 0.0)
        return self.water_density * (1.0 + SEA_COMPRESSIBILITY * pressure)

    def net_mass(self, density: Array, depth: Array, pump: Array, hull_warming: Array) -> Array:
        """Net buoyancy mass [kg], + = heavy, fully immersed.

        Args:
          density: in situ [kg/m3]. depth: [m]. pump: [cm3], + = lighter.
          hull_warming: temperature of the hull above `REFERENCE_TEMPERATURE` [K]. Each (time,).
        """
        vehicle = self.vehicle
        pressure = vehicle.reference_density * vehicle.gravity * depth
        strain = self.thermal_expansion * hull_warming - vehicle.hull_compressibility * pressure
        volume = (vehicle.neutral_volume + CUBIC_CM * pump) * (1.0 + strain)
        return vehicle.mass - density * volume

    def describe(self) -> dict[str, float]:
        """Numbers of hull and sensors that `Vehicle` lacks, by name, in the file's units."""
        return {
            "water_density": self.water_density,
            "thermal_expansion": self.thermal_expansion,
            "thermal_lag": self.thermal_lag,
            "pitch_scale": self.pitch_scale,
            "pitch_offset": self.pitch_offset,
            "heading_offset": self.heading_offset,
            **dict(zip(CYCLES, self.heading_cycles, strict=True)),
        }

    def replace(self, **changes: object) -> Calibration:
        """Return a copy with other values."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    def with_vehicle(self, **changes: Any) -> Calibration:
        """Return a copy with other values of its vehicle, as `Vehicle.replace` takes them."""
        return self.replace(vehicle=self.vehicle.replace(**changes))


def driven(vehicle: Vehicle) -> bool:
    """True for a propelled vehicle, which is identified by its runs and not by dives."""
    return vehicle.steered("speed") is not None


def require_glider(vehicle: Vehicle) -> None:
    """Raise VehicleError for a vehicle that the flight model of gliders cannot fly."""
    needs = {
        f"the hull law {FlowFrame.kind!r}": is_flow_frame(vehicle.law),
        "one moving battery": len(vehicle.masses) == 1,
        "a pump": vehicle.steered("buoyancy") is not None,
    }
    lacks = [what for what, there in needs.items() if not there]
    if lacks:
        raise VehicleError(
            f"vehicle {vehicle.name!r} has no flight model: that is of gliders with the hull "
            f"law {FlowFrame.kind!r}, one moving battery and a pump, and it lacks "
            f"{' and '.join(lacks)} (hull law {vehicle.law.kind!r}; parts: "
            f"{', '.join(vehicle.part_names) or 'none'})"
        )


def load_calibration(
    vehicle: str | Path | Vehicle,
    *,
    pitch_scale: float | None = None,
    pitch_offset: float | None = None,
) -> Calibration:
    """Load the calibration of a vehicle file; without one in the file, the nominal calibration.

    Args:
      vehicle: name of a shipped file, path of a file, such as `twin identify` writes, or a loaded
        vehicle.
      pitch_scale, pitch_offset: known errors of the pitch sensor [1], [rad], which replace the
        file's.

    Raises:
      VehicleError: unknown or unreadable file, a vehicle that is no glider with a battery and a
        pump, or an element of the file that is no number.
    """
    loaded = _at_reference(vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle))
    require_glider(loaded)
    calibration = Calibration(vehicle=loaded, water_density=loaded.reference_density)
    errors = identified(loaded).get("flight")
    if errors is not None and len({len(row) for row in errors.values()}) != 1:
        raise VehicleError(
            f"vehicle file {loaded.path}: the errors of its identification ('flight') must be "
            "equally many for each parameter; identify the vehicle again"
        )
    calibration = calibration.replace(errors=errors)
    if loaded.hull_thermal_expansion > 0.0:
        calibration = calibration.replace(
            thermal_expansion=loaded.hull_thermal_expansion, thermal_lag=loaded.hull_thermal_lag
        )
    numerics = {
        element.get("name"): element.get("data", "")
        for element in ElementTree.fromstring(loaded.xml).iterfind("./custom/numeric")
    }
    hull = _numbers(loaded, numerics, HULL_NUMERIC, 3)
    if hull is not None:
        calibration = calibration.replace(
            water_density=hull[0], thermal_expansion=hull[1], thermal_lag=hull[2]
        )
    pump = _numbers(loaded, numerics, PUMP_NUMERIC, 1)
    if pump is not None:
        # files of version 0.1.0 have the pump's place here, and the vehicle's pump at the centre
        own = loaded.steered("buoyancy")
        assert own is not None
        calibration = calibration.with_vehicle(
            **{own.name: {"position": (pump[0], *own.position[1:])}}
        )
    sensors = _numbers(loaded, numerics, SENSOR_NUMERIC, 7)
    if sensors is not None:
        calibration = calibration.replace(
            pitch_scale=sensors[0],
            pitch_offset=sensors[1],
            heading_offset=sensors[2],
            heading_cycles=tuple(sensors[3:]),
        )
    known = {"pitch_scale": pitch_scale, "pitch_offset": pitch_offset}
    return calibration.replace(**{n: value for n, value in known.items() if value is not None})


def identified(vehicle: Vehicle) -> Mapping[str, Any]:
    """Record of the identification in a vehicle's file; empty where the file has none."""
    for text in ElementTree.fromstring(vehicle.xml).iter("text"):
        if text.get("name") == PROVENANCE:
            try:
                found = json.loads(text.get("data", ""))
            except json.JSONDecodeError as error:
                raise VehicleError(
                    f"vehicle file {vehicle.path}: <text name={PROVENANCE!r}> is not JSON: {error}"
                ) from None
            return found if isinstance(found, dict) else {}
    return {}


def _at_reference(vehicle: Vehicle) -> Vehicle:
    """Vehicle that displaces as much, with its neutral volume at `REFERENCE_TEMPERATURE`."""
    warmer = REFERENCE_TEMPERATURE - vehicle.hull_reference_temperature
    if not (warmer and vehicle.hull_thermal_expansion):
        return vehicle
    return vehicle.replace(
        reference_density=vehicle.reference_density
        / (1.0 + vehicle.hull_thermal_expansion * warmer),
        hull_reference_temperature=REFERENCE_TEMPERATURE,
    )


def _numbers(
    vehicle: Vehicle, numerics: Mapping[str | None, str], name: str, size: int
) -> list[float] | None:
    if name not in numerics:
        return None
    try:
        values = [float(word) for word in numerics[name].split()]
    except ValueError:
        values = []
    if len(values) != size or not all(map(math.isfinite, values)):
        raise VehicleError(
            f"vehicle file {vehicle.path}: <numeric name={name!r}> data = {numerics[name]!r} must "
            f"be {size} finite numbers"
        )
    return values
