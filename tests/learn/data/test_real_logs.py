"""Real logs in learn: truth with holes, sample periods, splits, folds, dead reckoning of rows."""

import dataclasses
import math

import numpy as np
import pytest
from logs import stored

import learn
from factory.importing import import_logs
from factory.importing.dives.dive_rows import blocks
from factory.samples import Flight, write_csv
from factory.samples.gliders import write_slocum
from learn.data.dataset import MissionSequence, filled, load_missions, nearest
from learn.data.labels import LabelConfig
from learn.data.preparation import prepare
from learn.evaluation.log_score import LogReference, score_row
from learn.networks.base import NetworkConfig
from learn.report.card import RunOrigin
from learn.training.fit_config import FitConfig, fit_settings
from learn.training.fitting import fit
from learn.training.optimiser import TrainingConfig
from twin.errors import InputError, StoreError
from twin.navigation.estimators.base import Estimate
from twin.navigation.features import INPUT_SETS, select_features
from twin.records.logged import LogRow
from twin.records.store import open_store, write_store
from twin.vehicle.vehicle import load_vehicle

FLIGHT = Flight(dives=6)
INPUTS = select_features(INPUT_SETS["glider"])
SMALL = NetworkConfig(kind="mlp", hidden=8, layers=1)
SHORT = TrainingConfig(seconds=0.0, epochs=2, validations=2)


def log_store(folder, flight=FLIGHT, period=4.0):
    """An imported Slocum whose Doppler log saw the speed below 12 m."""
    files = write_slocum(folder, flight)
    time = flight.time[::2]
    deep = flight.state(time)["depth"] > 12.0
    truth = {
        "time": time,
        "pressure_bar": flight.state(time)["depth"] / 10.0,
        "U_dvl_ms": np.where(deep, flight.speed, np.nan),
    }
    files.append(write_csv(folder / "unit1_dvl_truth.csv", truth))
    dataset, _ = import_logs("slocum", files, period=period)
    return write_store(dataset, folder / "real.zarr", overwrite=True)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return log_store(tmp_path_factory.mktemp("logs"))


def config(store, **changes):
    base = FitConfig(store=str(store), features=INPUTS, network=SMALL, training=SHORT)
    return dataclasses.replace(base, **changes)


def test_dives_are_divided_in_blocks_of_time():
    assert blocks(1).tolist() == [2]
    assert blocks(2).tolist() == [0, 2]
    assert blocks(3).tolist() == [0, 1, 2]
    assert blocks(10).tolist() == [0] * 6 + [1] * 2 + [2] * 2
    for count in range(3, 60):
        found = blocks(count)
        assert len(found) == count
        assert set(found) == {0, 1, 2}
        assert (np.diff(found) >= 0).all()


def test_an_imported_store_has_all_parts(store):
    parts = [m.split for m in load_missions(store, ("measured_depth",))]
    assert parts == ["train"] * 4 + ["validation", "test"]


def test_missing_truth_weighs_nothing(store):
    data = prepare(store, target="surge", features=INPUTS)
    for target, weight in zip(data.train.targets, data.train.weights, strict=True):
        assert np.isfinite(target).all()
        assert 0.2 < weight.mean() < 0.95
        # with the truth a constant, what counts is the same value everywhere
        assert np.ptp(target[weight > 0]) < 1e-5
    assert data.normalisation.target_mean == pytest.approx(FLIGHT.speed, rel=1e-6)


def test_missing_truth_in_a_simulated_store_is_an_error(small_store, tmp_path):
    dataset = open_store(small_store).load()
    dataset["true_surge"][0, 5] = np.nan
    broken = write_store(dataset, tmp_path / "broken.zarr")
    with pytest.raises(StoreError, match="true_surge of mission 0 is not finite"):
        prepare(broken, target="surge", features=("depth_rate",))


