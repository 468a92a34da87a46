"""Encoders: the measured positions of the vehicle's moving parts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, UnknownName
from twin.numbers import number
from twin.records.schema import Variable, declare, variable
from twin.records.trajectory import actuator_names
from twin.sensors.base import Outset, Sensor, SensorRun, Signals, require_non_negative, signal


@dataclasses.dataclass(frozen=True, kw_only=True)
class Encoders(Sensor):
    """Resolution of the position readings; a reading is the nearest multiple. 0 is continuous.

    Each part whose position and command are in the truth has one channel. The Sea-Wing's are
    unpublished; 12-bit potentiometers over each range have such resolutions.
    """

    name = "encoders"
    ideal_is_truth = True

    shift_resolution: float = 2.5e-5
    """[m] Resolution of each sliding part: 0.1 m / 4096 for a battery"""
    rotation_resolution_deg: float = 0.05
    """[deg] Resolution of each turning part: 180 deg / 4096"""
    pump_resolution: float = 0.25
    """[cm3] Resolution of each pumped volume: 976 cm3 / 4096"""
    resolutions: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Resolutions of single parts by name, in the part's unit; 0 for parts of other units"""

    def __post_init__(self) -> None:
        require_non_negative(self, "shift_resolution", "rotation_resolution_deg", "pump_resolution")
        if not isinstance(self.resolutions, Mapping):
            raise InputError(
                f"Encoders.resolutions is {self.resolutions!r}: give a mapping of parts and steps"
            )
        steps = {
            part: number(step, f"Encoders.resolutions[{part!r}]")
            for part, step in self.resolutions.items()
        }
        object.__setattr__(self, "resolutions", steps)
        for part, step in steps.items():
            if not (math.isfinite(step) and step >= 0.0):
                raise InputError(
                    f"Encoders.resolutions[{part!r}] is {step:g}: it must be finite and at least 0"
                )

    @classmethod
    def ideal(cls) -> Encoders:
        """Make encoders with continuous readings."""
        return cls(shift_resolution=0.0, rotation_resolution_deg=0.0, pump_resolution=0.0)

    def inputs(self, signals: Iterable[str]) -> tuple[str, ...]:
        """Signals of the parts' positions."""
        return tuple(f"true_{part}" for part in actuator_names(signals))

    def channels(self, signals: Iterable[str]) -> tuple[Variable, ...]:
        """Variables of the parts' readings, in the units of their positions."""
        return tuple(_reading(part) for part in actuator_names(signals))

    def begin(self, outset: Outset) -> EncodersRun:
        """Begin to measure measured_PART, in the unit of true_PART, for each part.

        Raises:
          UnknownName: `resolutions` names a part that the vehicle lacks.
        """
        parts = actuator_names(outset.signals)
        for name in self.resolutions:
            if name not in parts:
                raise UnknownName("part with an encoder", name, parts)
        steps = self.shift_resolution, self.rotation_resolution_deg, self.pump_resolution
        by_unit = dict(zip(("m", "degree", "cm3"), steps, strict=True))
        usual = {part: by_unit.get(variable(f"true_{part}").units, 0.0) for part in parts}
        return EncodersRun({**usual, **self.resolutions})


@dataclasses.dataclass
class EncodersRun(SensorRun):
    """Encoders of one vehicle."""

    steps: dict[str, float]
    """Resolution of each part."""

    def measure(self, signals: Signals, first: int, last: int) -> dict[str, NDArray[Any]]:
        """See `SensorRun`."""
        out = {}
        for part, step in self.steps.items():
            true = signal(signals, f"true_{part}")[first:last]
            out[f"measured_{part}"] = np.rint(true * (1.0 / step)) * step if step > 0.0 else true
        return out


def _reading(part: str) -> Variable:
    """Variable of a part's encoder; for your own part it is declared like the position's."""
    true = variable(f"true_{part}")
    name = f"measured_{part}"
    try:
        return variable(name)
    except UnknownName:
        declare(Variable(name, true.units, f"{true.long_name}, by its encoder", limits=true.limits))
        return variable(name)
