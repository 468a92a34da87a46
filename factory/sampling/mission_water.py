"""Mission water: currents, density profile and sea floor of one mission, from its parameters.

Mission place: where and when a mission is flown, and the coordinates of its samples.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.sampling.distribution import number
from factory.sampling.draw import Parameters
from factory.sampling.surveys import SHALLOWEST_FLOOR_M
from twin.physics.scenario import SAMPLE_PERIOD
from twin.records.coordinates import START_LATITUDE, START_LONGITUDE, START_TIME, flown_coordinates
from twin.records.trajectory import sample_times
from twin.vehicle.vehicle import Vehicle
from twin.water.current import (
    Current,
    CurrentSum,
    Ekman,
    GaussMarkov,
    Geostrophic,
    Inertial,
    LogLayer,
    TidalEllipse,
    Tide,
    Uniform,
)
from twin.water.current.axes import DEFAULT_TIME, Origin, coriolis
from twin.water.current.layers import VON_KARMAN
from twin.water.density import REFERENCE_DENSITY, DensityProfile
from twin.water.floor import RoughFloor

CURRENT_MARGIN = 0.5
"""[m/s] of current beyond the fastest speed through the water: a floor reaches as far as both go"""
DEEPEST_FLOOR_M = 130.0
"""[m] The sea floor of a survey is cut off here: shallow water, beyond the DVL's reach in places"""
PARTS = ("steady", "shear", "tide", "inertial", "ekman", "bottom", "wander")
WANDER_MEAN, WANDER_STD, WANDER_DIRECTION_STD_DEG = 0.6, 0.2, 30.0
"""Mean and deviation of the wandering part as shares of its largest speed, and of its direction."""
BOTTOM_ROUGHNESS_M = 1e-3
"""[m] of the log layer, sand"""
DEEP_MARGIN_M = 100.0
"""[m] of density profile below the deepest turning depth: overshoots and down-currents"""


def build_current(parameters: Parameters) -> Current | None:
    """The sum of the mission's currents, nowhere faster than `current.speed`; None is still."""
    value = parameters.number
    weights = {part: value(f"current.{part}") for part in PARTS}
    total, speed = sum(weights.values()), value("current.speed")
    if total <= 0.0 or speed <= 0.0:
        return None
    amplitude = {part: speed * weight / total for part, weight in weights.items()}
    parts: list[Current] = []
    if amplitude["steady"]:
        direction = value("current.steady_direction_deg")
        parts.append(Uniform.toward(amplitude["steady"], direction))
    if amplitude["shear"]:
        parts.append(
            Geostrophic(
                baroclinic=amplitude["shear"],
                direction_deg=value("current.shear_direction_deg"),
                scale_depth=value("current.shear_scale_m"),
            )
        )
    if amplitude["tide"]:
        ellipse = TidalEllipse(
            constituent=str(parameters.values["current.tide_constituent"]),
            semi_major=amplitude["tide"],
            semi_minor=amplitude["tide"] * value("current.tide_ratio"),
            direction_deg=value("current.tide_direction_deg"),
            phase_deg=value("current.tide_phase_deg"),
        )
        parts.append(Tide(ellipses=(ellipse,)))
    if amplitude["inertial"]:
        parts.append(
            Inertial(
                speed=amplitude["inertial"],
                layer_depth=value("current.inertial_layer_m"),
                direction_deg=value("current.inertial_direction_deg"),
            )
        )
    if amplitude["ekman"]:
        parts.append(_ekman(parameters, amplitude["ekman"]))
    if amplitude["bottom"] and (depth := bottom_depth(parameters)) is not None:
        parts.append(_bottom(parameters, amplitude["bottom"], depth))
    if amplitude["wander"]:
        largest = amplitude["wander"]
        parts.append(
            GaussMarkov(
                speed=WANDER_MEAN * largest,
                speed_std=WANDER_STD * largest,
                max_speed=largest,
                direction_deg=value("current.wander_direction_deg"),
                direction_std_deg=WANDER_DIRECTION_STD_DEG,
                correlation_time=3600.0 * value("current.wander_time_h"),
                seed=int(value("current.wander_seed")),
            )
        )
    return parts[0] if len(parts) == 1 else CurrentSum(parts=tuple(parts))


