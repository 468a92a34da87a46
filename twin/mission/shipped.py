"""Shipped missions, by name."""

from __future__ import annotations

from pathlib import Path

from twin.errors import MissionError, unknown_name
from twin.mission.plan import Mission

_FOLDER = Path(__file__).resolve().parent.parent / "missions"


def mission_names() -> tuple[str, ...]:
    """Names of the missions in `twin/missions/`."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))


def load_mission(mission: str | Path = "default") -> Mission:
    """A shipped mission by name, or any mission by the path of its TOML file.

    Raises:
      MissionError: unknown name (the nearest is offered), unreadable or impossible mission.
    """
    text = str(mission)
    if text in mission_names():
        return Mission.from_toml(_FOLDER / f"{text}.toml")
    path = Path(text)
    if path.suffix == ".toml" or path.is_file():
        return Mission.from_toml(path)
    raise MissionError(unknown_name("mission", text, mission_names()) + " or a path to a .toml")
