"""Several stores, each of one vehicle: trained on, gone on with and judged as one run."""

import json
import shutil

import numpy as np
import pytest
from navigation import add_fixes, trimmed_mission, write_store

import learn
from learn.__main__ import PROGRAM
from learn.data.dataset import Selection, load_missions
from learn.data.preparation import prepare
from learn.data.stores import open_stores
from learn.finishing import finish
from learn.networks.base import NetworkConfig
from learn.run import FAMILIARITY, MORE_STORES, open_run, read_description, write_description
from learn.training.fit_config import FitConfig
from learn.training.fitting import fit
from learn.training.optimiser import TrainingConfig
from learn.training.resources import choose_residence
from twin.errors import InputError, StoreError
from twin.navigation.features import FLIGHT
from twin.navigation.flight_filter_kernels import CHANNELS
from twin.navigation.settings import ESTIMATED, estimate
from twin.records.attributes import SETTINGS, VEHICLE_MJCF
from twin.vehicle.vehicle import load_vehicle

FEATURES = ("sin_pitch", "depth_rate", "glide_speed", "flight_surge")
KINDS = ("seaglider", "slocum-200")
QUICK = ("--epochs", "1", "--hidden", "4", "--layers", "1", "--members", "1", "--workers", "1")


def write_kind(path, kind, *, splits=(0, 0, 1, 2), seed=1, drop=()):
    """Missions that trim alike, in a store that says that this vehicle flew them."""
    rng = np.random.default_rng(seed)
    missions = []
    for k in range(len(splits)):
        sign = 1.0 if k % 2 else -1.0
        signals = trimmed_mission(
            600 + 50 * k,
            net_mass=sign * rng.uniform(0.2, 0.4),
            shift=sign * rng.uniform(0.015, 0.025),
            rotation=0.3,
            depth=50.0 if sign > 0 else 500.0,
        )
        add_fixes(signals, [0, 500])
        signals["measured_density"] = np.full(len(signals["true_north"]), 1027.0)
        missions.append(signals)
    said = {SETTINGS: json.dumps({"vehicle": kind}), VEHICLE_MJCF: load_vehicle(kind).xml}
    return write_store(path, missions, list(splits), drop=drop, attributes=said)


