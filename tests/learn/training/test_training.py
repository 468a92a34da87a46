"""Training: it learns, resumes to the same bits, and says what is wrong."""

import dataclasses
import itertools
import json
import math
import os
import pickle
import time
import zipfile

import numpy as np
import pytest
import torch

import learn.training.trainer
from learn.data.dataset import load_missions
from learn.data.preparation import prepare
from learn.files import write_sealed
from learn.networks.base import NetworkConfig
from learn.networks.predictor import Ensemble, Predictor, load_predictor
from learn.seams import NETWORKS
from learn.training.checkpoint import write_checkpoint
from learn.training.optimiser import TrainingConfig, step_size
from learn.training.trainer import Trainer, mean_squared_error, pick_device
from twin.errors import InputError, StoreError
from twin.navigation.features import DEFAULT_GROUPS, channels_of, select_features

SMALL = NetworkConfig(kind="elman", hidden=10, layers=2)
SOAP = TrainingConfig(
    seconds=0, epochs=60, rate=5e-3, batch=16, window=64, washin=16, validations=6
)
ADAM = dataclasses.replace(SOAP, optimiser="adam", epochs=40)
SCG = TrainingConfig(optimiser="scg", seconds=0, epochs=80, full_window=256, washin=32)


@pytest.fixture(scope="module")
def surge(small_store):
    # the accelerometer settles a short training on few missions; longer ones do without it
    chosen = select_features((*DEFAULT_GROUPS, "accelerometer"))
    return prepare(small_store, target="surge", features=chosen)


def trainer(data, config, network=SMALL, **options):
    scale = data.normalisation.target_scale
    return Trainer(network, config, data.train, data.validation, target_scale=scale, **options)


@pytest.mark.parametrize("config", [SOAP, ADAM, SCG], ids=["soap", "adam", "scg"])
def test_training_explains_most_of_the_motion_of_unseen_missions(surge, config):
    reports = []
    trained = trainer(surge, config, report=reports.append).run()
    variance = surge.normalisation.target_scale**2
    error = mean_squared_error(trained.network, surge.validation) * variance
    assert error < 0.1 * variance
    assert error == pytest.approx(min(r.validation_mse for r in reports), rel=1e-6)
    assert reports[-1].share == 1.0
    assert tuple(reports) == trained.history


def test_scg_never_raises_the_training_error(surge):
    errors = []
    trainer(surge, SCG, report=lambda r: errors.append(r.train_mse)).run()
    assert all(b <= a for a, b in itertools.pairwise(errors))
    assert errors[-1] < 0.5 * errors[0]


@pytest.mark.parametrize("kind", sorted(NETWORKS))
def test_every_network_trains(surge, kind):
    config = dataclasses.replace(ADAM, epochs=10, validations=1)
    network = NetworkConfig(kind=kind, period=surge.period, hidden=8, layers=2)
    before = trainer(surge, config, network).network
    start = mean_squared_error(before, surge.validation)
    trained = trainer(surge, config, network).run()
    assert mean_squared_error(trained.network, surge.validation) < start


def test_validation_takes_a_fifth_of_a_time_budget_at_most(surge, monkeypatch):
    def slow(network, sequences):
        start = time.thread_time()
        while time.thread_time() - start < 0.2:
            pass
        return 1.0

    monkeypatch.setattr(learn.training.trainer, "mean_squared_error", slow)
    config = dataclasses.replace(ADAM, seconds=2.0, epochs=0, validations=40)
    assert 2 <= len(trainer(surge, config).run().history) <= 4


def test_equal_seeds_give_equal_networks_and_others_do_not(surge):
    config = dataclasses.replace(ADAM, epochs=1)
    states = [
        trainer(surge, dataclasses.replace(config, seed=seed)).run().network.out.weight
        for seed in (3, 3, 4)
    ]
    assert torch.equal(states[0], states[1])
    assert not torch.equal(states[0], states[2])


class Killed(Exception):
    pass


@pytest.mark.parametrize("config", [SOAP, ADAM, SCG], ids=["soap", "adam", "scg"])
def test_a_killed_training_resumes_to_the_same_bits(surge, config, tmp_path):
    config = dataclasses.replace(config, epochs=4, validations=8)
    straight = trainer(surge, config).run()
    path = tmp_path / "checkpoint.pt"
    count = 0

    def kill(report):
        nonlocal count
        count += 1
        if count == 4:
            raise Killed

    with pytest.raises(Killed):
        trainer(surge, config, checkpoint=path, report=kill).run()
    assert path.exists()
    resumed = trainer(surge, config, checkpoint=path).run()
    assert path.exists()  # until what came of it is saved
    for a, b in zip(straight.network.parameters(), resumed.network.parameters(), strict=True):
        assert torch.equal(a, b)
    ours = [(r.step, r.train_mse, r.validation_mse) for r in resumed.history]
    assert ours == [(r.step, r.train_mse, r.validation_mse) for r in straight.history]


