"""The commands and the program of docs/howto/forecast.md run as they stand there."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

from examples import ROOT, needs_docs
from patience import HANG_S

pytestmark = needs_docs


def page() -> str:
    return (ROOT / "docs/howto/forecast.md").read_text(encoding="utf-8")


def test_the_commands_run(tmp_path: Path) -> None:
    lines = [
        line
        for block in re.findall(r"^```sh\n(.*?)^```", page(), re.M | re.S)
        for line in block.splitlines()
    ]
    assert len(lines) == 2
    for line in lines:
        words = shlex.split(line)
        if words[0] == "twin":
            words = ["python", "-m", *words]
        done = subprocess.run(
            [sys.executable, *words[1:]],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=HANG_S,
        )
        assert done.returncode == 0, f"{line}: {done.stderr}"
    document = json.loads((tmp_path / "next/forecast.json").read_text())
    assert document["flown"] == 20
    assert len(document["surfacings"]) >= 2
    assert (tmp_path / "next/index.html").is_file()


def test_the_program_runs(capsys) -> None:
    (program,) = re.findall(r"^```python\n(.*?)^```", page(), re.M | re.S)
    exec(compile(program, "docs/howto/forecast.md", "exec"), {})
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "1"
    assert "Ellipse" in said[-1]


def test_every_option_of_the_table_is_one_of_the_command() -> None:
    import dataclasses

    from glider_twin_ops.commands.forecast import ForecastSurfacings

    fields = {field.name for field in dataclasses.fields(ForecastSurfacings)} - {"json"}
    told = set(re.findall(r"--([a-z-]+)", page()))
    options = {name.rstrip("_").replace("_", "-") for name in fields}
    assert options <= told | {"seed", "threads", "way"}
