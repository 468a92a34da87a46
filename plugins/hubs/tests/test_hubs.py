"""Data sets for learning: opened by `datasets` and by LeRobot, and their cards."""

import functools
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import yaml
from hubs import read_with
from logs import refused, stored

from factory.exporting import ExportOptions
from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.samples import Flight
from factory.samples.gliders import write_slocum
from factory.sampling.recipe import make_recipe
from glider_twin_hubs import HUGGINGFACE, LEROBOT, huggingface
from glider_twin_hubs.huggingface import licence_identifier
from glider_twin_hubs.lerobot import Total, episode_statistics
from twin.records.logged import LogStore

pq = pytest.importorskip("pyarrow.parquet")

PEOPLE = """
metadata:
  title: Dives off Cape Example
  license: CC BY 4.0
  citation: Doe, J. (2026). Dives off Cape Example.
  institution: Example Institute
"""


SHORT = {
    "mission.duration_h": "uniform(0.1, 0.15)",
    "mission.max_depth_m": "uniform(12, 25)",
    "mission.min_depth_m": "uniform(3, 6)",
    "mission.surface_duration_s": "uniform(60, 90)",
}
"""Missions of six to nine minutes that dive and surface"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("field") / "missions.zarr"
    generate(make_recipe(preset="field", hours=0.5, changes=SHORT), out, workers=1)
    return GeneratedStore(out)


@pytest.fixture(scope="module")
def folders(run, tmp_path_factory):
    place = tmp_path_factory.mktemp("hubs")
    for one in (HUGGINGFACE, LEROBOT):
        one.export(run, range(len(run)), place / one.name)
    return {name: place / name for name in ("huggingface", "lerobot")}


@pytest.fixture(scope="module")
def log_store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    return LogStore(stored(folder / "real.zarr", "slocum", write_slocum(folder, Flight())))


def front_matter(folder):
    _, front, _ = (folder / "README.md").read_text().split("---\n", 2)
    return yaml.safe_load(front)


def missions_of(run, split):
    return [mission for mission, word in enumerate(run.splits) if word == split]


def test_datasets_opens_the_folder_with_the_splits_of_the_store(folders, run, tmp_path):
    found = read_with(
        ".venv-hub", "scripts/hub_readers.sh",
        f"""
import datasets, json
sets = datasets.load_dataset({str(folders["huggingface"])!r})
print(json.dumps({{name: dict(
    rows=one.num_rows,
    pitch=one.with_format("numpy")["measured_pitch"][:].tolist(),
    missions=sorted(set(one["mission"])),
    first=one[0]["datetime"].isoformat(),
) for name, one in sets.items()}}))
""",
        tmp_path,
    )  # fmt: skip
    assert set(found) == set(run.splits)
    for split, one in found.items():
        some = missions_of(run, split)
        assert one["missions"] == some
        expected = np.concatenate([run.row("measured_pitch", m)[: run.samples[m]] for m in some])
        np.testing.assert_array_equal(np.array(one["pitch"], np.float32), expected)
        moment = run.dataset["datetime"][some[0], 0].values.astype("datetime64[s]")
        assert one["first"][:19] == str(moment)


def test_large_splits_go_on_in_further_files(run, tmp_path, monkeypatch):
    monkeypatch.setattr(huggingface, "LARGEST_FILE", 1000)
    HUGGINGFACE.export(run, range(len(run)), tmp_path / "hub")
    for split in set(run.splits):
        files = sorted((tmp_path / "hub/data").glob(f"{split}-*.parquet"))
        some = missions_of(run, split)
        assert len(files) == len(some)
        assert [pq.read_table(f)["mission"][0].as_py() for f in files] == some


def test_the_card_says_what_the_data_are(folders, run):
    for name in folders:
        front = front_matter(folders[name])
        text = (folders[name] / "README.md").read_text()
        assert front["license"] == "unknown"
        assert "Not stated" in text
        assert "No citation was given" in text
        assert "simulated" in front["pretty_name"].lower()
        assert "**Simulated**" in text
        assert f"{int(run.samples.sum())} samples" in text
        for signal in run.signals():
            assert f"| `{signal}` |" in text
    assert front_matter(folders["lerobot"])["tags"][0] == "LeRobot"


def test_what_people_say_of_a_log_is_kept(log_store, tmp_path):
    said = tmp_path / "deployment.yml"
    said.write_text(PEOPLE)
    options = ExportOptions(metadata=said)
    HUGGINGFACE.export(log_store, range(len(log_store)), tmp_path / "hub", options=options)
    front = front_matter(tmp_path / "hub")
    text = (tmp_path / "hub/README.md").read_text()
    assert (front["license"], front["pretty_name"]) == ("cc-by-4.0", "Dives off Cape Example")
    assert "Doe, J. (2026)" in text
    assert "CC BY 4.0" in text
    assert "Example Institute" in text
    assert "Simulated" not in text.split("## Signals")[0]
    refused(
        "huggingface export takes no --vehicle",
        log_store,
        [0],
        tmp_path / "b",
        options=ExportOptions(vehicle="glider"),
        by=HUGGINGFACE.export,
    )


@pytest.mark.parametrize(
    ("text", "identifier"),
    [
        ("CC-BY-4.0", "cc-by-4.0"),
        ("Creative Commons Attribution 4.0 International", "cc-by-4.0"),
        ("https://creativecommons.org/licenses/by-nc-sa/4.0/", "cc-by-nc-sa-4.0"),
        ("https://creativecommons.org/publicdomain/zero/1.0/", "cc0-1.0"),
        ("Apache License 2.0", "apache-2.0"),
        ("MIT", "mit"),
        ("", "unknown"),
        ("Ask the PI before use", "other"),
    ],
)
def test_licences_get_the_identifiers_of_hubs(text, identifier):
    assert licence_identifier(text) == identifier


def test_lerobot_opens_the_folder_and_gives_the_values_of_the_store(folders, run, tmp_path):
    found = read_with(
        ".venv-lerobot", "scripts/lerobot.sh",
        f"""
