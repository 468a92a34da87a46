"""Tutorials and examples: run them, and keep the pictures that they make.

    python scripts/tutorials.py                          # all, and their pictures in docs/gallery
    python scripts/tutorials.py --only fly own_current       # some of them
    python scripts/tutorials.py --only fly --folder FOLDER   # into a folder; no picture is kept
    python scripts/tutorials.py --gallery                    # the pictures of docs/gallery.md

A tutorial runs block by block in one empty folder, as a reader would do: `sh` in a shell, `python`
in one session. A block with `file=NAME` is written there. A `text` block shows output of the block
before; its numbers may differ. `sh gl` needs OpenGL and `sh cc` a C compiler. Blocks marked
`elsewhere` are for another machine and do not run. Each example has its own folder. Examples in
examples/training take minutes and run only if named. A block `sh gallery` runs at the top of the
repository, so that a picture always matches its command.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TUTORIALS = ROOT / "docs" / "tutorials"
EXAMPLES = ROOT / "examples"
GALLERY = ROOT / "docs" / "gallery"
BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHOWN = re.compile(r"^```sh gallery\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PICTURE = re.compile(r"!\[[^\]]+\]\(\.\./gallery/tutorials/([\w.-]+)\)")
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
SHELL = re.compile(r"[|&;<>*$`()~]|^\s*\w+=")
"""Pattern of text that needs a shell, in a line without its quoted parts"""
QUOTED = re.compile(r"\"[^\"$`\\]*\"|'[^']*'")
WIDEST = 1000
"""[px] Largest width of a kept picture"""


class Lesson:
    """Run of one page: its folder, the names of its Python session, and the last output."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.session: dict[str, Any] = {"__name__": "tutorial"}
        self.said = ""

    def run(self, page: str) -> None:
        """Run every block of a page's text, in order.

        Raises:
          RuntimeError: a command failed, or did not print what the page shows.
        """
        for language, mark, text in BLOCK.findall(page):
            mark = mark.strip()
            if mark == "elsewhere" or (mark in NEEDS and not NEEDS[mark]()):
                continue
            if mark.startswith("file="):
                (self.folder / mark.removeprefix("file=")).write_text(text)
            elif language == "text":
                self.compare(text)
            elif language in ("python", "sh") and mark in ("", *NEEDS):
                self.said = self.python(text) if language == "python" else self.shell(text)
                print(self.said, end="", flush=True)
            else:
                raise RuntimeError(f"no way to run a block marked {language} {mark}")

    def python(self, text: str) -> str:
        """Run a block in the session, and return its output."""
        said = io.StringIO()
        with contextlib.chdir(self.folder), contextlib.redirect_stdout(said):
            if str(self.folder) not in sys.path:
                sys.path.insert(0, str(self.folder))  # a session has its folder there
            exec(compile(text, "tutorial", "exec"), self.session)
        return said.getvalue()

    def shell(self, text: str) -> str:
        """Run commands; ours and the page's programs run in this process, to save imports."""
        lines = [line for line in text.replace("\\\n", " ").splitlines() if line.strip()]
        words = [shlex.split(line, comments=True) for line in lines]
        here = all(one[0] in ("twin", "factory", "learn") or _is_program(one) for one in words)
        if not here or any(SHELL.search(QUOTED.sub("", line)) for line in lines):
            return self.bash(text)
        return "".join(
            self.program(one[1]) if _is_program(one) else self.command(*one) for one in words
        )

    def program(self, name: str) -> str:
        """Run a program of the page, as `python NAME` does, and return its output."""
        said = io.StringIO()
        with contextlib.chdir(self.folder), contextlib.redirect_stdout(said):
            try:
                runpy.run_path(name, run_name="__main__")
            except SystemExit as end:
                if end.code:
                    raise RuntimeError(f"python {name} ended with {end.code}") from end
        return said.getvalue()

    def command(self, program: str, *words: str) -> str:
        """Run one of our commands, and return its output."""
        said = io.StringIO()
        with (
            contextlib.chdir(self.folder),
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
        ):
            code = importlib.import_module(f"{program}.__main__").PROGRAM.main(words)
        if code:
            raise RuntimeError(
                f"{program} {shlex.join(words)} ended with {code}\n{said.getvalue()}"
            )
        return said.getvalue()

    def bash(self, text: str) -> str:
        """Run commands that need a shell, and return their output."""
        found = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        places = os.pathsep.join(p for p in (str(ROOT), os.environ.get("PYTHONPATH")) if p)
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", text],
            cwd=self.folder,
            env={**os.environ, "PATH": found, "PYTHONPATH": places},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        if done.returncode:
            raise RuntimeError(f"{text}ended with {done.returncode}\n{done.stdout}")
        return done.stdout

    def compare(self, shown: str) -> None:
        """Raise an error unless the text that a page shows was printed, apart from numbers."""
        said = {without_numbers(line) for line in self.said.splitlines()}
        for line in shown.splitlines():
            if line.strip() and line.strip() != "..." and without_numbers(line) not in said:
                raise RuntimeError(f"the page shows a line that was not printed: {line}")


