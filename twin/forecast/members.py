"""Members: the scenarios that a forecast flies, each with its own vehicle, water and compass."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from twin.facade import in_water
from twin.forecast.known import Known
from twin.forecast.request import Request, believing, longest_dive
from twin.forecast.vehicle_draws import SPEED, draw_vehicles, known_compass, scaled_speed
from twin.forecast.water_draws import (
    INTERVAL,
    WaterDraws,
    calibration_deviation,
    draw_deviation,
    draw_field_error,
    draw_water,
)
from twin.mission import Mission
from twin.navigation.current import CurrentFilter, CurrentParameters
from twin.physics.scenario import Scenario
from twin.water.current import Series
from twin.water.current.base import Current
from twin.water.current.sampler import sample_track

Array = NDArray[np.float64]

SAMPLE_PERIOD = 10.0
"""[s] between two samples of a member: a surfacing is known to 3 m at 0.3 m/s"""
STEPS = 2.0
"""Times the vehicle file's physics step: in six hours the end moves by less than 5 m"""
UNTOLD = "the fixes of these logs do not tell it"
FASTEST = 3.0
"""[m/s] at which a drawn current is cut off: faster ones are no draws of a sea's current"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Members:
    """What is flown, and from what it was drawn; the first is the mean of what is known."""

    scenarios: tuple[Scenario, ...]
    spread: dict[str, str]
    """What was drawn, in words."""


def members_of(request: Request, known: Known) -> Members:
    """Draw the members.

    Raises:
      CurrentError, MissionError, VehicleError: the field, the mission or the vehicle does not do.
    """
    rng = np.random.default_rng(request.seed)
    duration, count = request.flown, request.members
    water = draw_water(known.filter_, duration, count, rng, longest_dive(request.mission))
    spread = {
        "current": f"{known.source}: known to {draw_deviation(known.filter_):.2f} m/s each way"
    }
    if request.field is not None:
        water, spread["current"] = _with_field(request, known, water, rng)
    told = known.by_model and known.tells_calibration
    vehicles, drawn = draw_vehicles(request.vehicle, count, rng, speed=not told)
    spread["vehicle"] = f"identified: {', '.join(drawn)}" if drawn else "not identified"
    scale, source = water.speed_scale, "by the fixes"
    deviation, _ = calibration_deviation(known.filter_)
    untold = f": {UNTOLD}" if known.by_model else ""
    if not told:
        deviation = CurrentParameters.speed_scale
        scale, source = _normal(rng, count, deviation), f"assumed{untold}"
    if told or not set(drawn) & set(SPEED):
        vehicles = [
            scaled_speed(one, float(part)) for one, part in zip(vehicles, scale, strict=True)
        ]
        spread["speed"] = f"{100.0 * scale[0]:+.1f} %, +-{100.0 * deviation:.1f} %, {source}"
    elif untold:
        spread["speed"] = f"as identified{untold}"
    compass, deviation, source = _compass(request, known, water, rng)
    spread["compass"] = (
        f"{math.degrees(compass[0]):+.1f} degree, +-{math.degrees(deviation):.1f} degree, {source}"
    )
    mission = believing(request.mission, known.last_current)
    nominal = _scenario(request, mission)
    scenarios = tuple(
        dataclasses.replace(
            nominal,
            vehicle=vehicle,
            believed=request.vehicle,
            compass_offset=-float(offset),
            current=_current(request.field, course),
        )
        for vehicle, offset, course in zip(vehicles, compass, water.current, strict=True)
    )
    return Members(scenarios=scenarios, spread=spread)


def _normal(rng: np.random.Generator, count: int, deviation: float) -> Array:
    """Draws about 0, (count,), the first of them 0."""
    draws = deviation * rng.standard_normal(count)
    draws[0] = 0.0
    return draws


def _compass(
    request: Request, known: Known, water: WaterDraws, rng: np.random.Generator
) -> tuple[Array, float, str]:
    """True heading less the compass's [rad], (member,), its deviation, and who says so."""
    identified, deviation = known_compass(request.vehicle)
    _, filtered = calibration_deviation(known.filter_)
    if known.tells_calibration:
        # by a flight model, whose compass was corrected: the filter's error is what remained of it
        return (identified if known.by_model else 0.0) + water.compass, filtered, "by the fixes"
    untold = f": {UNTOLD}" if known.legs else ""
    if deviation is not None:
        drawn = _normal(rng, request.members, deviation)
        return identified + drawn, deviation, f"identified{untold}"
    if untold:
        prior = CurrentFilter(latitude=request.place.latitude_deg, time=known.filter_.time)
        _, deviation = calibration_deviation(prior)
        return _normal(rng, request.members, deviation), deviation, f"assumed{untold}"
    return water.compass, filtered, "assumed"


def _scenario(request: Request, mission: Mission) -> Scenario:
    """The nominal one; its current is put in later."""
    duration = request.flown
    flown = dataclasses.replace(mission, duration_s=duration)
    place = request.place
    scenario = Scenario(
        vehicle=request.vehicle,
        mission=flown,
        duration=duration,
        start={
            "latitude": place.latitude_deg,
            "longitude": place.longitude_deg,
            "time": place.time,
            "heading": _first_heading(flown, request),
        },
        current=request.field,
        timestep=STEPS * file_step(request.vehicle.xml),
        sample_period=SAMPLE_PERIOD,
    )
    return in_water(scenario, request.density)


def file_step(xml: str) -> float:
    """[s] of the physics, as a vehicle file says; MuJoCo's default where it does not."""
    import mujoco

    return float(mujoco.MjSpec.from_string(xml).option.timestep)


def _first_heading(mission: Mission, request: Request) -> float:
    """[rad] toward the first target, so that no turn at the start takes time."""
    placed = mission.placed(request.place.latitude_deg, request.place.longitude_deg)
    targets = getattr(placed.segments[0], "targets", None)
    if not targets:
        return math.radians(mission.start_heading_deg)
    return math.atan2(targets[0]["east_m"], targets[0]["north_m"]) % (2.0 * math.pi)


def _with_field(
    request: Request, known: Known, water: WaterDraws, rng: np.random.Generator
) -> tuple[WaterDraws, str]:
    """The draws of the field's error, and what they are in words."""
    field = _mean_field(request)
    drawn = draw_field_error(
        water, known.filter_, field, request.field_error, rng, told=known.legs > 0
    )
    words = f"field, error {request.field_error:g} m/s"
    return drawn, words + (f", told by {known.source}" if known.legs else "")


def _mean_field(request: Request) -> tuple[float, float]:
    """North, east [m/s] at the start, mean over the depths of the first dives."""
    assert request.field is not None
    deepest = max(getattr(s, "max_depth_m", 0.0) for s in request.mission.segments)
    depths = np.linspace(0.0, max(deepest, 1.0), 21)
    rest = np.zeros_like(depths)
    program = request.field.compile(request.flown, request.place)
    north, east = sample_track(program, rest, rest, rest, depths, rest, rest, rest)[:, :2].T
    return float(north.mean()), float(east.mean())


def _current(field: Current | None, course: Array) -> Current:
    cut = np.clip(course, -FASTEST, FASTEST)
    series = Series(interval=INTERVAL, north=tuple(cut[:, 0]), east=tuple(cut[:, 1]))
    return series if field is None else field + series