def test_a_log_without_truth_cannot_be_learned_from(tmp_path, monkeypatch):
    store = stored(tmp_path / "plain.zarr", "slocum", write_slocum(tmp_path, FLIGHT), period=4.0)
    with pytest.raises(StoreError, match=r"no truth to learn surge from.*learn evaluate RUN"):
        prepare(store, target="surge", features=INPUTS)

    def started(*_, **__):
        raise AssertionError("read or trained for nothing")

    monkeypatch.setattr("learn.training.fitting.load_missions", started)
    monkeypatch.setattr("learn.training.fitting.train_tasks", started)
    with pytest.raises(StoreError, match=r"no truth to learn surge from.*plain.zarr`"):
        fit(config(store), tmp_path / "run")


def test_a_missing_channel_says_what_to_type(store):
    with pytest.raises(StoreError, match=r"no channel measured_roll_rate.*--without roll_rate"):
        prepare(store, target="surge", features=("roll_rate", "depth_rate"))


def test_a_finer_store_is_thinned_and_a_coarser_one_refused(store):
    whole = load_missions(store, ("measured_depth",))[0]
    thin = load_missions(store, ("measured_depth",), period=8.0)[0]
    assert thin.period == 8.0
    np.testing.assert_array_equal(
        thin.signals["measured_depth"], whole.signals["measured_depth"][::2]
    )
    for wanted in (2.0, 6.0):
        with pytest.raises(StoreError, match=r"a sample every 4 s and one every .*--period 4"):
            load_missions(store, ("measured_depth",), period=wanted)


def test_holes_in_inputs_are_bridged_and_truth_is_not():
    holes = np.array([1.0, np.nan, 3.0, np.nan])
    np.testing.assert_allclose(filled("measured_pitch", holes), [1, 2, 3, 3])
    assert np.isnan(filled("true_surge", holes)).sum() == 2
    assert np.isnan(filled("measured_gps_north", holes)).sum() == 2
    turned = filled("measured_heading", np.array([350.0, np.nan, 10.0]))
    np.testing.assert_allclose(np.sin(np.deg2rad(turned[1])), 0.0, atol=1e-9)


def test_sparse_truth_survives_thinning():
    values = np.full(12, np.nan)
    values[1::2] = np.arange(1, 12, 2)
    np.testing.assert_array_equal(nearest(values, 2), [1, 3, 5, 7, 9, 11])
    assert np.isfinite(nearest(values, 3)).all()
    np.testing.assert_array_equal(nearest(np.arange(12.0), 3), [0, 3, 6, 9])


def test_training_goes_on_from_a_run(store, tmp_path):
    first = fit(config(store, period=8.0), tmp_path / "first")
    assert first.period == 8.0
    # no step: what comes out is what went in
    still = dataclasses.replace(SHORT, epochs=1, rate=1e-12)
    go_on = config(store, period=8.0, start=str(first.folder), training=still)
    second = fit(go_on, tmp_path / "second")
    missions = load_missions(
        store, [c for c in open_store(store).data_vars if c.startswith("measured_")], period=8.0
    )
    ours, theirs = (run.networks()["surge"].predict(missions[:2]) for run in (first, second))
    for (mine, _), (other, _) in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-5)
    scales = [run.networks()["surge"].members[0].normalisation for run in (first, second)]
    assert scales[0] == scales[1]
    other_inputs = dataclasses.replace(go_on, features=("depth_rate",))
    with pytest.raises(InputError, match="other inputs"):
        fit(other_inputs, tmp_path / "x")
    wrong = dataclasses.replace(go_on, network=NetworkConfig(kind="mlp", hidden=9, layers=1))
    with pytest.raises(InputError, match="another kind, size or inputs"):
        fit(wrong, tmp_path / "y")


def test_a_dive_that_is_left_out_is_seen_by_no_network(store):
    held = prepare(store, target="surge", features=INPUTS, held_out=(2,))
    assert len(held.train.inputs) + len(held.validation.inputs) == 5
    assert fit_settings(store, features=INPUTS, held_out=[2]).held_out == (2,)


# --- dead reckoning -----------------------------------------------------------------------------


