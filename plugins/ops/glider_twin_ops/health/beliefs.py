"""Beliefs: a vehicle's parameters, dive after dive, with what each dive adds.

    found = follow_parameters(load_logs("real.zarr"), load_calibration("mine.xml"))
    found.value("drag"), found.deviation("drag")          # after each dive, (dives,)

A recursion of `twin identify`: each dive's part of its residuals and Jacobian (`DepthRates`)
updates a Gaussian belief that begins at the vehicle file's values and spreads, and whose parameters
are random walks from dive to dive. Without walks the last belief is the fit to all dives together.
The residuals are linear about one calibration; it is moved to the fit without walks and the dives
are looked at once more. Looking back, each dive's belief is smoothed by those after it (Rauch, Tung
and Striebel, AIAA Journal 3, 1965).
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from twin.errors import InputError
from twin.identify import Calibration, DepthRates, Log, UnknownParameter, centred, choose, gliding
from twin.numbers import Array

FOLLOWED = ("neutral_density", "drag")
"""Parameters that are followed where the caller names none: those that every glide tells"""
WALK = 0.01
"""Change from dive to dive, over the parameter's spread, before the dives say: water and growth"""
LEARNING = 8
"""Dives at the beginning that say how much larger walks and noise are; a later fault does not"""
FACTORS = np.exp(np.arange(-2.5, 2.6, 0.5))
"""that are tried, of the walks and of the deviation of what a dive says; the logarithm of each is
about one either way before the dives say"""
PASSES = 2
"""Fits to all dives between which weights are taken again; the last one's place is where the
residuals are linear about"""
ENDS: dict[str, Any] = {"max_nfev": 8, "xtol": 1e-3, "ftol": 1e-4}
"""Ends of its search: offsets are in spreads"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Beliefs:
    """What is believed of the parameters after each dive; arrays are over dives first."""

    parameters: tuple[UnknownParameter, ...]
    nominal: tuple[float, ...]
    """Values of the calibration that the offsets count from"""
    rows: tuple[int, ...]
    """of the store, of the dives that were used"""
    offset: Array
    """in spreads from the nominal value, (dives, parameters)"""
    covariance: Array
    """of the offsets, (dives, parameters, parameters)"""
    innovation: Array
    """How far a dive alone is from what was believed before it, over the deviation, by its own
    directions, (dives, parameters); NaN where it tells none"""
    smoothed: Array
    """offsets by all dives, (dives, parameters)"""
    smoothed_covariance: Array

    def value(self, name: str, *, smoothed: bool = False) -> Array:
        """Value of a parameter after each dive, in its unit, (dives,)."""
        k = self._place(name)
        offsets = (self.smoothed if smoothed else self.offset)[:, k]
        return np.array([self.parameters[k].value(self.nominal[k], float(x)) for x in offsets])

    def deviation(self, name: str, *, smoothed: bool = False) -> Array:
        """Standard deviation of it, in its unit, (dives,)."""
        k = self._place(name)
        covariance = (self.smoothed_covariance if smoothed else self.covariance)[:, k, k]
        values = self.value(name, smoothed=smoothed)
        off = self.parameters[k].deviation
        return np.array([off(v, s) for v, s in zip(values, np.sqrt(covariance), strict=True)])

    def _place(self, name: str) -> int:
        names = [parameter.name for parameter in self.parameters]
        if name not in names:
            raise InputError(f"belief {name!r} is not followed; those are: {', '.join(names)}")
        return names.index(name)


def follow_parameters(
    logs: Sequence[Log],
    calibration: Calibration,
    parameters: Sequence[str] = FOLLOWED,
    *,
    walks: float | None = None,
    fixes: bool = True,
) -> Beliefs:
    """Follow parameters over the dives of one vehicle, in their order.

    Args:
      logs: the dives. calibration: where the beliefs begin, with the parameters' spreads; a neutral
        density begins where the logs neither sink nor rise, since their sea may be another.
      parameters: names of `twin.identify.unknowns`.
      walks: change of each from dive to dive over the spread; default `WALK`, times a factor that
        the first dives tell, as they tell how far dives are off.
      fixes: compare the currents between fixes too, which tell of the compass.

    Raises:
      InputError: no dive, an unknown parameter, or a calibration that does not fly.
    """
    used, _ = gliding(logs)
    chosen = choose(list(parameters))
    if any(one.name == "neutral_density" for one in chosen):
        calibration = centred(used, calibration)
    problem = DepthRates(used, calibration, chosen, fixes=fixes)
    about, _ = problem.fit(np.zeros(len(chosen)), PASSES, **ENDS)
    said = _said(problem, about)
    steps = np.full(len(chosen), WALK if walks is None else walks)
    if walks is None:
        said, steps = _scaled(said, steps)
    offset, covariance, innovation, _ = _filtered(said, steps)
    smoothed, after = _smoothed(offset, covariance, steps)
    return Beliefs(
        parameters=chosen,
        nominal=tuple(one.get(calibration) for one in chosen),
        rows=tuple(log.index for log in used),
        offset=offset,
        covariance=covariance,
        innovation=innovation,
        smoothed=smoothed,
        smoothed_covariance=after,
    )


def _said(problem: DepthRates, about: Array) -> list[tuple[Array, Array]]:
    """J^T J of each dive's residuals at some offsets, and J^T (J x - r), in independent ones."""
    count = len(about)
    found = [(np.zeros((count, count)), np.zeros(count)) for _ in problem.logs]
    for one in problem.residuals(about).values():
        jacobian, values = one.jacobian / one.deviation[:, None], one.values / one.deviation
        for dive in np.unique(one.dives):
            mine = one.dives == dive
            matrix, pulled = found[dive]
            matrix += jacobian[mine].T @ jacobian[mine]
            pulled += jacobian[mine].T @ (jacobian[mine] @ about - values[mine])
    return found


