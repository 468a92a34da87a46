"""What the front page shows does what it says, on smaller numbers."""

import dataclasses
import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
import sys

import pytest
from examples import ROOT, needs_docs, run
from patience import HANG_S
from PIL import Image

from factory.__main__ import PROGRAM as FACTORY
from factory.samples import LATITUDE, LONGITUDE, Flight
from factory.samples.gliders import write_slocum
from learn.__main__ import PROGRAM as LEARN
from twin.__main__ import PROGRAM as TWIN
from twin.show.render.context import available_backend

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


def commands(heading):
    """Words of the commands of a section."""
    text = (ROOT / PAGE).read_text(encoding="utf-8")
    section = text.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    (block,) = re.findall(r"```sh\n(.*?)```", section, re.DOTALL)
    return [shlex.split(line) for line in block.splitlines()]


def flown(words):
    """Exit code of a command with the smaller numbers."""
    program, *rest = words
    return PROGRAMS[program].main([*rest, *SMALLER.get(" ".join(words[:2]), [])])


def test_networks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words in commands("Your networks"):
        assert flown(words) == 0, words
    (run_folder,) = (path for path in (tmp_path / "runs").iterdir() if path.is_dir())
    assert (run_folder / "report" / "index.html").is_file()
    assert (run_folder / "c" / "glider_velocity.h").is_file()
    compile_example(run_folder / "c")
    assert (tmp_path / "data" / "missions.parquet").is_file()


def compile_example(header):
    """The C of docs/howto/on_board.md, inside a function."""
    text = (ROOT / "docs/howto/on_board.md").read_text(encoding="utf-8")
    (include, body) = re.findall(r"```c\n(#include .*?\n)(.*?)```", text, re.DOTALL)[0]
    program = f"{include}void use(double surge, double sway);\nvoid step(void)\n{{\n{body}}}\n"
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is not None:
        words = [compiler, "-std=c99", "-Wall", "-Werror", "-fsyntax-only", "-x", "c", "-"]
        subprocess.run([*words, f"-I{header}"], input=program, text=True, check=True)


def test_logs(tmp_path, monkeypatch):
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


def nearby(words):
    """A place that the log's vehicle can reach, in place of the page's."""
    return ["--goto", f"{LATITUDE + 0.02},{LONGITUDE}"] if "--goto" in words else []


def test_robots(capsys):
    names = run(PAGE)
    assert names["run"]["true_altitude"].min() > 0.0
    ends = [one["true_north"][-1] for one in names["fleet"]]
    assert ends == sorted(ends)
    assert "tethys" in capsys.readouterr().out


# --- The commands and the program of docs/howto/forecast.md run as they stand there


def page():
    return (ROOT / "docs/howto/forecast.md").read_text(encoding="utf-8")


def test_the_commands_run(tmp_path):
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


def test_the_program_runs(capsys):
    (program,) = re.findall(r"^```python\n(.*?)^```", page(), re.M | re.S)
    exec(compile(program, "docs/howto/forecast.md", "exec"), {})
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "1"
    assert "Ellipse" in said[-1]


def test_every_option_of_the_table_is_one_of_the_command():
    from glider_twin_ops.commands.forecast import ForecastSurfacings

    fields = {field.name for field in dataclasses.fields(ForecastSurfacings)} - {"json"}
    told = set(re.findall(r"--([a-z-]+)", page()))
    options = {name.rstrip("_").replace("_", "-") for name in fields}
    assert options <= told | {"seed", "threads", "way"}


# --- The tutorials run as they stand: every block, in order, in an empty folder


PAGES = [page for page in sorted((ROOT / "docs/tutorials").glob("*.md")) if page.stem != "index"]
KEPT = ROOT / "docs/gallery/tutorials"
LARGEST = 150_000
"""[byte] of a kept picture"""
NEED_GL = {"dive.png"}


@pytest.fixture(scope="module")
def tutorials():
    """scripts/tutorials.py"""
    spec = importlib.util.spec_from_file_location("tutorials", ROOT / "scripts/tutorials.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_runs(page, tmp_path, tutorials):
    done = subprocess.run(
        [sys.executable, "scripts/tutorials.py", "--only", page.stem, "--folder", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-3000:]}"
    shown = set(tutorials.pictures(page)) - (NEED_GL if available_backend() is None else set())
    for name in shown:
        with Image.open(tmp_path / name) as picture:
            assert len(picture.convert("RGB").getcolors(1 << 24)) > 50, name


def test_the_pictures_are_those_of_the_pages(tutorials):
    shown = [name for page in PAGES for name in tutorials.pictures(page)]
    assert all(tutorials.pictures(page) for page in PAGES)
    assert len(set(shown)) == len(shown), "two tutorials make pictures of one name"
    assert {path.name for path in KEPT.iterdir()} == set(shown)
    for path in KEPT.iterdir():
        assert path.stat().st_size < LARGEST, path.name


def test_the_first_page_leads_to_all():
    index = (ROOT / "docs/tutorials/index.md").read_text(encoding="utf-8")
    assert [page.stem for page in PAGES if f"({page.name})" not in index] == []


@pytest.mark.parametrize(
    ("page", "told"),
    [
        ("```sh\nfalse\n```\n", "ended with 1"),
        ("```sh\ntwin trim --vehicle nobody\n```\n", "nobody ended with 2"),
        ("```sh\necho 4 m\n```\n\n```text\n5 km\n```\n", "not printed: 5 km"),
        ("```rust\n1\n```\n", "no way to run a block marked rust"),
    ],
)
def test_what_fails_or_was_not_printed_ends_it(tutorials, tmp_path, page, told):
    with pytest.raises(RuntimeError, match=told):
        tutorials.Lesson(tmp_path).run(page)


def test_numbers_may_differ_and_other_machines_are_left_out(tutorials, tmp_path):
    page = "```sh\necho 'up to +4.5e-3 m'\n```\n\n```text\nup to  -1 m\n```\n"
    lesson = tutorials.Lesson(tmp_path)
    lesson.run(page + "```sh elsewhere\nfalse\n```\n\n```sh file=a.sh\nls\n```\n")
    assert (tmp_path / "a.sh").read_text() == "ls\n"
