"""Request: what a forecast is asked for, checked before anything is flown."""

from __future__ import annotations

import dataclasses
import math

from twin import Mission, Origin, Vehicle, Waypoint
from twin.errors import InputError, MissionError, unknown_name
from twin.physics import ENGINES
from twin.water.current import Current

HOUR, DAY = 3600.0, 86400.0
FIELD_ERROR = 0.1
"""[m/s] of a forecast field's depth-averaged current, north and east each: of the size that models
of shelf seas have against gliders"""
LONGEST_HOURS = 240.0
LEAST_MEMBERS, MOST_MEMBERS = 10, 100_000
FASTEST = 3.0
"""[m/s] over ground: a glider's speed and 2 m/s of current, rounded up"""
SLOWEST = 0.1
"""[m/s] of a climb, for how far beyond the horizon members fly"""
DEEPEST = 1500.0
"""[m] for a vehicle whose file has no rated depth: that of the deepest among the shipped ones"""
LATE = 0.25
"""Of a dive, by which members come up later than others"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Request:
    """Where from, on what mission, in which water, how many members."""

    vehicle: Vehicle
    mission: Mission
    place: Origin
    """With its time."""
    hours: float = 12.0
    """How far ahead [h]."""
    members: int = 200
    field: Current | None = None
    """A forecast of the current; None: what the logs told goes on."""
    field_error: float = FIELD_ERROR
    """[m/s] standard deviation of its error, north and east each."""
    density: str = "usual"
    """Water column, as `twin simulate --density` takes it."""
    energy_left_kwh: float | None = None
    """Energy left in the batteries [kW h]; None: no days left are told."""
    seed: int = 0
    """Of the draws."""
    engine: str = "lanes"
    """What flies the members, as `Scenario.engine`."""

    def __post_init__(self) -> None:
        check_members(self.members, self.engine)
        check_hours(self.hours)
        for name, least, most in (("field_error", 0.0, 5.0), ("energy_left_kwh", 0.0, 1e4)):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and least < value <= most):
                raise InputError(f"forecast: {name} = {value:g} must be above 0, at most {most:g}")
        if self.seed < 0:
            raise InputError(f"forecast: seed = {self.seed} must be at least 0")
        if self.place.time is None:
            raise InputError("forecast: the start has no time: give LAT,LON,TIME")
        if self.mission.needs_floor:
            raise MissionError(
                f"mission {self.mission.name!r} goes by {self.mission.needs_floor}, and a forecast "
                f"has no sea floor: leave {self.mission.needs_floor} out"
            )

        self.notes()  # refuses targets that are too far

    def notes(self) -> tuple[str, ...]:
        """What is odd about depth and targets; MissionError where one is too far to be meant."""
        said = []
        placed = self.mission.placed(self.place.latitude_deg, self.place.longitude_deg)
        if isinstance(first := placed.segments[0], Waypoint):
            away = math.hypot(first.targets[0]["north_m"], first.targets[0]["east_m"])
            if away <= first.arrival_radius_m:
                said.append(
                    f"already within {first.arrival_radius_m:g} m of target 1 ({away:.0f} m): it "
                    "counts as reached at the start"
                )
            elif away > FASTEST * max(self.horizon, DAY):
                span = f"{self.hours:g} h" if self.horizon > DAY else "a day"
                said.append(
                    f"target 1 is {away / 1e3:.0f} km away, farther than anything goes in "
                    f"{span}: is it the place that is meant?"
                )
        rated, deepest = self.vehicle.rated_depth, self.deepest
        if deepest > (rated or DEEPEST):
            known = (
                f"{self.vehicle.name} is built for {rated:g} m"
                if rated
                else f"no vehicle that is known here is built for more than {DEEPEST:g} m; yours "
                'has it as <numeric name="rated_depth" data="METRES"/> in its file'
            )
            said.append(
                f"dives to {deepest:g} m, and {known}: the forecast flies them though nothing may "
                "come up from there; give a depth that it is built for"
            )
        return tuple(said)

    @property
    def deepest(self) -> float:
        """[m] of all dives of the mission."""
        return max(getattr(one, "max_depth_m", 0.0) for one in self.mission.segments)

    @property
    def horizon(self) -> float:
        """[s] within which surfacings are told."""
        return HOUR * self.hours

    @property
    def flown(self) -> float:
        """[s] that members fly: beyond the horizon, until those that are late are up, too."""
        return self.horizon + self.deepest / SLOWEST + LATE * longest_dive(self.mission)


def check_members(members: int, engine: str = "lanes") -> None:
    """Raise InputError for an unknown engine, and for members that are too few or too many."""
    if engine not in ENGINES:
        raise InputError(unknown_name("engine", str(engine), ENGINES))
    if not LEAST_MEMBERS <= members <= MOST_MEMBERS:
        raise InputError(
            f"forecast: members = {members} must be from {LEAST_MEMBERS} to {MOST_MEMBERS}: fewer "
            "say nothing of an ellipse"
        )


def check_hours(hours: float) -> None:
    """Raise InputError for a forecast that reaches nowhere, or too far ahead."""
    if not 0.0 < hours <= LONGEST_HOURS:
        raise InputError(f"forecast: hours = {hours:g} must be above 0, at most {LONGEST_HOURS:g}")


def mission_to(
    goto: str, *, depth: float, pitch_deg: float, surface_after_s: float, radius: float
) -> Mission:
    """A mission to places in the text "LAT,LON[;LAT,LON ...]".

    Raises:
      MissionError: a place that cannot be read, or an impossible depth or pitch.
    """
    targets = []
    for part in goto.split(";"):
        try:
            latitude, longitude = (float(word) for word in part.split(","))
        except ValueError:
            raise MissionError(
                f"goto {part.strip()!r}: write LAT,LON in degrees, with ; between places, such as "
                "36.9,-122.5;37,-122.6"
            ) from None
        targets.append({"latitude": latitude, "longitude": longitude})
    segment = Waypoint(
        targets=tuple(targets),
        max_depth_m=depth,
        pitch_deg=pitch_deg,
        surface_after_s=surface_after_s,
        arrival_radius_m=radius,
    )
    return Mission(name="goto", segments=(segment,))


def longest_dive(mission: Mission) -> float:
    """[s] between surfacings that a mission asks for; 3 h where it does not say."""
    times = [getattr(segment, "surface_after_s", None) for segment in mission.segments]
    return max((time for time in times if time is not None), default=3.0 * HOUR)
