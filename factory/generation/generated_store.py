"""Generated store: read a store of `factory generate` with its recipe, parameters and failures.

`StoredFlight` reads a store of `twin simulate` or `Trajectory.save`, for exports.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from factory.generation.completion import (
    FAILED_ATTEMPT,
    FAILED_MISSION,
    FAILED_REASON,
    FAILED_TIME,
    SENSOR_PREFIX,
    UNUSED_CODE,
    FailedAttempt,
)
from factory.sampling.distribution import Distribution, Fixed, Parameter, Value, parse_distribution
from factory.sampling.draw import Parameters
from factory.sampling.parameters import ADDED, Table, parameter_table
from factory.sampling.recipe import Recipe, read_recipe
from twin.bounded import parse_json
from twin.errors import StoreError
from twin.records.attributes import (
    ATTEMPT,
    CHANGES,
    DURATION,
    FAILED_MISSIONS,
    SCENARIO,
    SENSOR_SUITE,
    SENSORS,
    SETTINGS,
    VEHICLE_MJCF,
)
from twin.records.coordinates import read_place
from twin.records.logged import LogStore
from twin.records.reader import MissionStore
from twin.records.schema import MISSION
from twin.records.storage.store_path import StorePath
from twin.sensors import SensorSuite

if TYPE_CHECKING:
    from factory.sampling.fly import GivenCurrent


class GeneratedStore(MissionStore):
    """Store that `factory generate` made.

    Raises:
      StoreError: missing, damaged, of a newer schema, or not made by `factory generate`.
    """

    def __init__(self, path: str | StorePath):
        super().__init__(path)
        self._read: dict[str, NDArray[Any]] = {}
        if self.logged:
            raise StoreError(
                f"store {self.path} holds logs of real vehicles, which cannot be flown again; "
                "`factory verify` checks them"
            )
        try:
            self.settings: dict[str, Any] = parse_json(self.attributes[SETTINGS], SETTINGS)
            failed = self.attributes.get(FAILED_MISSIONS, "[]")
            self._failed = parse_json(failed, FAILED_MISSIONS)
            self.distributions: dict[str, Distribution] = {
                name: parse_distribution(text, name)
                for name, text in {**ADDED, **self.settings["distributions"]}.items()
            }
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            if SCENARIO in self.attributes:
                what = "is a mission of `twin simulate`; `twin plot` and `twin render` read it"
            else:
                what = "was not made by `factory generate`, or its attributes are damaged "
                what += f"({type(error).__name__}: {error})"
            raise StoreError(f"store {self.path} {what}") from error

    @property
    def sensor_preset(self) -> str:
        """Name of the sensor suite; `ideal` sensors have no errors."""
        return str(self.attributes[SENSORS])

    @property
    def seed(self) -> int:
        """Root of every random draw."""
        return int(self.settings["seed"])

    @functools.cached_property
    def hours(self) -> float:
        """[h] Simulated time of all missions."""
        return float(self.array(DURATION).sum()) / 3600.0

    @functools.cached_property
    def table(self) -> Table:
        """Parameters of the vehicle's missions by name."""
        return parameter_table(self.vehicle)

    @functools.cached_property
    def suite(self) -> SensorSuite:
        """Sensor suite, from the settings in the store."""
        return SensorSuite.from_settings(self.settings["sensors"])

    @functools.cached_property
    def given_current(self) -> GivenCurrent | None:
        """Current of all missions; None if each mission has its own."""
        description = self.settings.get("current")
        if description is None:
            return None
        from factory.sampling.fly import given_current

        return given_current(description, float(self.array(DURATION).max()))

    @functools.cached_property
    def recipe(self) -> Recipe:
        """Recipe of the store, to fly any mission again.

        If libraries have other versions now, the last bits of a result may differ.

        Raises:
          StoreError: the recipe is damaged, or this program would sample or fly it differently.
        """
        own = self.settings["distributions"]
        older = {name: text for name, text in ADDED.items() if name not in own}
        document = {
            SETTINGS: {**self.settings, "distributions": {**older, **own}},
            CHANGES: {**older, **self.json(CHANGES)},
            VEHICLE_MJCF: self.attributes[VEHICLE_MJCF],
        }
        try:
            return read_recipe(document, any_versions=True)
        except StoreError as error:
            raise StoreError(f"store {self.path}: {error}") from error

    def attempt(self, mission: int) -> int:
        """Return the number of the attempt that made the stored mission."""
        return int(self._at(ATTEMPT, mission))

    def _at(self, name: str, mission: int) -> Any:
        """Value for a mission in an array over missions; the array is read once and kept."""
        if name not in self._read:
            self._read[name] = self.array(name)
        return self._read[name][mission]

    def parameters(self, mission: int) -> Parameters:
        """Read the sampled parameters of a mission.

        Raises:
          StoreError: the version of the factory that made the store had other parameters.
        """
        changed = sorted(self.distributions.keys() ^ self.table.keys())
        if changed:
            raise StoreError(
                f"store {self.path} was made by a factory with other parameters "
                f"({', '.join(changed)}): verify and replay it with glider-twin "
                f"{self.settings['versions']['glider-twin']} as it was then"
            )
        values: dict[str, Value] = {}
        columns: dict[str, list[Value]] = {}
        for name, parameter in self.table.items():
            if name == "mission.duration_h":
                continue
            if parameter.per_segment:
                columns[name] = self._segments(parameter, mission)
            else:
                values[name] = self._value(parameter, mission)
        count = sum(isinstance(kind, str) for kind in columns["mission.kind"])
        segments = ({name: column[i] for name, column in columns.items()} for i in range(count))
        duration = float(self._at(DURATION, mission))
        return Parameters(duration_s=duration, values=values, segments=tuple(segments))

    def _value(self, parameter: Parameter, mission: int) -> Value:
        distribution = self.distributions[parameter.name]
        if parameter.variable not in self and isinstance(distribution, Fixed):
            return distribution.value
        return self._word(parameter, self._at(parameter.variable, mission))

    def _segments(self, parameter: Parameter, mission: int) -> list[Value]:
        if parameter.variable not in self:
            return [math.nan] * int(self.dataset.sizes["segment"])
        return [self._word(parameter, value) for value in self._at(parameter.variable, mission)]

    def _word(self, parameter: Parameter, value: Any) -> Value:
        words = self.flags(parameter.variable)
        if not words:
            return float(value)
        return math.nan if value == UNUSED_CODE else words[int(value)]

    def sensor_constants(self, mission: int) -> dict[str, float]:
        """Read the sampled constants of a mission's sensors; constants without an array are 0."""
        stored = {name: SENSOR_PREFIX + name for name in self.suite.drawn_units()}
        return {n: float(self._at(a, mission)) if a in self else 0.0 for n, a in stored.items()}

    def failures(self) -> list[FailedAttempt]:
        """List the attempts that failed and were replaced."""
        if FAILED_MISSION not in self.dataset.variables:
            fields = ("mission", "attempt", "reason", "time_s")
            return [FailedAttempt(*(item[name] for name in fields)) for item in self._failed]
        columns = (FAILED_MISSION, FAILED_ATTEMPT, FAILED_REASON, FAILED_TIME)
        rows = zip(*(self.array(name).tolist() for name in columns), strict=True)
        return [FailedAttempt(m, n, why, None if math.isnan(t) else t) for m, n, why, t in rows]


