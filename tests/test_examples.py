"""The examples in examples/ run as a reader would run them, and what they show is so."""

import re
import runpy
import subprocess
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
from examples import ROOT
from PIL import Image

from twin.seams import CURRENTS

EXAMPLES = {path.stem: path for path in sorted((ROOT / "examples").glob("*.py"))}
LONGEST, WIDEST = 65, 100
"""lines of an example, characters of a line"""
pytestmark = pytest.mark.skipif(
    not (ROOT / "examples").is_dir(), reason="a source distribution has no examples"
)


def compare_vehicles(names, said):
    rows = [line.split() for line in said.splitlines()[1:]]
    speeds = {row[0]: float(row[2]) for row in rows}
    assert max(speeds, key=speeds.__getitem__) == "glider"
    assert min(speeds.values()) > 0.2


def current_from_a_log(names, said):
    assert len(names["rows"]) >= 6
    assert np.sqrt(np.mean(names["error"] ** 2)) < 0.04
    assert np.abs(names["table"][:, [2, 4]]).max() > 0.08  # there was a current to be found


def depth_policy(names, said):
    means = [float(word) for word in re.findall(r"mean reward ([\d.]+)", said)]
    assert max(means[2:]) > means[0] + 0.2
    assert names["reward"] > 0.6


def energy_by_pitch(names, said):
    still, *_, strong = names["cost"].argmin(axis=1)
    assert names["pitches"][strong] > names["pitches"][still]


def fleet_with_spread(names, said):
    assert len(names["flown"]) == 50
    north, east = names["ends"].std(axis=0)
    assert north > 5.0
    assert east > 1.0


def forecast_of_surfacings(names, said):
    assert len(names["found"].surfacings) >= 2
    first, second = (one.ellipse(0.9).semi_major_m for one in names["found"].surfacings[:2])
    assert 100.0 < first < second


def glider_in_an_eddy(names, said):
    bent = [float(word) for word in re.findall(r"ends +([-+\d]+) m", said)]
    assert len(bent) == 3
    assert max(map(abs, bent)) > 1000.0


def mission_in_a_current(names, said):
    assert names["run"].provenance["ended"] == "flown"
    assert np.all(np.abs(names["drift"]) > 50.0)  # the current is not small beside the mission
    assert "2003-08-01T06:" in said


def own_current(names, said):
    east = names["run"]["true_east"]
    assert east.min() < -150.0  # carried west south of the front,
    assert east[-1] > east.min() + 30.0  # and back north of it


def python_controller(names, said):
    depth = names["run"]["true_depth"]
    assert np.count_nonzero((depth[1:] > 60.0) & (depth[:-1] <= 60.0)) > 2
    assert depth.max() < 65.0


def store_with_xarray(names, said):
    assert names["missions"].sizes["mission"] >= 3
    assert float(names["missions"].speed.min()) > 0.2
    assert float(names["missions"].compass.max()) < 10.0


def thousand_in_a_batch(names, said):
    heavy = names["pump"] < -100.0
    assert (names["sinking"][heavy] > 0.0).all()
    assert (names["sinking"][names["pump"] > 100.0] < 0.0).all()
    assert names["forward"].max() > 0.4


def train_and_dead_reckon(names, said):
    shares = [float(line.split()[-1]) for line in said.splitlines()[1:]]
    assert shares
    assert np.median(shares) < 3.0  # per cent; what 2 s of training on a busy machine reach


def virtual_mooring(names, said):
    assert len(names["up"]) > 8
    assert np.median(names["away"]) < 0.5 * names["drifter"].max()


CHECKS = {
    check.__name__: check
    for check in (
        compare_vehicles, current_from_a_log, depth_policy, energy_by_pitch, fleet_with_spread,
        forecast_of_surfacings, glider_in_an_eddy, mission_in_a_current, own_current,
        python_controller, store_with_xarray, thousand_in_a_batch, train_and_dead_reckon,
        virtual_mooring,
    )
}  # fmt: skip


def test_every_example_is_short_and_is_checked():
    assert set(EXAMPLES) == set(CHECKS)
    for path in EXAMPLES.values():
        lines = path.read_text().splitlines()
        assert len(lines) <= LONGEST, path.name
        assert max(map(len, lines)) <= WIDEST, path.name


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    before = set(CURRENTS)
    try:
        names = runpy.run_path(str(EXAMPLES[name]), run_name="__main__")
    finally:
        plt.close("all")
        for kind in set(CURRENTS) - before:  # for the tests that come after this one
            CURRENTS.unregister(kind)
    CHECKS[name](names, capsys.readouterr().out)
    with Image.open(tmp_path / f"{name}.png") as picture:
        assert picture.width >= 600
        assert len(picture.convert("RGB").getcolors(1 << 24)) > 50


def test_the_page_of_the_folder_shows_them_all():
    shown = subprocess.run([sys.executable, str(ROOT / "scripts/docs_examples.py")], check=False)
    assert shown.returncode == 0, "run python scripts/docs_examples.py --write"
    page = (ROOT / "examples" / "README.md").read_text()
    programs = set((ROOT / "examples").rglob("*.py"))
    for path in programs - set((ROOT / "examples" / "own_types").iterdir()):
        name = path.stem
        assert re.search(rf"{name}\.py\), [1-9]\d* (s|min) ", page), name
        picture = ROOT / "docs" / "gallery" / "examples" / f"{name}.png"
        assert picture.stat().st_size < 150_000, name


def test_a_trained_policy(tmp_path, monkeypatch, capsys):
    """Only that it runs and judges: it is trained for minutes where it is used."""
    pytest.importorskip("stable_baselines3", reason="the extra 'sb3' is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["train_depth_policy.py", "256", "2"])
    monkeypatch.setattr("stable_baselines3.PPO.learn", lambda model, steps: model)
    names = runpy.run_path(str(ROOT / "examples" / "training" / "train_depth_policy.py"))
    scores = names["scores"]
    assert list(scores) == ["trained", "autopilot", "proportional", "random", "still"]
    assert all(((means >= 0.0) & (means <= 1.0)).all() for means in scores.values())
    assert scores["autopilot"].mean() > scores["still"].mean()
    assert (tmp_path / "depth_policy.zip").is_file()
    assert (tmp_path / "train_depth_policy.png").is_file()
    assert "autopilot     mean reward" in capsys.readouterr().out