def test_a_checkpoint_from_before_there_were_buffers_goes_on(surge, tmp_path):
    config = dataclasses.replace(ADAM, epochs=4, validations=8)
    straight = trainer(surge, config).run()
    path, reports = tmp_path / "checkpoint.pt", []

    def kill(report):
        reports.append(report)
        if len(reports) == 4:
            raise Killed

    with pytest.raises(Killed):
        trainer(surge, config, checkpoint=path, report=kill).run()
    saved = torch.load(path, weights_only=True)
    assert saved["position"] > 0
    del saved["buffer"]
    write_checkpoint(path, saved)
    resumed = trainer(surge, config, checkpoint=path).run()
    for a, b in zip(straight.network.parameters(), resumed.network.parameters(), strict=True):
        assert torch.equal(a, b)


def test_resuming_with_other_settings_is_refused(surge, tmp_path):
    path = tmp_path / "checkpoint.pt"
    config = dataclasses.replace(ADAM, epochs=2)

    def kill(report):
        if len(killed.history) > 1:
            raise Killed

    killed = trainer(surge, config, checkpoint=path, report=kill)
    with pytest.raises(Killed):
        killed.run()
    other = dataclasses.replace(config, rate=2e-3)
    with pytest.raises(StoreError, match=r"settings \(training rate 0.005 instead of 0.002\)"):
        trainer(surge, other, checkpoint=path).run()


def test_early_stopping_keeps_the_best_weights(surge):
    config = dataclasses.replace(ADAM, epochs=60, rate=0.1, patience=3, validations=60)
    reports = []
    trained = trainer(surge, config, report=reports.append).run()
    errors = [r.validation_mse for r in reports]
    assert trained.stopped_early
    assert len(errors) - 1 - int(np.argmin(errors)) == 3
    best = mean_squared_error(trained.network, surge.validation)
    assert best * surge.normalisation.target_scale**2 == pytest.approx(min(errors), rel=1e-6)


def test_the_schedule_rises_then_falls_to_zero():
    config = TrainingConfig(rate=1e-2, warmup=0.1)
    rates = [step_size(config, share) for share in np.linspace(0, 1, 101)]
    assert max(rates) == pytest.approx(1e-2)
    assert int(np.argmax(rates)) == 10
    assert rates[-1] == pytest.approx(0.0, abs=1e-12)
    assert all(b > a for a, b in itertools.pairwise(rates[:11]))
    assert all(b < a for a, b in itertools.pairwise(rates[10:]))


def test_a_time_budget_is_kept(surge):
    """The budget is computing time of the training itself, so a busy machine changes nothing."""
    config = dataclasses.replace(ADAM, seconds=1.0, epochs=0)
    start = time.thread_time()
    trained = trainer(surge, config).run()
    assert 0.9 < time.thread_time() - start < 4.0
    assert trained.history[-1].share == 1.0


def test_divergence_is_an_error_not_a_nan(surge):
    broken = dataclasses.replace(surge.train, inputs=[v.copy() for v in surge.train.inputs])
    broken.inputs[0][5:, 0] = math.inf
    data = dataclasses.replace(surge, train=broken)
    with pytest.raises(InputError, match="training diverged"):
        trainer(data, dataclasses.replace(ADAM, epochs=1)).run()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"optimiser": "sgd"}, "unknown optimiser 'sgd'"),
        ({"batch": 0}, "training batch must be at least 1, not 0"),
        ({"rate": 0.0}, "training rate must be positive"),
        ({"seconds": -5.0}, r"training seconds \(--seconds\) must not be negative: -5"),
        ({"patience": -1}, "training patience must not be negative: -1"),
        ({"seconds": 0.0}, "training needs a budget"),
        ({"warmup": 1.0}, "training warmup is a share"),
        ({"washin": -1}, r"training washin \(--washin\) must not be negative"),
    ],
)
def test_wrong_settings_say_what_is_wrong(changes, message):
    with pytest.raises(InputError, match=message):
        TrainingConfig(**changes)


