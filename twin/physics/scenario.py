"""Scenario: everything that one simulated mission depends on, and its JSON description."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import NoneType
from typing import Any

from twin.errors import FloorError, InputError, MissionError, unknown_name
from twin.faults.base import Fault, check_fits, fault_from_dict
from twin.mission import Mission
from twin.mission.controller import Schedule
from twin.navigation.estimators.base import VelocityEstimator
from twin.navigation.settings import Navigation, navigation_from_dict
from twin.numbers import number
from twin.physics.start import Ballast, Start
from twin.physics.true_signals import ENGINES as ENGINES
from twin.physics.true_signals import SAMPLE_PERIOD as SAMPLE_PERIOD
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle
from twin.water.current.axes import FORMER_DEFAULT, Origin
from twin.water.current.base import Current, current_from_dict
from twin.water.density import DensityProfile
from twin.water.floor import Floor, floor_from_dict

SHORTEST, LONGEST = 1e-4, 1e10
"""[s] Limits of a run's duration and sample period: the shortest step and 300 years. Within them
every count of steps and samples is a whole number."""
AS_THEY_ARE = ("hydrodynamics", "timestep", "integrator", "centred", "sample_period")
"""Fields that a description stores unchanged."""
MAKERS = {
    "mission": "load_mission",
    "believed": "load_vehicle",
    "current": "parse_current",
    "density": "parse_density",
    "floor": "parse_floor",
}
"""Public function that makes a field's value from a text."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scenario:
    """Everything that one simulated mission depends on."""

    vehicle: Vehicle = dataclasses.field(default_factory=load_vehicle)
    """Vehicle that is simulated."""
    believed: Vehicle | None = None
    """Vehicle that guidance is trimmed for; None: the simulated one."""
    ballast: Ballast | None = None
    """Ballasting of the vehicle; None: neutral in water of the reference density."""
    encoder_zeros: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Position of each part, by name and in its unit, when its encoder reads 0; left out: 0."""
    compass_offset: float = 0.0
    """[rad] Error of guidance's compass: reading minus true heading."""
    mission: Mission | Schedule | None = None
    """Closed-loop mission, open-loop schedule, or None: a controller commands the vehicle."""
    faults: Sequence[Fault] = ()
    """Faults of the vehicle, each with the time from which it acts; see `twin.faults`."""
    navigate: Navigation | VelocityEstimator | str | None = None
    """Position that guidance uses. None or "truth": the true one. "estimate", a velocity estimator
    or its name, such as "network:runs/mine": an estimate on board. A Navigation also sets the
    sensors and their seed."""
    duration: float | None = None
    """[s] Duration of the run; None: the mission's own."""
    start: Start | Mapping[str, Any] | None = None
    """Start of the run: a `Start`, or a mapping of some of its fields, such as
    {"latitude": 49.0, "longitude": -16.0, "time": "2003-08-01T00:00"}; the mission sets the other
    fields. None: the mission's start depth and heading, at rest in the water."""
    current: Current | None = None
    density: DensityProfile | None = None
    """Density profile; None: the reference density, compressed with depth if the hull is."""
    floor: Floor | None = None
    """Sea floor that the hull collides with; None: bottomless water."""
    origin: Origin | None = None
    """Geographic position and time of the frame's origin; None: those of the start. See `place`."""
    engine: str = "mujoco"
    """Engine: "mujoco", or "lanes", the Fossen model for many vehicles in a batch."""
    hydrodynamics: str = "coefficients"
    timestep: float | None = None
    """[s] Step of the physics; None: the vehicle file's."""
    integrator: str | None = None
    centred: bool = True
    """Hydrodynamics at the time-centred velocity, second order (docs/physics/equations.md)."""
    sample_period: float = SAMPLE_PERIOD
    """[s] Time between samples, a whole number of physics steps."""

    def __post_init__(self) -> None:
        if isinstance(self.vehicle, str):
            object.__setattr__(self, "vehicle", load_vehicle(self.vehicle))
        if self.origin == Origin():
            object.__setattr__(self, "origin", None)  # the default origin means no origin
        object.__setattr__(self, "navigate", Navigation.of(self.navigate))
        if isinstance(self.start, Mapping):
            object.__setattr__(self, "start", Start.of(self.start, self.usual_start()))
        for name, kinds in (
            ("vehicle", Vehicle),
            ("mission", (Mission, Schedule, NoneType)),
            ("believed", (Vehicle, NoneType)),
            ("ballast", (Ballast, NoneType)),
            ("start", (Start, NoneType)),
            ("current", (Current, NoneType)),
            ("density", (DensityProfile, NoneType)),
            ("floor", (Floor, NoneType)),
            ("origin", (Origin, NoneType)),
        ):
            value = getattr(self, name)
            if not isinstance(value, kinds):
                way = f"twin.{MAKERS[name]}({value!r})" if name in MAKERS else ""
                made = f", as twin.{MAKERS[name]} makes" if way else ""
                wanted = way if isinstance(value, str) and way else f"{_class_names(kinds)}{made}"
                raise InputError(f"scenario: {name} is {value!r}; give {wanted}")
        if not isinstance(self.encoder_zeros, Mapping):
            raise InputError(
                f"scenario: encoder_zeros is {self.encoder_zeros!r}; give a mapping of parts and "
                "errors, such as {'PART': 0.01}"
            )
        for name, value in self.encoder_zeros.items():
            self.vehicle.part(name)
            if not math.isfinite(number(value, f"scenario: encoder_zeros[{name!r}]")):
                raise InputError(f"scenario: encoder_zeros[{name!r}] = {value} must be finite")
        if self.believed is not None and self.believed.part_names != self.vehicle.part_names:
            raise InputError(
                f"scenario: believed vehicle {self.believed.name!r} has other parts than "
                f"{self.vehicle.name!r}: {', '.join(self.believed.part_names)}"
            )
        object.__setattr__(self, "faults", tuple(self.faults))
        for fault in self.faults:
            if not isinstance(fault, Fault):
                raise InputError(
                    f"scenario: faults has {fault!r}; give what twin.parse_faults makes of a text "
                    "such as 'fouling:per_day=0.02,from=3d'"
                )
            check_fits(fault, self.vehicle)
        if not math.isfinite(number(self.compass_offset, "scenario: compass_offset")):
            raise InputError(f"scenario: compass_offset {self.compass_offset} must be finite")
        flown = self.mission
        if isinstance(flown, Mission) and flown.needs_place and not self.has_place:
            raise MissionError(
                f"mission {flown.name!r} goes to places on the Earth, but its start is "
                "missing: give --start LAT,LON, or "
                'start={"latitude": 49.0, "longitude": -16.0}'
            )
        if self.start is not None:
            self.begin.positions(self.vehicle.part_names, self.vehicle.rest)
            place = self.begin.origin(self.origin)
            if self.current is not None and self.begin.latitude is not None:
                self.current.check_place(place.latitude_deg, place.longitude_deg)
            if self.current is not None and self.begin.time is not None:
                self.current.check_time(str(self.begin.time))
        if self.density is None and self.vehicle.hull_compressibility > 0.0:
            # a compressible hull in incompressible water would sink without end
            water = DensityProfile.compressed(self.vehicle.reference_density)
            object.__setattr__(self, "density", water)
        self._check_floor()
        for name, what in (("sample_period", "sample period"), ("duration", "duration")):
            value = getattr(self, name)
            if name == "duration" and value is None:
                continue
            figure = number(value, f"scenario: {name}")
            if not isinstance(value, int | float):  # numpy's, for example
                object.__setattr__(self, name, figure)
            value = figure
            if not SHORTEST <= value <= LONGEST:
                raise InputError(f"{what} {value:g} s is outside {SHORTEST:g} to {LONGEST:g} s")
        if self.timestep is not None:
            number(self.timestep, "scenario: timestep")
        if self.engine not in ENGINES:
            raise InputError(unknown_name("engine", str(self.engine), ENGINES))
        for name in ("hydrodynamics", "integrator"):
            value = getattr(self, name)
            if not isinstance(value, str) and not (value is None and name == "integrator"):
                raise InputError(f"scenario: {name} is {value!r}: give its name as a text")

    def _check_floor(self) -> None:
        """Raise if a bathymetry has no place, or a mission that needs a sea floor has none."""
        flown = self.mission
        if self.floor is None:
            if isinstance(flown, Mission) and flown.needs_floor:
                raise MissionError(
                    f"mission {flown.name!r} goes by {flown.needs_floor}, and the scenario has no "
                    "sea floor: give one (--floor depth:200, floor=FlatFloor(depth_m=200)), "
                    f"or leave {flown.needs_floor} out"
                )
        elif self.floor.needs_place and not self.has_place:
            raise FloorError(
                "a bathymetry file needs to know where the mission starts: --start LAT,LON, or "
                'start={"latitude": 49.0, "longitude": -16.0}'
            )

    @property
    def open_ended(self) -> bool:
        """True when the run ends as soon as its mission has been flown."""
        plan = self.mission
        return self.duration is None and isinstance(plan, Mission) and plan.duration_s is None

    @property
    def begin(self) -> Start:
        """Start of the run: the given one, or else `usual_start`."""
        if self.start is None:
            return self.usual_start()
        assert isinstance(self.start, Start)  # __post_init__ has converted a mapping
        return self.start

    def usual_start(self) -> Start:
        """Start without `start`: at rest in the water at the mission's depth and heading.

        A vehicle that starts at the surface floats just immersed, as a neutral glider does. With
        the CB at depth 0, half of the hull would stand out of the water and drop.
        """
        plan, awash = self.mission, self.vehicle.hull_diameter / 2
        if isinstance(plan, Mission):
            heading = math.radians(plan.start_heading_deg)
            return Start(depth=max(plan.start_depth_m, awash), heading=heading)
        return Start(depth=awash)

    @property
    def place(self) -> Origin:
        """Geographic position and time of the origin: from the start, `origin`, or the default.

        Currents, density by name, pressure, stores and exports use it.
        """
        return self.begin.origin(self.origin)

    def mission_in_metres(self) -> Mission:
        """Mission with its targets in metres from `place`.

        Raises:
          InputError: a schedule or a controller commands the vehicle.
        """
        if not isinstance(self.mission, Mission):
            raise InputError("the scenario has no mission: a schedule or a controller flies it")
        return self.mission.placed(self.place.latitude_deg, self.place.longitude_deg)

    @property
    def has_place(self) -> bool:
        """True when the scenario gives its place on Earth; otherwise `place` is the default."""
        return self.origin is not None or self.begin.latitude is not None

    @property
    def believed_vehicle(self) -> Vehicle:
        """Vehicle that guidance is trimmed for."""
        return self.vehicle if self.believed is None else self.believed

    def run_time(self) -> float:
        """Longest duration [s]; raises InputError when neither scenario nor mission gives one."""
        duration = self.duration
        if duration is None and isinstance(self.mission, Mission):
            duration = self.mission_in_metres().time_limit_s(self.believed_vehicle)
        if duration is None:
            raise InputError("give a duration: neither the scenario nor its mission has one")
        if not SHORTEST <= duration <= LONGEST:
            raise InputError(
                f"duration {duration:g} s is outside {SHORTEST:g} to {LONGEST:g} s; change the "
                "mission"
            )
        return float(duration)

    def describe(self) -> dict[str, Any]:
        """Describe the scenario as a dict for JSON, which `scenario_from_dict` turns back.

        The vehicle is stored as its MJCF text and the fields that differ from it. Gridded currents
        are stored with a hash of their file.
        """
        duration = self.run_time()

        def pinned(water: Current | Floor | None) -> Any:
            return None if water is None else water.pinned(duration, self.place).describe()

        # a start with a time but no place does not set the origin's place
        origin = self.place if self.begin.latitude is not None else self.origin or Origin()
        plan: dict[str, Any] | None = None
        if self.mission is not None:
            kind = "mission" if isinstance(self.mission, Mission) else "schedule"
            plan = {"kind": kind, **self.mission.to_dict()}
        return {
            "vehicle": {
                "name": self.vehicle.name,
                "mjcf_sha256": hashlib.sha256(self.vehicle.xml.encode()).hexdigest(),
                "mjcf": self.vehicle.xml,
                "changes": self.vehicle.changes(),
            },
            "believed": None if self.believed is None else self.believed.changes(),
            "ballast": None if self.ballast is None else dataclasses.asdict(self.ballast),
            "encoder_zeros": dict(self.encoder_zeros),
            "compass_offset": self.compass_offset,
            **({"faults": [fault.describe() for fault in self.faults]} if self.faults else {}),
            "plan": plan,  # stores call the mission a plan
            "navigate": self.navigate.describe() if isinstance(self.navigate, Navigation) else None,
            "duration": self.duration,
            "start": None if self.start is None else dataclasses.asdict(self.begin),
            "current": pinned(self.current),
            "density": None if self.density is None else self.density.describe(),
            "floor": pinned(self.floor),
            "origin": dataclasses.asdict(origin),
            **({} if self.engine == ENGINES[0] else {"engine": self.engine}),
            **{name: getattr(self, name) for name in AS_THEY_ARE},
        }