def _scaled(
    said: list[tuple[Array, Array]], steps: Array
) -> tuple[list[tuple[Array, Array]], Array]:
    """What dives say, and the walks, as large as make the first dives' innovations likeliest."""
    best, found = -np.inf, (1.0, 1.0)
    for noise, walk in itertools.product(FACTORS.tolist(), repeat=2):
        first = [(matrix / noise**2, pulled / noise**2) for matrix, pulled in said[:LEARNING]]
        likely = _filtered(first, walk * steps)[3]
        likely -= 0.5 * float(np.log(noise) ** 2 + np.log(walk) ** 2)
        if likely > best:
            best, found = likely, (noise, walk)
    noise, walk = found
    return [(matrix / noise**2, pulled / noise**2) for matrix, pulled in said], walk * steps


def _filtered(
    said: Sequence[tuple[Array, Array]], steps: Array
) -> tuple[Array, Array, Array, float]:
    """Offsets, covariances and innovations after each dive, and the logarithm of the innovations'
    likelihood; the first belief is a unit normal."""
    count = len(steps)
    mean: Array = np.zeros(count)
    covariance: Array = np.eye(count)
    means, covariances, innovations, likely = [], [], [], 0.0
    for matrix, pulled in said:
        covariance = covariance + np.diag(steps**2)
        innovation, width = _innovation(matrix, pulled, mean, covariance)
        innovations.append(innovation)
        likely -= 0.5 * float(np.nansum(innovation**2)) + width
        precision = np.linalg.inv(covariance)
        before = mean
        covariance = np.asarray(np.linalg.inv(precision + matrix), np.float64)
        mean = covariance @ (precision @ before + pulled)
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances), np.array(innovations), likely


def _innovation(
    matrix: Array, pulled: Array, mean: Array, covariance: Array
) -> tuple[Array, float]:
    """What a dive alone says less what was believed, whitened, in the dive's own directions, the
    best told one last, NaN for directions that it does not tell; and the logarithm of the root of
    its covariance's determinant."""
    strength, ways = np.linalg.eigh(matrix)
    told = strength > 1e-9 * max(float(strength.max()), 1e-30)
    found = np.full(len(mean), np.nan)
    ways, strength = ways[:, told], strength[told]
    off = ways.T @ (pulled - matrix @ mean) / strength
    root = np.linalg.cholesky(np.diag(1.0 / strength) + ways.T @ covariance @ ways)
    found[told] = np.linalg.solve(root, off)
    return found, float(np.log(np.diag(root)).sum())


def _smoothed(means: Array, covariances: Array, steps: Array) -> tuple[Array, Array]:
    """Each belief by all dives."""
    found, after = means.copy(), covariances.copy()
    walk = np.diag(steps**2)
    for d in range(len(means) - 2, -1, -1):
        ahead = covariances[d] + walk
        gain = covariances[d] @ np.linalg.inv(ahead)
        found[d] = means[d] + gain @ (found[d + 1] - means[d])
        after[d] = covariances[d] + gain @ (after[d + 1] - ahead) @ gain.T
    return found, after
