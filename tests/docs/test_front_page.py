"""What the front page shows does what it says, on smaller numbers."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from examples import ROOT, needs_docs, run

from factory.__main__ import PROGRAM as FACTORY
from factory.samples import LATITUDE, LONGITUDE, Flight
from factory.samples.gliders import write_slocum
from learn.__main__ import PROGRAM as LEARN
from twin.__main__ import PROGRAM as TWIN

pytestmark = needs_docs

PAGE = "docs/index.md"
PROGRAMS = {"twin": TWIN, "factory": FACTORY, "learn": LEARN}
SMALLER = {
    "learn fit": ["--seconds", "0.3", "--members", "1", "--workers", "1"],
    "factory generate": ["--hours", "3", "--workers", "1"],
    "twin identify": ["--no-handling"],
    "twin forecast": ["--members", "10", "--hours", "0.5", "--surface-every", "0.3"],
}
"""Options behind those of the page, so that a test takes seconds"""


def commands(heading: str) -> list[list[str]]:
    """Words of the commands of a section."""
    text = (ROOT / PAGE).read_text(encoding="utf-8")
    section = text.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    (block,) = re.findall(r"```sh\n(.*?)```", section, re.DOTALL)
    return [shlex.split(line) for line in block.splitlines()]


def flown(words: list[str]) -> int:
    """Exit code of a command with the smaller numbers."""
    program, *rest = words
    return PROGRAMS[program].main([*rest, *SMALLER.get(" ".join(words[:2]), [])])


def test_networks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for words in commands("Your networks"):
        assert flown(words) == 0, words
    (run_folder,) = (path for path in (tmp_path / "runs").iterdir() if path.is_dir())
    assert (run_folder / "report" / "index.html").is_file()
    assert (run_folder / "c" / "glider_velocity.h").is_file()
    compile_example(run_folder / "c")
    assert (tmp_path / "data" / "missions.parquet").is_file()


def compile_example(header: Path) -> None:
    """The C of docs/howto/on_board.md, inside a function."""
    text = (ROOT / "docs/howto/on_board.md").read_text(encoding="utf-8")
    (include, body) = re.findall(r"```c\n(#include .*?\n)(.*?)```", text, re.DOTALL)[0]
    program = f"{include}void use(double surge, double sway);\nvoid step(void)\n{{\n{body}}}\n"
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is not None:
        words = [compiler, "-std=c99", "-Wall", "-Werror", "-fsyntax-only", "-x", "c", "-"]
        subprocess.run([*words, f"-I{header}"], input=program, text=True, check=True)


def test_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tables of an imaginary Slocum stand for its binary files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tables").mkdir()
    write_slocum(tmp_path / "tables", Flight(dives=6))
    first, *others = commands("Your logs")
    at = first.index("*.dbd")
    assert flown([*first[:at], "tables", *first[at + 2 :]]) == 0
    for words in others:
        assert flown([*words, *nearby(words)]) == 0, words
    for made in ("mine.xml", "flight.nc", "flight/map.png", "next/index.html", "map.png"):
        assert (tmp_path / made).exists(), made


def nearby(words: list[str]) -> list[str]:
    """A place that the log's vehicle can reach, in place of the page's."""
    return ["--goto", f"{LATITUDE + 0.02},{LONGITUDE}"] if "--goto" in words else []


def test_robots(capsys: pytest.CaptureFixture[str]) -> None:
    names = run(PAGE)
    assert names["run"]["true_altitude"].min() > 0.0
    ends = [one["true_north"][-1] for one in names["fleet"]]
    assert ends == sorted(ends)
    assert "tethys" in capsys.readouterr().out
