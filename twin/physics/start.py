"""Start: position, time, attitude and motion at which a simulation begins, and the ballast."""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError, unknown_name
from twin.numbers import number, numbers
from twin.water.current.axes import HIGHEST_LATITUDE, Origin, same_place

if TYPE_CHECKING:
    from twin.vehicle.vehicle import Vehicle
    from twin.water.density import DensityProfile

DEEPEST_SEA = 11_000.0
"""[m] Depth of the Challenger Deep, rounded up; a ballasting depth below it is refused."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Start:
    """Position, time, attitude and motion at which a simulation begins.

    Raises:
      InputError: a place or a time that cannot be used.
    """

    north: float = 0.0
    """[m] North of the frame's origin."""
    east: float = 0.0
    """[m] East of the frame's origin."""
    depth: float = 0.0
    """[m] Depth of the centre of buoyancy."""
    roll: float = 0.0
    """[rad] Roll, positive to starboard."""
    pitch: float = 0.0
    """[rad] Pitch, positive nose up."""
    heading: float = 0.0
    """[rad] Heading, clockwise from north."""
    v_rel: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[m/s] Surge, sway and heave through the water; at zero the vehicle drifts with the water."""
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[rad/s] Roll, pitch and yaw rate, body FRD."""
    actuators: tuple[float, ...] | Mapping[str, float] = ()
    """Positions of the parts in their units: all in order, or some by name; empty: all at rest."""
    latitude: float | None = None
    """[degree] Latitude, north positive, WGS84; given with `longitude` or not at all."""
    longitude: float | None = None
    """[degree] Longitude, east positive, as -180..180 or 0..360."""
    time: str | datetime.date | None = None
    """UTC time: ISO 8601 text, a date or a datetime (naive: UTC); stored as text."""

    def __post_init__(self) -> None:
        for name in ("north", "east", "depth", "roll", "pitch", "heading"):
            number(getattr(self, name), f"start: {name}")
        for name in ("v_rel", "rates"):
            if numbers(getattr(self, name), f"start: {name}").shape != (3,):
                raise InputError(f"start: {name} is {getattr(self, name)!r}: give three numbers")
        if isinstance(self.actuators, Mapping):
            for part, position in self.actuators.items():
                number(position, f"start: actuators[{part!r}]")
        else:
            numbers(self.actuators, "start: actuators")
        if (self.latitude is None) != (self.longitude is None):
            missing = "longitude" if self.longitude is None else "latitude"
            raise InputError(f"start: {missing} is missing; give latitude and longitude together")
        if self.latitude is not None:
            _check_degrees("latitude", self.latitude, HIGHEST_LATITUDE)
            _check_degrees("longitude", self.longitude, 360.0)
            if self.north or self.east:
                raise InputError(
                    f"start: north {self.north:g} m and east {self.east:g} m beside a latitude: a "
                    "start with a place is the origin of its frame; leave north and east out, or "
                    "give the scenario an origin instead of the place"
                )
        if self.time is not None:
            object.__setattr__(self, "time", utc_text(self.time))
        for name in ("v_rel", "rates", "actuators"):
            if isinstance(getattr(self, name), list):  # as JSON and TOML have them
                object.__setattr__(self, name, tuple(getattr(self, name)))

    @classmethod
    def of(cls, given: Mapping[str, Any], rest: Start) -> Start:
        """Make a start from some fields by name; the other fields are taken from `rest`.

        Raises:
          InputError: a name that is no field (the nearest is offered), or an impossible value.
        """
        allowed = [field.name for field in dataclasses.fields(cls)]
        for name in given:
            if name not in allowed:
                raise InputError(f"start: {unknown_name('key', str(name), allowed)}")
        return dataclasses.replace(rest, **given)

    def origin(self, given: Origin | None = None) -> Origin:
        """Origin of the north-east-down frame: place and time of this start, else those of `given`.

        Raises:
          InputError: the start and `given` contradict each other.
        """
        origin = Origin() if given is None else given
        if self.latitude is not None and self.longitude is not None:
            if given is not None and not same_place(
                (self.latitude, self.longitude), (given.latitude_deg, given.longitude_deg)
            ):
                raise InputError(
                    f"the start is at latitude {self.latitude:g}, longitude {self.longitude:g}, "
                    f"the origin at {given.latitude_deg:g}, {given.longitude_deg:g}: leave origin "
                    "out, it follows from the start"
                )
            origin = dataclasses.replace(
                origin, latitude_deg=float(self.latitude), longitude_deg=float(self.longitude)
            )
        if self.time is not None:
            if origin.time is not None and utc_text(origin.time) != self.time:
                raise InputError(
                    f"the start's time is {self.time}, the origin's {origin.time}: leave origin "
                    "out, it follows from the start"
                )
            origin = dataclasses.replace(origin, time=str(self.time))
        return origin

    def positions(self, names: Sequence[str], rest: ArrayLike) -> NDArray[np.float64]:
        """Position of each part, shape (parts,).

        Args:
          names: of the vehicle's parts. rest: positions of parts without a given one, (parts,).

        Raises:
          InputError: `actuators` has a wrong number of values, or an unknown part.
        """
        positions = np.array(rest, dtype=np.float64)
        if isinstance(self.actuators, Mapping):
            for name, value in self.actuators.items():
                if name not in names:
                    raise InputError(unknown_name("part", name, names))
                positions[list(names).index(name)] = value
        elif len(self.actuators):
            if len(self.actuators) != len(positions):
                raise InputError(
                    f"start: actuators has {len(self.actuators)} positions, the vehicle has "
                    f"{len(positions)} parts: {', '.join(names)}"
                )
            positions[:] = self.actuators
        return positions


