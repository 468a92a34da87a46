"""The tutorials run as they stand: every block, in order, in an empty folder."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from examples import ROOT, needs_docs
from patience import HANG_S
from PIL import Image

from twin.show.render.context import available_backend

pytestmark = needs_docs

PAGES = [page for page in sorted((ROOT / "docs/tutorials").glob("*.md")) if page.stem != "index"]
KEPT = ROOT / "docs/gallery/tutorials"
LARGEST = 150_000
"""[byte] of a kept picture"""
NEED_GL = {"dive.png"}


@pytest.fixture(scope="module")
def tutorials() -> ModuleType:
    """scripts/tutorials.py"""
    spec = importlib.util.spec_from_file_location("tutorials", ROOT / "scripts/tutorials.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_runs(page: Path, tmp_path: Path, tutorials: ModuleType) -> None:
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


def test_the_pictures_are_those_of_the_pages(tutorials: ModuleType) -> None:
    shown = [name for page in PAGES for name in tutorials.pictures(page)]
    assert all(tutorials.pictures(page) for page in PAGES)
    assert len(set(shown)) == len(shown), "two tutorials make pictures of one name"
    assert {path.name for path in KEPT.iterdir()} == set(shown)
    for path in KEPT.iterdir():
        assert path.stat().st_size < LARGEST, path.name


def test_the_first_page_leads_to_all() -> None:
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
def test_what_fails_or_was_not_printed_ends_it(
    tutorials: ModuleType, tmp_path: Path, page: str, told: str
) -> None:
    with pytest.raises(RuntimeError, match=told):
        tutorials.Lesson(tmp_path).run(page)


def test_numbers_may_differ_and_other_machines_are_left_out(
    tutorials: ModuleType, tmp_path: Path
) -> None:
    page = "```sh\necho 'up to +4.5e-3 m'\n```\n\n```text\nup to  -1 m\n```\n"
    lesson = tutorials.Lesson(tmp_path)
    lesson.run(page + "```sh elsewhere\nfalse\n```\n\n```sh file=a.sh\nls\n```\n")
    assert (tmp_path / "a.sh").read_text() == "ls\n"
