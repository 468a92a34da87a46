"""What one dive says adds up to a fit to all; what a pitch offset adds, left-out dives judge."""

import dataclasses

import identify_logs as simulated
import numpy as np
import pytest
from scipy.optimize import least_squares

from twin.identify import identify, load_calibration, load_logs
from twin.identify.comparison import (
    LEAST_GAIN,
    PRIOR,
    ComparedQuantity,
    Comparison,
    Gain,
    correlation_samples,
    left_out,
    shares,
)
from twin.identify.pitch import PITCHING
from twin.identify.residuals import DepthRates, dive_residuals, noise_of_dives
from twin.identify.rollout import refine
from twin.identify.turning_fit import TURNING
from twin.identify.unknowns import choose
from twin.vehicle.vehicle import load_vehicle

OFFSET = 2.5
PITCHES = ((20.0, 28.0), (28.0, 20.0), (24.0, 34.0), (34.0, 24.0))


NOMINAL = load_calibration("glider")
TRUTH = {"neutral_density": 1025.2, "drag": 1.2 * NOMINAL.vehicle.flow_frame.drag[0]}


def assert_recovered(found, **truth):
    """Within the stated deviations: the recoveries of many vehicles are the release's."""
    for name, value in (TRUTH | truth).items():
        assert found[name].determined
        assert abs(found[name].value - value) < 3.5 * found[name].deviation, name


@pytest.fixture(scope="module")
def runs():
    vehicle = simulated.changed(load_vehicle("glider"), drag=1.2, neutral_density=1025.2)
    return [simulated.flown(vehicle, k, pitch=pitch, yos=1) for k, pitch in enumerate(PITCHES)]


@pytest.mark.parametrize("offset", [0.0, OFFSET])
def test_a_pitch_offset_is_chosen_where_there_is_one(tmp_path, runs, offset):
    """The same four dives, with a sensor that is straight and one that is mounted askew."""
    moved = [simulated.add_pitch_offset(run, offset) for run in runs]
    store = simulated.stored(tmp_path / "log.zarr", moved)
    for run in moved:
        simulated.add_pitch_offset(run, -offset)
    found = identify(load_logs(store), NOMINAL, fixes=False)
    estimate = found["pitch_offset"]
    assert estimate.determined == (offset > 0.0)
    assert estimate.value == pytest.approx(offset, abs=0.4)
    assert list(found.determined) == [e.name for e in found.estimates if e.determined]
    if not estimate.determined:
        assert "left-out dives" in estimate.note
    assert_recovered(found)
    assert found.depth_rate_rmse < 0.9 * found.nominal_depth_rate_rmse


def test_the_full_twin_recovers_what_was_flown(tmp_path, runs):
    logs = load_logs(simulated.stored(tmp_path / "log.zarr", runs[:2]))
    flight = identify(logs, NOMINAL, parameters=list(TRUTH), fixes=False)
    refined = refine(logs, flight)
    for name in TRUTH:  # what both leave at nominal is as unsure in both
        ratio = refined.identification[name].deviation / flight[name].deviation
        assert 0.5 < ratio < 2.0, name
    place = 1e3 * NOMINAL.vehicle.battery.neutral_x
    assert_recovered(refined.identification, shift_offset=place)
    assert refined.depth_rate_rmse < 0.01
    assert refined.pitch_rmse < np.deg2rad(1.0)


class Straight(Comparison):
    """Residuals that are linear in drag, trim, mass and a bias."""

    biases = ("a bias",)

    def __init__(self, design, parameters):
        channels = {"depth_rate": ComparedQuantity(unit="m/s", least=1e-6, samples=1.0)}
        super().__init__(NOMINAL, parameters, channels, {"depth_rate": [0]})
        self.design, self.weights = design, {"depth_rate": [np.ones(len(design))]}

    def missed(self, x):
        calibration = self.calibration(x)
        values = [100.0 * (p.get(calibration) / p.get(NOMINAL) - 1.0) for p in STRAIGHT]
        return {"depth_rate": [self.design @ np.array([*values, x[-1]])]}


STRAIGHT = choose(["neutral_density", "mass", "lift_ratio"])


