"""Minibatch optimisers: torch's Adam (Kingma and Ba 2015), and SOAP.

SOAP (N. Vyas et al., "SOAP: improving and stabilizing Shampoo using Adam", 2024) is Adam in the
eigenbasis of Shampoo's preconditioner. Each weight matrix has running second moments of its
gradient's rows and columns. Adam's scale per element is applied in the moments' eigenbases, which
one power iteration updates from time to time. On smooth regression with little noise, SOAP needs
several times fewer steps than Adam.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor

from learn.training.optimiser import MinibatchOptimiser, TrainingConfig


class Soap(torch.optim.Optimizer):
    """SOAP as a torch optimiser; vectors (biases) get plain Adam.

    Args:
      parameters: tensors to train.
      lr: step size.
      betas: decay factors of the gradient's mean and of its mean square.
      shampoo_beta: decay factor of the row and column moments.
      every: steps between two updates of the eigenbases.
      weight_decay: fraction of each weight matrix subtracted per step and unit of `lr`,
        independently of the gradient (decoupled, as in AdamW).
    """

    def __init__(
        self,
        parameters: Iterable[Tensor],
        lr: float = 3e-3,
        betas: tuple[float, float] = (0.95, 0.95),
        shampoo_beta: float = 0.95,
        eps: float = 1e-8,
        every: int = 10,
        weight_decay: float = 0.0,
    ) -> None:
        defaults = {
            "lr": lr,
            "betas": betas,
            "shampoo_beta": shampoo_beta,
            "eps": eps,
            "every": every,
            "weight_decay": weight_decay,
        }
        super().__init__(parameters, defaults)

    # torch's methods without the wrapper that imports torch's compiler, which takes 1.6 s
    add_param_group = inspect.unwrap(torch.optim.Optimizer.add_param_group)
    zero_grad = inspect.unwrap(torch.optim.Optimizer.zero_grad)
    state_dict = inspect.unwrap(torch.optim.Optimizer.state_dict)
    load_state_dict = inspect.unwrap(torch.optim.Optimizer.load_state_dict)

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:  # type: ignore[override]
        """Update the parameters from their gradients."""
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is not None:
                    self._update(parameter, parameter.grad, group)

    def _update(self, parameter: Tensor, gradient: Tensor, group: dict[str, Any]) -> None:
        state = self.state[parameter]
        if not state:
            state["step"] = 0
            state["mean"] = torch.zeros_like(gradient)
            state["square"] = torch.zeros_like(gradient)
            if gradient.dim() == 2:
                _start_bases(state, gradient)
                return  # the first gradient only starts the eigenbases
        state["step"] += 1
        beta1, beta2 = group["betas"]
        rotated = _rotate(state, gradient)
        state["mean"].lerp_(gradient, 1.0 - beta1)
        state["square"].mul_(beta2).addcmul_(rotated, rotated, value=1.0 - beta2)
        correction = (1.0 - beta2 ** state["step"]) ** 0.5 / (1.0 - beta1 ** state["step"])
        scale = state["square"].sqrt().add_(group["eps"])
        update = _rotate_back(state, _rotate(state, state["mean"]) / scale)
        if gradient.dim() == 2:
            parameter.mul_(1.0 - group["lr"] * group["weight_decay"])
        parameter.add_(update, alpha=-group["lr"] * correction)
        if gradient.dim() == 2:
            _follow(state, gradient, group["shampoo_beta"], state["step"] % group["every"] == 0)


def _start_bases(state: dict[str, Any], gradient: Tensor) -> None:
    state["rows"] = gradient @ gradient.T
    state["columns"] = gradient.T @ gradient
    state["row_basis"] = _eigenvectors(state["rows"])
    state["column_basis"] = _eigenvectors(state["columns"])


def _eigenvectors(moment: Tensor) -> Tensor:
    small = torch.finfo(moment.dtype).eps * moment.diagonal().mean().clamp_min(1e-30)
    eye = torch.eye(len(moment), dtype=moment.dtype, device=moment.device)
    return torch.linalg.eigh((moment + small * eye).double())[1].flip(1).to(moment.dtype)


def _follow(state: dict[str, Any], gradient: Tensor, beta: float, turn: bool) -> None:
    """Update the moments and, if `turn`, the eigenbases by one power iteration."""
    state["rows"].lerp_(gradient @ gradient.T, 1.0 - beta)
    state["columns"].lerp_(gradient.T @ gradient, 1.0 - beta)
    if not turn:
        return
    for moment, basis, axis in (("rows", "row_basis", 0), ("columns", "column_basis", 1)):
        old = state[basis]
        product = state[moment] @ old
        # sorted by eigenvalue: the QR factorisation keeps leading directions first
        order = torch.argsort((old * product).sum(0), descending=True)
        state["square"] = state["square"].index_select(axis, order)
        state[basis] = torch.linalg.qr(product[:, order])[0]


def _rotate(state: dict[str, Any], matrix: Tensor) -> Tensor:
    if "rows" not in state:
        return matrix
    return state["row_basis"].T @ matrix @ state["column_basis"]


def _rotate_back(state: dict[str, Any], matrix: Tensor) -> Tensor:
    if "rows" not in state:
        return matrix
    return state["row_basis"] @ matrix @ state["column_basis"].T


class SoapOptimiser(MinibatchOptimiser):
    """SOAP with weight decay."""

    summary = "Adam in the eigenbasis of Shampoo's preconditioner, a cosine schedule, weight decay"
    settings = (*MinibatchOptimiser.settings, "weight_decay")

    def build(self, parameters: Iterable[Tensor], config: TrainingConfig) -> torch.optim.Optimizer:
        """See `MinibatchOptimiser`."""
        return Soap(parameters, lr=config.rate, weight_decay=config.weight_decay)


class AdamOptimiser(MinibatchOptimiser):
    """Adam of torch."""

    summary = "running means of the gradient and of its squares, with a cosine schedule"

    def build(self, parameters: Iterable[Tensor], config: TrainingConfig) -> torch.optim.Optimizer:
        """See `MinibatchOptimiser`."""
        return torch.optim.Adam(parameters, lr=config.rate)
