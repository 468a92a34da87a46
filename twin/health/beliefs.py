"""Beliefs: a vehicle's parameters, dive after dive, with what each dive adds.

    found = follow_parameters(load_logs("real.zarr"), load_calibration("mine.xml"))
    found.value("drag"), found.deviation("drag")          # after each dive, (dives,)

A recursion of `twin identify`: each dive's residuals and Jacobian (`twin.identify.dive_residuals`)
update a Gaussian belief that begins at the vehicle file's values and spreads, and whose parameters
are random walks from dive to dive. Without walks the last belief is the fit to all dives together.
The residuals are linear about one calibration; it is moved to the fit without walks and the dives
are looked at once more. Looking back, each dive's belief is smoothed by those after it (Rauch, Tung
and Striebel, AIAA Journal 3, 1965).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.identify.calibration import Calibration
from twin.identify.logged_missions import Log, gliding
from twin.identify.residuals import dive_residuals, noise_of_dives
from twin.identify.unknowns import UnknownParameter, choose

Array = NDArray[np.float64]

FOLLOWED = ("neutral_density", "drag")
"""Parameters that are followed where the caller names none: those that every glide tells"""
WALKS: Mapping[str, float] = {"neutral_density": 0.05, "drag": 0.05}
"""Change from dive to dive, over the parameter's spread: water and growth"""
OTHER_WALK = 0.02
"""likewise, of every other parameter"""
PASSES = 2
"""Calibrations about which the residuals are linear"""


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
        return np.array(
            [
                self.parameters[k].deviation(v, s)
                for v, s in zip(values, np.sqrt(covariance), strict=True)
            ]
        )

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
    walks: Mapping[str, float] | float | None = None,
    advance: Callable[[], object] = lambda: None,
) -> Beliefs:
    """Follow parameters over the dives of one vehicle, in their order.

    Args:
      logs: the dives. calibration: where the beliefs begin, with the parameters' spreads.
      parameters: names of `twin.identify.unknowns`.
      walks: change from dive to dive over the spread, by name or of all; default `WALKS`.
      advance: called once for each dive of each pass.

    Raises:
      InputError: no dive, an unknown parameter, or a calibration that does not fly.
    """
    used, _ = gliding(logs)
    chosen = choose(list(parameters))
    nominal = tuple(one.get(calibration) for one in chosen)
    steps = np.array([_walk(one.name, walks) for one in chosen])
    about = calibration
    shift = np.zeros(len(chosen))
    for turn in range(PASSES):
        said = _said(used, about, chosen, advance)
        # the offsets count from the vehicle file's values, whatever they are linear about
        said = [(matrix, matrix @ shift - slope) for matrix, slope in said]
        if turn + 1 < PASSES:
            still, _, _ = _filtered(said, np.zeros(len(chosen)))
            shift = np.clip(still[-1], -3.0, 3.0)
            about = calibration
            for one, value, offset in zip(chosen, nominal, shift, strict=True):
                about = one.at(about, value, float(offset))
    offset, covariance, innovation = _filtered(said, steps)
    smoothed, after = _smoothed(offset, covariance, steps)
    return Beliefs(
        parameters=chosen, nominal=nominal, rows=tuple(log.index for log in used), offset=offset,
        covariance=covariance, innovation=innovation, smoothed=smoothed, smoothed_covariance=after,
    )  # fmt: skip


def _walk(name: str, walks: Mapping[str, float] | float | None) -> float:
    if walks is None:
        return WALKS.get(name, OTHER_WALK)
    return float(walks) if isinstance(walks, int | float) else float(walks.get(name, 0.0))


def _said(
    logs: Sequence[Log],
    about: Calibration,
    parameters: tuple[UnknownParameter, ...],
    advance: Callable[[], object],
) -> list[tuple[Array, Array]]:
    """J^T J and J^T r of each dive's depth rates and pitches about a calibration."""
    noise = noise_of_dives(logs, about)
    count, found = len(parameters), []
    for log in logs:
        residuals = dive_residuals([log], about, parameters, noise)
        kept = {k: v for k, v in residuals.channels.items() if k in ("depth_rate", "pitch")}
        matrix, slope = dataclasses.replace(residuals, channels=kept).information()
        found.append((matrix[:count, :count], slope[:count]))
        advance()
    return found


def _filtered(said: Sequence[tuple[Array, Array]], steps: Array) -> tuple[Array, Array, Array]:
    """Offsets, covariances and innovations after each dive; the first belief is a unit normal."""
    count = len(steps)
    mean: Array = np.zeros(count)
    covariance: Array = np.eye(count)
    means, covariances, innovations = [], [], []
    for matrix, pulled in said:
        covariance = covariance + np.diag(steps**2)
        innovations.append(_innovation(matrix, pulled, mean, covariance))
        precision = np.linalg.inv(covariance)
        before = mean
        covariance = np.asarray(np.linalg.inv(precision + matrix), np.float64)
        mean = covariance @ (precision @ before + pulled)
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances), np.array(innovations)


def _innovation(matrix: Array, pulled: Array, mean: Array, covariance: Array) -> Array:
    """What a dive alone says less what was believed, over its deviation, by the dive's own
    directions; NaN for directions that it does not tell."""
    strength, ways = np.linalg.eigh(matrix)
    told = strength > 1e-9 * max(float(strength.max()), 1e-30)
    found = np.full(len(mean), np.nan)
    along = ways.T @ (pulled - matrix @ mean)
    spread = np.einsum("ij,jk,ki->i", ways.T, covariance, ways)
    found[told] = along[told] / strength[told] / np.sqrt(1.0 / strength[told] + spread[told])
    return found


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
