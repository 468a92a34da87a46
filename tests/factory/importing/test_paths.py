"""Paths: no text of a foreign file becomes one, so that nothing is written but what was asked."""

from pathlib import Path

import pytest
from logs import pack, refused, slocum

from factory.exporting import EXPORTERS
from factory.samples import Flight
from factory.samples.gliders import write_dbd
from glider_twin_protocols.mcap_file import files
from twin.bounded import MOST_STEM, file_names
from twin.records.logged import LogStore
from twin.records.store import write_store

FLIGHT = Flight(depth=50.0)
HOSTILE = (
    "../../beside", "../list", "/tmp/glider-twin-absolute", "..", ".", "", "a/b/c/d",
    "0badcafe/../../beside", "0badcafe\0", "0badcaf", "0badcafe0", "..\\..\\beside",
    "~/beside", "0badcafg",
)  # fmt: skip


@pytest.fixture
def place(tmp_path):
    """A folder below others, so that a path that leads out of it stays in the test's own."""
    pytest.importorskip("dbdreader")
    found = tmp_path / "one" / "two" / "logs"
    found.mkdir(parents=True)
    return found


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Content of a log that lists its sensors itself."""
    pytest.importorskip("dbdreader")
    return write_dbd(tmp_path_factory.mktemp("own"), FLIGHT, factored=False)[0].read_bytes()


def tree(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("crc", HOSTILE)
def test_the_number_of_a_list_of_sensors_is_no_path(place, own, tmp_path, crc, packed):
    content = own.replace(b"sensor_list_crc: 0badcafe", b"sensor_list_crc: " + crc.encode(), 1)
    log = place / ("a.dcd" if packed else "a.dbd")
    log.write_bytes(pack(content) if packed else content)
    (tmp_path / "one" / "beside.cac").write_bytes(b"mine")
    before = tree(tmp_path)
    refused(rf"^{log.name} is .*sensor_list_crc", "slocum", [log])
    assert tree(tmp_path) == before
    assert not Path("/tmp/glider-twin-absolute.cac").exists()


def test_a_second_number_behind_the_first_is_no_way_around(place, own, tmp_path):
    """The decoder takes the last line of a name, wherever among the lines of the header it is."""
    good = b"sensor_list_crc: 0badcafe\n"
    bad = b"sensor_list_crc: ../../beside\n"
    longer = own.replace(b"num_ascii_tags: 14", b"num_ascii_tags: 15", 1)
    far = b"mission_name: " + b"x" * 5000 + b"\n"
    contents = {
        "before.dbd": longer.replace(good, bad + good, 1),
        "behind.dbd": longer.replace(good, good + bad, 1),
        "beyond.dbd": own.replace(b"sensor_list_factored: 0\n", b"", 1).replace(
            good, good + b"sensor_list_factored: 0\n", 1
        ).replace(b"14", b"16", 1).replace(b"sensor_list_factored: 0\n",
                                           b"sensor_list_factored: 0\n" + far + bad, 1),
    }  # fmt: skip
    for name, content in contents.items():
        (place / name).write_bytes(content)
    before = tree(tmp_path)
    for name in contents:
        refused(name, "slocum", [place / name])
    assert tree(tmp_path) == before


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("total_num_sensors", b"19!3"), ("sensors_per_cycle", b"-1"),
        ("state_bytes_per_cycle", b"99999999"), ("num_ascii_tags", b"1e3"),
        ("num_ascii_tags", b"99"),
    ],
)  # fmt: skip
def test_a_count_of_a_header_that_is_none_is_told(place, own, key, value):
    start = own.index(key.encode()) + len(key) + 2
    content = own[:start] + value + own[own.index(b"\n", start) :]
    (place / "a.dbd").write_bytes(content)
    refused(r"^a\.dbd is (damaged|truncated) (in|within) its header", "slocum", [place / "a.dbd"])


def test_names_of_files_are_plain_and_one_text_has_one():
    texts = ["../../x", "a/b", "a-b", "A-B", "", "...", "é", "unit_334.x", "x" * 999, "a\0\x1b[2J"]
    found = file_names(texts, "deployment")
    assert list(found) == texts
    assert found["../../x"] == "x"
    assert found["a/b"] == "a-b"
    assert found["a-b"] == "a-b-2"
    assert found["A-B"] == "A-B-3"
    assert found["unit_334.x"] == "unit_334.x"
    assert found[""] == "deployment"
    assert len({name.lower() for name in found.values()}) == len(texts)
    for name in found.values():
        assert Path(name).name == name
        assert name.isascii()
        assert name.isprintable()
        assert len(name) <= MOST_STEM + 9


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A store of logs."""
    folder = tmp_path_factory.mktemp("store")
    return write_store(slocum(folder, FLIGHT)[0], folder / "real.zarr")


@pytest.mark.parametrize("name", ["../../beside", "/tmp/glider-twin-export", "a\0b", "é" * 200])
def test_exports_stay_in_their_folder(store, tmp_path, name, monkeypatch):
    bags = tmp_path / "one" / "bags"
    bags.parent.mkdir()
    with LogStore(store) as run:
        monkeypatch.setattr(LogStore, "deployments", (name,) * len(run))
        monkeypatch.setattr(
            LogStore, "missions_of", lambda self, one: list(range(len(self))) if one == name else []
        )
        for stem, missions in files(run, range(len(run))):
            assert Path(stem).name == stem
            assert missions == list(range(len(run)))
        for kind in ("og1", "mcap"):
            if kind == "mcap":
                pytest.importorskip("mcap")
            for path in EXPORTERS[kind].export(run, range(len(run)), bags / kind):
                assert path.parent == bags / kind
    assert all(bags in path.parents for path in tmp_path.rglob("*") if path.is_file())