def test_a_missing_gpu_is_an_error_only_when_demanded(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert pick_device("auto").type == "cpu"
    with pytest.raises(InputError, match="no CUDA device"):
        pick_device("cuda")


@pytest.fixture(scope="module")
def predictors(surge):
    brief = dataclasses.replace(ADAM, epochs=1, validations=1)
    trained = (trainer(surge, dataclasses.replace(brief, seed=seed)).run() for seed in (0, 1, 2))
    return [Predictor(one.network, surge.normalisation) for one in trained]


def test_predictions_do_not_depend_on_the_company(predictors, small_store):
    missions = load_missions(small_store, channels_of(predictors[0].features))
    together = predictors[0].predict(missions)
    assert [len(v) for v in together] == [m.samples for m in missions]
    alone = predictors[0].predict(missions[3:4])[0]
    assert np.allclose(together[3], alone, atol=1e-6)


def test_saved_networks_come_back_equal(predictors, tmp_path):
    predictors[0].save(tmp_path / "surge")
    again = load_predictor(tmp_path / "surge")
    assert again.normalisation == predictors[0].normalisation
    x = np.random.default_rng(0).normal(size=(50, len(again.features))).astype(np.float32)
    assert np.array_equal(
        again.network.run_missions([x])[0], predictors[0].network.run_missions([x])[0]
    )


def test_damaged_networks_are_explained(predictors, tmp_path):
    with pytest.raises(StoreError, match=r"no network at .*train one with `learn fit`"):
        load_predictor(tmp_path / "none")
    predictors[0].save(tmp_path / "surge")
    text = (tmp_path / "surge.json").read_text()
    (tmp_path / "surge.json").write_text(text.replace('"format": 2', '"format": 99'))
    with pytest.raises(StoreError, match="has format 99, this program reads 1 and 2"):
        load_predictor(tmp_path / "surge")
    found = json.loads(text)
    write_sealed(tmp_path / "surge.json", {**found, "network": {**found["network"], "hidden": 20}})
    with pytest.raises(StoreError, match=r"surge\.safetensors does not fit"):
        load_predictor(tmp_path / "surge")
    write_sealed(tmp_path / "surge.json", json.loads(text.replace('"sin_pitch"', '"sin_pich"')))
    with pytest.raises(InputError, match="unknown feature 'sin_pich': did you mean 'sin_pitch'"):
        load_predictor(tmp_path / "surge")
    (tmp_path / "surge.json").write_text("{")
    with pytest.raises(StoreError, match="damaged"):
        load_predictor(tmp_path / "surge")


def test_every_changed_bit_of_a_network_is_found_when_it_is_loaded(predictors, tmp_path):
    stem = tmp_path / "surge"
    predictors[0].save(stem)
    random = np.random.default_rng(0)
    for path in (stem.with_suffix(".json"), stem.with_suffix(".safetensors")):
        whole = path.read_bytes()
        for place in random.integers(len(whole), size=150):
            bit = 1 << int(random.integers(8))
            path.write_bytes(whole[:place] + bytes([whole[place] ^ bit]) + whole[place + 1 :])
            with pytest.raises(StoreError, match=r"surge\.(json|safetensors)") as told:
                load_predictor(stem)
            assert "\n" not in str(told.value)
        path.write_bytes(whole)
    assert load_predictor(stem).features == predictors[0].features


def test_networks_of_older_versions_have_no_hash_and_are_read(predictors, tmp_path):
    stem = tmp_path / "surge"
    predictors[0].save(stem)
    found = json.loads(stem.with_suffix(".json").read_text())
    old = {name: found[name] for name in ("network", "normalisation")}
    stem.with_suffix(".json").write_text(json.dumps({"format": 1, **old}))
    assert load_predictor(stem).features == predictors[0].features
    stem.with_suffix(".json").write_text(json.dumps({**found, "format": 1}))
    with pytest.raises(StoreError, match="its sha256 is not that of its text"):
        load_predictor(stem)


def test_an_ensemble_has_mean_and_spread(predictors, small_store):
    missions = load_missions(small_store, channels_of(predictors[0].features), limit=2)
    mean, spread = Ensemble(tuple(predictors)).predict(missions)[1]
    runs = np.stack([p.predict(missions)[1] for p in predictors])
    assert np.allclose(mean, runs.mean(0))
    assert np.allclose(spread, runs.std(0, ddof=1))
    assert not Ensemble((predictors[0],)).predict(missions)[0][1].any()
    with pytest.raises(InputError, match="at least one"):
        Ensemble(())


class Run:
    """Pickles to a call of `os.mkdir`: what loads it as a pickle runs it."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


@pytest.mark.parametrize("hostile", ["pickle", "call", "other", "text", "bomb"])
def test_a_hostile_checkpoint_is_refused_and_never_run(surge, tmp_path, hostile):
    path, ran = tmp_path / "checkpoint.pt", tmp_path / "ran"
    if hostile == "pickle":
        path.write_bytes(pickle.dumps(Run(ran)))
    elif hostile == "call":
        torch.save({"identity": Run(ran)}, path)
    elif hostile == "other":
        torch.save([1, 2], path)
    elif hostile == "text":
        path.write_text("PK")
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("archive/data/0", bytes(300 * 2**20))
    with pytest.raises(StoreError, match=r"checkpoint .*; remove it to start over") as raised:
        trainer(surge, dataclasses.replace(ADAM, epochs=1), checkpoint=path).run()
    assert "\n" not in str(raised.value)
    assert not ran.exists()
