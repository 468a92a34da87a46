"""Stored: a store of the factory read back, with everything that made it."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from factory.generation.mission_record import Failure
from factory.generation.shards import SENSOR_PREFIX, UNUSED_CODE
from factory.recipe.distribution import Distribution, Fixed, Value, parse_distribution
from factory.recipe.given_current import GivenCurrent, stored_current
from factory.recipe.parameter import Parameter
from factory.recipe.parameters import Table, parameter_table
from factory.recipe.plan import SPLITS
from factory.recipe.sampling import Parameters
from twin.errors import StoreError
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.store import IMPORT_REPORT, check_arrays, open_store
from twin.sensors import SensorSuite
from twin.vehicle.vehicle import Vehicle, parse_vehicle


class Stored:
    """A complete store of missions, flown or logged: what both kinds have.

    Raises:
      StoreError: missing, damaged or of a newer schema.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.dataset: xr.Dataset = open_store(self.path)

    def __len__(self) -> int:
        return int(self.dataset.sizes[MISSION])

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return float(self.dataset.attrs["sample_period_s"])

    @functools.cached_property
    def samples(self) -> NDArray[np.int64]:
        """Samples of each mission."""
        return np.asarray(self.small("n_samples"), np.int64)

    @functools.cached_property
    def splits(self) -> list[str]:
        """Name of each mission's split."""
        return [SPLITS[int(code)] for code in self.small("split")]

    def small(self, name: str) -> NDArray[Any]:
        """An array without a time axis.

        Raises:
          StoreError: it is missing or damaged.
        """
        try:
            return np.asarray(self.dataset[name].values)
        except Exception as error:
            reason = " ".join(str(error).split())
            raise StoreError(
                f"store {self.path}: array {name!r} cannot be read ({type(error).__name__}: "
                f"{reason})"
            ) from error

    def signals(self) -> list[str]:
        """Names of the stored signals (mission, time)."""
        return [
            name
            for name in VARIABLES
            if name in self.dataset and self.dataset[name].dims == (MISSION, TIME)
        ]

    def row(self, name: str, mission: int) -> NDArray[np.float32]:
        """One signal of one mission, padding included.

        Raises:
          StoreError: its chunk is missing or damaged.
        """
        try:
            return np.asarray(self.dataset[name][mission].values)
        except Exception as error:
            reason = " ".join(str(error).split())
            raise StoreError(
                f"store {self.path}: {name} of mission {mission} cannot be read "
                f"({type(error).__name__}: {reason})"
            ) from error

    def check_arrays(self) -> None:
        """Raise StoreError when the files of an array are gone."""
        check_arrays(self.dataset, self.path)

    def check_mission(self, mission: int) -> None:
        """Raise StoreError when there is no such mission."""
        if not 0 <= mission < len(self):
            raise StoreError(f"store {self.path} has missions 0 to {len(self) - 1}, not {mission}")


class StoredRun(Stored):
    """A store that `factory generate` made.

    Raises:
      StoreError: missing, damaged, of a newer schema, or not made by `factory generate`.
    """

    def __init__(self, path: str | Path):
        super().__init__(path)
        if is_log(self.dataset):
            raise StoreError(
                f"store {self.path} holds logs of real vehicles, which cannot be flown again; "
                "`factory verify` checks them"
            )
        try:
            self.settings: dict[str, Any] = json.loads(self.dataset.attrs["settings"])
            self._failed = json.loads(self.dataset.attrs["failed_missions"])
            self.distributions: dict[str, Distribution] = {
                name: parse_distribution(text, name)
                for name, text in self.settings["distributions"].items()
            }
        except (KeyError, ValueError) as error:
            if "scenario" in self.dataset.attrs:
                raise StoreError(
                    f"store {self.path} is a mission of `twin simulate`; `twin plot` and `twin "
                    "render` read it"
                ) from error
            raise StoreError(
                f"store {self.path} was not made by `factory generate`, or its attributes are "
                f"damaged ({type(error).__name__}: {error})"
            ) from error

    @property
    def seed(self) -> int:
        """Root of every random draw."""
        return int(self.settings["seed"])

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return float(self.settings["sample_period_s"])

    @functools.cached_property
    def hours(self) -> float:
        """Simulated time of all missions [h]."""
        return float(self.small("duration").sum()) / 3600.0

    @functools.cached_property
    def vehicle(self) -> Vehicle:
        """The nominal vehicle, from the MJCF text in the store."""
        name = str(self.settings["vehicle"])
        return parse_vehicle(str(self.dataset.attrs["vehicle_mjcf"]), Path(f"{name}.xml"))

    @functools.cached_property
    def table(self) -> Table:
        """Every parameter of missions of the vehicle."""
        return parameter_table(self.vehicle)

    @functools.cached_property
    def suite(self) -> SensorSuite:
        """The sensors, from their settings in the store."""
        return SensorSuite.from_settings(self.settings["sensors"])

    @functools.cached_property
    def given_current(self) -> GivenCurrent | None:
        """The current of all missions; None when each has its own."""
        description = self.settings.get("current")
        if description is None:
            return None
        return stored_current(description, float(self.small("duration").max()))

    def attempt(self, mission: int) -> int:
        """The attempt that made the stored mission."""
        return int(self.small("attempt")[mission])

    def parameters(self, mission: int) -> Parameters:
        """What the mission was made of.

        Raises:
          StoreError: the factory that made the store knew other parameters.
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
        kinds = columns["mission.kind"]
        count = sum(isinstance(kind, str) for kind in kinds)
        return Parameters(
            duration_s=float(self.small("duration")[mission]),
            values=values,
            segments=tuple(
                {name: column[i] for name, column in columns.items()} for i in range(count)
            ),
        )

    def _value(self, parameter: Parameter, mission: int) -> Value:
        if parameter.variable not in self.dataset:
            distribution = self.distributions[parameter.name]
            if isinstance(distribution, Fixed):
                return distribution.value
            raise StoreError(f"store {self.path} lacks the array {parameter.variable!r}")
        return self._word(parameter, self.small(parameter.variable)[mission])

    def _segments(self, parameter: Parameter, mission: int) -> list[Value]:
        if parameter.variable not in self.dataset:
            return [math.nan] * int(self.dataset.sizes["segment"])
        row = self.small(parameter.variable)[mission]
        return [self._word(parameter, value) for value in row]

    def _word(self, parameter: Parameter, value: Any) -> Value:
        meanings = self.dataset[parameter.variable].attrs.get("flag_meanings")
        if meanings is None:
            return float(value)
        return math.nan if value == UNUSED_CODE else str(meanings).split()[int(value)]

    def sensor_constants(self, mission: int) -> dict[str, float]:
        """The sensors' constants of a mission; those that no mission has are 0."""
        return {
            name: float(self.small(SENSOR_PREFIX + name)[mission])
            if SENSOR_PREFIX + name in self.dataset
            else 0.0
            for name in self.suite.drawn_units()
        }

    def failures(self) -> list[tuple[int, Failure]]:
        """The attempts that were replaced, with their missions."""

        def filled(values: Mapping[str, Any]) -> dict[str, Value]:
            return {name: math.nan if value is None else value for name, value in values.items()}

        return [
            (
                item["mission"],
                Failure(
                    attempt=item["attempt"],
                    reason=item["reason"],
                    time_s=item["time_s"],
                    values=filled(item["parameters"]),
                    segments=tuple(filled(segment) for segment in item["segments"]),
                ),
            )
            for item in self._failed
        ]


def is_log(dataset: xr.Dataset) -> bool:
    """Whether `factory import` wrote the store."""
    return IMPORT_REPORT in dataset.attrs