@pytest.fixture(scope="module")
def stores(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kinds")
    return [
        write_kind(folder / f"{kind}.zarr", kind, seed=seed) for seed, kind in enumerate(KINDS, 1)
    ]


def config_of(stores, **changes):
    first, *more = map(str, stores)
    return FitConfig(
        store=first,
        more_stores=tuple(more),
        features=FEATURES,
        network=NetworkConfig(hidden=4, layers=1),
        training=TrainingConfig(epochs=1, seconds=0.0, buffer=1000),
        **changes,
    )


@pytest.fixture(scope="module")
def run(stores, tmp_path_factory):
    """Trained and judged."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
        return finish(fit(config_of(stores), tmp_path_factory.mktemp("runs") / "both"))


def call(capsys, *words):
    code = PROGRAM.main([str(word) for word in words])
    return code, *capsys.readouterr()


def test_missions_come_in_the_order_that_is_asked_for_each_with_its_own_vehicle(stores):
    with open_stores(stores, [*ESTIMATED, "true_surge"]) as several:
        assert len(several) == 8
        assert several.splits == ["train", "train", "validation", "test"] * 2
        assert several.lengths.tolist() == [600, 650, 700, 750] * 2
        found = several.read([6, 1, 4])
        assert [one.index for one in found] == [2, 1, 0]
        assert [one.index for group in several.groups(3) for one in group] == [0, 1, 2, 3] * 2
    for one, place in zip(found, (1, 0, 1), strict=True):
        store, kind = stores[place], KINDS[place]
        alone = load_missions(store, [*ESTIMATED, "true_surge"])[one.index]
        for name in (*ESTIMATED, "true_surge"):
            assert np.array_equal(one.signals[name], alone.signals[name])
        with Selection(store, ESTIMATED) as selection:
            measured = {n: selection.read([one.index])[0].signals[n] for n in CHANNELS}
        wanted = estimate(measured, load_vehicle(kind), one.period, mission=0)
        assert np.array_equal(one.signals["estimated_surge"], wanted["estimated_surge"])
    other = estimate(measured, load_vehicle(KINDS[0]), one.period, mission=0)
    assert not np.array_equal(other["estimated_surge"], wanted["estimated_surge"])


def test_scales_are_of_all_training_missions_and_of_no_other(stores):
    options = {"target": "surge", "features": FEATURES}
    with prepare(stores, **options) as both, prepare(stores, **options, resident=False) as streamed:
        inputs = np.concatenate(both.train.inputs)
        assert len(both.train.inputs) == 4
        assert np.abs(inputs.mean(0)).max() < 1e-4
        assert np.abs(inputs.std(0) - 1.0).max() < 1e-3
        assert streamed.normalisation == both.normalisation
        one, other = both.train.take([3, 0]), streamed.train.take(np.array([3, 0]))
        assert all(map(np.array_equal, one.inputs, other.inputs))
    with prepare(stores[0], **options) as alone, prepare(stores[:1], **options) as listed:
        assert alone.normalisation == listed.normalisation != both.normalisation
        assert all(map(np.array_equal, alone.train.inputs, listed.train.inputs))


def test_the_run_says_what_it_was_made_from_and_how_it_does_on_each(run, stores):
    said = run.description
    assert said["settings"]["store"] == str(stores[0])
    assert said["settings"][MORE_STORES] == [str(stores[1])]
    (further,) = said[MORE_STORES]
    assert (further["store"], further["vehicle"]) == (str(stores[1]), KINDS[1])
    assert further["store_content"] != said["store_content"]
    assert len(said[FAMILIARITY]["mean"]) == 7
    figures = run.figures
    assert set(figures["stores"]) == set(map(str, stores))
    each = list(figures["stores"].values())
    assert [one["missions"] for one in each] == [1, 1]
    assert figures["missions"] == 2
    lengths = [750, 750]
    pooled = np.average([one["surge_mse"] for one in each], weights=lengths)
    assert figures["surge_mse"] == pytest.approx(pooled)
    page, card = run.report.read_text(), (run.folder / "README.md").read_text()
    assert "Each store" in page
    for store in stores:
        assert store.name in page
        assert store.name in card.replace("\\", "")
    alone = learn.evaluate(run, stores[1], split="test", baselines=())
    assert alone.figures["surge_mse"] == pytest.approx(each[1]["surge_mse"])


def test_what_needs_one_vehicle_asks_for_it(run, stores, capsys):
    code, _, err = call(capsys, "evaluate", run.folder)
    assert code == 2
    assert "was trained on several stores" in err
    assert stores[1].name in err
    with pytest.raises(InputError, match="was trained on several stores"):
        learn.export(run, to="c")


def test_a_run_of_several_stores_is_gone_on_with(stores, tmp_path, monkeypatch):
    own = [shutil.copytree(store, tmp_path / store.name) for store in stores]
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs" / "both"
    monkeypatch.setattr("learn.api.finish", lambda run, **_: run)
    made = learn.fit(
        [one.name for one in own], folder=folder, features=FEATURES, epochs=1, hidden=4, layers=1,
        members=1,
    )  # fmt: skip
    weights = (folder / "sway-0.safetensors").read_bytes()
    for path in folder.glob("sway-0.*"):
        path.unlink()
    write_description(folder, {**made.description, "complete": False})
    again = learn.fit(folder=folder, resume=True)  # knows its stores
    assert (folder / "sway-0.safetensors").read_bytes() == weights
    assert [one.name for one in again.stores] == [one.name for one in own]
    with pytest.raises(InputError, match=r"more_stores with slocum-200\.zarr"):
        learn.fit(own[0], folder=folder, resume=True)
    write_kind(own[1], KINDS[1], seed=7)
    with pytest.raises(InputError, match=r"store slocum-200\.zarr is not the one"):
        learn.fit(folder=folder, resume=True)


def test_one_store_is_described_as_ever(stores, tmp_path):
    fit(config_of(stores[:1]), tmp_path / "one")
    said = read_description(tmp_path / "one")
    assert MORE_STORES not in said
    assert MORE_STORES not in said["settings"]
    assert open_run(tmp_path / "one").store == stores[0]


def test_the_memory_is_that_of_all_stores(stores):
    alone, both = (choose_residence(config_of(s), 1, 4.0) for s in (stores[:1], stores))
    assert alone.resident
    assert both.resident
    with pytest.raises(InputError, match="streaming the training data takes"):
        choose_residence(config_of(stores), 1, 1e-4)


@pytest.fixture
def unlike(tmp_path, monkeypatch):
    """Stores that do not go with the others, by what is wrong with them."""
    write_kind(tmp_path / "no_ctd.zarr", KINDS[1], drop=("measured_density",))
    write_kind(tmp_path / "no_split.zarr", KINDS[1], splits=(1, 1, 2, 2))
    monkeypatch.setattr("navigation.PERIOD", 1.0)
    write_kind(tmp_path / "slower.zarr", KINDS[1])
    return tmp_path


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ("no_ctd.zarr", r"no_ctd\.zarr has no channel measured_density"),
        ("no_split.zarr", r"no_split\.zarr has no missions for training"),
        ("slower.zarr", r"slower\.zarr has a sample every 1 s, store .* every 0\.5 s: give --per"),
        ("nothere.zarr", r"no store at .*nothere\.zarr"),
    ],
)
def test_stores_that_do_not_go_together_are_refused_by_name(stores, unlike, other, message):
    with pytest.raises(StoreError, match=message):
        fit(config_of([stores[0], unlike / other]), unlike / "run")
    assert not (unlike / "run").exists()


def test_a_common_multiple_brings_two_periods_together(stores, unlike):
    with open_stores([stores[0], unlike / "slower.zarr"], ["true_surge"], period=1.0) as both:
        assert both.period == 1.0
        assert both.lengths.tolist() == [300, 325, 350, 375, 600, 650, 700, 750]


def test_inputs_are_what_all_vehicles_have(stores, tmp_path):
    own, other = (set(learn.fit_settings(store).features) for store in stores)
    both = learn.fit_settings(stores)
    assert set(both.features) == own & other
    assert "sin_rotation" in own - other
    assert {"shift", "pump", "flight_surge"} <= set(both.features)
    write_kind(tmp_path / "no_ctd.zarr", KINDS[1], drop=("measured_density",))
    without = learn.fit_settings([stores[0], tmp_path / "no_ctd.zarr"]).features
    assert not {name for name in without if name.startswith(FLIGHT)}
    with pytest.raises(InputError, match=r"slocum-200\.zarr has no sin_rotation"):
        learn.fit_settings(stores, features=["attitude", "sin_rotation"])
    with pytest.raises(InputError, match="is given twice"):
        learn.fit_settings([stores[0], stores[0]])
    with pytest.raises(InputError, match="held out of one store"):
        config_of(stores, held_out=(1,))


def test_labels_of_a_doppler_log_are_of_one_store(stores, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code, _, err = call(capsys, "fit", *stores, *QUICK, "--labels", "dvl", "--name", "x")
    assert code == 2
    assert "labels of a Doppler log are learned from one store" in err
    assert not (tmp_path / "runs" / "x").exists()
