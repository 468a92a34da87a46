"""Shipped missions by name, and a table of the shipped vehicles."""

from __future__ import annotations

import dataclasses
import math
import warnings
from dataclasses import dataclass
from pathlib import Path

from twin.errors import MissionError, unknown_name
from twin.mission.glide_balance import steady_glide
from twin.mission.plan import DEPTHS, Mission, built_for, check_depth
from twin.mission.segments import SawTooth, Segment
from twin.vehicle.presets import assets_folder, vehicle_names
from twin.vehicle.vehicle import Vehicle, load_vehicle

DEFAULT, PROPELLED = "default", "survey"
"""Default missions. DEFAULT: of a glider. PROPELLED: of a vehicle with a propeller."""


def mission_names() -> tuple[str, ...]:
    """Names of the missions in `assets/missions/`."""
    return tuple(sorted(path.stem for path in _folder().glob("*.toml")))


def _folder() -> Path:
    return assets_folder() / "missions"


def load_mission(
    mission: str | Path = "default", vehicle: Vehicle | None = None, *, above_floor: bool = False
) -> Mission:
    """Load a shipped mission by name, or a mission by the path of its TOML or Slocum file (.mi).

    Warns of each item in a Slocum file that is not flown, a line each.

    Args:
      mission: name or path.
      vehicle: vehicle that flies a Slocum file, as for `slocum_mission.read_slocum`.
      above_floor: use the altitudes in a Slocum file, as for `read_slocum`.

    Raises:
      MissionError: unknown name (the nearest is offered), unreadable or impossible mission.
    """
    text = str(mission)
    if text in mission_names():
        return Mission.from_toml(_folder() / f"{text}.toml")
    path = Path(text)
    if path.suffix.lower() in (".mi", ".ma"):
        from twin.mission.slocum_mission import read_slocum

        reading = read_slocum(path, vehicle, above_floor=above_floor)
        for note in reading.notes:
            warnings.warn(note, stacklevel=2)
        return reading.mission
    if path.suffix == ".toml" or path.is_file():
        return Mission.from_toml(path)
    raise MissionError(
        unknown_name("mission", text, mission_names()) + " or a path to a .toml or .mi"
    )


def usual_mission(vehicle: Vehicle) -> str:
    """Name of the shipped mission for a vehicle: that of its file, else by its parts."""
    by_parts = PROPELLED if vehicle.steered("speed") is not None else DEFAULT
    return vehicle.usual_mission or by_parts


def load_mission_for(
    vehicle: Vehicle, mission: str | Path | None = None, *, above_floor: bool = False
) -> Mission:
    """Load a mission as `load_mission` does, and check it for a vehicle; None: its usual mission.

    If the usual mission is too deep for the vehicle, it is flown at the depth that the vehicle is
    built for; if its pitch is impossible, at the vehicle's own usual glide. Both with a warning.

    Raises:
      MissionError: as for `load_mission`; or the vehicle cannot fly it. If a shipped mission is for
        another type of vehicle, the message names the usual one of this vehicle.
    """
    usual = usual_mission(vehicle)
    asked = mission is not None
    mission = usual if mission is None else mission
    loaded = load_mission(mission, vehicle, above_floor=above_floor)
    try:
        check_depth(loaded.deepest, vehicle)
    except MissionError as error:
        if asked:
            raise
        text = f"mission {usual!r} is flown to {built_for(vehicle):g} m: {error}"
        warnings.warn(text, stacklevel=2)
        loaded = _no_deeper(loaded, built_for(vehicle))
    try:
        loaded.check(vehicle)
    except MissionError as error:
        if not asked and (own := _at_usual_glide(loaded, vehicle)) is not None:
            pitch = math.degrees(vehicle.usual_glide[0])
            warnings.warn(
                f"mission {usual!r} is flown at the {pitch:.1f} deg of the vehicle's usual glide: "
                f"{error}",
                stacklevel=2,
            )
            return own
        if str(mission) not in mission_names() or str(mission) == usual:
            raise
        hint = f"the shipped mission for such a vehicle is {usual!r}"
        raise MissionError(f"{error}; {hint}") from None
    return loaded


def _no_deeper(mission: Mission, most: float) -> Mission:
    """Copy of the mission whose segments go no deeper than `most` [m]."""

    def bounded(one: Segment) -> Segment:
        depths = {name: getattr(one, name, None) for name in DEPTHS}
        deep = {name: most for name, depth in depths.items() if depth and depth > most}
        return dataclasses.replace(one, **deep)

    return dataclasses.replace(mission, segments=tuple(map(bounded, mission.segments)))


