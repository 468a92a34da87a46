"""Way: steady motion of a vehicle (dive, climb or level), with the part positions that hold it.

Values of a segment are checked here against the vehicle that flies it. Targets too far away for a
mission are refused, and the error suggests the place that was likely meant.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from twin.errors import MissionError, unknown_name
from twin.geodesy import great_circle
from twin.mission.glide_balance import imbalance, newton, steady_flight, steady_glide
from twin.mission.mission_file import fail
from twin.numbers import Array
from twin.vehicle.parts import BatterySlide, Part
from twin.vehicle.vehicle import Vehicle

TIME_MARGIN = 1.5
"""[1] Factor on the time of steady motion, for inflections, turns and down-currents."""
SLACK = 1e-9
"""[1] Rounding, relative to the travel, by which a value may exceed a part's travel."""


class Way(NamedTuple):
    """Steady dive, climb or level motion."""

    pitch: float
    """[rad] Pitch, positive nose up."""
    vertical_speed: float
    """[m/s] Vertical speed, positive down."""
    speed: float
    """[m/s] Speed through the water."""
    angle_of_attack: float
    """[rad] Angle of attack."""
    command: Array
    """Positions of the parts, shape (parts,), that hold the motion without any loop."""


def way(
    vehicle: Vehicle,
    label: str,
    field: str,
    pitch_deg: float,
    net_mass: float,
    speed: float | None,
    *,
    trim_share: float = 0.0,
    within_travel: bool = False,
) -> Way:
    """Steady motion at a pitch; propelled if the vehicle has a propeller.

    Args:
      label, field: segment of the mission and its key, for errors.
      pitch_deg: signed [deg]. net_mass: signed [kg], positive heavy; unused without a pump.
        speed: [m/s] through the water, None: cruising; only for propelled vehicles.
      trim_share: fraction of the pitch that a battery next to an elevator holds, 0 to 1.
      within_travel: clip the pitching part at the end of its travel instead of raising an error.

    Raises:
      MissionError: the vehicle cannot fly it; the message names the segment and the field.
    """
    pitch = math.radians(pitch_deg)
    command = vehicle.rest
    pump = vehicle.steered_index("buoyancy")
    if pump is not None:
        command[pump] = vehicle.pump_for_net_mass(net_mass)
    if vehicle.steered("speed") is not None:
        speed = vehicle.cruise_speed if speed is None else speed
        driven = _propelled(vehicle, label, field, pitch, speed, command, within_travel, trim_share)
        return _straighten(vehicle, label, driven)
    if pump is None:
        raise MissionError(
            f"{label}: vehicle {vehicle.name!r} has neither a pump nor a propeller: nothing "
            "drives it"
        )
    try:
        glide = steady_glide(vehicle, pitch, net_mass)
    except MissionError as error:
        raise MissionError(f"{label}: {field} = {abs(pitch_deg):g}: {error}") from None
    pitching = vehicle.steered("pitch")
    if isinstance(pitching, BatterySlide):
        low, high = float(pitching.low), float(pitching.high)
        if not (within_travel or low <= glide.shift <= high):
            rule = (
                f"a shallower pitch (it needs the battery at {glide.shift:.4f} m, and vehicle "
                f"{vehicle.name!r} moves it from {low:g} to {high:g} m)"
            )
            fail(label, field, abs(pitch_deg), rule)
        command[vehicle.part_names.index(pitching.name)] = min(max(glide.shift, low), high)
    found = Way(pitch, glide.vertical_speed, glide.speed, glide.angle_of_attack, command)
    return _straighten(vehicle, label, found)


def level_way(vehicle: Vehicle, label: str, speed: float | None) -> Way:
    """Steady level motion of a vehicle with a propeller, with its other parts at rest.

    Args:
      label: segment of the mission, for errors. speed: [m/s] through the water, None: cruising.

    Raises:
      MissionError: the vehicle has no propeller, or cannot reach the speed.
    """
    if vehicle.steered("speed") is None:
        raise MissionError(
            f"{label}: vehicle {vehicle.name!r} has no propeller, so it keeps no depth while it "
            "goes ahead: give a saw-tooth"
        )
    speed = vehicle.cruise_speed if speed is None else speed
    found = _propelled(vehicle, label, "speed_m_s", None, speed, vehicle.rest, False)
    return _straighten(vehicle, label, found)