def _is_program(words: list[str]) -> bool:
    """True if a command is just `python NAME.py`."""
    return len(words) == 2 and words[0] == "python" and words[1].endswith(".py")


def without_numbers(line: str) -> str:
    """Words of a line, without numbers, signs and extra blanks."""
    return " ".join(NUMBER.sub("#", line).split())


def has_opengl() -> bool:
    """True if `twin render` can draw on this machine."""
    from twin.show.render.context import available_backend

    return available_backend() is not None


def has_compiler() -> bool:
    """True if `learn export --to c` finds a C compiler."""
    return shutil.which(os.environ.get("CC", "cc")) is not None


NEEDS = {"gl": has_opengl, "cc": has_compiler}
"""Requirements on the machine for marked blocks, which are left out without them."""


def names() -> dict[str, Path]:
    """List every tutorial and example by name, in the order of their files."""
    pages = [page for page in sorted(TUTORIALS.glob("*.md")) if page.stem != "index"]
    found = (*pages, *sorted(EXAMPLES.glob("*.py")), *sorted((EXAMPLES / "training").glob("*.py")))
    return {path.stem: path for path in found}


def commands(page: str) -> list[str]:
    """Shell blocks of a page's text that make pictures, in order."""
    return [block.strip() for block in SHOWN.findall(page)]


def show(page: Path, folder: Path = ROOT) -> None:
    """Run the blocks of a page that make its pictures.

    Raises:
      RuntimeError: the page has no such block, or one failed.
    """
    blocks = commands(page.read_text())
    if not blocks:
        raise RuntimeError(f"no block marked `sh gallery` in {page}")
    for block in blocks:
        print(f"$ {block}", flush=True)
        Lesson(folder).bash(block)


def pictures(path: Path) -> list[str]:
    """Names of the pictures that a tutorial shows or an example makes."""
    return PICTURE.findall(path.read_text()) if path.suffix == ".md" else [f"{path.stem}.png"]


def run(path: Path, folder: Path) -> None:
    """Run a tutorial or an example in an empty folder."""
    if path.suffix == ".md":
        Lesson(folder).run(path.read_text())
        return
    with contextlib.chdir(folder):
        runpy.run_path(str(path), run_name="__main__")


def keep(picture: Path, place: Path) -> None:
    """Save a copy that is small enough for the repository: at most WIDEST wide, in 256 colours."""
    from PIL import Image

    with Image.open(picture) as full:
        scale = min(1.0, WIDEST / full.width)
        small = full.convert("RGB").resize(
            (round(full.width * scale), round(full.height * scale)), Image.Resampling.LANCZOS
        )
        place.parent.mkdir(parents=True, exist_ok=True)
        small.quantize(256, method=Image.Quantize.MAXCOVERAGE).save(place, optimize=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the selected pages; the first failure ends the run."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    usual = [name for name, path in names().items() if path.parent.name != "training"]
    parser.add_argument("--only", nargs="+", choices=names(), default=usual, metavar="NAME")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--gallery", action="store_true")
    asked = parser.parse_args(arguments)
    sys.path.insert(0, str(ROOT))
    if asked.gallery:
        show(ROOT / "docs" / "gallery.md")
        return 0
    for name in asked.only:
        path, began = names()[name], time.perf_counter()
        with contextlib.ExitStack() as stack:
            folder = asked.folder
            if folder is None:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            run(path, folder)
            for picture in pictures(path) if asked.folder is None else ():
                kind = "tutorials" if path.suffix == ".md" else "examples"
                keep(folder / picture, GALLERY / kind / picture)
        print(f"{name}: {time.perf_counter() - began:.1f} s", file=sys.stderr, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
