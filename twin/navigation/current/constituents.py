"""Constituents: the tidal frequencies that a current may hold, and which of them a record can tell.

Periods and equilibrium amplitudes after Doodson (1921), as in Pugh and Woodworth (2014), Sea-Level
Science, table 4.1. Within a species the amplitudes of a place are roughly in the proportion of
those of the equilibrium tide: that is the prior from which the filter learns them.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

Species = Literal["semidiurnal", "diurnal"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Constituent:
    """One line of the tide."""

    name: str
    period: float
    """[h]"""
    species: Species
    amplitude: float
    """[1] of the equilibrium tide, Doodson's coefficient"""

    @property
    def frequency(self) -> float:
        """[1/h]"""
        return 1.0 / self.period


CONSTITUENTS = {
    one.name: one
    for one in (
        Constituent(name="M2", period=12.4206012, species="semidiurnal", amplitude=0.90812),
        Constituent(name="K1", period=23.93447213, species="diurnal", amplitude=0.53011),
        Constituent(name="S2", period=12.0, species="semidiurnal", amplitude=0.42248),
        Constituent(name="O1", period=25.81933871, species="diurnal", amplitude=0.37694),
        Constituent(name="N2", period=12.65834751, species="semidiurnal", amplitude=0.17391),
    )
}
"""In the order in which a longer record adds them."""
STRONGEST = {"semidiurnal": "M2", "diurnal": "K1"}
"""Of each species: the amplitudes of the others count from it."""
RAYLEIGH = 0.5
"""[1] Cycles by which two lines must part over a record to be told apart. Harmonic analysis asks
for one; a filter with priors resolves with half of it (Pugh and Woodworth 2014, chapter 4)."""


def chosen_constituents(duration: float, interval: float) -> tuple[str, ...]:
    """Names of the constituents that a record of surfacings can tell apart.

    The strongest line of a species is always among them, unless the surfacings alias it. Others
    join when the record is long enough to part them from those before.

    Args:
      duration: [h] of the record.
      interval: [h] usually from surfacing to surfacing: a line whose half period is shorter would
        be seen at a false frequency.
    """
    chosen: list[Constituent] = []
    for one in CONSTITUENTS.values():
        if 0.5 * one.period < interval:
            continue
        apart = [abs(one.frequency - other.frequency) * duration for other in chosen]
        if one.name in STRONGEST.values() or min(apart, default=0.0) >= RAYLEIGH:
            chosen.append(one)
    return tuple(one.name for one in chosen)


def relative_amplitude(name: str) -> float:
    """[1] Amplitude of a constituent by that of the strongest of its species, equilibrium tide."""
    one = CONSTITUENTS[name]
    return one.amplitude / CONSTITUENTS[STRONGEST[one.species]].amplitude