def utc_text(time: str | datetime.date) -> str:
    """Write a moment as ISO 8601 text in UTC, such as 2003-08-01T00:00:00.

    Args:
      time: text, a date or a datetime; without an offset it is taken as UTC.

    Raises:
      InputError: the text is not ISO 8601.
    """
    moment: object = time
    if isinstance(time, str):
        try:
            moment = datetime.datetime.fromisoformat(time.strip())
        except ValueError:
            moment = None
    elif isinstance(time, datetime.date) and not isinstance(time, datetime.datetime):
        moment = datetime.datetime.combine(time, datetime.time())
    if not isinstance(moment, datetime.datetime):
        raise InputError(
            f"start: time {time!r} is not ISO 8601; write UTC as 2003-08-01 or 2003-08-01T12:00"
        )
    if moment.tzinfo is not None:
        moment = moment.astimezone(datetime.UTC).replace(tzinfo=None)
    return moment.isoformat()


def parse_place(text: str) -> dict[str, Any]:
    """Parse "LATITUDE,LONGITUDE" or "LATITUDE,LONGITUDE,TIME" into fields of a `Start`.

    Raises:
      InputError: there are not two or three values, or a coordinate is not a number.
    """
    words = [word.strip() for word in text.split(",")]
    try:
        if len(words) not in (2, 3):
            raise ValueError
        place: dict[str, Any] = {"latitude": float(words[0]), "longitude": float(words[1])}
    except ValueError:
        raise InputError(
            f"start {text!r}: write LATITUDE,LONGITUDE or LATITUDE,LONGITUDE,TIME in degrees and "
            "UTC, such as 49,-16,2003-08-01T00:00"
        ) from None
    return {**place, "time": words[2]} if len(words) == 3 else place


