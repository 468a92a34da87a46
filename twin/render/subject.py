"""Source: a stored mission as the subject of a picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from twin.errors import StoreError
from twin.records.attributes import is_logged
from twin.records.store import read_trajectory
from twin.records.tracks import choose_tracks, read_tracks
from twin.render.film import Subject
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle

TRACK = ("true_north", "true_east", "true_depth")
"""Signals without which there is nothing to draw."""


def read_subject(
    store: Path,
    mission: int = 0,
    *,
    vehicle: str | None = None,
    tracks: Path | None = None,
    names: str | None = None,
    title: str | None = None,
) -> Subject:
    """A mission of a store, with dead-reckoned tracks if there are any.

    Args:
      vehicle: name or file; None takes the vehicle whose MJCF text the store holds, or the shipped
        glider where it holds none (real logs).
      tracks: file as in `twin.records.tracks`.
      names: of those tracks, separated by commas; None takes all.
      title: first line of the picture; None is made from the store.

    Raises:
      StoreError, VehicleError, InputError: something cannot be read.
    """
    trajectory = read_trajectory(store, mission)
    lacking = [name for name in TRACK if name not in trajectory.signals]
    if lacking and is_logged(trajectory.provenance):
        raise StoreError(
            f"store {store} holds logs of real vehicles, which have no true track to draw: use "
            f"`twin plot {store} --mission {mission}` or `factory plot {store}`"
        )
    attributes = trajectory.provenance
    return Subject(
        trajectory=trajectory,
        vehicle=stored_vehicle(attributes) if vehicle is None else load_vehicle(vehicle),
        tracks=() if tracks is None else tuple(choose_tracks(read_tracks(tracks, mission), names)),
        title=_title(store, mission, attributes) if title is None else title,
    )


def stored_vehicle(attributes: dict[str, Any]) -> Vehicle:
    """The vehicle that a store's attributes describe, else the shipped glider."""
    scenario = _scenario(attributes)
    if scenario is not None:
        entry = scenario["vehicle"]
        vehicle = parse_vehicle(entry["mjcf"], Path(f"{entry['name']}.xml"))
        return vehicle.with_changes(entry["changes"])
    if "vehicle_mjcf" in attributes:
        return parse_vehicle(str(attributes["vehicle_mjcf"]), Path("vehicle.xml"))
    return load_vehicle()


def _scenario(attributes: dict[str, Any]) -> dict[str, Any] | None:
    """The description that `twin simulate` stores, or None."""
    if "scenario" not in attributes:
        return None
    described: dict[str, Any] = json.loads(attributes["scenario"])
    return described


def _title(store: Path, mission: int, attributes: dict[str, Any]) -> str:
    scenario = _scenario(attributes)
    plan = None if scenario is None else scenario.get("plan")
    if plan and plan.get("name"):
        return f"Mission {plan['name']}"
    return f"{store.stem}, mission {mission}"
