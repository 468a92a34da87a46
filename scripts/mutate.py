"""Mutate: change the code on purpose, line by line, and count the changes that no test notices.

    python scripts/mutate.py                      # every mutant of scripts/mutants.toml
    python scripts/mutate.py --only sensors/dvl   # those whose file or change holds this text
    python scripts/mutate.py --slice 2/5          # the second fifth
    python scripts/mutate.py --list               # find every text and test, run nothing

Each mutant is a text of a source file and what stands there instead. It is made in a scratch copy
of the tree, where the tests named for it run in their order; a mutant is killed when one of them
fails or takes too long. In the end the tests that killed run once without any change: what one that
fails then has killed counts as survived, as does a text that is gone or stands twice. The placed
ones, drawn by chance, run first and have a score of their own.

What ran is kept in `build/mutants` as it goes: a run that was stopped goes on, and a later one
repeats only mutants whose file or killing tests have changed since. Remove the folder to run all
anew.

Compiled code is kept by content (`twin.compiled`), so a mutant compiles what depends on it and
nothing else; where the table says `interpreted`, its tests run without the compiler. Exits with 1
when fewer than 90 % are killed, and with `--list` when a text or a test is missing. Mutants marked
`equivalent` change nothing that a test could see: listed, not run. `scripts/place_mutants.py` makes
new ones.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import difflib
import functools
import hashlib
import json
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / "scripts" / "mutants.toml"
KEPT = "build/mutants"
"""folder in the root with what ran, a line for each mutant, and with what was compiled for it"""
GOAL = 0.90
"""share of the mutants that the tests must kill"""
WORK_S, PATIENCE_S = 300, 3000.0
"""[s] of a processor and of the clock for the tests of one mutant; one that hangs is noticed too"""
FAILED, BROKEN = 1, 2
"""pytest's exit codes for a failed test and for a test file that cannot be imported"""
FAILURE = re.compile(r"^(?:FAILED|ERROR) (tests/[^\s\[]+)", re.MULTILINE)
"""pytest's line of a test that failed"""
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
    def name(self) -> str:
        """The change in full."""
        return f"{self.file}: {self.old} -> {self.new}"

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
        named = [table.get("tests", {}).get(name, [name]) for name in entry["tests"]]
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
        if count:
            files = ", ".join(path.relative_to(self.root).as_posix() for path in holding)
            return f"its text stands {count} times: in {files}"
        return f"its text is gone{self._nearest(mutant, package)}"

    def _nearest(self, mutant: Mutant, package: Path) -> str:
        """Where a line like the mutant's longest stands now, in words."""
        longest = max(mutant.old.splitlines(), key=len).strip()
        lines = {
            line.strip(): f"{path.relative_to(self.root).as_posix()}:{number}"
            for path in self._sources
            if path.is_relative_to(package)
            for number, line in enumerate(self._text(path).splitlines(), 1)
            if len(longest) <= 2 * len(line.strip()) <= 4 * len(longest)
        }
        found = difflib.get_close_matches(longest, lines, n=1)
        return f"; nearest: {lines[found[0]]}: {found[0]}" if found else ""

    def missing_tests(self, mutant: Mutant) -> list[str]:
        """The mutant's tests that are not there."""

        def is_there(test: str) -> bool:
            file, _, function = test.partition("::")
            path = self.root / file
            return path.is_file() and (not function or f"def {function}(" in self._text(path))

        return [test for test in mutant.tests if not is_there(test)]

    def fingerprint(self, mutant: Mutant, killers: Sequence[str]) -> str:
        """Of what an outcome hangs on: the change, its file, and the killers or else all tests."""
        place = self.find(mutant)
        assert isinstance(place, Path)
        tests = killers or mutant.tests
        files = [place, *(self.root / test.partition("::")[0] for test in tests)]
        parts = [mutant.old, mutant.new, str(mutant.interpreted), *tests]
        parts += [self._text(file) for file in files if file.is_file()]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