def test_held_parameters_move_a_fit_with_biases_by_their_usual_errors():
    """Against the fits themselves, with each held parameter off by its usual error."""
    design = np.random.default_rng(5).normal(size=(30, 4))
    fitted, held = STRAIGHT[:1], STRAIGHT[1:]
    problem = Straight(design, fitted)
    _, change = problem.considered(np.zeros(2), held)
    want = np.zeros((2, 2))
    for parameter in held:
        off = parameter.held / parameter.spread
        wrong = Straight(design, fitted)
        wrong.nominal = parameter.at(NOMINAL, parameter.get(NOMINAL), 1e-3 * off)
        moved = least_squares(wrong.residual, np.zeros(2), jac=wrong.jacobian).x / 1e-3
        want += np.outer(moved, moved)
    np.testing.assert_allclose(change @ change.T, want, rtol=0.02, atol=1e-3 * np.abs(want).max())


def test_a_pitch_scale_that_is_asked_for_comes_back(tmp_path, runs):
    """The same four dives, with a sensor that reads 1.2 times their pitch."""
    before = [run["measured_pitch"] for run in runs]
    for run, pitch in zip(runs, before, strict=True):
        run.signals["measured_pitch"] = 1.2 * pitch
    logs = load_logs(simulated.stored(tmp_path / "log.zarr", runs))
    for run, pitch in zip(runs, before, strict=True):
        run.signals["measured_pitch"] = pitch
    asked = ["neutral_density", "drag", "pitch_scale"]
    scale = identify(logs, NOMINAL, parameters=asked, fixes=False)["pitch_scale"]
    assert abs(scale.value - 1.0 / 1.2) < 3.0 * scale.deviation
    assert scale.determined
    assert scale.value < 0.95
    known = identify(logs, NOMINAL, known=["pitch_scale", "pitch_offset"], fixes=False)
    assert known["pitch_scale"].note == "given as known"


def test_an_offset_that_is_asked_for_or_known_is_not_judged(tmp_path, runs):
    logs = load_logs(simulated.stored(tmp_path / "log.zarr", runs[:1]))
    names = ["neutral_density", "drag"]
    asked = identify(logs, NOMINAL, parameters=[*names, "pitch_offset"], fixes=False)
    assert "left-out" not in asked["pitch_offset"].note
    known = identify(logs, NOMINAL, known=["pitch_offset"], fixes=False)
    assert known["pitch_offset"].note == "given as known"
    few = identify(logs, NOMINAL, fixes=False)
    assert few["pitch_offset"].note.startswith("1 dives: from 4 on")


def regression(seed, dives=9, length=50, columns=3):
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(dives * length, columns))
    truth = rng.normal(size=columns)
    blocks = np.repeat(np.arange(dives), length)
    return design, design @ truth + rng.normal(size=dives * length), blocks


def test_one_step_is_the_whole_fit_to_the_other_dives():
    """For linear residuals, with what was known before: ridge regression without the dive."""
    design, values, blocks = regression(0)
    jacobian = np.concatenate([-design, np.eye(3)])
    residual = np.concatenate([values, np.zeros(3)])
    found = left_out(jacobian, residual, np.concatenate([blocks, np.full(3, PRIOR)]))
    for dive in range(9):
        train, held = blocks != dive, blocks == dive
        matrix = design[train].T @ design[train] + np.eye(3)
        x = np.linalg.solve(matrix, design[train].T @ values[train])
        assert found[dive] == pytest.approx(np.sum((values[held] - design[held] @ x) ** 2))


def test_a_column_of_noise_is_not_worth_it():
    gains = []
    for seed in range(20):
        design, values, blocks = regression(seed)
        noise = np.random.default_rng(100 + seed).normal(size=(len(values), 1))
        without = left_out(-design, values, blocks)
        with_it = left_out(-np.concatenate([design, noise], axis=1), values, blocks)
        gains.append(1.0 - with_it.sum() / without.sum())
    assert np.mean(gains) < 0.0
    assert max(gains) < LEAST_GAIN


@pytest.mark.parametrize(
    ("share", "deviations", "supported"),
    [(0.17, 9.0, True), (0.01, 9.0, False), (0.3, 1.5, False), (-0.2, -3.0, False)],
)
def test_a_gain_must_be_large_and_sure(share, deviations, supported):
    assert Gain(share=share, deviations=deviations).supported == supported


@pytest.fixture(scope="module")
def dives(tmp_path_factory, runs):
    return load_logs(simulated.stored(tmp_path_factory.mktemp("dives") / "log.zarr", runs))


PARAMETERS = (*choose(["neutral_density", "drag"]), PITCHING[1], TURNING[3])
FLOWN = ("depth_rate", "pitch", "yaw_rate", "roll")