def _at_usual_glide(mission: Mission, vehicle: Vehicle) -> Mission | None:
    """Copy of the mission with its saw-teeth, and its ascent if needed, at the vehicle's usual
    glide; None if the vehicle cannot fly that either."""
    if vehicle.steered("speed") is not None:
        return None
    pitch = math.degrees(vehicle.usual_glide[0])
    segments = tuple(
        dataclasses.replace(one, pitch_deg=pitch, climb_pitch_deg=None)
        if isinstance(one, SawTooth)
        else one
        for one in mission.segments
    )
    for ascent in (mission.ascent_pitch_deg, pitch):
        own = dataclasses.replace(mission, segments=segments, ascent_pitch_deg=ascent)
        try:
            own.check(vehicle)
        except MissionError:
            continue
        return own
    return None


MISSING = "-"
"""Text of a cell without a value."""


@dataclass(frozen=True, kw_only=True)
class VehicleLine:
    """Numbers of one shipped vehicle; None if it lacks the part or does not glide."""

    name: str
    summary: str
    mass_kg: float
    propeller_high_rad_s: float | None
    """Largest rate of the propeller [rad/s]."""
    pump_low_cm3: float | None
    """Pump position at which the vehicle is heaviest [cm3]."""
    pump_high_cm3: float | None
    pump_rate_cm3_s: float | None
    turns_by: str
    """Name of the part that turns it."""
    pitch_deg: float | None
    """Magnitude of pitch in the usual glide [deg]."""
    net_mass_kg: float | None
    """Magnitude of net mass in the usual glide [kg]."""
    speed_m_s: float
    """Speed through still water of the reference density [m/s]: in the usual dive, or the cruising
    speed of a propelled vehicle."""
    climb_speed_m_s: float | None
    """Speed through the water in the usual climb [m/s]."""
    vertical_speed_m_s: float | None
    """Vertical speed in the usual dive [m/s], positive down."""
    source: str

    @classmethod
    def of(cls, vehicle: Vehicle) -> VehicleLine:
        """Numbers of a vehicle; raises MissionError if its usual glide is impossible."""
        pump, propeller = vehicle.steered("buoyancy"), vehicle.steered("speed")
        pitch, net_mass = vehicle.usual_glide
        dive = climb = None
        if propeller is None and not vehicle.holds_pose:
            dive, climb = (steady_glide(vehicle, -s * pitch, s * net_mass) for s in (1.0, -1.0))
        return cls(
            name=vehicle.name,
            summary=vehicle.summary,
            mass_kg=vehicle.mass,
            propeller_high_rad_s=None if propeller is None else propeller.high,
            pump_low_cm3=None if pump is None else pump.low,
            pump_high_cm3=None if pump is None else pump.high,
            pump_rate_cm3_s=None if pump is None else pump.rate,
            turns_by=vehicle.steering.get("heading", ""),
            pitch_deg=None if dive is None else math.degrees(pitch),
            net_mass_kg=None if dive is None else net_mass,
            speed_m_s=vehicle.cruise_speed if dive is None else dive.speed,
            climb_speed_m_s=None if climb is None else climb.speed,
            vertical_speed_m_s=None if dive is None else dive.vertical_speed,
            source=vehicle.source,
        )

    def cells(self) -> dict[str, str]:
        """Cells of the table as text, by column heading."""
        pump = MISSING
        if self.pump_low_cm3 is not None:
            pump = f"{self.pump_low_cm3:.0f} to {self.pump_high_cm3:.0f}"
        return {
            "vehicle": self.name,
            "mass kg": f"{self.mass_kg:.1f}",
            "propeller rad/s": _cell(self.propeller_high_rad_s, "g"),
            "pump cm3": pump,
            "cm3/s": _cell(self.pump_rate_cm3_s, "g"),
            "turned by": self.turns_by or MISSING,
            "pitch deg": _cell(self.pitch_deg, ".0f"),
            "net mass kg": _cell(self.net_mass_kg, ".2f"),
            "speed m/s": f"{self.speed_m_s:.2f}",
            "down m/s": _cell(self.vertical_speed_m_s, ".2f"),
        }


def _cell(value: float | None, form: str) -> str:
    return MISSING if value is None else format(value, form)


def shipped_vehicles() -> list[VehicleLine]:
    """Numbers of every shipped vehicle, in the order of names."""
    return [VehicleLine.of(load_vehicle(name)) for name in vehicle_names()]
