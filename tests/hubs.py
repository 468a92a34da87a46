"""Readers of data sets that have environments of their own."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent


def read_with(environment: str, made_by: str, code: str, cache: Path) -> Any:
    """What code prints as JSON, run by the Python of such an environment, without a network.

    Args:
      environment: folder, such as .venv-hub.
      made_by: the script that makes it, for whoever finds the test skipped.
      code: of Python.
      cache: empty folder for what the reader keeps.
    """
    python = ROOT / environment / "bin/python"
    if not python.exists():
        pytest.skip(f"needs {environment}: {made_by}")
    settings = {
        "HF_HOME": str(cache),
        "HF_HUB_OFFLINE": "1",
        "HF_DATASETS_DISABLE_PROGRESS_BARS": "1",
    }
    kept = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([python, "-c", code], env=kept | settings, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
