"""Parameters of a current: strength and duration of its parts, and their prior.

The filter learns each part's actual course from the fixes. Here are also the tidal frequencies that
a current may hold, those that a record can tell apart, and the place of each number in the state of
a current filter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import InputError, unknown_name
from twin.numbers import Array

Species = Literal["semidiurnal", "diurnal"]


class Constituent(NamedTuple):
    """One line of the tide."""

    name: str
    period: float
    """[h]"""
    species: Species
    amplitude: float
    """[1] of the equilibrium tide, Doodson's coefficient"""


CONSTITUENTS = {
    one.name: one
    for one in (
        Constituent("M2", 12.4206012, "semidiurnal", 0.90812),
        Constituent("K1", 23.93447213, "diurnal", 0.53011),
        Constituent("S2", 12.0, "semidiurnal", 0.42248),
        Constituent("O1", 25.81933871, "diurnal", 0.37694),
        Constituent("N2", 12.65834751, "semidiurnal", 0.17391),
    )
}
"""In the order in which a longer record adds them."""
STRONGEST = {"semidiurnal": "M2", "diurnal": "K1"}
"""Strongest line of each species: the amplitudes of the others count from it."""
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
        apart = [abs(1.0 / one.period - 1.0 / other.period) * duration for other in chosen]
        if one.name in STRONGEST.values() or min(apart, default=0.0) >= RAYLEIGH:
            chosen.append(one)
    return tuple(one.name for one in chosen)


def relative_amplitude(name: str) -> float:
    """[1] Amplitude of a constituent by that of the strongest of its species, equilibrium tide."""
    one = CONSTITUENTS[name]
    return one.amplitude / CONSTITUENTS[STRONGEST[one.species]].amplitude


@dataclasses.dataclass(frozen=True, kw_only=True)
class CurrentParameters:
    """Strength and memory of a current's parts. Deviations are of north and of east each.

    Raises:
      InputError: a negative or infinite value, a time that is not positive, or an unknown
        constituent.
    """

    mean: float = 0.15
    """[m/s] standard deviation of the mean current before the first fix"""
    wander: float = 0.0375
    """[m/s] by which the mean current wanders in a day (a random walk)"""
    eddy: float = 0.0525
    """[m/s] of the first-order Gauss-Markov part: eddies, weather"""
    eddy_time: float = 8.0
    """[h] after which that part has lost its memory"""
    semidiurnal: float = 0.0424
    """[m/s] of each rotary component of M2; its neighbours in the equilibrium's proportion"""
    diurnal: float = 0.0265
    """[m/s] of each rotary component of K1"""
    tide_time: float = 20.0
    """[d] after which a constituent has lost its phase"""
    inertial: float = 0.0225
    """[m/s] of the inertial oscillation"""
    inertial_time: float = 3.0
    """[d] in which it decays"""
    dive: float = 0.012
    """[m/s] of what a single dive adds and does not pass on: the profile of the current, the
    speed's error"""
    speed_scale: float = 0.06
    """[1] of the relative error of the speed through the water"""
    compass: float = 3.4
    """[degree] of the compass' offset"""
    constituents: tuple[str, ...] = ("M2", "K1")
    """of the tide"""
    field: float = 0.0
    """[1] part that counts of the current that a forecast field foretells, where there is one: all
    other numbers are then of what the field lacks"""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            if field.name == "constituents":
                continue
            value = float(getattr(self, field.name))
            positive = field.name.endswith("_time")
            if not math.isfinite(value) or value < 0.0 or (positive and value == 0.0):
                allowed = "positive" if positive else "zero or positive"
                raise InputError(f"{field.name} of a current is {value:g}; it must be {allowed}")
        for name in self.constituents:
            if name not in CONSTITUENTS:
                raise InputError(unknown_name("constituent", name, CONSTITUENTS))

    @classmethod
    def persistence(cls, wander: float) -> CurrentParameters:
        """The special case in which the last dive's current is the forecast.

        Args:
          wander: [m/s] in a day.
        """
        return cls(
            wander=wander, eddy=0.0, semidiurnal=0.0, diurnal=0.0, inertial=0.0,
            dive=PERSISTENCE_DIVE, speed_scale=0.0, compass=0.0, constituents=(), field=0.0,
        )  # fmt: skip

    @property
    def persists(self) -> bool:
        """Whether the forecast is the last dive's current."""
        return self.eddy == 0.0 and self.inertial == 0.0 and not self.constituents


