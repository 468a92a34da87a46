"""`learn export` says how to install what it needs, before it reads anything."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from learn.commands.trained import ExportNetwork
from twin.cli.console import Console
from twin.errors import InputError


@pytest.mark.parametrize("package", ["onnx", "onnxscript", "onnxruntime"])
def test_export_needs_the_extra_onnx(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf'{package},.* pip install "glider-twin\[onnx\]"$'):
        ExportNetwork(run_folder=tmp_path / "none").run(Console("learn"))


def test_running_a_model_needs_the_extra_onnx(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from learn.networks.onnx_export import StepModel

    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(InputError, match=r'pip install "glider-twin\[onnx\]"$'):
        StepModel(tmp_path / "none.onnx")
