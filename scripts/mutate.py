"""Mutate: change the code on purpose, line by line, and count the changes that no test notices.

    python scripts/mutate.py                      # every mutant of scripts/mutants.toml
    python scripts/mutate.py --only sensors/dvl   # those whose file or change holds this text
    python scripts/mutate.py --slice 2/5          # the second fifth

Each mutant is a text of a source file and what stands there instead. It is made in a scratch copy
of the tree, where the tests named for it run; a mutant is killed when one of them fails or takes
too long. Code that numba compiles is compiled again wherever it depends on the changed file, and
runs without the compiler where the table says `interpreted`. Exits with 1 when fewer than 85 % are
killed. Mutants marked `equivalent` change nothing that a test could see: listed, not run.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / "scripts" / "mutants.toml"
GOAL = 0.85
"""share of the mutants that the tests must kill"""
PATIENCE_S = 300.0
"""[s] for the tests of one mutant; a mutant that makes them hang is noticed too"""
FAILED, BROKEN = 1, 2
"""pytest's exit codes for a failed test and for a test file that cannot be imported"""
PACKAGES = ("twin", "factory", "learn")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mutant:
    """One change of the code."""

    file: str
    """where the text stood when the table was written; it is looked for elsewhere if it moved"""
    old: str
    new: str
    tests: tuple[str, ...]
    """test files that should notice"""
    interpreted: bool = False
    """whether its tests run without numba's compiler"""
    equivalent: str = ""
    """why no test can notice; empty: one should"""

    @property
    def label(self) -> str:
        """The change in one line."""

        def short(text: str) -> str:
            return " ".join(text.split())[:60]

        return f"{self.file}: {short(self.old)} -> {short(self.new)}"


def read_table(path: Path) -> list[Mutant]:
    """The mutants of a table: `[tests]` names lists of test files, `[[mutant]]` each a change."""
    table = tomllib.loads(path.read_text())
    mutants = []
    for entry in table["mutant"]:
        fields = dict(entry)
        fields["tests"] = tuple(t for name in fields["tests"] for t in table["tests"][name])
        mutants.append(Mutant(**fields))
    return mutants


