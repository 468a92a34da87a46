"""The examples in examples/ run as a reader would run them, short and without warnings."""

from __future__ import annotations

import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from examples import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
pytestmark = pytest.mark.skipif(
    not (ROOT / "examples").is_dir(), reason="a source distribution has no examples"
)


def run(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    monkeypatch.chdir(folder)
    names = runpy.run_path(str(ROOT / "examples" / f"{name}.py"))
    plt.close("all")
    return names


def test_every_example_is_short_and_has_a_test() -> None:
    tested = {"mission_in_a_current", "fleet_with_spread", "python_controller"}
    assert {path.stem for path in EXAMPLES} == tested | {"train_depth_policy"}
    for path in EXAMPLES:
        most = 60 if path.stem == "train_depth_policy" else 40  # it judges what it trains, too
        assert len(path.read_text().splitlines()) < most, path.name


def test_a_mission_in_a_current(tmp_path, monkeypatch, capsys) -> None:
    names = run("mission_in_a_current", tmp_path, monkeypatch)
    assert names["run"].provenance["ended"] == "flown"
    assert np.all(np.abs(names["drift"]) > 50.0)  # the current is not small beside the mission
    assert (tmp_path / "mission.png").stat().st_size > 10_000
    assert (tmp_path / "mission.zarr" / "start_latitude").is_dir()
    assert "2003-08-01T06:" in capsys.readouterr().out


def test_a_fleet_with_spread(tmp_path, monkeypatch) -> None:
    names = run("fleet_with_spread", tmp_path, monkeypatch)
    assert len(names["flown"]) == 50
    north, east = names["ends"].std(axis=0)
    assert north > 5.0
    assert east > 1.0
    assert not list(tmp_path.iterdir())


def test_a_controller_in_python(tmp_path, monkeypatch) -> None:
    names = run("python_controller", tmp_path, monkeypatch)
    depth = names["run"]["true_depth"]
    dives = np.count_nonzero((depth[1:] > 60.0) & (depth[:-1] <= 60.0))
    assert dives > 2
    assert depth.max() < 65.0
    assert (tmp_path / "track.png").is_file()


def test_a_trained_policy(tmp_path, monkeypatch, capsys) -> None:
    """Only that it runs and judges: it is trained for minutes where it is used."""
    pytest.importorskip("stable_baselines3", reason="the extra 'sb3' is not installed")
    monkeypatch.setattr("sys.argv", ["train_depth_policy.py", "256", "2"])
    monkeypatch.setattr("stable_baselines3.PPO.learn", lambda model, steps: model)
    names = run("train_depth_policy", tmp_path, monkeypatch)
    scores = names["scores"]
    assert list(scores) == ["trained", "autopilot", "proportional", "random", "still"]
    assert all(((means >= 0.0) & (means <= 1.0)).all() for means in scores.values())
    assert scores["autopilot"].mean() > scores["still"].mean()
    assert (tmp_path / "depth_policy.zip").is_file()
    assert "autopilot     mean reward" in capsys.readouterr().out
