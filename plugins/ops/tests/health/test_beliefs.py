"""Beliefs end at the fit to all dives, are as far off as they say, and look back."""

import identify_logs as simulated
import numpy as np
import pytest

from glider_twin_ops.health import answers, follow_parameters
from twin import load_vehicle
from twin.errors import InputError
from twin.identify import NAMES as PARAMETERS
from twin.identify import identify, load_calibration, load_logs

NAMES = ("neutral_density", "drag")
DIVES = 10


@pytest.fixture(scope="module")
def sea(tmp_path_factory):
    """Logs of a vehicle that is 20 % dirtier than its file, and the truth."""
    vehicle = load_vehicle("glider")
    truth = {"neutral_density": 1025.4, "drag": 1.2 * vehicle.flow_frame.drag[0]}
    dirty = simulated.changed(vehicle, drag=1.2, neutral_density=1025.4)
    runs = [simulated.flown(dirty, 40 + k, yos=1, max_depth=100.0) for k in range(DIVES)]
    store = simulated.stored(tmp_path_factory.mktemp("logs") / "sea.zarr", runs)
    return load_logs(store), truth


@pytest.fixture(scope="module")
def still(sea):
    return follow_parameters(sea[0], load_calibration("glider"), NAMES, walks=0.0, fixes=False)


def test_without_walks_the_last_belief_is_the_fit_to_all_dives(sea, still):
    """Its deviation is that of a fit whose other numbers are exact: it is for changes from dive to
    dive, which errors of numbers that stay do not make."""
    others = [name for name in PARAMETERS if name not in NAMES]
    fit = identify(sea[0], load_calibration("glider"), parameters=NAMES, known=others, fixes=False)
    for name, truth in sea[1].items():
        one, value, deviation = fit[name], still.value(name)[-1], still.deviation(name)[-1]
        assert abs(value - one.value) < 0.5 * one.deviation
        assert deviation == pytest.approx(one.deviation, rel=0.2)
        assert abs(value - truth) < 3.5 * deviation


def test_innovations_are_as_large_as_they_say_and_white(sea, still):
    free = follow_parameters(sea[0], load_calibration("glider"), NAMES, fixes=False)
    for found in (still, free):
        seen = found.innovation[1:]
        assert 0.5 < np.sqrt(np.mean(seen**2)) < 1.5
        assert abs(np.mean(seen[1:] * seen[:-1])) < 2.0 / np.sqrt(seen[1:].size)


def test_beliefs_narrow_and_looking_back_is_narrower(still):
    for name in NAMES:
        deviation = still.deviation(name)
        assert (np.diff(deviation) < 0.05 * deviation[1:]).all()
        assert deviation[-1] < 0.6 * deviation[0]
        assert still.value(name, smoothed=True)[0] == pytest.approx(still.value(name)[-1])
    with pytest.raises(InputError, match="is not followed"):
        still.value("mass")


def walked(seed, count, noise=1.0):
    """What dives say of parameters that walk, and by how much these do."""
    rng = np.random.default_rng(seed)
    steps, matrix = np.array([0.02, 0.05]), np.array([[900.0, 200.0], [200.0, 300.0]])
    truth = rng.standard_normal(2) + np.cumsum(steps * rng.standard_normal((count, 2)), axis=0)
    root = np.linalg.cholesky(np.linalg.inv(matrix))
    seen = truth + noise * rng.standard_normal((count, 2)) @ root.T
    return [(matrix, matrix @ one) for one in seen], steps


def test_looking_back_is_least_squares_over_all_dives():
    said, steps = walked(2, count=6)
    offset, covariance, _, _ = answers._filtered(said, steps)
    smoothed, _ = answers._smoothed(offset, covariance, steps)
    size = 2 * len(said)
    whole, right = np.zeros((size, size)), np.zeros(size)
    for k, (matrix, pulled) in enumerate(said):
        here = slice(2 * k, 2 * k + 2)
        whole[here, here] += matrix
        right[here] += pulled
        known = np.eye(2) + np.diag(steps**2) if k == 0 else np.diag(steps**2)
        rows = np.zeros((2, size))
        rows[:, here] = np.eye(2)
        if k:
            rows[:, 2 * k - 2 : 2 * k] = -np.eye(2)
        whole += rows.T @ np.linalg.inv(known) @ rows
    assert smoothed.ravel() == pytest.approx(np.linalg.solve(whole, right), abs=1e-9)


@pytest.mark.parametrize("noise", [0.4, 3.0])
def test_dives_say_how_far_they_are_off(noise):
    said, steps = walked(3, count=60, noise=noise)
    before = answers._filtered(said, steps)[2][8:]
    scaled, walks = answers._scaled(said, steps)
    after = answers._filtered(scaled, walks)[2][8:]
    assert abs(np.log(np.sqrt(np.mean(after**2)))) < 0.5 * abs(np.log(np.sqrt(np.mean(before**2))))


def test_a_sea_of_another_density_is_found_from_a_file_of_the_ocean(sea, still):
    ocean = load_calibration("glider")
    brackish = ocean.replace(vehicle=ocean.vehicle.replace(reference_density=1008.0))
    found = follow_parameters(sea[0], brackish, NAMES, walks=0.0, fixes=False)
    for name in NAMES:
        assert found.value(name)[-1] == pytest.approx(
            still.value(name)[-1], abs=0.1 * still.deviation(name)[-1]
        )
