"""What is optional is named with the command that installs it."""

import importlib.util
import os
import shutil
import subprocess
import sys
from importlib import metadata
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

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
    known = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=known, capture_output=True, text=True
    )


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