class Scratch:
    """A copy of a tree to change and to run tests in.

    Compiled code is kept by content, so all copies and runs keep it in one place.
    """

    def __init__(self, folder: Path, of: Path) -> None:
        self.root = folder
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
        compiled = Path("twin", "__pycache__", "compiled")
        kept = of / KEPT / "compiled"
        if not kept.is_dir():
            kept.mkdir(parents=True, mode=0o700)
            if (of / compiled).is_dir():
                shutil.copytree(of / compiled, kept, dirs_exist_ok=True)
        (folder / compiled).parent.mkdir(exist_ok=True)
        (folder / compiled).symlink_to(kept)
        self._output = folder / ".pytest.out"
        self._server = subprocess.Popen(
            [sys.executable, Path(__file__).with_name("pytest_server.py")],
            cwd=folder, text=True, bufsize=1, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def close(self) -> None:
        """End its process."""
        self._server.communicate()

    def failures(
        self, tests: Sequence[str], *, interpreted: bool, first: bool, processes: int = 0
    ) -> list[str]:
        """The tests that fail, without their cases; with `first` the first one, and within limits.

        All of `tests` where they took too long or the process crashed.

        Raises:
          SystemExit: pytest could not run them.
        """
        words = [
            "-q",
            "-pno:cacheprovider",
            "--assert=plain",
            f"-n{processes}",
            *(["-x"] if first else []),
        ]
        pytests = dict.fromkeys(name for name in os.environ if name.startswith("PYTEST_"))
        environment = pytests | {
            "PYTHONPATH": str(self.root),
            "CI": "1",  # hypothesis tries the same examples every time
            "NUMBA_DISABLE_JIT": "1" if interpreted else None,
        }
        order = {
            "root": str(self.root), "arguments": [*words, *tests], "environment": environment,
            "seconds": WORK_S if first else None, "output": str(self._output),
        }  # fmt: skip
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        self._server.stdin.write(json.dumps(order) + "\n")
        group = int(self._server.stdout.readline())

        def end() -> None:  # with every process that the tests started
            with contextlib.suppress(ProcessLookupError):
                os.killpg(group, signal.SIGKILL)

        patience = threading.Timer(PATIENCE_S, end)
        if first:
            patience.start()
        code = int(self._server.stdout.readline())
        patience.cancel()
        end()
        said = self._output.read_text(errors="replace")
        if code in (FAILED, BROKEN) or code < 0:  # below 0: it crashed, or took too long
            return sorted(set(FAILURE.findall(said))) or list(tests)
        if "while loading conftest" in said:  # which imports the package
            return list(tests)
        if code:
            raise SystemExit(f"mutate: pytest could not run {' '.join(tests)}:\n{said}")
        return []

    def killers(self, mutant: Mutant) -> list[str]:
        """The tests that fail with the mutant in place."""
        path = Tree(self.root).find(mutant)
        assert isinstance(path, Path)
        whole = path.read_text()
        self._versions += 1
        try:
            path.write_text(whole.replace(mutant.old, mutant.new))
            os.utime(path, (self._clock + self._versions, self._clock + self._versions))
            return self.failures(mutant.tests, interpreted=mutant.interpreted, first=True)
        finally:
            path.write_text(whole)
            os.utime(path, (self._clock, self._clock))


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


class Kept:
    """What ran, in a file: a line for each mutant with the tests that killed it."""

    def __init__(self, path: Path, tree: Tree, mutants: Iterable[Mutant]) -> None:
        self._path, self._tree, self._lock = path, tree, threading.Lock()
        path.parent.mkdir(parents=True, exist_ok=True)
        ran: dict[str, dict[str, Any]] = {}
        for line in path.read_text().splitlines() if path.is_file() else ():
            with contextlib.suppress(json.JSONDecodeError):  # half a line of a run that was killed
                entry = json.loads(line)
                ran[entry["mutant"]] = entry
        self.killers: dict[Mutant, list[str]] = {}
        for mutant in mutants:
            entry = ran.get(mutant.name)
            if entry and entry["of"] == tree.fingerprint(mutant, entry["killers"]):
                self.killers[mutant] = entry["killers"]

    def add(self, mutant: Mutant, killers: list[str]) -> None:
        """One more; at once in the file."""
        of = self._tree.fingerprint(mutant, killers)
        line = json.dumps({"mutant": mutant.name, "killers": killers, "of": of})
        with self._lock, self._path.open("a") as file:
            self.killers[mutant] = killers
            file.write(line + "\n")


def run_all(mutants: list[Mutant], jobs: int, folder: Path) -> dict[Mutant, str]:
    """Run the mutants in `jobs` copies of the tree; the ones that survived, and why."""
    copies = [Scratch(folder / str(job), ROOT) for job in range(jobs)]
    kept = Kept(ROOT / KEPT / "ran.jsonl", Tree(copies[0].root), mutants)
    waiting, errors = queue.SimpleQueue[Mutant](), list[SystemExit]()
    for mutant in mutants:
        if mutant not in kept.killers:
            waiting.put(mutant)
    print(f"{len(mutants) - waiting.qsize()} of {len(mutants)} mutants are kept", flush=True)

    def work(scratch: Scratch) -> None:
        while not errors:
            try:
                mutant = waiting.get_nowait()
            except queue.Empty:
                return
            begun = time.monotonic()
            try:
                killers = scratch.killers(mutant)
            except SystemExit as error:
                errors.append(error)
                return
            kept.add(mutant, killers)
            word = "killed" if killers else "SURVIVED"
            by = f" by {killers[0]}" if killers else ""
            print(f"{word:8} {time.monotonic() - begun:5.1f} s  {mutant.label}{by}", flush=True)

    threads = [threading.Thread(target=work, args=[copy]) for copy in copies]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]
    survived = {m: "no test fails" for m in mutants if not kept.killers[m]}
    for interpreted in (False, True):
        by = {m: kept.killers[m] for m in mutants if m.interpreted is interpreted}
        tests = sorted({test for killers in by.values() for test in killers})
        # a file stands for its functions
        tests = [t for t in tests if "::" not in t or t.partition("::")[0] not in tests]
        processes = jobs if jobs > 1 else 0
        failing = tests and copies[0].failures(
            tests, interpreted=interpreted, first=False, processes=processes
        )
        files = {test.partition("::")[0] for test in failing}
        survived |= {
            mutant: f"{killers[0]} fails without any change"
            for mutant, killers in by.items()
            if killers and (set(killers) & set(failing) or set(killers) <= files)
        }
    for copy in copies:
        copy.close()
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
    tree = Tree(ROOT)
    gone = lost(tree, mutants)
    for mutant, why in gone.items():
        print(f"GONE      {mutant.label}: {why}")
    for mutant in mutants:
        place = tree.find(mutant)
        if isinstance(place, Path) and place != ROOT / mutant.file:
            print(f"MOVED     {mutant.label}: now in {place.relative_to(ROOT).as_posix()}")
    equivalent = [m for m in mutants if m.equivalent]
    for mutant in equivalent:
        print(f"equivalent {mutant.label}: {mutant.equivalent}")
    if options.list:
        print(f"{len(mutants)} mutants, {len(equivalent)} of them equivalent; {len(gone)} are gone")
        return 1 if gone else 0
    to_run = [m for m in mutants if m not in gone and not m.equivalent]
    to_run.sort(key=lambda m: not m.placed)
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        survived = run_all(to_run, options.jobs, Path(folder)) if to_run else {}
    for mutant, why in survived.items():
        print(f"SURVIVED  {mutant.label}: {why}")
    share = 1.0
    for kind, group in (
        ("placed ", [m for m in mutants if m.placed]),
        ("hand-made ", [m for m in mutants if not m.placed]),
        ("", mutants),
    ):
        ran = [m for m in group if not m.equivalent]
        alive, missing = sum(m in survived for m in ran), sum(m in gone for m in ran)
        killed = len(ran) - alive - missing
        share = killed / len(ran) if ran else 1.0
        print(
            f"{killed} of {len(ran)} {kind}mutants killed ({share:.1%}); {alive} survived, "
            f"{missing} gone, {len(group) - len(ran)} equivalent; {GOAL:.0%} must be killed"
        )
    return 0 if share >= GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