def _straighten(vehicle: Vehicle, label: str, steady: Way) -> Way:
    """Set the turning part for straight motion: at rest, unless the hull turns by itself.

    Sway, roll and the part's position are solved so that side force, roll moment and yaw moment
    vanish without a turn. The position is clipped to its travel; then the heading drifts.

    Raises:
      MissionError: no position of the part keeps it straight.
    """
    place = vehicle.steered_index("heading")
    if place is None or not vehicle.law.turns_by_itself:
        return steady
    part, alpha = vehicle.parts[place], steady.angle_of_attack
    scale, command = part.high - part.low, steady.command.copy()

    def left(x: Array) -> Array:
        command[place] = scale * x[2]
        ahead, down = (steady.speed * f(alpha) for f in (math.cos, math.sin))
        velocity = np.array([ahead, x[0], down])
        wrench = imbalance(vehicle, command, velocity, pitch=steady.pitch, roll=float(x[1]))
        return wrench[[1, 3, 5]] / (vehicle.mass * vehicle.gravity)

    found = newton(left, np.array([0.0, 0.0, part.rest / scale]))
    if found is None:
        raise MissionError(
            f"{label}: vehicle {vehicle.name!r} turns by itself (its hull's yaw_moment_offset), "
            f"and no position of its {part.name} keeps it straight at {steady.speed:.2f} m/s"
        )
    command[place] = min(max(scale * float(found[2]), part.low), part.high)
    return steady._replace(command=command)


def _propelled(
    vehicle: Vehicle,
    label: str,
    field: str,
    pitch: float | None,
    speed: float,
    command: Array,
    within_travel: bool,
    trim_share: float = 0.0,
) -> Way:
    """Steady motion under the propeller; pitch [rad], None: level."""
    pitching, trimming = vehicle.steered("pitch"), vehicle.steered("trim")
    more = ""
    if pitch is not None and trimming is not None:
        if trim_share < 1.0:
            more = f", or let the {trimming.name} take more of the pitch: trim_share"
        place = vehicle.part_names.index(trimming.name)
        shift = trim_share * standing_shift(vehicle, trimming, pitch)
        command[place] = min(max(shift, trimming.low), trimming.high)
    try:
        flight = steady_flight(vehicle, pitch, speed, command)
    except MissionError as error:
        raise MissionError(f"{label}: {error}{more}") from None
    command = flight.position
    if pitching is not None:
        place = vehicle.part_names.index(pitching.name)
        low, high = pitching.low, pitching.high
        if not (within_travel or low <= command[place] <= high):
            rule = (
                f"a shallower pitch or a higher speed_m_s{more} (it needs the {pitching.name} at "
                f"{pitching.text(command[place])}, and vehicle {vehicle.name!r} moves it from "
                f"{pitching.text(low)} to {pitching.text(high)})"
            )
            value = speed if pitch is None else abs(math.degrees(pitch))
            fail(label, field, round(value, 6), rule)
        command[place] = min(max(command[place], low), high)
    down = speed * math.sin(flight.angle_of_attack - flight.pitch)
    return Way(flight.pitch, down, speed, flight.angle_of_attack, command)


def standing_shift(vehicle: Vehicle, slide: Part, pitch: float) -> float:
    """Shift [m] of a battery slide that holds a pitch [rad] without speed."""
    place, position = vehicle.part_names.index(slide.name), vehicle.rest

    def moment(shift: float) -> float:
        position[place] = shift
        return float(imbalance(vehicle, position, np.zeros(3), pitch=pitch)[4])

    neutral = moment(0.0)
    return -neutral / (moment(1.0) - neutral)  # linear in the shift


def reject_missing(vehicle: Vehicle, label: str, segment: Any) -> None:
    """Raise MissionError for a segment's field about a part that the vehicle does not have.

    A field at its default is ignored.
    """
    slides = isinstance(vehicle.steered("pitch"), BatterySlide)
    for field in dataclasses.fields(segment):
        for ending, there, part in (
            ("net_mass_kg", vehicle.steered("buoyancy") is not None, "pump"),
            ("speed_m_s", vehicle.steered("speed") is not None, "propeller"),
            ("rotation_deg", vehicle.steered("heading") is not None, "part that turns it"),
            ("shift_m", slides, "battery slide"),
            ("trim_share", vehicle.steered("trim") is not None, "battery beside an elevator"),
        ):
            if field.name.endswith(ending) and not there:
                value = getattr(segment, field.name)
                if value is not None and value != field.default:
                    raise MissionError(
                        f"{label}: {field.name} = {value:g}: vehicle {vehicle.name!r} has no {part}"
                        f" (its parts: {', '.join(vehicle.part_names)}); leave {field.name} out"
                    )


def heading(degrees: float | None) -> float:
    """Convert a heading to its number in a row [rad]; NaN for None: the heading at entry."""
    return math.nan if degrees is None else math.radians(degrees % 360.0)


def turn_limit(vehicle: Vehicle, degrees: float) -> float:
    """Symmetric limit [rad] of the heading loop within the travel of the turning part."""
    part = vehicle.steered("heading")
    if part is None:
        return 0.0
    travel = min(-part.low, part.high)
    return float(min(math.radians(degrees), max(travel, 0.0)))


