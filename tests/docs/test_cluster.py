"""The commands of docs/cluster.md run as they stand there."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from s3 import s3_server

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ("twin", "factory", "learn")
SECONDS = 300.0


def commands(section: str) -> list[list[str]]:
    """Words of the page's commands below a heading, without those of shells and pip."""
    text = (ROOT / "docs/cluster.md").read_text(encoding="utf-8").partition(f"\n## {section}\n")[2]
    blocks = re.findall(r"^```sh\n(.*?)^```", text.partition("\n## ")[0], re.M | re.S)
    lines = [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]
    return [words for words in lines if words and words[0] in PROGRAMS]


def test_the_commands_of_s3_run(tmp_path: Path) -> None:
    found = commands("S3")
    assert {words[1] for words in found} >= {"generate", "info", "verify", "export", "fit"}
    with s3_server() as environment:
        for words in found:
            done = subprocess.run(
                [sys.executable, "-m", *words],
                cwd=tmp_path,
                env={**os.environ, **environment, "PYTHONPATH": str(ROOT)},
                capture_output=True,
                text=True,
                timeout=SECONDS,
            )
            assert done.returncode == 0, f"{shlex.join(words)}: {done.stderr}"
    assert len(list((tmp_path / "og1").glob("*.nc"))) == 2
    assert (tmp_path / "runs/small/report/index.html").is_file()


def test_the_program_of_icechunk_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("icechunk", reason='needs pip install "glider-twin[icechunk]"')
    text = (ROOT / "docs/cluster.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(program, names)
    store = names["repository"].readonly_session("main").store
    assert xr.open_zarr(store, consolidated=False).attrs["seed"] == 0
