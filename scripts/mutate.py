"""Mutate: change the code on purpose, line by line, and count the changes that no test notices.

    python scripts/mutate.py                      # every mutant of scripts/mutants.toml
    python scripts/mutate.py --only sensors/dvl   # those whose file or change holds this text
    python scripts/mutate.py --slice 2/5          # the second fifth
    python scripts/mutate.py --list               # find every text and test, run nothing

Each mutant is a text of a source file and what stands there instead. It is made in a scratch copy
of the tree, where the tests named for it run; a mutant is killed when one of them fails or takes
too long. A text that is gone or stands twice counts as survived. Compiled code is kept by content
(`twin.compiled`), so a mutant compiles what depends on it and nothing else; where the table says
`interpreted`, its tests run without the compiler. Exits with 1 when fewer than 90 % are killed, and
with `--list` when a text or a test is missing. Mutants marked `equivalent` change nothing that a
test could see: listed, not run. `scripts/place_mutants.py` makes new ones.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import functools
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / "scripts" / "mutants.toml"
GOAL = 0.90
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
    """test files, or `file::function`, that should notice"""
    placed: str = ""
    """which operator of `scripts/place_mutants.py` made it; empty: written by hand"""
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
        named = [table["tests"].get(name, [name]) for name in entry["tests"]]
        mutants.append(Mutant(**{**entry, "tests": tuple(t for tests in named for t in tests)}))
    return mutants


class Tree:
    """The source files of a tree, and where mutants stand in them."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._sources = sorted(p for package in PACKAGES for p in (root / package).rglob("*.py"))
        self._text = functools.cache(Path.read_text)

    def find(self, mutant: Mutant) -> Path | str:
        """The file that holds the mutant's text once: its own, else another of the package.

        Where there is none, the reason in words.
        """
        own = self.root / mutant.file
        count = self._text(own).count(mutant.old) if own.is_file() else 0
        if count == 1:
            return own
        if count:
            return f"its text stands {count} times in {mutant.file}"
        package = self.root / Path(mutant.file).parts[0]
        holding = [
            path
            for path in self._sources
            if path.is_relative_to(package) and mutant.old in self._text(path)
        ]
        count = sum(self._text(path).count(mutant.old) for path in holding)
        if count == 1:
            return holding[0]
        return f"its text stands {count} times in {package.name}/" if count else "its text is gone"

    def missing_tests(self, mutant: Mutant) -> list[str]:
        """The mutant's tests that are not there."""

        def is_there(test: str) -> bool:
            file, _, function = test.partition("::")
            path = self.root / file
            return path.is_file() and (not function or f"def {function}(" in self._text(path))

        return [test for test in mutant.tests if not is_there(test)]


