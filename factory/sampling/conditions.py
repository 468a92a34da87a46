"""Conditions: vehicle, currents, density, sea floor and place of one mission, from its parameters.

The sampled vehicle differs from the one that guidance assumes. The amplitudes of the currents add
up to one sampled largest speed.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from factory.sampling.distribution import number
from factory.sampling.parameters import ADDED_MASS, BOTTOM, FLOOR_DEPTH
from twin.physics.true_signals import SAMPLE_PERIOD
from twin.records.coordinates import START_LATITUDE, START_LONGITUDE, START_TIME, flown_coordinates
from twin.records.trajectory import sample_times
from twin.water import current as currents
from twin.water.current.axes import DEFAULT_TIME, Origin, coriolis

if TYPE_CHECKING:
    from factory.sampling.draw import Parameters
    from twin.physics.start import Ballast
    from twin.vehicle.vehicle import Vehicle
    from twin.water.current import Current
    from twin.water.density import DensityProfile
    from twin.water.floor import RoughFloor

BALLAST_FRACTION = 0.5
"""[1] Depth of neutral buoyancy relative to the deepest turning depth, as pilots ballast, so that
dive and climb lose equal buoyancy to the stratification"""
GRAM, MILLIMETRE = 1e-3, 1e-3
CURRENT_MARGIN = 0.5
"""[m/s] Current added to the fastest speed through the water, for the extent of the sea floor"""
SHALLOWEST_FLOOR_M, DEEPEST_FLOOR_M = 25.0, 130.0
"""[m] Limits of a survey's sea floor. SHALLOWEST_FLOOR_M is below every sampled depth plus
altitude; DEEPEST_FLOOR_M exceeds the DVL's range in places."""
PARTS = ("steady", "shear", "tide", "inertial", "ekman", "bottom", "wander")
WANDER_MEAN, WANDER_STD, WANDER_DIRECTION_STD_DEG = 0.6, 0.2, 30.0
"""Wandering current. WANDER_MEAN, WANDER_STD: mean and standard deviation of its speed over the
largest. WANDER_DIRECTION_STD_DEG: [degree] standard deviation of its direction"""
BOTTOM_ROUGHNESS_M = 1e-3
"""[m] Roughness length of the log layer, for sand"""
DEEP_MARGIN_M = 100.0
"""[m] Extent of the density profile below the deepest turning depth, for overshoots"""


def spread_vehicle(nominal: Vehicle, parameters: Parameters) -> Vehicle:
    """Return `nominal` with sampled coefficients, CG, compressibility and fields of its parts."""
    value = parameters.number
    law = nominal.law
    factors = {u.name: value(f"vehicle.{u.name}") for u in law.uncertainties()}
    factor = {cell: value(f"vehicle.added_mass_{name}") for name, (_, cell) in ADDED_MASS.items()}
    added_mass = nominal.added_mass.copy()
    for i, j in zip(*np.nonzero(np.triu(added_mass)), strict=True):
        # a coupling without its own factor gets the geometric mean of the factors of the motions
        # that it couples, so that the matrix stays positive definite
        own = factor.get((i, j))
        added_mass[i, j] *= math.sqrt(factor[i, i] * factor[j, j]) if own is None else own
        added_mass[j, i] = added_mass[i, j]
    cg = [0.0, MILLIMETRE * value("vehicle.cg_y_mm"), MILLIMETRE * value("vehicle.cg_z_mm")]
    parts = {
        part.name: {
            u.field: getattr(part, u.field) * value(f"vehicle.{part.name}_{u.name}")
            for u in part.uncertainties()
            if u.field is not None
        }
        for part in nominal.parts
    }
    return nominal.replace(
        law=law.scaled(factors),
        added_mass=added_mass,
        static_cg=nominal.static_cg + np.array(cg),
        hull_compressibility=nominal.hull_compressibility + value("vehicle.compressibility"),
        **parts,
    )


def believed_vehicle(nominal: Vehicle, parameters: Parameters) -> Vehicle:
    """Return `nominal` with those sampled coefficients that guidance knows."""
    uncertain = [u for u in nominal.law.uncertainties() if u.known]
    known = {u.name: parameters.number(f"vehicle.{u.name}") for u in uncertain}
    if all(known[u.name] == u.certain for u in uncertain):
        return nominal
    return nominal.replace(law=nominal.law.scaled(known))


def ballast_of(nominal: Vehicle, parameters: Parameters) -> Ballast:
    """Ballast: neutral at half the deepest turning depth, plus a glider's sampled error."""
    from twin.physics.start import Ballast

    heavy = 0.0
    if nominal.steered("buoyancy") is not None:
        heavy = GRAM * parameters.number("vehicle.ballast_g")
    return Ballast(depth=BALLAST_FRACTION * parameters.deepest_m, heavy=heavy)


def encoder_zeros(nominal: Vehicle, parameters: Parameters) -> dict[str, float]:
    """Positions of the parts at which their encoders read 0, in the parts' units."""
    return {
        part.name: u.scale * parameters.number(f"vehicle.{part.name}_{u.name}")
        for part in nominal.parts
        for u in part.uncertainties()
        if u.field is None
    }


