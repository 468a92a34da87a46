"""Stored flight: a store of `twin simulate` or `Trajectory.save` read back, for exports."""

from __future__ import annotations

import functools
from typing import Any

from factory.stores.generated import GeneratedStore, open_missions
from twin.bounded import parse_json
from twin.errors import StoreError
from twin.records.attributes import SCENARIO, SENSOR_SUITE, SETTINGS
from twin.records.logs import LogStore
from twin.records.place import read_place
from twin.records.reader import MissionStore
from twin.records.schema import MISSION
from twin.records.store_path import StorePath
from twin.sensors import SensorSuite


class StoredFlight(MissionStore):
    """A store of missions that were flown one by one, each from its scenario.

    Raises:
      StoreError: missing, damaged, of a newer schema, or flown without sensors.
    """

    def __init__(self, path: str | StorePath):
        super().__init__(path)
        attributes = self.attributes
        if SENSOR_SUITE not in attributes:
            raise StoreError(
                f"store {self.path} was flown without sensors, an export needs what they measured: "
                "`twin simulate --sensors field --out STORE` writes a store that has it"
            )
        try:
            self.scenario: dict[str, Any] = parse_json(attributes[SCENARIO], SCENARIO)
            settings = parse_json(attributes[SENSOR_SUITE], SENSOR_SUITE)["settings"]
            self.suite = SensorSuite.from_settings(settings)
        except (KeyError, TypeError, ValueError) as error:
            raise StoreError(
                f"store {self.path}: its attributes are damaged ({type(error).__name__}: {error})"
            ) from error

    @functools.cached_property
    def splits(self) -> list[str]:
        """Single flights belong to no split."""
        return ["none"] * len(self)

    def place(self, mission: int) -> dict[str, float | str]:
        """Where and when it began; see `twin.records.place`."""
        return read_place(self.dataset.isel({MISSION: mission}))


def is_flight(attributes: dict[Any, Any]) -> bool:
    """Whether a store's attributes are those of single flights, not of the factory's missions."""
    return SCENARIO in attributes and SETTINGS not in attributes


def open_exportable(path: str | StorePath) -> GeneratedStore | LogStore | StoredFlight:
    """As `open_missions`, and also a single flight of `twin simulate` with sensors.

    Raises:
      StoreError: it cannot be read, is none of these, holds no missions, or was flown without
        sensors.
    """
    with MissionStore(path) as reader:
        reader.check_filled()
        flight = is_flight(reader.attributes)
    return StoredFlight(path) if flight else open_missions(path)