class Scratch:
    """A copy of the tree with compile caches of its own."""

    def __init__(self, folder: Path) -> None:
        self.tree, self._caches = folder / "tree", folder / "caches"
        listed = ["git", "ls-files", "-co", "--exclude-standard"]
        names = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
        for name in names.splitlines():
            if (ROOT / name).is_file():
                (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, self.tree / name)
        self._sources = sorted(
            p for package in PACKAGES for p in (self.tree / package).rglob("*.py")
        )
        # whole seconds: Python and numba tell an old compiled file by the time of its source
        self.last = ""
        self._clock = int(time.time()) - 100_000
        for source in self._sources:
            os.utime(source, (self._clock, self._clock))
        self._importers = _importers(self.tree, self._sources)

    def find(self, mutant: Mutant) -> Path | None:
        """The file that holds the mutant's text, once; None where the text is gone.

        Raises:
          SystemExit: its file has the text more than once.
        """
        first = self.tree / mutant.file
        count = first.read_text().count(mutant.old) if first.is_file() else 0
        if count > 1:
            raise SystemExit(f"mutate: {mutant.label}: the text is there {count} times")
        if count:
            return first
        package = self.tree / Path(mutant.file).parts[0]
        others = [p for p in self._sources if p.is_relative_to(package)]
        holding = [p for p in others if mutant.old in p.read_text()]
        if len(holding) == 1 and holding[0].read_text().count(mutant.old) == 1:
            return holding[0]
        return None

    def passes(self, tests: Iterable[str], *, interpreted: bool, cache: str) -> bool:
        """Whether the tests pass; too slow is a failure.

        Raises:
          SystemExit: pytest could not run them.
        """
        environment = {
            name: value for name, value in os.environ.items() if name != "NUMBA_DISABLE_JIT"
        }
        environment |= {
            "PYTHONPATH": str(self.tree),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(self._caches / cache),
            "XDG_CACHE_HOME": str(self._caches / cache),
            "CI": "1",  # hypothesis tries the same examples every time
        }
        if interpreted:
            environment["NUMBA_DISABLE_JIT"] = "1"
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
        run = subprocess.Popen(
            command, cwd=self.tree, env=environment, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            self.last, _ = run.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.last = "too slow"
            return False
        finally:  # with every process that the tests started
            with contextlib.suppress(ProcessLookupError):
                os.killpg(run.pid, signal.SIGKILL)
            run.wait()
        if run.returncode in (FAILED, BROKEN) or run.returncode < 0:  # below 0: it crashed
            return False
        if run.returncode:
            raise SystemExit(f"mutate: pytest could not run {' '.join(tests)}:\n{self.last}")
        return True

    def keep_compiled(self) -> None:
        """Keep what the tests of the unchanged tree compiled: mutants start from it."""
        for folder in self.tree.rglob("__pycache__/jit-*"):
            kept = self._caches / "by-content" / folder.relative_to(self.tree)
            shutil.copytree(folder, kept, dirs_exist_ok=True)

    def survives(self, mutant: Mutant, path: Path) -> bool:
        """Whether the mutant's tests still pass with it in place."""
        whole = path.read_text()
        changed = {path, *self._importers.get(path, ())}
        self._start_compiled()
        try:
            path.write_text(whole.replace(mutant.old, mutant.new))
            for source in changed:
                os.utime(source, (self._clock + 10, self._clock + 10))
            return self.passes(mutant.tests, interpreted=mutant.interpreted, cache="mutant")
        finally:
            path.write_text(whole)
            for source in changed:
                os.utime(source, (self._clock, self._clock))

    def _start_compiled(self) -> None:
        """Compile caches as the unchanged tree left them."""
        shutil.rmtree(self._caches / "mutant", ignore_errors=True)
        if (self._caches / "base").is_dir():
            shutil.copytree(self._caches / "base", self._caches / "mutant")
        for folder in self.tree.rglob("__pycache__/jit-*"):
            shutil.rmtree(folder)
        if (self._caches / "by-content").is_dir():
            shutil.copytree(self._caches / "by-content", self.tree, dirs_exist_ok=True)


def _importers(tree: Path, sources: list[Path]) -> dict[Path, set[Path]]:
    """The files that import each file, also through others: their compiled code is old with it."""
    modules = {".".join(p.relative_to(tree).with_suffix("").parts): p for p in sources}
    direct: dict[Path, set[Path]] = {}
    for source in sources:
        for node in ast.walk(ast.parse(source.read_text())):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            for name in names:
                if name in modules:
                    direct.setdefault(modules[name], set()).add(source)
    found = {}
    for source in sources:
        reached, ahead = set[Path](), [source]
        while ahead:
            for importer in direct.get(ahead.pop(), ()):
                if importer not in reached:
                    reached.add(importer)
                    ahead.append(importer)
        found[source] = reached
    return found


def chosen(mutants: list[Mutant], only: str, part: str) -> list[Mutant]:
    """The mutants of `--only` and `--slice`."""
    mutants = [mutant for mutant in mutants if only in mutant.label]
    index, count = (int(number) for number in part.split("/"))
    if not 1 <= index <= count:
        raise SystemExit(f"mutate: --slice {part}: give 1/5 to 5/5")
    return [m for number, m in enumerate(mutants) if number * count // len(mutants) == index - 1]


def main() -> int:
    """Run the table; 0 when enough mutants are killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="mutants whose file or change holds this text")
    parser.add_argument("--slice", default="1/1", help="which part of how many, e.g. 2/5")
    parser.add_argument("--list", action="store_true", help="find every text, run nothing")
    options = parser.parse_args()
    mutants = chosen(read_table(TABLE), options.only, options.slice)
    killed, survived, gone = 0, [], []
    equivalent = [m for m in mutants if m.equivalent]
    to_run = [m for m in mutants if not m.equivalent]
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        scratch = Scratch(Path(folder))
        places = {mutant: scratch.find(mutant) for mutant in mutants}
        gone = [mutant for mutant in mutants if places[mutant] is None]
        to_run = [mutant for mutant in to_run if mutant not in gone]
        if not options.list:
            for interpreted in (False, True):
                tests = sorted({t for m in to_run if m.interpreted is interpreted for t in m.tests})
                if tests and not scratch.passes(tests, interpreted=interpreted, cache="base"):
                    raise SystemExit(
                        f"mutate: the tests fail without any change:\n{scratch.last[-3000:]}"
                    )
            scratch.keep_compiled()
            for mutant in to_run:
                begun, path = time.monotonic(), places[mutant]
                assert path is not None
                if scratch.survives(mutant, path):
                    survived.append(mutant)
                    word = "SURVIVED"
                else:
                    killed += 1
                    word = "killed"
                print(f"{word:8} {time.monotonic() - begun:5.1f} s  {mutant.label}", flush=True)
    for mutant in gone:
        print(f"gone      {mutant.label}")
    for mutant in equivalent:
        print(f"equivalent {mutant.label}: {mutant.equivalent}")
    run = killed + len(survived)
    share = killed / run if run else 1.0
    print(
        f"{killed} of {run} mutants killed ({share:.0%}); {len(survived)} survived, {len(gone)} "
        f"gone, {len(equivalent)} equivalent; at least {GOAL:.0%} must be killed"
    )
    return 0 if share >= GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