def open_missions(path: str | StorePath) -> GeneratedStore | LogStore:
    """Open a store of the factory or a store of logs.

    Raises:
      StoreError: the store cannot be read, is neither of these, or holds no missions.
    """
    with MissionStore(path) as store:
        store.check_filled()
        return LogStore(path) if store.logged else GeneratedStore(path)


class StoredFlight(MissionStore):
    """Store of single missions, each flown from its own scenario.

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
        """Split of each mission: "none", since single flights have no split."""
        return ["none"] * len(self)

    def place(self, mission: int) -> dict[str, float | str]:
        """Read a mission's start place and time; see `twin.records.coordinates`."""
        return read_place(self.dataset.isel({MISSION: mission}))


def is_flight(attributes: dict[Any, Any]) -> bool:
    """True if `attributes` belong to a store of single flights, not to one of the factory."""
    return SCENARIO in attributes and SETTINGS not in attributes


def open_exportable(path: str | StorePath) -> GeneratedStore | LogStore | StoredFlight:
    """Open a store as `open_missions`, or a single flight of `twin simulate` with sensors.

    Raises:
      StoreError: the store cannot be read, is none of these, holds no missions, or was flown
        without sensors.
    """
    with MissionStore(path) as reader:
        reader.check_filled()
        flight = is_flight(reader.attributes)
    return StoredFlight(path) if flight else open_missions(path)