def _check_travel(
    label: str, field: str, value: float, unit: str, low: float, high: float, vehicle: Vehicle
) -> None:
    slack = SLACK * (high - low)
    if not low - slack <= value <= high + slack:
        rule = f"{low:g} to {high:g} {unit} (travel of vehicle {vehicle.name!r})"
        fail(label, field, value, rule)


def checked_shift(vehicle: Vehicle, label: str, shift: float) -> float:
    """Return `shift` [m] if it is within the travel of the pitching part."""
    part = vehicle.steered("pitch")
    assert part is not None
    _check_travel(label, "shift_m", shift, "m", float(part.low), float(part.high), vehicle)
    return shift


def checked_rotation(vehicle: Vehicle, label: str, field: str, degrees: float) -> float:
    """Convert `degrees` to rad if they are within the travel of the turning part."""
    part = vehicle.steered("heading")
    assert part is not None
    low, high = math.degrees(part.low), math.degrees(part.high)
    _check_travel(label, field, degrees, "deg", low, high, vehicle)
    return math.radians(degrees)


def checked_part(vehicle: Vehicle, label: str, name: str, value: float) -> int:
    """Index of the part of that name, if its travel allows `value` in its own unit."""
    if name not in vehicle.part_names:
        known = vehicle.part_names
        raise MissionError(f"{label}: parts: {unknown_name('part', name, known)}")
    part = vehicle.part(name)
    _check_travel(label, f"parts.{name}", value, part.unit, part.low, part.high, vehicle)
    return vehicle.part_names.index(name)


def check_net_mass(vehicle: Vehicle, label: str, field: str, net_mass: float) -> None:
    """Check that the pump can reach a signed `net_mass` [kg]; messages give magnitudes."""
    pump = vehicle.steered("buoyancy")
    assert pump is not None
    heaviest = vehicle.net_mass_for_pump(float(pump.low))
    lightest = -vehicle.net_mass_for_pump(float(pump.high))
    reach, direction = (heaviest, "heavy") if net_mass > 0 else (lightest, "light")
    if abs(net_mass) > reach * (1.0 + SLACK):
        rule = f"at most {reach:g} kg {direction} (pump of vehicle {vehicle.name!r})"
        fail(label, field, abs(net_mass), rule)


FARTHEST = 1000e3
"""[m] Largest distance of a target from the start. Farther, the tangent plane is too wrong (its
error grows as the cube of the distance), and the place is nearly always a mistake."""


def check_reachable(label: str, place: tuple[float, float], start: tuple[float, float]) -> None:
    """Raise MissionError for a target too far from the start; both latitude, longitude [degree]."""
    metres = great_circle(*place, *start)
    if metres <= FARTHEST:
        return
    near = [(great_circle(*one, *start), one, why) for one, why in _likely_places(*place)]
    likely = min((one for one in near if one[0] <= FARTHEST), default=None)
    hint = "check its signs (south and west are negative), and --start or --from"
    if likely is not None:
        (latitude, longitude), why = likely[1:]
        hint = f"did you mean {latitude:g}, {longitude:g} ({why})?"
    raise MissionError(
        f"{label} at {place[0]:g}, {place[1]:g} degree is {metres / 1e3:.0f} km from the start at "
        f"{start[0]:g}, {start[1]:g}; at most {FARTHEST / 1e3:.0f} km are flown: {hint}"
    )


def check_near(label: str, north: float, east: float) -> None:
    """Raise MissionError for a target too far from the origin, both in metres."""
    metres = math.hypot(north, east)
    if metres > FARTHEST:
        raise MissionError(
            f"{label} is {metres / 1e3:.0f} km from the origin; at most {FARTHEST / 1e3:.0f} km "
            "are flown: north_m and east_m are metres"
        )


def _likely_places(latitude: float, longitude: float) -> Iterator[tuple[tuple[float, float], str]]:
    """Yield places that could be meant, each with the mistake that leads to the given one."""
    yield (latitude, -longitude), "the sign of the longitude; west is negative"
    yield (-latitude, longitude), "the sign of the latitude; south is negative"
    yield (-latitude, -longitude), "the signs"
    for north, east in ((longitude, latitude), (longitude, -latitude), (-longitude, latitude)):
        if abs(north) <= 90.0:
            yield (north, east), "latitude comes first"
    north, east = (round(_minutes(degrees), 6) for degrees in (latitude, longitude))
    if abs(north) <= 90.0 and abs(east) <= 180.0:
        yield (
            (north, east),
            "a Slocum file has DDMM.mmm, degrees and minutes: "
            f"longitude {_minutes(east):.3f}, latitude {_minutes(north):.3f}",
        )


def _minutes(degrees: float) -> float:
    """Convert degrees to DDMM.mmm, the form that a Slocum's file needs."""
    part, whole = math.modf(abs(degrees))
    return math.copysign(100.0 * whole + 60.0 * part, degrees)
