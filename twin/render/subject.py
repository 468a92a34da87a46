"""Subject: the stored mission that a picture shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.records.attributes import SCENARIO
from twin.records.reader import MissionStore
from twin.records.store import read_trajectory
from twin.records.tracks import choose_tracks, read_tracks
from twin.render.film import Subject
from twin.vehicle.vehicle import load_vehicle

Array = NDArray[np.float64]

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
    floor: bool = True,
) -> Subject:
    """A mission of a store, with dead-reckoned tracks if there are any.

    Args:
      vehicle: name or file; None takes the store's, see `MissionStore.vehicle`.
      tracks: file as in `twin.records.tracks`.
      names: of those tracks, separated by commas; None takes all.
      title: first line of the picture; None is made from the store.
      floor: draw the sea floor of the mission where it has one.

    Raises:
      StoreError, VehicleError, InputError: something cannot be read.
    """
    trajectory, found = read_trajectory(store, mission), MissionStore(store)
    lacking = [name for name in TRACK if name not in trajectory.signals]
    if lacking and found.logged:
        raise StoreError(
            f"store {store} holds logs of real vehicles, which have no true track to draw: use "
            f"`twin plot {store} --mission {mission}` or `factory plot {store}`"
        )
    return Subject(
        trajectory=trajectory,
        vehicle=found.vehicle if vehicle is None else load_vehicle(vehicle),
        tracks=() if tracks is None else tuple(choose_tracks(read_tracks(tracks, mission), names)),
        title=_title(found, mission) if title is None else title,
        floor=_floor(found) if floor else None,
    )


def _floor(store: MissionStore) -> Array | None:
    """The sea floor that the mission of `twin simulate` had; raises FloorError if it is gone."""
    described = store.json(SCENARIO) if SCENARIO in store.attributes else {}
    if not described.get("floor"):
        return None
    from twin.physics.scenario import scenario_from_dict

    scenario = scenario_from_dict(described)
    assert scenario.floor is not None
    return scenario.floor.compile(scenario.run_time(), scenario.place)


def _title(store: MissionStore, mission: int) -> str:
    scenario = store.json(SCENARIO) if SCENARIO in store.attributes else {}
    plan = scenario.get("plan")
    if plan and plan.get("name"):
        return f"Mission {plan['name']}"
    return f"{store.path.stem}, mission {mission}"
