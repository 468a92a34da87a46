"""Current parameters: size and correlation time of a current's components, and their prior.

A filter estimates each component's actual course from the fixes. This module also has the tidal
frequencies that a current may contain, the ones that a record can separate, and the layout of a
current filter's state.
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
    """Constituent of the tide."""

    name: str
    period: float
    """[h] Period"""
    species: Species
    amplitude: float
    """[1] Amplitude in the equilibrium tide, Doodson's coefficient"""


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
"""Tidal constituents, in the order in which a longer record adds them."""
STRONGEST = {"semidiurnal": "M2", "diurnal": "K1"}
"""Strongest constituent of each species; the others' amplitudes are relative to it."""
RAYLEIGH = 0.5
"""[1] Smallest difference of two constituents, in cycles per record, to separate them. Harmonic
analysis needs 1, a filter with priors half of that (Pugh and Woodworth 2014, chapter 4)."""


def chosen_constituents(duration: float, interval: float) -> tuple[str, ...]:
    """Names of the constituents that a record of surfacings can separate.

    The strongest constituent of a species is always included, unless the surfacings alias it.
    Another is included if the record is long enough to separate it from those already chosen.

    Args:
      duration: [h] of the record.
      interval: [h] usual time between surfacings. A constituent with a shorter half period would
        appear at a false frequency, and is left out.
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
    """[1] Amplitude of a constituent relative to the strongest of its species, equilibrium tide."""
    one = CONSTITUENTS[name]
    return one.amplitude / CONSTITUENTS[STRONGEST[one.species]].amplitude


@dataclasses.dataclass(frozen=True, kw_only=True)
class CurrentParameters:
    """Parameters of a current's components; standard deviations hold for north and east each.

    Raises:
      InputError: a negative or infinite value, a time that is not positive, or an unknown
        constituent.
    """

    mean: float = 0.15
    """[m/s] Standard deviation of the mean current before the first fix"""
    wander: float = 0.0375
    """[m/s] Standard deviation of the mean current's change in a day (a random walk)"""
    eddy: float = 0.0525
    """[m/s] Standard deviation of the first-order Gauss-Markov component: eddies, weather"""
    eddy_time: float = 8.0
    """[h] Correlation time of that component"""
    semidiurnal: float = 0.0424
    """[m/s] Standard deviation of each rotary component of M2; other constituents scale with it"""
    diurnal: float = 0.0265
    """[m/s] Standard deviation of each rotary component of K1; other constituents scale with it"""
    tide_time: float = 20.0
    """[d] Correlation time of a constituent's phase and amplitude"""
    inertial: float = 0.0225
    """[m/s] Standard deviation of the inertial oscillation"""
    inertial_time: float = 3.0
    """[d] Decay time of the inertial oscillation"""
    dive: float = 0.012
    """[m/s] Standard deviation of an error that is independent from dive to dive: shear, error of
    the speed"""
    speed_scale: float = 0.06
    """[1] Standard deviation of the relative error of the speed through the water"""
    compass: float = 3.4
    """[degree] Standard deviation of the compass' offset"""
    constituents: tuple[str, ...] = ("M2", "K1")
    """Constituents of the tide"""
    field: float = 0.0
    """[1] Weight of a forecast field's current; with a field, all other parameters describe the
    difference between the current and the weighted field"""

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
        """Create parameters for persistence, where the last dive's current is the forecast.

        Args:
          wander: [m/s] standard deviation of the current's change in a day.
        """
        return cls(
            wander=wander, eddy=0.0, semidiurnal=0.0, diurnal=0.0, inertial=0.0,
            dive=PERSISTENCE_DIVE, speed_scale=0.0, compass=0.0, constituents=(), field=0.0,
        )  # fmt: skip

    @property
    def persists(self) -> bool:
        """True if the forecast is the last dive's current."""
        return self.eddy == 0.0 and self.inertial == 0.0 and not self.constituents


DEGREES = 5.0
"""[1] Degrees of freedom of the Student's t distribution of a deployment's fixes about the filter's
predictions. It covers the heavy tails of current changes and the differences between similar seas.
The standard deviations in `CurrentParameters` are those of the distribution's scale; its covariance
is DEGREES / (DEGREES - 2) times as large."""
PERSISTENCE_DIVE = 0.004
"""[m/s] `dive` for persistence: small, so that the last dive's current is kept"""


class Unknown(NamedTuple):
    """Parameter that tuning estimates by its logarithm, with a log-normal prior."""

    name: str
    likely: float
    spread: float
    """[1] Standard deviation of the natural logarithm"""
    of_scale: bool = False
    """True if the value is relative to the deployment's scale of currents."""


SCALE = "scale"
UNKNOWNS: tuple[Unknown, ...] = (  # a few legs determine the first, short records the first two
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
"""Parameters that tuning estimates. The prior of the currents' scale is wide (0.02 m/s on a slope
to 1 m/s in a sound); the others are narrow, since a training set has a few dozen dives. Proportions
are those of shelf currents, where tide and weather share the variance (Kundu 1976, J. Phys.
Oceanogr. 6; Pollard and Millard 1970, Deep-Sea Res. 17, for 1 to 10 days of inertial decay)."""


FIELD, FIELD_SPREAD, MOST_FIELD = 1.0, 0.5, 2.0
"""[1] Weight of a forecast field. FIELD: prior mean. FIELD_SPREAD: prior standard deviation.
MOST_FIELD: upper limit"""


def parameters_of(logarithms: Array, constituents: Sequence[str]) -> CurrentParameters:
    """Compute parameters from their logarithms, in the order of `UNKNOWNS`."""
    values = {u.name: math.exp(x) for u, x in zip(UNKNOWNS, logarithms, strict=True)}
    scale = values.pop(SCALE)
    for unknown in UNKNOWNS:
        if unknown.of_scale:
            values[unknown.name] *= scale
    return CurrentParameters(mean=scale, constituents=tuple(constituents), **values)


def likely_logarithms() -> Array:
    """Logarithms at the centre of the prior."""
    return np.log([unknown.likely for unknown in UNKNOWNS])


def prior_cost(logarithms: Array) -> float:
    """Negative logarithm of the prior, without its constant."""
    spread = np.array([unknown.spread for unknown in UNKNOWNS])
    return 0.5 * float(np.sum(((logarithms - likely_logarithms()) / spread) ** 2))


POSITION, CALIBRATION, DIVE = slice(0, 2), slice(2, 4), slice(4, 6)
"""Slices of the state, north and east. POSITION: [m]. DIVE: [m/s] error of the current dive.
CALIBRATION: relative error of the speed [1] and offset of the compass [rad]"""
MODES = 6
"""Index of the first mode's north component in the state"""


def even(matrix: Array) -> Array:
    """Covariance with the asymmetry from rounding removed."""
    return 0.5 * (matrix + matrix.T)


def pair(values: ArrayLike, what: str) -> Array:
    """Convert to north and east, (2,).

    Raises:
      InputError: `values` are not two finite numbers.
    """
    found = np.asarray(values, float)
    if found.shape != (2,) or not np.isfinite(found).all():
        raise InputError(f"a {what} is north and east, two finite numbers, not {values!r}")
    return found


def square(values: ArrayLike, what: str) -> Array:
    """Convert to a matrix of north and east, (2, 2).

    Raises:
      InputError: `values` are of another shape or not finite.
    """
    found = np.asarray(values, float)
    if found.shape != (2, 2) or not np.isfinite(found).all():
        raise InputError(f"a {what} is a finite matrix of 2 by 2, not {values!r}")
    return found
