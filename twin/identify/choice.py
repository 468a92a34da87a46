"""Choice: whether a log supports a further parameter, by the dives that are left out of a fit.

A pitch offset turns into drag and trim when a log holds one pitch, and then takes up what the
model lacks. It therefore has to earn its place: with it the dives of a log must predict the others
better than without it, by more than such gains scatter from dive to dive and by a share that
matters (cross-validation; Hastie et al. 2009, The Elements of Statistical Learning, 7.10).

A fit without one dive, and one with one parameter more, are each a Gauss-Newton step from the fit
to all: the equations are nearly linear in the parameters. On public logs the step tells the gain
of whole new fits to a fifth of it.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.identify.problem import PRIOR, Problem, cut
from twin.identify.unknowns import UnknownParameter

Array = NDArray[np.float64]
Blocks = NDArray[np.int_]

LEAST_DIVES = 4
"""Dives below which none is left out."""
LEAST_GAIN = 0.04
"""Part of the mean square error of left-out dives that a parameter must take away. The pitch
offsets of ten public logs take 0 to 2.4 %, that of an eleventh 18 % (docs/howto/identify.md)."""
LEAST_DEVIATIONS = 2.0
"""Standard deviations that the gain must lie above zero."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Gain:
    """What a parameter takes away from the squared error of dives that were left out."""

    share: float
    """Of the squared error without the parameter; negative when it does harm."""
    deviations: float
    """The gain over its own standard deviation, by its scatter over the dives."""

    @property
    def supported(self) -> bool:
        """Whether the log supports the parameter."""
        return self.share > LEAST_GAIN and self.deviations > LEAST_DEVIATIONS


def gain_of(problem: Problem, x: Array, candidate: UnknownParameter) -> Gain:
    """What one parameter more would take away from the error of left-out dives.

    Args:
      problem: fitted, with the weights of its fit, which both sides are judged by.
      x: the fit, offsets from nominal.
      candidate: not among the problem's parameters.
    """
    wider = problem.with_parameter(candidate)
    at = np.append(x, 0.0)
    jacobian, residual = wider.jacobian(at), wider.residual(at)
    without = left_out(jacobian[:-1, :-1], residual[:-1], wider.blocks[:-1])
    taken = without - left_out(jacobian, residual, wider.blocks)
    scatter = float(np.std(taken, ddof=1) * np.sqrt(len(taken)))
    total = float(taken.sum())
    return Gain(
        share=total / float(without.sum()),
        deviations=total / scatter if scatter > 0.0 else 0.0,
    )


def left_out(jacobian: Array, residual: Array, blocks: Blocks) -> Array:
    """Sums of squared residuals of each dive, as a fit to the others predicts them, (blocks,).

    Args:
      jacobian: (residuals, parameters), weighted, near the fit to all.
      residual: (residuals,), weighted.
      blocks: (residuals,) the dive of each; PRIOR: what was known before. Few dives are cut in
        parts (`twin.identify.problem.cut`).
    """
    blocks = cut(blocks)
    matrix, slope = jacobian.T @ jacobian, jacobian.T @ residual
    errors = []
    for number in np.unique(blocks[blocks != PRIOR]):
        own, seen = jacobian[blocks == number], residual[blocks == number]
        step = -np.linalg.solve(matrix - own.T @ own, slope - own.T @ seen)
        errors.append(float(np.sum((seen + own @ step) ** 2)))
    return np.array(errors)
