"""What is optional is named with the command that installs it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from twin.errors import InputError
from twin.extras import require
from twin.show.render.encode import Encoder
from twin.suite.requirement import require_dm_control


@pytest.mark.parametrize(("package", "extra"), [("onnx", "onnx"), ("imageio_ffmpeg", "video")])
def test_a_missing_package_is_named_with_its_extra(
    package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match="this needs") as caught:
        require(package, extra=extra, purpose="this")
    message = str(caught.value)
    assert f"the package {package}," in message
    assert message.endswith(f'pip install "glider-twin[{extra}]"')
    assert "\n" not in message


def test_only_a_package_that_is_not_there_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    require("json", extra="video", purpose="this")
    monkeypatch.setitem(sys.modules, "json", None)
    with pytest.raises(InputError, match="the package json,"):
        require("json", extra="video", purpose="this")


def test_a_video_needs_the_extra_video(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(InputError, match=r'pip install "glider-twin\[video\]"$'):
        Encoder(tmp_path / "dive.mp4", 64, 64, 10.0)
    assert list(tmp_path.iterdir()) == []


def test_the_suite_names_the_command_that_installs_dm_control(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    require_dm_control()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"twin\.suite needs dm_control") as caught:
        require_dm_control()
    assert 'pip install --no-deps "dm-control>=1.0.50,<2"' in str(caught.value)