def test_what_single_dives_say_adds_up_to_what_a_fit_to_all_sees(dives):
    """A recursion over dives and a fit to all of them have the same normal equations."""
    noise = noise_of_dives(dives, NOMINAL)
    assert tuple(noise) == FLOWN
    depth = {"depth_rate", "pitch"}
    sides = []
    for parts in ([dives], [[one] for one in dives]):
        said = [dive_residuals(logs, NOMINAL, PARAMETERS, noise) for logs in parts]
        assert all(tuple(one.channels) == FLOWN for one in said)
        kept = [
            dataclasses.replace(one, channels={n: one.channels[n] for n in depth}) for one in said
        ]
        sides.append([sum(term) for term in zip(*(o.information() for o in kept), strict=True)])
    (whole, slope), (summed, slopes) = sides
    np.testing.assert_allclose(summed, whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max())
    np.testing.assert_allclose(slopes, slope, rtol=1e-9, atol=1e-9 * np.abs(slope).max())


@pytest.mark.parametrize("which", range(len(PARAMETERS)))
def test_a_dives_residuals_change_as_their_jacobian_says(dives, which):
    """Drag moves the pitch and the turn too, through the speed that they are taken at."""
    offset = 0.01
    parameter = PARAMETERS[which]
    noise = noise_of_dives(dives[:1], NOMINAL)
    here = dive_residuals(dives[:1], NOMINAL, PARAMETERS, noise)
    moved = parameter.at(NOMINAL, parameter.get(NOMINAL), offset)
    there = dive_residuals(dives[:1], moved, PARAMETERS, noise)
    assert here.unknowns == (*(p.name for p in PARAMETERS), "yaw_bias", "roll_offset")
    changed = []
    for name in FLOWN:
        said, found = here.channels[name], there.channels[name].values
        assert said.values.shape == said.deviation.shape == found.shape
        expected = offset * said.jacobian[:, which]
        error = np.abs(found - said.values - expected).max()
        assert error <= 0.05 * np.abs(expected).max() + 1e-9
        if np.abs(expected).max() > 1e-7:
            changed.append(name)
    # the battery hardly rotates in these dives, so that their rolls say next to nothing
    assert [name for name in changed if name != "roll"] == {
        "neutral_density": ["depth_rate", "pitch", "yaw_rate"],
        "drag": ["depth_rate", "pitch", "yaw_rate"],
        "righting_arm": ["pitch", "yaw_rate"],
        "yaw_damping": ["yaw_rate"],
    }[parameter.name]


def test_an_outlier_of_three_deviations_counts_half_and_of_nine_a_tenth():
    (kept,) = shares([np.array([0.0, 0.6, -0.6, 1.8])], 0.2)
    np.testing.assert_allclose(kept, [1.0, 0.5, 0.5, 0.1])


@pytest.mark.parametrize("memory", [0.0, 0.6, 0.9])
def test_correlated_residuals_count_as_many_as_a_first_order_process_has_independent_ones(memory):
    """1 + 2 (a + a^2 + ...) = (1 + a) / (1 - a), over the pieces of a log."""
    rng, pieces = np.random.default_rng(7), []
    for length in (30_000, 50_000):
        kick, piece = rng.standard_normal(length), np.zeros(length)
        for k in range(1, length):
            piece[k] = memory * piece[k - 1] + kick[k]
        pieces.append(piece)
    expected = (1.0 + memory) / (1.0 - memory)
    assert correlation_samples(pieces, 400) == pytest.approx(expected, rel=0.15)


def test_the_current_is_what_the_fixes_say_beyond_the_way_through_the_water(runs, dives):
    """There and back again in currents that are known: their changes are left, of no way swum."""
    truth = load_calibration(
        simulated.changed(load_vehicle("glider"), drag=1.2, neutral_density=1025.2)
    )
    swum, one = runs[0].position[-1, :2], dives[0]
    known = np.random.default_rng(5).normal(0.0, 0.2, (8, 2))
    logs = [
        dataclasses.replace(
            one, heading=one.heading + k * np.pi, follows=k > 0,
            displacement=tuple((-1) ** k * swum + current * one.duration),
        )
        for k, current in enumerate(known)
    ]  # fmt: skip
    problem = DepthRates(logs, truth, choose(["drag"]), fixes=True)
    changes = problem.missed(np.zeros(problem.size))["current"]
    np.testing.assert_allclose(changes, np.diff(known, axis=0), atol=0.02)