class Scratch:
    """A copy of a tree to change and to run tests in, with compiled code of its own."""

    def __init__(self, folder: Path, of: Path) -> None:
        self.root, self._compiled = folder, folder / "twin" / "__pycache__" / "compiled"
        listed = ["git", "ls-files", "-co", "--exclude-standard"]
        names = subprocess.run(listed, cwd=of, check=True, capture_output=True, text=True).stdout
        for name in names.splitlines():
            if (of / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(of / name, folder / name)
        # Python tells an old .pyc by the whole second of its source: no two versions share one.
        self._clock = int(time.time()) - 1_000_000
        for package in PACKAGES:
            for source in (folder / package).rglob("*.py"):
                os.utime(source, (self._clock, self._clock))
        self._versions = 0
        self.last = ""

    def start_compiled_as(self, other: Scratch) -> None:
        """Begin with what another copy of the same tree has compiled."""
        if other._compiled.is_dir():
            shutil.copytree(other._compiled, self._compiled, dirs_exist_ok=True)

    def passes(
        self,
        tests: Iterable[str],
        *,
        interpreted: bool,
        processes: int = 0,
        patience: float | None = PATIENCE_S,
    ) -> bool:
        """Whether the tests pass, in this many processes beside; too slow is a failure.

        Raises:
          SystemExit: pytest could not run them.
        """
        environment = {
            name: value
            for name, value in os.environ.items()
            if name != "NUMBA_DISABLE_JIT" and not name.startswith("PYTEST_")
        }
        # CI: hypothesis tries the same examples every time
        environment |= {"PYTHONPATH": str(self.root), "CI": "1"}
        if interpreted:
            environment["NUMBA_DISABLE_JIT"] = "1"
        command = [
            *(sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"),
            *(f"-n{processes}", *tests),
        ]
        run = subprocess.Popen(
            command, cwd=self.root, env=environment, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            self.last, _ = run.communicate(timeout=patience)
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

    def survives(self, mutant: Mutant) -> bool:
        """Whether the mutant's tests still pass with it in place."""
        path = Tree(self.root).find(mutant)
        assert isinstance(path, Path)
        whole = path.read_text()
        kept = set(self._compiled.iterdir()) if self._compiled.is_dir() else set()
        self._versions += 1
        try:
            path.write_text(whole.replace(mutant.old, mutant.new))
            os.utime(path, (self._clock + self._versions, self._clock + self._versions))
            return self.passes(mutant.tests, interpreted=mutant.interpreted)
        finally:
            path.write_text(whole)
            os.utime(path, (self._clock, self._clock))
            for folder in set(self._compiled.iterdir()) - kept if kept else ():
                shutil.rmtree(folder)


def chosen(mutants: list[Mutant], only: str, part: str) -> list[Mutant]:
    """The mutants of `--only` and `--slice`."""
    mutants = [mutant for mutant in mutants if only in mutant.label]
    index, count = (int(number) for number in part.split("/"))
    if not 1 <= index <= count:
        raise SystemExit(f"mutate: --slice {part}: give 1/{count} to {count}/{count}")
    return [m for number, m in enumerate(mutants) if number * count // len(mutants) == index - 1]


def lost(tree: Tree, mutants: list[Mutant]) -> dict[Mutant, str]:
    """The mutants that cannot be run as they stand, and why."""
    found = {}
    for mutant in mutants:
        place, tests = tree.find(mutant), tree.missing_tests(mutant)
        if isinstance(place, str):
            found[mutant] = place
        elif tests:
            found[mutant] = f"{', '.join(tests)} missing"
    return found


def run_all(mutants: list[Mutant], jobs: int, folder: Path) -> list[Mutant]:
    """Run the mutants in `jobs` copies of the tree; the ones that survived.

    Raises:
      SystemExit: the tests fail without any change.
    """
    copies = [Scratch(folder / str(job), ROOT) for job in range(jobs)]
    for interpreted in (False, True):
        tests = sorted({t for m in mutants if m.interpreted is interpreted for t in m.tests})
        # a file stands for its functions
        tests = [t for t in tests if "::" not in t or t.partition("::")[0] not in tests]
        if tests and not copies[0].passes(
            tests, interpreted=interpreted, processes=jobs if jobs > 1 else 0, patience=None
        ):
            raise SystemExit(f"mutate: tests fail without any change:\n{copies[0].last[-3000:]}")
    for copy in copies[1:]:
        copy.start_compiled_as(copies[0])
    waiting, survived, failures = queue.SimpleQueue[Mutant](), list[Mutant](), list[SystemExit]()
    for mutant in mutants:
        waiting.put(mutant)

    def work(scratch: Scratch) -> None:
        while not failures:
            try:
                mutant = waiting.get_nowait()
            except queue.Empty:
                return
            begun = time.monotonic()
            try:
                survives = scratch.survives(mutant)
            except SystemExit as error:
                failures.append(error)
                return
            if survives:
                survived.append(mutant)
            word = "SURVIVED" if survives else "killed"
            print(f"{word:8} {time.monotonic() - begun:5.1f} s  {mutant.label}", flush=True)

    threads = [threading.Thread(target=work, args=[copy]) for copy in copies]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failures:
        raise failures[0]
    return survived


def main(arguments: list[str] | None = None) -> int:
    """Run the table; 0 when enough mutants are killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="mutants whose file or change holds this text")
    parser.add_argument("--slice", default="1/1", help="which part of how many, e.g. 2/5")
    parser.add_argument("--jobs", type=int, default=2, help="mutants tried at a time")
    parser.add_argument("--table", type=Path, default=TABLE, help="file with the mutants")
    parser.add_argument("--list", action="store_true", help="find every text, run nothing")
    options = parser.parse_args(arguments)
    mutants = chosen(read_table(options.table), options.only, options.slice)
    gone = lost(Tree(ROOT), mutants)
    for mutant, why in gone.items():
        print(f"GONE      {mutant.label}: {why}")
    equivalent = [m for m in mutants if m.equivalent]
    for mutant in equivalent:
        print(f"equivalent {mutant.label}: {mutant.equivalent}")
    if options.list:
        print(f"{len(mutants)} mutants, {len(equivalent)} of them equivalent; {len(gone)} are gone")
        return 1 if gone else 0
    to_run = [m for m in mutants if m not in gone and not m.equivalent]
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        survived = run_all(to_run, options.jobs, Path(folder)) if to_run else []
    for mutant in survived:
        print(f"SURVIVED  {mutant.label}")
    run, killed = len(to_run) + len(gone), len(to_run) - len(survived)
    share = killed / run if run else 1.0
    print(
        f"{killed} of {run} mutants killed ({share:.1%}); {len(survived)} survived, {len(gone)} "
        f"gone, {len(equivalent)} equivalent; at least {GOAL:.0%} must be killed"
    )
    return 0 if share >= GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
