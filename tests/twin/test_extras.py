"""What is optional is named with the command that installs it; MuJoCo 4 flies as 3."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from importlib import metadata
from importlib.machinery import ModuleSpec
from pathlib import Path

import numpy as np
import pytest
from processes import python

from twin.control.dm_suite import ALONE, require_dm_control
from twin.errors import InputError
from twin.extras import require, require_factory
from twin.show.render import Shot
from twin.show.render.film import encoder

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("package", "extra"), [("onnx", "onnx"), ("imageio_ffmpeg", "video")])
def test_a_missing_package_is_named_with_its_extra(package, extra, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match="this needs") as caught:
        require(package, extra=extra, purpose="this")
    message = str(caught.value)
    assert f"the package {package}," in message
    assert message.endswith(f'pip install "glider-twin[{extra}]"')
    assert "\n" not in message


def test_only_a_package_that_is_not_there_is_an_error(monkeypatch):
    require("json", extra="video", purpose="this")
    monkeypatch.setitem(sys.modules, "json", None)
    with pytest.raises(InputError, match="the package json,"):
        require("json", extra="video", purpose="this")


def test_a_video_needs_the_extra_video(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(InputError, match=r'pip install "glider-twin\[video\]"$'):
        encoder(tmp_path / "dive.mp4", Shot(width=64, height=64)).__enter__()
    assert list(tmp_path.iterdir()) == []


def test_the_suite_names_the_command_that_installs_dm_control(monkeypatch):
    require_dm_control()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for version, line in (((3, 12), ""), ((3, 13), f" && {ALONE}")):
        monkeypatch.setattr(sys, "version_info", version)
        with pytest.raises(InputError, match="a task of dm_control needs the package") as caught:
            require_dm_control()
        assert str(caught.value).endswith(f'pip install "glider-twin[suite]"{line}')


def test_a_mujoco_that_dm_control_cannot_use_is_named(monkeypatch):
    monkeypatch.setattr(metadata, "version", lambda name: {"mujoco": "4.0.0"}[name])
    with pytest.raises(InputError, match=r"below 4, and mujoco 4\.0\.0 is installed") as caught:
        require_dm_control()
    assert 'pip install "glider-twin[suite]"' in str(caught.value)
    assert "GliderEnv" in str(caught.value)


FOREIGN = '"""Of somebody else."""\nfrom .base import Factory\n'


def shadowed(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A Python process that finds the packages of this folder first."""
    path = os.pathsep.join((str(folder), str(ROOT)))
    return python(*words, cwd=folder, PYTHONPATH=path)


@pytest.fixture
def overwritten(tmp_path):
    """A folder with this project's `factory` whose first file another package has replaced."""
    shutil.copytree(ROOT / "factory", tmp_path / "factory")
    (tmp_path / "factory" / "__init__.py").write_text(FOREIGN)
    (tmp_path / "factory" / "base.py").write_text("class Factory:\n    pass\n")
    return tmp_path


def test_a_factory_of_somebody_else_is_named(overwritten):
    where = overwritten / "factory" / "__init__.py"
    for words in (("-m", "factory", "info"), ("-m", "learn", "compare")):
        done = shadowed(overwritten, *words)
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
        assert f"{where} is not glider-twin's factory and is found before it" in done.stderr
    done = shadowed(overwritten, "-c", "import learn")
    assert done.returncode == 1
    assert f"{where} is not glider-twin's factory" in done.stderr.splitlines()[-1]


def test_a_factory_that_lost_its_first_file_is_named(monkeypatch):
    require_factory()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: ModuleSpec(name, None))
    with pytest.raises(InputError, match=r"has no __init__\.py, as after .* factory_boy") as caught:
        require_factory()
    assert str(caught.value).endswith("pip install --force-reinstall --no-deps glider-twin")


# --- MuJoCo 4, to rounding ------------------------------------------------------------------------


NEWER = ROOT / ".venv-mujoco4" / "bin" / "python"
FLY = """
import json, sys
from importlib import metadata
import numpy as np
import factory, twin
from twin import control
from twin.errors import InputError

run = twin.simulate(duration=600.0, current="uniform:0.1,-0.05", sensors="field", seed=3)
figures = {"states": run.states[-1].tolist(), "parts": run["true_pump"].tolist()}
figures["trim"] = twin.trim(twin.load_vehicle("glider"), shift=0.02, net_mass=0.2).speed_m_s
factory.generate(sys.argv[1], hours=0.3, seed=1, preset="field", workers=1)
store = factory.open(sys.argv[1])
figures["store"] = [store.row("true_north", m).tolist() for m in range(len(store))]
for task in control.ALL_TASKS:
    one = control.GliderEnv(task, observation="dict", randomise="field")
    many = control.GliderVectorEnv(task, 2, observation="dict", randomise="field")
    one.reset(seed=1), many.reset(seed=1)
    one.action_space.seed(0)
    for _ in range(40):
        action = one.action_space.sample()
        seen, reward, *_ = one.step(action)
        both, rewards, *_ = many.step(np.stack([action, action]))
    figures[task] = [reward, *rewards, *np.concatenate(list(seen.values())).tolist()]
    figures[f"{task}, many"] = np.concatenate([v.ravel() for v in both.values()]).tolist()
try:
    control.load("hold")
    told = "loaded"
except InputError as error:
    told = str(error)
print(json.dumps([metadata.version("mujoco"), told, figures]))
"""


def flown(python: str | Path, store: Path) -> tuple[str, str, dict]:
    """MuJoCo's version, what dm_control's face says, and figures of flights."""
    done = subprocess.run(
        [python, "-c", FLY, str(store)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return tuple(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.skipif(not NEWER.exists(), reason="needs .venv-mujoco4: scripts/mujoco4.sh")
def test_figures_are_those_of_mujoco_3(tmp_path):
    version, told, figures = flown(sys.executable, tmp_path / "older.zarr")
    assert (version.partition(".")[0], told) == ("3", "loaded")
    newer, told, others = flown(NEWER, tmp_path / "newer.zarr")
    assert newer.startswith("4.")
    assert f"need a mujoco below 4, and mujoco {newer} is installed" in told
    assert figures.keys() == others.keys()
    for name, values in figures.items():
        # MuJoCo 4 rounds the last bit of a rotation matrix otherwise; stores hold 32-bit numbers
        near = {"rtol": 1e-6, "atol": 1e-6} if name == "store" else {"rtol": 1e-11, "atol": 1e-12}
        for one, other in zip(np.atleast_1d(values), np.atleast_1d(others[name]), strict=True):
            np.testing.assert_allclose(other, one, **near, err_msg=name)
