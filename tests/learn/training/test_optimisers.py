"""Scaled conjugate gradients on problems with known answers."""

import copy

import pytest
import torch

from learn.training.minibatch import Soap
from learn.training.scg import ScaledConjugateGradient
from twin.errors import InputError


def minimise(objective, start, *, max_iterations=1000, stop=None, **constants):
    """Iterate until converged, `max_iterations`, or `stop(optimiser)` after an iteration."""
    optimiser = ScaledConjugateGradient(objective, start, **constants)
    while not optimiser.converged and optimiser.iterations < max_iterations:
        optimiser.step()
        if stop is not None and stop(optimiser):
            break
    return optimiser


def quadratic(n, seed=0, condition=100.0):
    generator = torch.Generator().manual_seed(seed)
    basis, _ = torch.linalg.qr(torch.randn(n, n, generator=generator, dtype=torch.float64))
    values = torch.logspace(0, torch.tensor(condition).log10().item(), n, dtype=torch.float64)
    matrix = basis @ torch.diag(values) @ basis.T
    target = torch.randn(n, generator=generator, dtype=torch.float64)

    def objective(w):
        gradient = matrix @ (w - target)
        return float(0.5 * (w - target) @ gradient), gradient

    return objective, target


def rosenbrock(w):
    w = w.detach().requires_grad_()
    value = (100 * (w[1:] - w[:-1] ** 2) ** 2 + (1 - w[:-1]) ** 2).sum()
    (gradient,) = torch.autograd.grad(value, w)
    return value.item(), gradient


# Rounding costs even exact conjugate gradients a step or two at n 20 and condition 100.
@pytest.mark.parametrize(("n", "condition"), [(2, 100.0), (8, 100.0), (20, 10.0), (50, 100.0)])
def test_a_quadratic_is_solved_in_as_many_steps_as_dimensions(n, condition):
    objective, target = quadratic(n, condition=condition)
    start = torch.zeros(n, dtype=torch.float64)
    first, _ = objective(start)
    found = minimise(objective, start, lambda_start=1e-12, max_iterations=n)
    assert found.iterations <= n
    assert found.error < 1e-10 * first
    assert torch.allclose(found.parameters, target, atol=1e-4)


@pytest.mark.parametrize("n", [2, 10])
def test_rosenbrock(n):
    start = torch.full((n,), -1.2, dtype=torch.float64)
    start[1::2] = 1.0
    found = minimise(rosenbrock, start, gradient_tolerance=1e-8, max_iterations=2000)
    assert found.converged
    assert found.error < 1e-12
    assert torch.allclose(found.parameters, torch.ones(n, dtype=torch.float64), atol=1e-5)


def test_the_error_never_rises_and_falls_at_every_success():
    optimiser = ScaledConjugateGradient(rosenbrock, torch.tensor([-1.2, 1.0], dtype=torch.float64))
    accepted = 0
    for _ in range(60):
        before, point = optimiser.error, optimiser.parameters.clone()
        if optimiser.step():
            accepted += 1
            assert optimiser.error <= before
        else:
            assert optimiser.error == before
            assert torch.equal(optimiser.parameters, point)
        assert optimiser.error == rosenbrock(optimiser.parameters)[0]
    assert accepted > 30


def test_where_a_parabola_foretells_the_error_the_scale_falls_to_a_quarter():
    """Step 7 of Moller (1993), at every step on a parabola."""
    objective, _ = quadratic(8)
    start = torch.zeros(8, dtype=torch.float64)
    found = minimise(objective, start, lambda_start=1e-6, max_iterations=3)
    assert found.scale == pytest.approx(1e-6 / 4.0**3, rel=1e-12)


def test_negative_curvature_is_left():
    def saddle(w):  # a maximum along the first axis at the start, minima at (+-1, 0)
        x, y = float(w[0]), float(w[1])
        gradient = torch.tensor([4 * x * (x * x - 1), 2 * y], dtype=torch.float64)
        return (x * x - 1) ** 2 + y * y, gradient

    found = minimise(
        saddle, torch.tensor([0.05, 0.0], dtype=torch.float64), gradient_tolerance=1e-9
    )
    assert abs(abs(float(found.parameters[0])) - 1.0) < 1e-6


def test_an_infinite_candidate_is_refused_and_the_step_shortened():
    def walled(w):  # minimum at 1, NaN beyond 3
        value = torch.where(w > 3.0, torch.nan, (w - 1.0) ** 2 + 0.1 * (w - 1.0) ** 4)
        return float(value.sum()), 2 * (w - 1.0) + 0.4 * (w - 1.0) ** 3

    found = minimise(walled, torch.tensor([-4.0], dtype=torch.float64), gradient_tolerance=1e-9)
    assert abs(float(found.parameters[0]) - 1.0) < 1e-6


def test_a_resumed_run_takes_the_same_steps():
    start = torch.tensor([-1.2, 1.0], dtype=torch.float64)
    straight = ScaledConjugateGradient(rosenbrock, start)
    broken = ScaledConjugateGradient(rosenbrock, start)
    for _ in range(11):
        straight.step()
        broken.step()
    resumed = ScaledConjugateGradient(rosenbrock, start)
    resumed.load_state_dict(broken.state_dict())
    for _ in range(20):
        straight.step()
        resumed.step()
    assert torch.equal(straight.parameters, resumed.parameters)


def test_the_stopping_hook_ends_the_search():
    start = torch.tensor([-1.2, 1.0], dtype=torch.float64)
    found = minimise(rosenbrock, start, stop=lambda optimiser: optimiser.iterations == 7)
    assert found.iterations == 7


def test_float32_gradients_are_enough():
    found = minimise(rosenbrock, torch.tensor([-1.2, 1.0]), max_iterations=500)
    assert found.error < 1e-5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sigma": 0.0}, "scg sigma must be positive, got 0.0"),
        ({"lambda_start": -1.0}, "scg lambda_start must be positive"),
        ({"gradient_tolerance": -1.0}, "must not be negative"),
    ],
)
def test_wrong_constants_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        minimise(rosenbrock, torch.zeros(2), **changes)


# --- SOAP on a badly scaled matrix problem, where its eigenbases pay


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
