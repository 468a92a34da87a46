"""Windows of a store: the store's values, in an order by seed, in bounded memory, fast."""

import pickle
import time

import numpy as np
import pytest
from examples import BLOCK, ROOT

import factory
from twin.errors import InputError, StoreError
from twin.records.reader import MissionStore
from twin.records.windows import Windows

CHANNELS = ["measured_pitch", "true_surge", "measured_gps_north"]
LENGTH, STRIDE = 60, 25


@pytest.fixture(scope="module")
def windows(field_store):
    return factory.Windows(field_store, CHANNELS, length=LENGTH, stride=STRIDE)


@pytest.fixture
def small(field_store):
    """With memory for about two missions."""
    samples = int(MissionStore(field_store).samples.max())
    return Windows(
        field_store, CHANNELS, length=LENGTH, stride=STRIDE,
        memory=2.2 * 4 * len(CHANNELS) * samples,
    )  # fmt: skip


def expected(store, windows, number):
    row, start = int(windows.missions[number]), int(windows.starts[number])
    with MissionStore(store) as reader:
        return np.stack(
            [reader.row(name, row)[start : start + LENGTH] for name in CHANNELS], axis=1
        )


def test_windows_are_pieces_of_the_missions(windows, field_store):
    with MissionStore(field_store) as reader:
        counts = [int((n - LENGTH) // STRIDE + 1) for n in reader.samples]
        assert windows.period == reader.period
        assert (windows.starts + LENGTH <= reader.samples[windows.missions]).all()
    assert len(windows) == sum(counts)
    assert np.bincount(windows.missions).tolist() == counts
    for number in (0, 7, len(windows) - 1, -1):
        found = windows[number]
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, expected(field_store, windows, number))
    np.testing.assert_array_equal(windows[1:6:2], windows.read([1, 3, 5]))
    assert windows[-2:].shape == (2, LENGTH, len(CHANNELS))
    batch = windows.read([5, 2, 5])
    np.testing.assert_array_equal(batch, [windows[5], windows[2], windows[5]])
    assert np.isnan(windows.read(np.arange(len(windows)))[:, :, 2]).any()
    with pytest.raises(IndexError, match=f"there are {len(windows)} windows"):
        windows[len(windows)]


def test_a_part_of_the_store_has_its_missions_only(field_store):
    with MissionStore(field_store) as reader:
        rows = [k for k, split in enumerate(reader.splits) if split == "train"]
    found = Windows(field_store, CHANNELS, length=LENGTH, split="train")
    assert sorted(set(found.missions.tolist())) == rows
    assert found.starts[1] == LENGTH


def test_the_order_follows_from_the_seed(windows, field_store):
    every = np.arange(len(windows))
    assert (windows.order() == every).all()
    first = windows.order(seed=3)
    assert (np.sort(first) == every).all()
    assert (first == Windows(field_store, CHANNELS, length=LENGTH, stride=STRIDE).order(3)).all()
    for other in (windows.order(seed=4), windows.order(seed=3, epoch=1)):
        assert (other != first).any()
    batches = list(windows.batches(16, seed=3))
    assert {len(batch) for batch in batches[:-1]} == {16}
    np.testing.assert_array_equal(np.concatenate(batches), windows.read(first))


def test_what_does_not_fit_is_read_once_an_epoch(small, windows, monkeypatch):
    assert windows.fits
    assert not small.fits
    decoded = []
    whole = Windows._decoded

    def counted(self, missions):
        decoded.extend(missions)
        return whole(self, missions)

    monkeypatch.setattr(Windows, "_decoded", counted)
    order = small.order(seed=1)
    assert (np.sort(order) == np.arange(len(windows))).all()
    found = np.concatenate(list(small.batches(16, seed=1)))
    assert sorted(decoded) == sorted(set(windows.missions.tolist()))
    np.testing.assert_array_equal(found, windows.read(order))
    decoded.clear()
    random = np.random.default_rng(0).permutation(len(small))[:40]
    np.testing.assert_array_equal(small.read(random), windows.read(random))
    assert len(decoded) == len(set(decoded))
    assert sum(values.nbytes for values in small._kept.values()) <= small._memory
    assert small._kept.keys() < set(small.missions.tolist())


@pytest.mark.parametrize(
    ("context", "memory"), [("fork", "enough"), ("fork", "too little"), ("spawn", "too little")]
)
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork.*:DeprecationWarning")
def test_workers_of_a_data_loader_read_the_same(context, memory, small, windows):
    torch = pytest.importorskip("torch")
    chosen = windows.load() if memory == "enough" else small
    loader = torch.utils.data.DataLoader(
        chosen, batch_size=32, sampler=chosen.order(seed=2), num_workers=2,
        multiprocessing_context=context,
    )  # fmt: skip
    found = torch.cat(list(loader)).numpy()
    np.testing.assert_array_equal(found, windows.read(chosen.order(seed=2)))


def test_a_copy_for_another_process_is_small(windows):
    windows.load()
    sent = pickle.dumps(windows)
    assert len(sent) < 16 * len(windows) + 10_000
    np.testing.assert_array_equal(pickle.loads(sent)[3], windows[3])


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"length": 0}, InputError, "length is 0, it must be above zero"),
        ({"stride": -1}, InputError, "stride is -1"),
        ({"length": 10.5}, InputError, "length is 10.5, it must be a number of samples"),
        ({"stride": 2.5}, InputError, "stride is 2.5, it must be a number of samples"),
        ({"memory": 100}, InputError, r"memory is 100 bytes, the longest mission of .* takes \d+"),
        ({"channels": "measured_pitch"}, InputError, "give channels as a list"),
        ({"channels": ["measured_pich"]}, StoreError, "did you mean 'measured_pitch'"),
        ({"split": "trian"}, StoreError, "did you mean 'train'"),
        ({"length": 10**6}, StoreError, r"no mission of 1000000 samples.* the longest has \d+"),
    ],
)
def test_what_cannot_be_read_is_told(settings, error, message, field_store):
    with pytest.raises(error, match=message):
        Windows(field_store, **{"channels": CHANNELS, "length": LENGTH, **settings})


def test_it_is_a_hundred_times_as_fast_as_slices(windows, field_store):
    numbers = windows.order(seed=0)
    windows.load()
    best = {"slices": np.inf, "windows": np.inf}
    with MissionStore(field_store) as reader:
        for _ in range(3):
            begun = time.process_time()
            for k in numbers[:5]:
                row, start = int(windows.missions[k]), int(windows.starts[k])
                for name in CHANNELS:
                    reader.dataset[name][row, start : start + LENGTH].values  # noqa: B018
            middle = time.process_time()
            windows.read(numbers)
            end = time.process_time()
            best["slices"] = min(best["slices"], (middle - begun) / 5)
            best["windows"] = min(best["windows"], (end - middle) / len(numbers))
    assert best["slices"] > 100.0 * best["windows"]


def test_the_page_is_true(tmp_path, monkeypatch):
    """The examples of the section on windows, as they stand there."""
    pytest.importorskip("torch")
    page = (ROOT / "docs/reference/factory.md").read_text()
    section = page.split("## Windows for training")[1].split("\n## ")[0]
    monkeypatch.chdir(tmp_path)
    names = {}
    for _, text in BLOCK.findall(section):
        exec(text, names)
    assert names["windows"][0].shape == (64, 3)
    assert sum(len(batch) for batch in names["loader"]) == len(names["windows"])
