"""Flight fit: a hull's seven constants from its first dives, all glides at once.

The balance is nonlinear, so the flight filter's result depends on the order of its corrections. A
fit of all glides together does not. The fit finds the most probable set of constants
(Levenberg-Marquardt) with Huber's loss, and their covariance, from which a filter starts
(`FlightStart`).

    depth rate         z' = balance(c)                                  every glider has it
    Doppler log, down  w_m = (1 + s) z' + e U(c)
    and forward        U_m = (1 + s) U(c) - e z' + h . dc(z)

U is the level forward speed, s the log's scale error, e the angle between log and measured pitch, h
the heading. dc(z) is the water's velocity in the log's cells minus that at the vehicle, linear
between knots of depth. The downward velocity gives scale and angle, and dives on different headings
give the shear, so that the log's own errors do not bias the hull's constants.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.navigation.estimators.dvl import WATER, outliers, smoothed
from twin.navigation.flight_filter import FlightFilter, FlightSpread, FlightStart
from twin.navigation.flight_filter_kernels import CONSTANTS, NUDGE, PLACE, RATE, balanced
from twin.numbers import Array

GLIDE_RATE_SD = 3e-3
"""[m/s] Standard deviation of one glide's depth rate; `widened` allows for its persistence"""
LASTING_RATE_SD = 1e-2
"""[m/s] Standard deviation of a filter's later corrections; ten corrections then count as one"""
LOG_SD = (3e-3, 0.015)
"""[m/s] Standard deviations of the log downward and forward, from water that varies in an hour"""
LOG_SCALE, LOG_ANGLE = 0.01, 0.015
"""Prior standard deviations of a log. LOG_SCALE: [1] scale error. LOG_ANGLE: [rad] to the pitch"""
SHEAR, SHEAR_STEP, KNOTS_M = 0.05, 0.02, 25.0
"""[m/s] Prior standard deviations. SHEAR: of the shear. SHEAR_STEP: of its step between knots.
KNOTS_M: [m] between knots"""
HUBER = 2.0
"""[1] Residual in standard deviations beyond which its weight decreases"""
FEWEST = 20
"""Minimum number of glides of a fit: four minutes of steady flight"""
ROUNDS, STOP, MOST_DAMPING = 60, 1e-4, 1e6
"""A fit ends after ROUNDS steps, at a step of STOP standard deviations, or at MOST_DAMPING."""
SURE = 1e-6
"""[1] Factor on the prior standard deviations that keeps the constants at the file's"""
LN = "ln of the factor"
UNITS = dict(zip(CONSTANTS, (LN, LN, "rad", "rad", "kg", "1/Pa", LN), strict=True))
"""Unit of each constant in reports"""


