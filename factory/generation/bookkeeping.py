"""Bookkeeping: what a store keeps of each mission beside its signals, as arrays.

Every drawn parameter, every constant of the sensors, how many attempts it took. Which arrays there
can be follows from the recipe. Those that say nothing, because all missions have the same fixed
value, are left out of the store.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from factory.sampling.distribution import Choice, Fixed
from factory.sampling.mission_kinds import kinds_for
from twin.records import attributes as names
from twin.records.coordinates import ATTRIBUTES, PLACE, place_arrays
from twin.records.storage.sharded import flag_attributes

if TYPE_CHECKING:
    from factory.sampling.draw import Parameters
    from factory.sampling.recipe import Recipe

UNUSED_CODE = -1
"""Stands in integer parameters where NaN stands in the others."""
SENSOR_PREFIX = "sensor_"
LENGTH = "mission.duration_h"
"""The parameter that has no array of its own: `duration` has it"""
SEGMENT = "segment"
"""Dimension of the parameters that are drawn for every segment."""


class FailedAttempt(NamedTuple):
    """An attempt that had to be replaced, as JSON lists and the arrays of a store have it."""

    mission: int
    attempt: int
    reason: str
    time_s: float | None
    """[s] when the simulation left the finite numbers; None: it never started"""


class FlownMission(NamedTuple):
    """One mission as it was made."""

    mission: int
    attempt: int
    """the attempt that succeeded, from 0"""
    samples: int
    parameters: Parameters
    place: Mapping[str, float | str]
    """where and when it began, as a trajectory's provenance says it"""
    sensors: Mapping[str, float]
    """the sensors' constants"""
    failures: tuple[FailedAttempt, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Column:
    """One array over missions."""

    name: str
    attributes: Mapping[str, Any]
    empty: float
    """what stands where there is nothing"""
    usual: float | None = None
    """the array is left out when no mission has another value; None: it is always there"""
    per_segment: bool = False

    def says_something(self, values: NDArray[Any]) -> bool:
        """Whether one of these values has to be kept."""
        if self.usual is None:
            return True
        blank = np.isnan(values) if values.dtype.kind == "f" else values == self.empty
        return bool((~blank & (values != self.usual)).any())


def columns(recipe: Recipe) -> list[Column]:
    """Every array over missions that a store of the recipe can have, but for those of its plan."""
    counted = {name: names.OF_MISSIONS[name] for name in (names.N_SAMPLES, names.ATTEMPT)}
    placed = {name: ATTRIBUTES[name] for name in PLACE}
    drawn = {
        SENSOR_PREFIX + name: constant_attributes(name, unit)
        for name, unit in recipe.suite.drawn_units().items()
    }
    return [
        *(Column(name=n, attributes=said, empty=0) for n, said in counted.items()),
        *(Column(name=n, attributes=said, empty=np.nan) for n, said in placed.items()),
        *(_parameter_column(recipe, name) for name in _parameters(recipe)),
        *(Column(name=n, attributes=said, empty=0.0, usual=0.0) for n, said in drawn.items()),
    ]


def constant_attributes(name: str, unit: str) -> dict[str, Any]:
    """CF attributes of a constant that a sensor draws for a mission."""
    text = "constant of this mission's sensors: " + name.replace("_", " ")
    return {"units": unit, "long_name": text}


def rows(recipe: Recipe, missions: Sequence[FlownMission]) -> dict[str, NDArray[Any]]:
    """The values of these missions for all of `columns`."""
    made: dict[str, NDArray[Any]] = {
        names.N_SAMPLES: np.array([flown.samples for flown in missions], np.int32),
        names.ATTEMPT: np.array([flown.attempt for flown in missions], np.int16),
    }
    places = place_arrays([flown.place for flown in missions])
    made |= {name: values for name, (_, values, _) in places.items()}
    longest = max(len(flown.parameters.segments) for flown in missions)
    for name in _parameters(recipe):
        parameter, words = recipe.table[name], option_names(recipe, name)
        if parameter.per_segment:
            drawn = [[s[name] for s in flown.parameters.segments] for flown in missions]
        else:
            drawn = [[flown.parameters.values[name]] for flown in missions]
        width = longest if parameter.per_segment else 1
        empty, kind = (UNUSED_CODE, np.int8) if words else (np.nan, np.float64)
        values: NDArray[Any] = np.full((len(drawn), width), empty, kind)
        for i, row in enumerate(drawn):
            if words:
                row = [UNUSED_CODE if isinstance(v, float) else words.index(v) for v in row]
            values[i, : len(row)] = row
        made[parameter.variable] = values if parameter.per_segment else values[:, 0]
    for name in recipe.suite.drawn_units():
        values = np.array([flown.sensors.get(name, 0.0) for flown in missions])
        made[SENSOR_PREFIX + name] = values
    return made


def option_names(recipe: Recipe, name: str) -> tuple[str, ...]:
    """The words that a parameter can be; stores keep their positions."""
    if name == "mission.kind":
        return kinds_for(recipe.vehicle)
    distribution = recipe.distributions[name]
    if isinstance(distribution, Choice):
        return tuple(option for option in distribution.options if isinstance(option, str))
    return ()


def _parameters(recipe: Recipe) -> list[str]:
    """Parameters that stores can have an array of: not those that are one word."""
    fixed = {n: one.value for n, one in recipe.distributions.items() if isinstance(one, Fixed)}
    return [
        name
        for name in recipe.table
        if name != LENGTH and (option_names(recipe, name) or not isinstance(fixed.get(name), str))
    ]


def _parameter_column(recipe: Recipe, name: str) -> Column:
    parameter, distribution = recipe.table[name], recipe.distributions[name]
    attributes: dict[str, Any] = {
        "units": parameter.unit,
        "long_name": parameter.long_name,
        "distribution": distribution.text(),
        "parameter": name,
    }
    if parameter.why:
        attributes["comment"] = parameter.why
    words = option_names(recipe, name)
    if words:
        attributes |= flag_attributes(parameter.long_name, words)
        del attributes["units"]
    fixed = distribution.value if isinstance(distribution, Fixed) else None
    return Column(
        name=parameter.variable,
        attributes=attributes,
        empty=UNUSED_CODE if words else np.nan,
        usual=fixed if isinstance(fixed, float) and not parameter.per_segment else np.nan,
        per_segment=parameter.per_segment,
    )
