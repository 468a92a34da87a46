"""Legs of a dive: descents and climbs by depth, and the log's signal of what steers them."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Container
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from twin.vehicle.parts import BatteryHinge, BatterySlide, Fin, Part, Pump
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]
Phase = Literal["dive", "climb"]
PHASES: tuple[Phase, ...] = ("dive", "climb")

REVERSAL = 5.0
"""[m] of the other way that end a leg: `factory import` calls a dive what is deeper than this"""
LEAST_RANGE = 15.0
"""[m] of a leg that is compared; a shorter one is an inflection and little else"""
MARGIN, LEAST_MARGIN = 0.1, 3.0
"""Part of a leg's range, and metres at least, that are inflection at either end of it"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeadingLeg:
    """A descent or a climb: samples `first` to `last`."""

    first: int
    last: int
    phase: Phase
    top: float
    """[m]"""
    bottom: float
    """[m]"""

    @property
    def samples(self) -> slice:
        """Its samples."""
        return slice(self.first, self.last + 1)

    @property
    def band(self) -> tuple[float, float]:
        """Depths [m] between which it is away from its inflections."""
        margin = max(MARGIN * (self.bottom - self.top), LEAST_MARGIN)
        return self.top + margin, self.bottom - margin

    @property
    def compared(self) -> bool:
        """Whether it is long enough to be compared."""
        return self.bottom - self.top >= LEAST_RANGE


def legs_of(depth: Array) -> list[HeadingLeg]:
    """Descents and climbs in their order; `depth` [m], (time,), without NaN."""
    turns = _turns(depth)
    legs = []
    for a, b in itertools.pairwise(turns):
        phase: Phase = "dive" if depth[b] > depth[a] else "climb"
        ends = sorted((float(depth[a]), float(depth[b])))
        legs.append(HeadingLeg(first=a, last=b, phase=phase, top=ends[0], bottom=ends[1]))
    return legs


def _turns(depth: Array) -> list[int]:
    """Samples at which the depth turns round by REVERSAL, with the ends of what moves so far."""
    turns: list[int] = []
    low = high = way = 0
    for k, z in enumerate(depth):
        low = k if z <= depth[low] else low
        high = k if z >= depth[high] else high
        if way <= 0 and z - depth[low] >= REVERSAL:
            turns.append(low)
            high, way = k, 1
        elif way >= 0 and depth[high] - z >= REVERSAL:
            turns.append(high)
            low, way = k, -1
    if way:
        turns.append(high if way > 0 else low)
    return turns


USUAL = {
    BatterySlide: "measured_shift",
    BatteryHinge: "measured_rotation",
    Pump: "measured_pump",
}
"""Signals that importers give the parts of real vehicles, whatever a vehicle file calls them."""
RUDDER = "measured_fin"
"""The same, of a fin that turns the vehicle."""
USUAL_NAMES = frozenset({RUDDER, *USUAL.values()})
TURNING = (RUDDER, USUAL[BatteryHinge])
"""Signals of what turns a vehicle."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Turning:
    """The part that turns the vehicle, and the signal of what turned the logged one."""

    part: str
    """name of the vehicle's part"""
    signal: str | None
    """of the log, None: it has no position of what turns it"""
    same: bool
    """whether both are the same kind of part, so that their effects can be compared"""
    sense: float
    """what the vehicle's position is multiplied by to have the log's sign"""


def log_signal(vehicle: Vehicle, part: Part, names: Container[str]) -> str | None:
    """Name of the log's signal of a part: by the part's own name or by its kind; None without."""
    turns = vehicle.steering.get("heading") == part.name
    usual = RUDDER if isinstance(part, Fin) and turns else USUAL.get(type(part))
    for name in (f"measured_{part.name}", usual):
        if name is not None and name in names:
            return name
    return None


def turning_of(vehicle: Vehicle, names: Container[str]) -> Turning | None:
    """The turning part beside the log's; None of a vehicle without one."""
    part = vehicle.steered("heading")
    if part is None:
        return None
    signal = log_signal(vehicle, part, names)
    other = next((name for name in TURNING if name in names), None)
    return Turning(
        part=part.name,
        signal=signal or other,
        same=signal is not None,
        # a log's rudder is positive to starboard, a file's fin turns about an axis of its own
        sense=part.sense("heading") if isinstance(part, Fin) else 1.0,
    )
