"""SOAP on a badly scaled matrix problem, where its eigenbases pay."""

import copy

import pytest
import torch

from learn.training.minibatch import Soap


def residual(seed=0):
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape):
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    left, right = (torch.linalg.qr(draw(n, n))[0] for n in (12, 20))
    rows = torch.logspace(0, -2, 12, dtype=torch.float64)
    columns = torch.logspace(0, -2, 20, dtype=torch.float64)
    target = draw(12, 20)

    def loss(weights, bias):
        error = rows[:, None] * (left.T @ (weights - target) @ right) * columns
        return error.square().sum() + (bias - 1.0).square().sum()

    return loss


def descend(kind, steps, **options):
    loss = residual()
    weights = torch.zeros(12, 20, dtype=torch.float64, requires_grad=True)
    bias = torch.zeros(5, dtype=torch.float64, requires_grad=True)
    optimiser = kind([weights, bias], **options)
    for k in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = options["lr"] * (1.0 - k / steps)
        optimiser.zero_grad()
        value = loss(weights, bias)
        value.backward()
        optimiser.step()
    return loss(weights, bias).item(), optimiser


def test_it_beats_adam_on_a_badly_scaled_matrix():
    soap, _ = descend(Soap, 400, lr=0.05)
    adam, _ = descend(torch.optim.Adam, 400, lr=0.05)
    assert soap < 0.1 * adam


def test_the_bases_stay_orthogonal():
    _, optimiser = descend(Soap, 100, lr=0.05)
    state = next(s for s in optimiser.state.values() if "row_basis" in s)
    for name in ("row_basis", "column_basis"):
        basis = state[name]
        eye = torch.eye(len(basis), dtype=basis.dtype)
        assert torch.allclose(basis.T @ basis, eye, atol=1e-10)


def test_the_first_gradient_moves_no_matrix():
    weights = torch.ones(3, 4, requires_grad=True)
    optimiser = Soap([weights], lr=0.1)
    weights.square().sum().backward()
    optimiser.step()
    assert torch.equal(weights.detach(), torch.ones(3, 4))
    optimiser.step()
    assert not torch.equal(weights.detach(), torch.ones(3, 4))


def test_a_restored_state_continues_alike():
    torch.manual_seed(0)
    model = torch.nn.Linear(6, 4)
    x = torch.randn(30, 6)
    optimiser = Soap(model.parameters(), lr=0.01, every=3)

    def run(model, optimiser, steps):
        for _ in range(steps):
            optimiser.zero_grad()
            (model(x) - x[:, :4].sin()).square().mean().backward()
            optimiser.step()

    run(model, optimiser, 10)
    twin = copy.deepcopy(model)
    again = Soap(twin.parameters(), lr=0.5)
    again.load_state_dict(copy.deepcopy(optimiser.state_dict()))
    run(model, optimiser, 10)
    run(twin, again, 10)
    assert torch.equal(model.weight, twin.weight)


def test_zero_gradients_are_harmless():
    weights = torch.ones(3, 4, requires_grad=True)
    optimiser = Soap([weights], lr=0.1)
    for _ in range(12):
        weights.grad = torch.zeros(3, 4)
        optimiser.step()
    assert weights.detach().numpy() == pytest.approx(1.0)


def test_weight_decay_shrinks_matrices_and_spares_biases():
    weights, bias = torch.ones(3, 4, requires_grad=True), torch.ones(3, requires_grad=True)
    optimiser = Soap([weights, bias], lr=0.1, weight_decay=0.5)
    for _ in range(5):
        weights.grad, bias.grad = torch.zeros(3, 4), torch.zeros(3)
        optimiser.step()
    # the first gradient only shows the directions
    assert weights.detach().numpy() == pytest.approx(0.95**4)
    assert bias.detach().numpy() == pytest.approx(1.0)