def build_current(parameters: Parameters) -> Current | None:
    """Sum of the mission's currents, nowhere faster than `current.speed`; None is still water."""

    def value(name: str) -> float:
        return parameters.number(f"current.{name}")

    weights = {part: value(part) for part in PARTS}
    total, speed = sum(weights.values()), value("speed")
    if total <= 0.0 or speed <= 0.0:
        return None
    steady, shear, tide, inertial, ekman, bottom, wander = (
        speed * weight / total for weight in weights.values()
    )
    parts: list[Current] = []
    if steady:
        parts.append(currents.Uniform.toward(steady, value("steady_direction_deg")))
    if shear:
        parts.append(
            currents.Geostrophic(
                baroclinic=shear,
                direction_deg=value("shear_direction_deg"),
                scale_depth=value("shear_scale_m"),
            )
        )
    if tide:
        ellipse = currents.TidalEllipse(
            constituent=str(parameters.values["current.tide_constituent"]),
            semi_major=tide,
            semi_minor=tide * value("tide_ratio"),
            direction_deg=value("tide_direction_deg"),
            phase_deg=value("tide_phase_deg"),
        )
        parts.append(currents.Tide(ellipses=(ellipse,)))
    if inertial:
        parts.append(
            currents.Inertial(
                speed=inertial,
                layer_depth=value("inertial_layer_m"),
                direction_deg=value("inertial_direction_deg"),
            )
        )
    if ekman:
        parts.append(_ekman(parameters, ekman))
    if bottom and (depth := bottom_depth(parameters)) is not None:
        parts.append(_bottom(parameters, bottom, depth))
    if wander:
        parts.append(
            currents.GaussMarkov(
                speed=WANDER_MEAN * wander,
                speed_std=WANDER_STD * wander,
                max_speed=wander,
                direction_deg=value("wander_direction_deg"),
                direction_std_deg=WANDER_DIRECTION_STD_DEG,
                correlation_time=3600.0 * value("wander_time_h"),
                seed=int(value("wander_seed")),
            )
        )
    return parts[0] if len(parts) == 1 else currents.CurrentSum(parts=tuple(parts))


def _bottom(parameters: Parameters, speed: float, water_depth: float) -> Current:
    """Log layer with the velocity `speed` [m/s] at its top."""
    from twin.water.current.layers import VON_KARMAN

    thickness = parameters.number("current.bottom_layer_m")
    return currents.LogLayer(
        friction_velocity=speed * VON_KARMAN / math.log(thickness / BOTTOM_ROUGHNESS_M),
        direction_deg=parameters.number("current.bottom_direction_deg"),
        water_depth=water_depth,
        roughness=BOTTOM_ROUGHNESS_M,
        thickness=thickness,
    )


def _ekman(parameters: Parameters, surface_speed: float) -> Current:
    """Ekman layer with a given surface speed [m/s] and depth, which give viscosity and stress."""
    from twin.water.density import REFERENCE_DENSITY

    value = parameters.number
    latitude = value("water.latitude")
    f = abs(coriolis(latitude))
    viscosity = 0.5 * f * value("current.ekman_depth_m") ** 2
    return currents.Ekman(
        stress=surface_speed * REFERENCE_DENSITY * math.sqrt(viscosity * f),
        viscosity=viscosity,
        density=REFERENCE_DENSITY,
        direction_deg=value("current.ekman_direction_deg"),
        latitude_deg=latitude,
    )


def build_floor(parameters: Parameters, vehicle: Vehicle) -> RoughFloor | None:
    """Sea floor of a survey, out to the vehicle's range; None for missions in open water."""
    from twin.water.floor import RoughFloor

    if FLOOR_DEPTH not in parameters.values:
        return None
    value = parameters.number
    speeds = [number(segment, "mission.speed_m_s") for segment in parameters.segments]
    fastest = max((s for s in speeds if not math.isnan(s)), default=0.0)
    fastest = max(fastest, vehicle.cruise_speed) + CURRENT_MARGIN
    return RoughFloor(
        depth_m=value(FLOOR_DEPTH),
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
    """Depth [m] of the bottom, for surveys the mean; None if the bottom affects nothing."""
    if FLOOR_DEPTH in parameters.values:
        return parameters.number(FLOOR_DEPTH)
    below = parameters.number(BOTTOM)
    return None if math.isnan(below) else parameters.deepest_m + below


def build_density(parameters: Parameters) -> DensityProfile | None:
    """Density profile of the mission; None is the constant reference density."""
    from twin.water.density import DensityProfile

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


def origin(parameters: Parameters) -> Origin:
    """Start place and time of the mission, to the second; days are counted from DEFAULT_TIME."""
    seconds = round(86400.0 * parameters.number("mission.start_day"))
    start = datetime.datetime.fromisoformat(DEFAULT_TIME) + datetime.timedelta(seconds=seconds)
    return Origin(
        latitude_deg=parameters.number("water.latitude"),
        longitude_deg=parameters.number("water.longitude"),
        time=start.isoformat(),
    )


def mission_place(parameters: Parameters, current: Current | None) -> dict[str, float | str]:
    """Start place and time with the names of a trajectory's provenance.

    Args:
      current: given current of all missions; place and time of a gridded file take precedence.
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
    """Coordinates of a flown mission, (samples,), in the form of stores.

    Args:
      signals: rounded signals, (samples,).
      place: result of `mission_place`.
    """
    north, east = (signals[f"true_{name}"].astype(float) for name in ("north", "east"))
    return flown_coordinates(sample_times(len(north), SAMPLE_PERIOD), north, east, place)
