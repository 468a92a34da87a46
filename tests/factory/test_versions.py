"""Stores that other versions wrote are read, or refused in one line."""

import json
import shutil
from pathlib import Path

import pytest

from factory.__main__ import PROGRAM as FACTORY
from learn.__main__ import PROGRAM as LEARN
from twin.records.attributes import SETTINGS, VERSION
from twin.records.storage.sharded import METADATA

OLD = Path(__file__).parents[1] / "data" / "e2ff189"
"""Stores of the commit of that name, of version 0.1.0"""
NEWER = 99

pytestmark = pytest.mark.filterwarnings("ignore:.*imported by version 1 of the readers")


@pytest.mark.parametrize("name", ["simulated.zarr", "logged.zarr"])
@pytest.mark.parametrize("command", ["info", "verify"])
def test_a_store_of_version_0_1_is_read(command, name):
    assert FACTORY.main([command, str(OLD / name)]) == 0


@pytest.mark.parametrize(
    ("words", "name", "message"),
    [
        (["verify", "--replay", "0"], "simulated.zarr", "physics"),
        (["generate", "--resume", "--out"], "simulated.zarr", "other settings"),
        (["generate", "--resume", "--out"], "logged.zarr", "logs"),
    ],
)
def test_its_missions_are_not_mixed_with_new_ones(tmp_path, capsys, words, name, message):
    store = tmp_path / name
    shutil.copytree(OLD / name, store)
    command, *options = words
    words = [command, str(store), *options] if command == "verify" else [*words, str(store)]
    assert FACTORY.main(words) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert message in line


@pytest.fixture
def newer(tmp_path, paper_store):
    """A store of a schema that is not known."""
    store = tmp_path / "newer.zarr"
    shutil.copytree(paper_store, store)
    document = json.loads((store / METADATA).read_text())
    document["attributes"][VERSION] = NEWER
    settings = json.loads(document["attributes"][SETTINGS])
    settings["versions"]["glider-twin"] = f"{NEWER}.0"
    document["attributes"][SETTINGS] = json.dumps(settings)
    (store / METADATA).write_text(json.dumps(document))
    return store


@pytest.mark.parametrize(
    "words",
    ["info {}", "generate --resume --out {}", "verify {} --replay 0", "plot {}",
     "export {} --to og1", "fit {} --name newer"],
)  # fmt: skip
def test_a_newer_store_is_refused_with_both_versions(newer, capsys, words):
    program = LEARN if words.startswith("fit") else FACTORY
    assert program.main(words.format(newer).split()) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"version {NEWER}" in line
    assert "upgrade glider-twin to 99.0" in line
