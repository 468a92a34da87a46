"""Every registered exporter: complete, documented, writes flown and logged stores; a user's own."""

import dataclasses
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from examples import OWN
from logs import refused, stored

from factory.exporting import EXPORTERS
from factory.generation.generated_store import open_missions
from factory.samples import Flight
from factory.samples.gliders import write_slocum
from twin.errors import StoreError, WriteError

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "reference" / "factory.md").read_text()
EVERY = pytest.mark.parametrize("exporter", list(EXPORTERS.values()), ids=lambda one: one.name)


@pytest.fixture(scope="module")
def log_store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    return stored(folder / "real.zarr", "slocum", write_slocum(folder, Flight()))


@EVERY
@pytest.mark.parametrize("name", ["field_store", "log_store"])
def test_stores_are_written_and_progress_is_told(exporter, name, request, tmp_path):
    for package in {"parquet": ["pyarrow"]}.get(exporter.extra, []):
        pytest.importorskip(package)
    run = open_missions(request.getfixturevalue(name))
    done = []
    target = exporter.default_path(tmp_path / "store.zarr")
    written = exporter.export(run, [0, 1], target, lambda: done.append(1))
    assert len(done) == 2
    assert written
    for path in written:
        assert path.stat().st_size > 300
        assert path == target if exporter.target == "file" else target in path.parents
    assert target.name.startswith("store")
    with pytest.raises(StoreError, match=r"missions 0 to \d+, not 77"):
        exporter.export(run, [77], target)
    with pytest.raises(WriteError, match="already exists; use --overwrite"):
        exporter.export(run, [0], target)
    again = exporter.export(run, [0], target, overwrite=True)
    assert set(again) <= {target, *written}
    if exporter.target == "folder":
        there = {path for path in target.rglob("*") if path.is_file()}
        assert there == {*again, target / "checksums.json"}
        (target / "notes.txt").write_text("precious")
        with pytest.raises(WriteError, match="glider-twin did not write it"):
            exporter.export(run, [0], target, overwrite=True)
    assert [path for path in tmp_path.iterdir() if path != target] == []


@EVERY
def test_formats_are_documented_and_their_extras_exist(exporter):
    assert f"| `{exporter.name}` | {exporter.title} | `STORE{exporter.ending}` |" in PAGE
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    known = extras["optional-dependencies"]
    assert exporter.extra is None or exporter.extra in known or (ROOT / exporter.extra).is_dir()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "My Format"}, "small letters"),
        ({"title": ""}, "title is empty"),
        ({"ending": "parquet"}, r"like '\.parquet' for a file"),
        ({"write": None}, "write must be a function"),
    ],
)
def test_half_an_exporter_is_refused(change, message):
    refused(message, EXPORTERS["og1"], **change, by=dataclasses.replace)


def test_an_exporter_of_ones_own_is_one_file_outside_the_package(log_store, tmp_path):
    environment = {**os.environ, "GLIDER_TWIN_PLUGINS": str(OWN / "my_format.py")}
    done = subprocess.run(
        [sys.executable, "-m", "factory", "export", str(log_store), "--to", "counts"],
        cwd=ROOT, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    run = open_missions(log_store)
    expected = [
        f"{k},{n},{run.row('measured_depth', k)[:n].max():.1f}" for k, n in enumerate(run.samples)
    ]
    assert log_store.with_name("real.csv").read_text().splitlines() == expected