def row_of(start, moved, current):
    """A level flight north for 1000 s at `moved` over the water, in a uniform current."""
    samples, period = 501, 2.0
    duration = period * (samples - 1)
    zeros = np.zeros(samples)
    signals = {
        "measured_roll": zeros,
        "measured_pitch": np.full(samples, -20.0),
        "measured_heading": zeros,
        "measured_depth": 0.1 * period * np.arange(samples),
        "true_surge": np.where(np.arange(samples) < 100, np.nan, 0.3),
    }
    displacement = (moved[0] + current[0] * duration, moved[1] + current[1] * duration)
    row = LogRow(deployment="a", start=start, duration=duration, displacement=displacement)
    mission = MissionSequence(index=0, split="test", period=period, signals=signals, row=row)
    return LogReference.of(mission, load_vehicle("graver-2005"), LabelConfig())


def test_the_current_of_the_row_before_is_carried_over():
    estimate = Estimate(surge=np.full(501, 0.3), sway=np.zeros(501))
    probe = row_of(0.0, (0.0, 0.0), (0.0, 0.0)).moved(estimate)
    assert probe is not None
    moved, current = (float(probe[0]), float(probe[1])), (0.1, -0.05)
    first = row_of(0.0, moved, current)
    second = row_of(1060.0, moved, current)
    assert second.row.follows(first.row)
    score = score_row(second, estimate, (first, estimate))
    drift = math.hypot(*current) * 1000.0
    assert score.tracks["ground"].end_m == pytest.approx(drift, rel=1e-6)
    assert score.dives["none"][0].end_m == pytest.approx(drift, rel=1e-6)
    assert score.dives["previous"][0].end_m == pytest.approx(0.0, abs=1e-6)
    assert "corrected" not in score.dives
    assert score.samples == 401
    assert score.squared["surge"] == pytest.approx(0.0)
    assert "sway" not in score.squared


def test_rows_far_apart_or_of_another_vehicle_lend_no_current():
    first = LogRow(deployment="a", start=0.0, duration=1000.0, displacement=(0.0, 0.0))
    late = dataclasses.replace(first, start=1000.0 + 3700.0)
    other = dataclasses.replace(first, start=1010.0, deployment="b")
    assert not late.follows(first)
    assert not other.follows(first)
    assert dataclasses.replace(first, start=1010.0).follows(first)


def test_the_card_of_a_run_on_logs_speaks_of_logs(store, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    settings = {"inputs": "glider", "network": "mlp", "hidden": 4, "epochs": 1, "members": 1}
    run = learn.fit(store, folder=tmp_path / "first", **settings)
    card = (run.folder / "README.md").read_text()
    assert "simulat" not in card
    assert "by blocks of dives" in card
    assert "every dive mirrored too" in card
    assert "logs of vehicles at sea (slocum)" in card
    assert "(test dives of that store)" in card
    assert "over the samples that have a truth" in card
    # this log knows the speed only
    assert "sway as zero, so that sway is not estimated" in card
    later = learn.fit(store, folder=tmp_path / "later", start=run.folder, epochs=1, members=1)
    card = (later.folder / "README.md").read_text().replace("\\", "")  # escapes of markdown
    assert f"weights to start from: run {run.folder}, trained on {store}, logs" in card


def test_the_card_tells_simulation_then_real(store, tmp_path):
    description = {
        "settings": {"store": str(store), "start": "runs/sim"},
        "store": {"source_format": "seaglider", "platform": "sg171"},
        "truth": ["true_surge", "true_sway"],
        "started_from": {"run": "runs/sim", "store": "sim.zarr", "preset": "field"},
    }
    origin = RunOrigin(description)
    assert origin.made_from() == [
        f"store: {store}, logs of vehicles at sea (seaglider)",
        "weights to start from: run runs/sim, trained on sim.zarr, simulated missions "
        "(preset field)",
    ]
    first, second = origin.limits()
    assert first.startswith("They were trained on logs of sg171;")
    assert "where the logs hold a velocity through the water" in second
    del description["started_from"]  # as runs of version 0.1.0
    assert "this run keeps no record" in RunOrigin(description).made_from()[1]
