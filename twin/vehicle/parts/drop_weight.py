"""Drop weight: a mass that is let go once, and the vehicle rises."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from twin.compiled import inline
from twin.compiled.elementary import scalar
from twin.vehicle.parts.base import Array, Carrier, Part, Quantity

if TYPE_CHECKING:
    from twin.vehicle.mjcf import MjcfReader


@inline
def native_mass(values, position):  # type: ignore[no-untyped-def]
    """Mass [kg] that is missing, negative: the hull of the file carries the weight."""
    return -values[0] * (1.0 - position)


@scalar
def fossen_mass(values, position):  # type: ignore[no-untyped-def]
    """[kg] that the vehicle carries less than its file says."""
    return values[0] * (position - 1.0)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DropWeight(Part):
    """A weight of small volume under the hull; its position is 1 while held and 0 once gone."""

    kind: ClassVar[str] = "drop-weight"
    unit: ClassVar[str] = "1"
    quantity: ClassVar[Quantity] = Quantity(
        unit="1", scale=1.0, long_name="part still held", limits=(0.0, 1.0)
    )
    one_way: ClassVar[bool] = True
    turn: ClassVar[int] = 60

    mass: float
    """[kg] in water: its weight less that of the water it displaces, over gravity; part of the
    hull's mass in the file"""

    native_mass = staticmethod(native_mass)
    fossen_mass = staticmethod(fossen_mass)

    @classmethod
    def own_parameters(cls, reader: MjcfReader, name: str) -> Mapping[str, Any]:
        """`NAME.mass` [kg]."""
        return {"mass": reader.number(f"{name}.mass")}

    def problems(self) -> list[tuple[str, str]]:
        """Also: a weight without weight, a travel that is not 0 to 1."""
        found = super().problems()
        if not self.mass > 0.0:
            found.append(("mass", "positive"))
        if (self.low, self.high) != (0.0, 1.0):
            found.append(("actrange", "'0 1'"))
        return found

    def values(self) -> tuple[float, ...]:
        """The mass [kg]."""
        return (self.mass,)

    def mirrored(self) -> float | None:
        """It has no side."""
        return 1.0

    @property
    def failsafe(self) -> float:
        """Let go, so that the vehicle rises."""
        return self.low

    @property
    def rest(self) -> float:
        """Held."""
        return 1.0

    def manoeuvre(self, rng: np.random.Generator, heavy: float, vehicle: Carrier) -> float:
        """Held: a manoeuvre comes back."""
        return 1.0

    def text(self, value: float) -> str:
        """Held, gone, or the part of it that is left."""
        return {1.0: "held", 0.0: "gone"}.get(value, f"{value:.4g} held")

    def told(self, time: Array, positions: Array) -> dict[str, str]:
        """When it was let go, if it was."""
        gone = np.flatnonzero(positions < 1.0)
        text = f"released at {time[gone[0]]:.0f} s" if gone.size else "held throughout"
        return {self.name: text}
