"""The gallery's pictures come from the commands above them; docs/howto/render.md runs."""

import importlib.util
import re
from pathlib import Path

import pytest
from pictures import needs_gl
from PIL import Image

ROOT = Path(__file__).resolve().parents[4]
PAGE = ROOT / "docs" / "gallery.md"
PICTURES = re.compile(r"!\[[^\]]+\]\(((?:docs/)?gallery/[^)]+)\)")
LARGEST, LARGEST_SUM = 300_000, 1_700_000
"""[byte] of a picture and of all"""

pytestmark = pytest.mark.skipif(
    not (ROOT / "docs").is_dir(), reason="a source distribution has no docs"
)


def gallery():
    spec = importlib.util.spec_from_file_location("gallery", ROOT / "scripts" / "gallery.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_picture_is_made_by_a_command_beside_it():
    page = PAGE.read_text()
    made = re.findall(r"docs/gallery/[\w.]+", "\n".join(gallery().commands(page)))
    assert {f"docs/{name}" for name in PICTURES.findall(page)} == set(made)
    assert {path.name for path in (ROOT / "docs/gallery").iterdir() if path.is_file()} == {
        Path(name).name for name in made
    }


def test_the_readme_opens_with_one():
    opening = PICTURES.match((ROOT / "README.md").read_text().splitlines()[2])
    assert opening is not None
    assert opening[1].removeprefix("docs/") in PICTURES.findall(PAGE.read_text())


def test_pictures_are_small_and_open():
    sizes = []
    for name in PICTURES.findall(PAGE.read_text()):
        path = PAGE.parent / name
        sizes.append(path.stat().st_size)
        with Image.open(path) as picture:
            assert picture.width >= 600
            assert len(picture.convert("RGB").getcolors(1 << 24)) > 100
    assert max(sizes) < LARGEST
    assert sum(sizes) < LARGEST_SUM


def test_a_page_without_commands_is_an_error(tmp_path, monkeypatch, capsys):
    module = gallery()
    monkeypatch.setattr(module, "ROOT", tmp_path)
    (tmp_path / "page.md").write_text("```sh\nfalse\n```\n")
    assert module.main(["page.md"]) == 1
    assert "sh gallery" in capsys.readouterr().err


def test_the_first_failure_ends_it(tmp_path, monkeypatch):
    module = gallery()
    monkeypatch.setattr(module, "ROOT", tmp_path)
    (tmp_path / "page.md").write_text(
        "```sh gallery\ntouch a\n```\n\n```sh gallery\nexit 3\ntouch b\n```\n"
    )
    assert module.main(["page.md"]) == 3
    assert (tmp_path / "a").exists()
    assert not (tmp_path / "b").exists()


@needs_gl
def test_the_examples_of_the_page_run():
    page = (ROOT / "docs" / "howto" / "render.md").read_text()
    blocks = re.findall(r"```python(?: gl)?\n(.*?)```", page, re.DOTALL)
    assert len(blocks) == 2
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/howto/render.md", "exec"), names)
    assert names["pixels"].shape == (180, 320, 3)