def _check_degrees(name: str, value: object, largest: float) -> None:
    """Raise InputError unless a value is a number of degrees within +-largest."""
    number = isinstance(value, float | int | np.number) and not isinstance(value, bool)
    if not (number and abs(value) <= largest):  # type: ignore[arg-type]
        why = " (nearer to a pole a north-east frame has no meaning)" if largest < 90.0 else ""
        raise InputError(
            f"start: {name} = {value!r} must be a number within -{largest:g}..{largest:g} "
            f"degree{why}"
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ballast:
    """Ballasting of a vehicle: neutral at a depth but for an excess mass, or a known volume."""

    depth: float | None = None
    """[m] Depth in the mission's own water at which the vehicle is neutral."""
    heavy: float = 0.0
    """[kg] Excess of the vehicle's mass over neutral at `depth`."""
    volume: float | None = None
    """[m3] Volume of the hull at zero pressure and its reference temperature; replaces `depth`."""

    def __post_init__(self) -> None:
        if (self.depth is None) == (self.volume is None):
            raise InputError("ballast: give either a depth or a volume")
        if self.volume is not None and (self.heavy or not self.volume > 0.0):
            raise InputError("ballast: a volume [m3] is positive and needs no `heavy`")

    def neutral_volume(self, vehicle: Vehicle, density: DensityProfile | None) -> float:
        """Hull volume [m3] at zero pressure that gives `vehicle` this ballasting, pumps at neutral.

        The hull at `depth` has the temperature of the water there.
        """
        if self.volume is not None:
            return self.volume
        assert self.depth is not None
        pressure = vehicle.reference_density * vehicle.gravity * self.depth
        strain = -vehicle.hull_compressibility * pressure
        there = vehicle.reference_density
        if density is not None:
            there = float(density.density(self.depth))
            water = density.temperature_salinity(self.depth)
            if water is not None:
                warming = float(water[0]) - vehicle.hull_reference_temperature
                strain += vehicle.hull_thermal_expansion * warming
        if not self.heavy and density is None and not strain:
            return vehicle.neutral_volume
        return (vehicle.mass - self.heavy) / (there * (1.0 + strain))


def weighed(
    vehicle: Vehicle,
    *,
    ballast_at: float | None = None,
    mass: float | None = None,
    compressibility: float | None = None,
) -> tuple[Vehicle, Ballast | None]:
    """Vehicle with the given mass and compressibility, and its ballast; None: the file's ballast.

    Args:
      ballast_at: [m] depth at which the vehicle is neutral in the mission's water.
      mass: [kg] of the whole vehicle; the volume of its hull stays, unless `ballast_at` sets it.
      compressibility: [1/Pa] of its hull.

    Raises:
      InputError, VehicleError: impossible values.
    """
    volume = vehicle.neutral_volume
    if compressibility is not None:
        vehicle = vehicle.replace(hull_compressibility=compressibility)
    if mass is not None:
        if not 0.5 * vehicle.mass <= mass <= 1.5 * vehicle.mass:
            raise InputError(
                f"mass {mass:g} kg: vehicle {vehicle.name!r} has {vehicle.mass:g} kg; give a mass "
                "near that"
            )
        vehicle = vehicle.replace(static_mass=vehicle.static_mass + mass - vehicle.mass)
    if ballast_at is not None:
        if not 0.0 <= ballast_at <= DEEPEST_SEA:
            raise InputError(f"ballast_at {ballast_at:g} m: a depth is from 0 to {DEEPEST_SEA:g} m")
        return vehicle, Ballast(depth=ballast_at)
    return vehicle, None if mass is None else Ballast(volume=volume)


def out_of_trim(vehicle: Vehicle, ballast: Ballast | None, density: DensityProfile | None) -> str:
    """Warning that the pump cannot balance the vehicle at the surface; empty if it can."""
    part = vehicle.steered("buoyancy")
    if ballast is None or part is None:
        return ""
    water = vehicle.reference_density if density is None else float(density.density(0.0))
    net = vehicle.mass - water * ballast.neutral_volume(vehicle, density)
    lightest, heaviest = vehicle.net_mass_range
    reach = -lightest if net > 0.0 else heaviest
    if abs(net) <= reach:
        return ""
    word, fate = ("heavy", "climb") if net > 0.0 else ("light", "dive")
    return (
        f"vehicle {vehicle.name!r} is {abs(net):.2f} kg {word} at the surface of this water, and "
        f"its {part.name} carries {reach:.2f} kg: it will not {fate}; --ballast-at 0 makes it "
        "neutral there, as does another --mass"
    )