class Glides(NamedTuple):
    """Steady glides of a dive."""

    inputs: Array
    """Rows of `FlightFilter.glides`, (n, LEARNED)"""
    depth: Array
    """[m], (n,)"""
    heading: Array
    """[rad], (n,)"""
    log: Array
    """[m/s] forward (level) and downward by a Doppler log in water lock, (n, 2); NaN without"""

    def taken(self, own: NDArray[Any] | slice) -> Glides:
        """Select some of the glides."""
        return Glides(*(values[own] for values in self))

    @staticmethod
    def joined(parts: Sequence[Glides]) -> Glides:
        """Join the glides of several dives."""
        return Glides(*(np.concatenate(values) for values in zip(*parts, strict=True)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlightFit:
    """Fit of a hull to its dives."""

    start: FlightStart | None
    """Start of a filter; None if the file's hull predicts held-back glides better"""
    left_over: float
    """Squared residuals of held-back glides with the other glides' hull, divided by the file's"""
    widened: float
    """Factor on the fit's standard deviations: root mean square of its residuals, at least 1. The
    residuals of steady flight do not average out with the number of glides"""
    glides: int
    log: bool
    """True if a Doppler log was used"""
    factors: Mapping[str, tuple[float, float]]
    """Estimate and standard deviation of every constant, in UNITS"""

    def rows(self) -> list[dict[str, object]]:
        """Rows of a table: name, estimate, standard deviation and unit of every constant."""
        return [
            {"constant": name, "estimate": value, "deviation": sd, "unit": UNITS[name]}
            for name, (value, sd) in self.factors.items()
        ]


def steady_glides(
    flight: FlightFilter, signals: Mapping[str, Array], spans: Sequence[slice], *, log: bool
) -> list[Glides]:
    """Collect the steady glides of each dive; the filter is reset first.

    Args:
      flight: filter of the vehicle; it is reset first.
      signals: the filter's channels and `measured_heading` of a mission; with `log` also
        `measured_dvl_surge`, `_sway`, `_heave` and `_mode`.
      spans: samples of each dive.
    """
    flight.reset()
    found = flight.glides(signals)
    place = found[:, PLACE].astype(int)
    every = Glides(
        inputs=found,
        depth=signals["measured_depth"][place],
        heading=np.deg2rad(signals["measured_heading"])[place],
        log=_log(signals, flight.period)[place] if log else np.full((len(found), 2), np.nan),
    )
    return [every.taken((place >= span.start) & (place < span.stop)) for span in spans]


def _log(signals: Mapping[str, Array], period: float) -> Array:
    """Level forward and downward velocity [m/s] by a Doppler log in water lock, (time, 2)."""
    valid = signals["measured_dvl_mode"] == WATER
    u, v, w = (signals[f"measured_dvl_{n}"] for n in ("surge", "sway", "heave"))
    valid &= np.isfinite(u) & np.isfinite(v) & np.isfinite(w)
    valid &= ~(outliers(u, valid, causal=True) | outliers(w, valid, causal=True))
    roll, pitch = (np.deg2rad(signals[f"measured_{n}"]) for n in ("roll", "pitch"))
    below = v * np.sin(roll) + w * np.cos(roll)
    forward, down = u * np.cos(pitch) + below * np.sin(pitch), below * np.cos(pitch)
    down = down - u * np.sin(pitch)
    return np.stack([smoothed(x, valid, period, "causal") for x in (forward, down)], axis=1)


def adapt_flight(flight: FlightFilter, dives: Sequence[Glides], *, log: bool) -> FlightFit:
    """Fit a hull that may have growth on it to its first dives.

    Each dive in turn is held back (of a single dive, each quarter), and predicted by the constants
    of the other dives, with the Doppler log if `log`, and by the file's constants. There is no
    third choice, a hull near its file: depth rates cannot tell it from a fouled hull.

    Raises:
      InputError: fewer steady glides than a fit needs, or no water lock in any.
    """
    whole = Glides.joined(dives)
    count = len(whole.depth)
    if count < FEWEST:
        raise InputError(
            f"these logs have {count} steady glides, and a fit needs {FEWEST}: one every 15 s "
            "at a steady pitch below the surface; give longer dives"
        )
    if log and not np.isfinite(whole.log).all(1).any():
        raise InputError(
            "the Doppler log has no water lock in a steady glide: adapt without it (--labels none)"
        )
    prior = FlightSpread().prior
    errors = LogErrors.over(whole.depth) if log else None
    parts = [dive for dive in dives if len(dive.depth)]
    if len(dives) == 1:
        parts = [whole.taken(own) for own in np.array_split(np.arange(count), 4)]
    priors = prior, SURE * prior
    fits = [_fit(flight, whole, one, errors) for one in priors]
    left = np.zeros(2)
    for k, held in enumerate(parts):
        others = Glides.joined([*parts[:k], *parts[k + 1 :]])
        for j, one in enumerate(priors):
            unknowns, _ = _fit(flight, others, one, errors, begin=fits[j][0])
            rows, _, _ = _residuals(flight, held, unknowns, errors)
            left[j] += np.minimum(rows**2, HUBER**2).sum()
    unknowns, covariance = fits[0]
    rows, _, _ = _residuals(flight, whole, unknowns, errors)
    widened = max(1.0, float(np.sqrt(np.mean(rows**2))))
    size = len(CONSTANTS)
    start = FlightStart.of(unknowns[:size], widened**2 * covariance[:size, :size], LASTING_RATE_SD)
    factors = zip(start.constants, start.deviations, strict=True)
    return FlightFit(
        start=start if left[0] < left[1] else None,
        left_over=float(left[0] / left[1]),
        widened=widened,
        glides=count,
        log=log,
        factors=dict(zip(CONSTANTS, factors, strict=True)),
    )


class LogErrors:
    """Errors of a Doppler log, unknowns after the constants: scale, angle, shear north and east at
    each knot of depth."""

    def __init__(self, knots: int):
        self.knots, self.size = knots, 2 + 2 * knots
        steps = np.diff(np.eye(knots), axis=0)
        shear = np.eye(knots) / SHEAR**2 + steps.T @ steps / SHEAR_STEP**2
        self.information = np.zeros((self.size, self.size))
        self.information[0, 0], self.information[1, 1] = LOG_SCALE**-2, LOG_ANGLE**-2
        for first in (2, 2 + knots):
            self.information[first : first + knots, first : first + knots] = shear

    @classmethod
    def over(cls, depth: Array) -> LogErrors:
        """Create with knots down to the deepest of these depths [m]."""
        return cls(math.ceil(float(depth.max()) / KNOTS_M) + 1)

    def shear(self, glides: Glides) -> Array:
        """Derivative of the forward speed by each knot's shear, north, then east, (n, 2 knots)."""
        near = np.clip(glides.depth / KNOTS_M, 0.0, self.knots - 1.0)
        weights = np.maximum(0.0, 1.0 - np.abs(near[:, None] - np.arange(self.knots)))
        heading = glides.heading[:, None]
        return np.concatenate([weights * np.cos(heading), weights * np.sin(heading)], axis=1)


def _residuals(
    flight: FlightFilter, glides: Glides, unknowns: Array, errors: LogErrors | None
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Residuals in standard deviations, (rows,); depth rate and level forward speed [m/s] by the
    balance, (n, 2); and which glides have a log. The rows are the depth rates of all glides, then
    the downward and then the forward velocities of the glides with a log."""
    size, found = len(CONSTANTS), np.zeros((len(glides.depth), 2))
    balanced(flight.model, glides.inputs, unknowns[:size], found)
    rate = glides.inputs[:, RATE]
    rows = (rate - found[:, 0]) / GLIDE_RATE_SD
    rows = np.where(np.isfinite(rows), rows, HUBER)  # no force along the hull
    seen = np.asarray(np.isfinite(glides.log).all(1) & np.isfinite(found).all(1))
    if errors is None:
        return rows, found, np.zeros(len(rate), bool)
    scale, angle = unknowns[size : size + 2]
    forward, logged, fell = found[seen, 1], glides.log[seen], rate[seen]
    down = logged[:, 1] - (1.0 + scale) * fell - angle * forward
    ahead = logged[:, 0] - (1.0 + scale) * forward + angle * fell
    ahead = ahead - errors.shear(glides)[seen] @ unknowns[size + 2 :]
    return np.concatenate([rows, down / LOG_SD[0], ahead / LOG_SD[1]]), found, seen


def _slopes(
    flight: FlightFilter, glides: Glides, unknowns: Array, prior: Array, errors: LogErrors | None
) -> tuple[Array, Array]:
    """Residuals (rows,) and their derivatives by each unknown, (rows, unknowns)."""
    rows, found, seen = _residuals(flight, glides, unknowns, errors)
    slopes = np.zeros((len(rows), len(unknowns)))
    for j, step in enumerate(NUDGE * prior):
        moved = unknowns.copy()
        moved[j] += step
        other, _, also = _residuals(flight, glides, moved, errors)
        if np.array_equal(seen, also):
            slopes[:, j] = (other - rows) / step
    if errors is not None:
        size, n, count = len(CONSTANTS), len(glides.depth), int(seen.sum())
        fell, forward = glides.inputs[seen, RATE], found[seen, 1]
        down, ahead = slice(n, n + count), slice(n + count, None)
        slopes[down, size], slopes[down, size + 1] = -fell / LOG_SD[0], -forward / LOG_SD[0]
        slopes[ahead, size], slopes[ahead, size + 1] = -forward / LOG_SD[1], fell / LOG_SD[1]
        slopes[ahead, size + 2 :] = -errors.shear(glides)[seen] / LOG_SD[1]
    return rows, slopes


def _fit(
    flight: FlightFilter,
    glides: Glides,
    prior: Array,
    errors: LogErrors | None,
    begin: Array | None = None,
) -> tuple[Array, Array]:
    """Find the most probable unknowns and their covariance.

    Args:
      prior: standard deviations of the constants from those of the file.
      errors: errors of the Doppler log to fit; None: fit without the log.
      begin: unknowns to start from; they change the number of steps, not the result.
    """
    size = len(CONSTANTS)
    total = size + (0 if errors is None else errors.size)
    information = np.zeros((total, total))
    information[:size, :size] = np.diag(prior**-2.0)
    if errors is not None:
        information[size:, size:] = errors.information
    tried = np.zeros(total) if begin is None else begin
    unknowns = tried
    damping, least = 1e-3, math.inf
    normal, slope = information, np.zeros(total)
    for _ in range(ROUNDS):
        rows, slopes = _slopes(flight, glides, tried, prior, errors)
        far = np.abs(rows)
        weights = np.where(far > HUBER, HUBER / np.maximum(far, HUBER), 1.0)
        cost = np.where(far > HUBER, HUBER * (far - 0.5 * HUBER), 0.5 * rows**2).sum()
        cost += 0.5 * tried @ information @ tried
        if cost < least:
            least, unknowns, damping = float(cost), tried, 0.3 * damping
            normal = information + (slopes.T * weights) @ slopes
            slope = -(slopes.T * weights) @ rows - information @ tried
        else:
            damping *= 10.0
        unit = 1.0 / np.sqrt(np.diag(normal))  # the units differ by ten orders of magnitude
        scaled = normal * np.outer(unit, unit)
        step = unit * np.linalg.solve(scaled + damping * np.eye(total), unit * slope)
        tried = unknowns + step
        if np.abs(step[:size] / prior).max() < STOP or damping > MOST_DAMPING:
            break
    unit = 1.0 / np.sqrt(np.diag(normal))
    inverse = np.linalg.inv(normal * np.outer(unit, unit))
    return unknowns, 0.5 * (inverse + inverse.T) * np.outer(unit, unit)