def _class_names(kinds: type | tuple[type, ...]) -> str:
    """Names of classes as an error message lists them."""
    known = kinds if isinstance(kinds, tuple) else (kinds,)
    names = [kind.__name__ for kind in known if kind is not NoneType]
    return " or ".join(f"{'an' if name[0] in 'AEIOU' else 'a'} {name}" for name in names)


def scenario_from_dict(data: Mapping[str, Any]) -> Scenario:
    """Rebuild a scenario from `Scenario.describe`; raises InputError if a file has changed."""
    entry = data["vehicle"]
    vehicle = parse_vehicle(entry["mjcf"], Path(f"{entry['name']}.xml"))
    plan: Mission | Schedule | None = None
    if data["plan"] is not None:
        fields = {key: value for key, value in data["plan"].items() if key != "kind"}
        mission = data["plan"]["kind"] == "mission"
        plan = Mission.from_dict(fields) if mission else Schedule(**fields)

    def made(name: str, make: Callable[[Any], Any]) -> Any:
        value = data.get(name)
        return None if value is None else make(value)

    start = None if data["start"] is None else Start(**data["start"])
    # where the start has a place, the description's origin repeats it
    origin = None if start is not None and start.latitude is not None else data["origin"]
    if origin is not None and Origin(**origin) == FORMER_DEFAULT:
        origin = None  # the default of older versions, not a user's choice
    return Scenario(
        vehicle=vehicle.with_changes(entry["changes"]),
        believed=made("believed", vehicle.with_changes),
        ballast=made("ballast", lambda fields: Ballast(**fields)),
        encoder_zeros=data.get("encoder_zeros", {}),
        compass_offset=data.get("compass_offset", 0.0),
        faults=tuple(fault_from_dict(fault) for fault in data.get("faults", ())),
        mission=plan,
        navigate=made("navigate", navigation_from_dict),
        duration=data["duration"],
        start=start,
        current=made("current", current_from_dict),
        density=made("density", lambda fields: DensityProfile(**fields)),
        floor=made("floor", floor_from_dict),
        origin=None if origin is None else Origin(**origin),
        engine=data.get("engine", ENGINES[0]),
        **{name: data[name] for name in AS_THEY_ARE},
    )
