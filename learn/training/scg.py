"""Scaled conjugate gradients: full-batch training without a line search.

M. F. Moller, "A scaled conjugate gradient algorithm for fast supervised learning", Neural Networks
6 (1993) 525-533. Steps and equation numbers follow that paper. The curvature along the search
direction comes from a second gradient, and a Levenberg-Marquardt term lambda keeps it positive.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from learn.training.optimiser import FullBatchOptimiser, Objective, TrainingConfig
from twin.errors import InputError


class ScaledConjugateGradient:
    """Scaled conjugate gradients; `step` is one iteration with at most two gradients.

        optimiser = ScaledConjugateGradient(objective, start)
        while not optimiser.converged:
            optimiser.step()

    `parameters` (n,) and `error` belong to the last accepted point: the error never rises.

    Args:
      sigma: length of the finite difference that measures curvature, at most 1e-4 by Moller.
        Float32 gradients need a larger one: the difference of two gradients must exceed their
        rounding.
      lambda_start: initial Levenberg-Marquardt scale lambda, at most 1e-6 by Moller.
      gradient_tolerance: length of the gradient at which to stop.

    Raises:
      InputError: sigma or lambda_start is not above 0, or the tolerance is negative.
    """

    def __init__(
        self,
        objective: Objective,
        start: Tensor,
        *,
        sigma: float = 1e-4,
        lambda_start: float = 1e-6,
        gradient_tolerance: float = 0.0,
    ) -> None:
        for name, value in (("sigma", sigma), ("lambda_start", lambda_start)):
            if not value > 0.0:
                raise InputError(f"scg {name} must be positive, got {value}")
        if gradient_tolerance < 0.0:
            raise InputError(
                f"scg gradient_tolerance must not be negative, got {gradient_tolerance}"
            )
        self.objective = objective
        self.sigma, self.lambda_start = sigma, lambda_start
        self.gradient_tolerance = gradient_tolerance
        self.parameters = start.detach().clone()
        self.error, gradient = objective(self.parameters)
        self.residual = -gradient
        self.direction = self.residual.clone()
        self.scale = self.lambda_start
        self.scale_added = 0.0
        self.curvature = 0.0
        self.success = True
        self.successes = 0
        self.iterations = 0
        self.evaluations = 1
        self.converged = float(self.residual.norm()) <= self.gradient_tolerance

    def step(self) -> bool:
        """Make one iteration; returns True if a better point was accepted."""
        direction = self.direction
        length2 = float(direction.dot(direction))
        if self.converged or length2 == 0.0:
            self.converged = True
            return False
        self.iterations += 1
        if self.success:  # step 2: curvature along the direction, from a second gradient
            reach = self.sigma / length2**0.5
            _, ahead = self.objective(self.parameters + reach * direction)
            self.evaluations += 1
            self.curvature = float(direction.dot(ahead + self.residual)) / reach
        # Step 3: scale. `curvature` already holds what earlier failures added, `scale_added`.
        self.curvature += (self.scale - self.scale_added) * length2
        if self.curvature <= 0.0:  # step 4: make it positive
            self.scale_added = 2.0 * (self.scale - self.curvature / length2)
            self.curvature = -self.curvature + self.scale * length2
            self.scale = self.scale_added
        slope = float(direction.dot(self.residual))  # step 5: length of the step
        length = slope / self.curvature
        candidate = self.parameters + length * direction
        error, gradient = self.objective(candidate)
        self.evaluations += 1
        # step 6: ratio of the actual to the predicted decrease of the error
        comparison = 2.0 * self.curvature * (self.error - error) / slope**2
        accepted = comparison >= 0.0  # step 7; False for NaN
        if accepted:
            self._accept(candidate, error, -gradient)
            if comparison >= 0.75:
                self.scale *= 0.25
        else:
            self.scale_added = self.scale
            self.success = False
        if not comparison >= 0.25:  # step 8
            finite = abs(comparison) < float("inf")
            factor = (1.0 - comparison) if finite else 1.0 / self.lambda_start
            self.scale += self.curvature * factor / length2
        # the scale is so large that the step is below rounding: no better point is near
        tiny = torch.finfo(self.parameters.dtype).eps
        lost = not accepted and abs(length) * length2**0.5 <= tiny * float(self.parameters.norm())
        small = float(self.residual.norm()) <= self.gradient_tolerance
        if lost and not torch.equal(self.direction, self.residual):
            self._restart()
        else:
            self.converged = lost or small
        return accepted

    def _accept(self, candidate: Tensor, error: float, residual: Tensor) -> None:
        previous = self.residual
        self.parameters, self.error, self.residual = candidate, error, residual
        self.scale_added, self.success = 0.0, True
        self.successes += 1
        if self.successes % self.parameters.numel() == 0:
            self.direction = residual.clone()
            return
        mu = float(self.direction.dot(previous))
        beta = float(residual.dot(residual) - residual.dot(previous)) / mu
        self.direction = residual + beta * self.direction
        if float(self.direction.dot(residual)) <= 0.0:
            self._restart()

    def _restart(self) -> None:
        """Restart from steepest descent, since rounding has spoilt the conjugate direction."""
        self.direction = self.residual.clone()
        self.scale, self.scale_added = self.lambda_start, 0.0
        self.success = True

    def state_dict(self) -> dict[str, Any]:
        """State that a resumed run needs, without the objective."""
        return {name: getattr(self, name) for name in _STATE}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from a `state_dict`; the next step is as without the interruption."""
        for name in _STATE:
            setattr(self, name, state[name])


_STATE = (
    "parameters",
    "error",
    "residual",
    "direction",
    "scale",
    "scale_added",
    "curvature",
    "success",
    "successes",
    "iterations",
    "evaluations",
    "converged",
)


FLOAT32_SIGMA = 3e-3
"""Finite difference in parameter space that measures curvature: large against the rounding of
float32 gradients, small against the distance over which curvature changes."""


class ScgOptimiser(FullBatchOptimiser):
    """The paper's scaled conjugate gradients."""

    summary = "scaled conjugate gradients over all samples at once, the paper's"

    def build(
        self, objective: Objective, start: Tensor, config: TrainingConfig
    ) -> ScaledConjugateGradient:
        """See `FullBatchOptimiser`."""
        return ScaledConjugateGradient(objective, start, sigma=FLOAT32_SIGMA)