import json, torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("local/missions", root={str(folders["lerobot"])!r},
                      delta_timestamps={{"action": [0.0, 0.5]}})
batch = next(iter(torch.utils.data.DataLoader(data, batch_size=4)))
second = LeRobotDataset("local/missions", root={str(folders["lerobot"])!r}, episodes=[1])
print(json.dumps(dict(
    frames=len(data), episodes=data.num_episodes, fps=data.fps, splits=data.meta.info["splits"],
    action=batch["action"].tolist(), task=batch["task"][0],
    second=second[3]["observation.state"].tolist(), time=second[3]["timestamp"].item(),
    mean=data.meta.stats["observation.state"]["mean"].tolist(),
)))
""",
        tmp_path,
    )  # fmt: skip
    ordered = [m for split in ("train", "validation", "test") for m in missions_of(run, split)]
    names = json.loads((folders["lerobot"] / "meta/info.json").read_text())["features"]
    state, action = names["observation.state"]["names"], names["action"]["names"]
    assert (found["frames"], found["episodes"]) == (int(run.samples.sum()), len(run))
    assert found["fps"] == 2
    assert found["time"] == 1.5
    assert found["task"].startswith("fly ")
    expected = np.stack([run.row(name, ordered[0])[:5] for name in action], axis=1)
    np.testing.assert_array_equal(
        np.array(found["action"], np.float32), [expected[k : k + 2] for k in range(4)]
    )
    expected = [run.row(name, ordered[1])[3] for name in state]
    np.testing.assert_array_equal(np.array(found["second"], np.float32), expected)
    for k, name in enumerate(state):
        values = np.concatenate([run.row(name, m)[: run.samples[m]] for m in ordered])
        np.testing.assert_allclose(found["mean"][k], values.mean(dtype=float), rtol=1e-6, atol=1e-9)


def test_lerobot_files_are_those_of_the_format(folders, run):
    """What LeRobot 0.4.4 asks of a folder, for machines without it."""
    folder = folders["lerobot"]
    info = json.loads((folder / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert info["video_path"] is None
    edges = [text.split(":") for text in info["splits"].values()]
    assert edges[0][0] == "0"
    assert edges[-1][1] == str(len(run))
    path = info["data_path"].format(chunk_index=0, file_index=0)
    table = pq.read_table(folder / path)
    assert set(table.column_names) == set(info["features"])
    assert table["index"].to_pylist() == list(range(info["total_frames"]))
    for name, feature in info["features"].items():
        width = feature["shape"][0]
        kind = table.schema.field(name).type
        value = kind if width == 1 else kind.value_type
        assert str(value) == {"float32": "float"}.get(feature["dtype"], feature["dtype"])
        assert width == 1 or kind.list_size == width == len(feature["names"])
    assert all(
        name.startswith("measured_") for name in info["features"]["observation.state"]["names"]
    )
    assert info["features"]["action"]["names"] == [
        f"commanded_{part}" for part in run.vehicle.part_names
    ]
    assert "measured_gps_north" in info["features"]["other"]["names"]
    for name in ("observation.state", "observation.environment_state", "action"):
        flat = table[name].combine_chunks().flatten().to_numpy()
        assert np.isfinite(flat).all(), name
    episodes = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    tasks = pq.read_table(folder / "meta/tasks.parquet").to_pandas()
    for k, episode in enumerate(episodes):
        rows = table.slice(episode["dataset_from_index"], episode["length"])
        assert episode["dataset_to_index"] - episode["dataset_from_index"] == episode["length"]
        assert set(rows["episode_index"].to_pylist()) == {k} == {episode["episode_index"]}
        assert episode["length"] == run.samples[episode["mission"]]
        (task,) = episode["tasks"]
        assert rows["task_index"][0].as_py() == tasks.loc[task, "task_index"]
        assert len(episode["stats/action/mean"]) == info["features"]["action"]["shape"][0]
    stats = json.loads((folder / "meta/stats.json").read_text())
    assert set(stats) == set(info["features"])


def test_large_data_sets_go_on_in_further_files(run, folders, tmp_path, monkeypatch):
    monkeypatch.setattr("glider_twin_hubs.lerobot.FILE_MB", 0)
    monkeypatch.setattr("glider_twin_hubs.lerobot.AT_A_TIME", 2)
    LEROBOT.export(run, range(len(run)), tmp_path / "many")
    files = sorted((tmp_path / "many/data").glob("*/*.parquet"))
    whole = pq.read_table(folders["lerobot"] / "data/chunk-000/file-000.parquet")
    gaps = ["other"]  # NaN equals nothing
    assert pq.read_table(files).drop_columns(gaps).equals(whole.drop_columns(gaps))
    meta = pq.read_table(tmp_path / "many/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert (
        [one["data/file_index"] for one in meta]
        == list(range(len(run)))
        == [int(path.stem.removeprefix("file-")) for path in files]
    )


def test_statistics_of_all_are_those_of_the_samples_together():
    rng = np.random.default_rng(2)
    parts = [rng.normal(k, 1 + k, (n, 2)) for k, n in enumerate((50, 70, 400))]
    total = Total()
    for part in parts:
        total.add({"x": episode_statistics(part)})
    found, every = total.result()["x"], np.concatenate(parts)
    for name in ("mean", "std", "min", "max"):
        np.testing.assert_allclose(found[name], getattr(np, name)(every, axis=0))
    assert found["count"] == [520.0]
    gappy = episode_statistics(np.array([[1.0, np.nan], [3.0, np.nan]]))
    assert gappy["mean"].tolist() == [2.0, 0.0]
    assert gappy["std"].tolist() == [1.0, 1.0]


def test_a_log_is_episodes_too(log_store, tmp_path):
    LEROBOT.export(log_store, range(len(log_store)), tmp_path / "dives")
    info = json.loads((tmp_path / "dives/meta/info.json").read_text())
    assert info["total_frames"] == int(log_store.samples.sum())
    assert "observation.environment_state" not in info["features"]
    assert info["fps"] == pytest.approx(1.0 / log_store.period)


def test_installed_the_formats_need_no_import_and_without_it_the_way_is_told():
    """As pip installs it; no other plug-in is looked at."""
    root = Path(__file__).resolve().parents[3]
    hub = tomllib.loads((root / "plugins/hubs/pyproject.toml").read_text())["project"]
    points = hub["entry-points"]["glider_twin.exporters"]
    code = (
        "import importlib.metadata as m; "
        "m.entry_points = lambda group: [m.EntryPoint(*p, group) for p in {}.items()]; "
        "from factory.exporting import EXPORTERS; print(EXPORTERS['lerobot'].ending)"
    )
    paths = os.pathsep.join([str(root), str(root / "plugins/hubs")])
    run = functools.partial(
        subprocess.run, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True
    )
    installed = run([sys.executable, "-c", code.replace("{}", repr(points))])
    assert installed.stdout == "-lerobot\n", installed.stderr
    missing = run([sys.executable, "-c", code])
    assert "lerobot comes with a plugin: `pip install ./plugins/hubs` in a" in missing.stderr
