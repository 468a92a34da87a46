"""Shipped missions, by name."""

from __future__ import annotations

import dataclasses
import math
import warnings
from pathlib import Path

from twin.errors import MissionError, unknown_name
from twin.mission.plan import Mission
from twin.mission.segments import SawTooth
from twin.vehicle.vehicle import Vehicle

DEFAULT, PROPELLED = "default", "survey"
"""What a vehicle flies when nothing is said: a glider, and one with a propeller"""


def mission_names() -> tuple[str, ...]:
    """Names of the missions in `assets/missions/`."""
    return tuple(sorted(path.stem for path in _folder().glob("*.toml")))


def _folder() -> Path:
    from twin.vehicle.presets import assets_folder  # numpy, which help texts do without

    return assets_folder() / "missions"


def load_mission(
    mission: str | Path = "default", vehicle: Vehicle | None = None, *, above_floor: bool = False
) -> Mission:
    """A shipped mission by name, or any mission by the path of its TOML or Slocum file (.mi).

    Warns of everything in a Slocum file that is not flown, one line each.

    Args:
      mission: name or path.
      vehicle: that flies a Slocum file, as `twin.mission.slocum_mission.read_slocum` takes it.
      above_floor: likewise.

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
    """Name of the shipped mission that suits a vehicle: its file's, or by its parts."""
    by_parts = PROPELLED if vehicle.steered("speed") is not None else DEFAULT
    return vehicle.usual_mission or by_parts


def load_mission_for(
    vehicle: Vehicle, mission: str | Path | None = None, *, above_floor: bool = False
) -> Mission:
    """As `load_mission`, checked for a vehicle; None: the shipped one that suits it.

    Where nobody asked for the mission and the vehicle cannot hold its pitch, it is flown at the
    vehicle's own usual glide, and a warning says so.

    Raises:
      MissionError: as `load_mission`, or the vehicle cannot fly it; where the default mission is
        for another kind of vehicle, the message names the one that suits this one.
    """
    usual = usual_mission(vehicle)
    asked = mission is not None
    mission = usual if mission is None else mission
    loaded = load_mission(mission, vehicle, above_floor=above_floor)
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


def _at_usual_glide(mission: Mission, vehicle: Vehicle) -> Mission | None:
    """The mission with its saw-teeth at the vehicle's usual glide, and its ascent too where it
    must be; None where that does not fly either."""
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
