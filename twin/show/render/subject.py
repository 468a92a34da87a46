"""Subject: the stored mission that a picture shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, StoreError, VehicleError, quoted
from twin.records.attributes import SCENARIO
from twin.records.logged import LoggedTrajectory
from twin.records.reader import MissionStore
from twin.records.store import read_trajectory
from twin.records.tracks import choose_tracks, read_tracks
from twin.records.trajectory import Trajectory
from twin.show.figures.page_layout import missions_caption
from twin.show.render.film import Subject
from twin.show.render.playback import POSITION
from twin.vehicle.vehicle import Vehicle, load_vehicle

Array = NDArray[np.float64]


def read_subject(
    store: Path,
    mission: int = 0,
    *,
    missions: Sequence[int] | None = None,
    vehicle: str | None = None,
    tracks: Path | None = None,
    names: str | None = None,
    title: str | None = None,
    floor: bool = True,
) -> Subject:
    """A mission of a store, with dead-reckoned tracks if there are any.

    Of a log the corrected track, the flight model's velocities and the measured attitude stand for
    the truth; see `twin.logs.logged_mission`.

    Args:
      missions: dives of a log that are shown as one; None shows `mission` alone.
      vehicle: of a log, or of a store that does not say its vehicle: name or file; None takes the
        store's, see `MissionStore.vehicle`. Its flight model, if it has one, tells the velocities
        of a log.
      tracks: file as in `twin.records.tracks`.
      names: of those tracks, separated by commas; None takes all.
      title: first line of the picture; None is made from the store.
      floor: draw the sea floor of the mission where it has one.

    Raises:
      StoreError, VehicleError, InputError: something cannot be read, or a log has no track; a
        vehicle is given for a simulated mission whose store says its own.
    """
    found = MissionStore(store)
    found.check_filled()
    drawn = None if vehicle is None else load_vehicle(vehicle)
    trajectory: Trajectory
    if found.logged:
        chosen = [mission] if missions is None else list(missions)
        trajectory, drawn = _logged(store, chosen, vehicle, drawn)
        caption = missions_caption(found, chosen, None)
    elif missions is not None:
        raise InputError(
            f"several missions together are for logs: each mission of {store} is a flight of its "
            "own"
        )
    else:
        if drawn is not None and found.says_vehicle:
            raise InputError(
                f"--vehicle is for logs: store {store} has its own vehicle: {found.vehicle.name}; "
                "leave --vehicle out"
            )
        trajectory, caption = read_trajectory(store, mission), _title(found, mission)
    return Subject(
        trajectory=trajectory,
        vehicle=found.vehicle if drawn is None else drawn,
        tracks=() if tracks is None else tuple(choose_tracks(read_tracks(tracks, mission), names)),
        title=caption if title is None else title,
        floor=_floor(found) if floor else None,
    )


def _logged(
    store: Path, missions: list[int], vehicle: str | None, drawn: Vehicle | None
) -> tuple[LoggedTrajectory, Vehicle | None]:
    """The dives of a log with their track, and the vehicle to draw; raises StoreError without."""
    from twin.identify.start_values import start_vehicle
    from twin.logs.logged_mission import logged_trajectory

    try:
        trajectory = logged_trajectory(store, missions, vehicle)
    except VehicleError:  # only drawn: its flight has no model
        trajectory = logged_trajectory(store, missions)
    lacking = [name for name in POSITION if f"true_{name}" not in trajectory]
    if lacking:
        raise StoreError(
            f"store {store}: mission {missions[0]} lacks {' and '.join(lacking)}: it has no "
            f"flight model ({trajectory.unflown}), no track of its own and no two fixes; "
            f"`twin plot {quoted(store)} --figure log` shows what was measured"
        )
    if drawn is None and trajectory.vehicle is not None:
        drawn = start_vehicle(store)
    return trajectory, drawn


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