DEGREES = 5.0
"""[1] of freedom of Student's t, as which the fixes of a deployment are distributed about what a
filter with given parameters expects: as heavy as the tails of currents' changes are, and as far as
seas of the same parameters differ. All deviations of `CurrentParameters` are those of its centre,
whose covariance is DEGREES / (DEGREES - 2) times theirs."""
PERSISTENCE_DIVE = 0.004
"""[m/s] of a single dive in that case: small, so that the last dive counts"""


class Unknown(NamedTuple):
    """A logarithm that tuning finds: its likely value and how far it may be from it."""

    name: str
    likely: float
    spread: float
    """[1] standard deviation of the natural logarithm"""
    of_scale: bool = False
    """Whether the value counts in the deployment's own scale of currents."""


SCALE = "scale"
UNKNOWNS: tuple[Unknown, ...] = (  # few legs tell the first, several short records the first two
    Unknown(SCALE, 0.15, 1.0),
    Unknown("dive", 0.08, 0.4, of_scale=True),
    Unknown("wander", 0.25, 0.6, of_scale=True),
    Unknown("eddy", 0.35, 0.6, of_scale=True),
    Unknown("eddy_time", 8.0, 0.5),
    Unknown("semidiurnal", 0.283, 0.7, of_scale=True),
    Unknown("diurnal", 0.177, 0.7, of_scale=True),
    Unknown("tide_time", 20.0, 0.5),
    Unknown("inertial", 0.15, 0.6, of_scale=True),
    Unknown("inertial_time", 3.0, 0.4),
)
"""Unknowns of tuning; priors are wide in the scale of the currents (0.02 m/s on a slope to
1 m/s in a sound) and narrow in the rest: a training part holds a few dozen dives. The proportions
are those of shelf currents, where tide and weather share the variance (Kundu 1976, J. Phys.
Oceanogr. 6; Pollard and Millard 1970, Deep-Sea Res. 17, for 1 to 10 days of inertial decay)."""


FIELD, FIELD_SPREAD, MOST_FIELD = 1.0, 0.5, 2.0
"""[1] part that counts of a forecast field: likely, its deviation, and the most"""


def parameters_of(logarithms: Array, constituents: Sequence[str]) -> CurrentParameters:
    """Parameters by their logarithms, in the order of `UNKNOWNS`."""
    values = {u.name: math.exp(x) for u, x in zip(UNKNOWNS, logarithms, strict=True)}
    scale = values.pop(SCALE)
    for unknown in UNKNOWNS:
        if unknown.of_scale:
            values[unknown.name] *= scale
    return CurrentParameters(mean=scale, constituents=tuple(constituents), **values)


def likely_logarithms() -> Array:
    """The prior's centre."""
    return np.log([unknown.likely for unknown in UNKNOWNS])


def prior_cost(logarithms: Array) -> float:
    """Negative logarithm of the prior, but for a constant."""
    spread = np.array([unknown.spread for unknown in UNKNOWNS])
    return 0.5 * float(np.sum(((logarithms - likely_logarithms()) / spread) ** 2))


POSITION, CALIBRATION, DIVE = slice(0, 2), slice(2, 4), slice(4, 6)
"""North, east [m]; relative error of the speed [1] and offset of the compass [rad]; what the dive
under way adds, north and east [m/s]"""
MODES = 6
"""Index of the first mode's north."""


def even(matrix: Array) -> Array:
    """A covariance without the skew part that rounding has made."""
    return 0.5 * (matrix + matrix.T)


def pair(values: ArrayLike, what: str) -> Array:
    """North and east, (2,).

    Raises:
      InputError: they are not two finite numbers.
    """
    found = np.asarray(values, float)
    if found.shape != (2,) or not np.isfinite(found).all():
        raise InputError(f"a {what} is north and east, two finite numbers, not {values!r}")
    return found


def square(values: ArrayLike, what: str) -> Array:
    """A matrix of north and east, (2, 2).

    Raises:
      InputError: it is of another shape or not finite.
    """
    found = np.asarray(values, float)
    if found.shape != (2, 2) or not np.isfinite(found).all():
        raise InputError(f"a {what} is a finite matrix of 2 by 2, not {values!r}")
    return found