def build_floor(parameters: Parameters, vehicle: Vehicle) -> RoughFloor | None:
    """The sea floor of a survey, as far as it can go; None for missions in open water."""
    if "floor.depth_m" not in parameters.values:
        return None
    value = parameters.number
    speeds = [number(segment, "mission.speed_m_s") for segment in parameters.segments]
    fastest = max((s for s in speeds if not math.isnan(s)), default=0.0)
    fastest = max(fastest, vehicle.cruise_speed) + CURRENT_MARGIN
    return RoughFloor(
        depth_m=value("floor.depth_m"),
        height_m=value("floor.roughness_m"),
        length_m=value("floor.correlation_m"),
        slope=value("floor.slope"),
        slope_direction_deg=value("floor.slope_direction_deg"),
        seed=int(value("floor.seed")),
        shallowest_m=SHALLOWEST_FLOOR_M,
        deepest_m=DEEPEST_FLOOR_M,
        reach_m=fastest * parameters.duration_s,
    )


def bottom_depth(parameters: Parameters) -> float | None:
    """Depth of the bottom [m], in surveys the mean; None is out of reach of everything."""
    if "floor.depth_m" in parameters.values:
        return parameters.number("floor.depth_m")
    below = parameters.number("water.bottom_below_m")
    return None if math.isnan(below) else parameters.deepest_m + below


def _bottom(parameters: Parameters, speed: float, water_depth: float) -> LogLayer:
    """The log layer that reaches `speed` at its top."""
    thickness = parameters.number("current.bottom_layer_m")
    return LogLayer(
        friction_velocity=speed * VON_KARMAN / math.log(thickness / BOTTOM_ROUGHNESS_M),
        direction_deg=parameters.number("current.bottom_direction_deg"),
        water_depth=water_depth,
        roughness=BOTTOM_ROUGHNESS_M,
        thickness=thickness,
    )


def _ekman(parameters: Parameters, surface_speed: float) -> Ekman:
    """The Ekman layer of a given surface speed and depth: both fix its viscosity and stress."""
    value = parameters.number
    latitude = value("water.latitude")
    f = abs(coriolis(latitude))
    viscosity = 0.5 * f * value("current.ekman_depth_m") ** 2
    stress = surface_speed * REFERENCE_DENSITY * math.sqrt(viscosity * f)
    return Ekman(
        stress=stress,
        viscosity=viscosity,
        density=REFERENCE_DENSITY,
        direction_deg=value("current.ekman_direction_deg"),
        latitude_deg=latitude,
    )


def build_density(parameters: Parameters) -> DensityProfile | None:
    """The mission's density profile; None is the constant reference density."""
    value = parameters.number
    if not value("water.stratified"):
        return None
    surface_salinity = value("water.surface_salinity")
    return DensityProfile.thermocline(
        surface_temperature=value("water.surface_temperature"),
        deep_temperature=value("water.deep_temperature"),
        surface_salinity=surface_salinity,
        deep_salinity=surface_salinity + value("water.salinity_increase"),
        mixed_layer_depth=value("water.mixed_layer_m"),
        decay_depth=value("water.thermocline_m"),
        max_depth=math.ceil(parameters.deepest_m) + DEEP_MARGIN_M,
        latitude=value("water.latitude"),
        longitude=value("water.longitude"),
    )


START_DAY = "mission.start_day"
EPOCH = datetime.datetime.fromisoformat(DEFAULT_TIME)
"""What days are counted from"""


def origin(parameters: Parameters) -> Origin:
    """Where and when the mission is, to the second."""
    days = datetime.timedelta(seconds=round(86400.0 * parameters.number(START_DAY)))
    return Origin(
        latitude_deg=parameters.number("water.latitude"),
        longitude_deg=parameters.number("water.longitude"),
        time=(EPOCH + days).isoformat(),
    )


def mission_place(parameters: Parameters, current: Current | None) -> dict[str, float | str]:
    """The place as a trajectory's provenance says it.

    Args:
      current: of all missions; a gridded file's place and time win.
    """
    place = origin(parameters)
    if current is not None:
        place = current.begins(parameters.duration_s, place)
    return {
        START_LATITUDE: place.latitude_deg,
        START_LONGITUDE: place.longitude_deg,
        START_TIME: str(place.time),
    }


def mission_coordinates(
    signals: Mapping[str, NDArray[np.float32]], place: Mapping[str, float | str]
) -> dict[str, NDArray[Any]]:
    """The coordinates of a flown mission, (samples,), as the store keeps them.

    Args:
      signals: as the store keeps them, (samples,).
      place: of `mission_place`.
    """
    north, east = (signals[f"true_{name}"].astype(float) for name in ("north", "east"))
    return flown_coordinates(sample_times(len(north), SAMPLE_PERIOD), north, east, place)
