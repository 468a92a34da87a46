"""Which tests `make quick` leaves out, and that the longest begin."""

from __future__ import annotations

import json
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from examples import ROOT, script

SLOW = json.loads((ROOT / "tests" / "slow.json").read_text(encoding="utf-8"))


def collected(*words: str) -> list[str]:
    """Files of the tests that pytest would run, in their order."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-n0", "--collect-only", "-q", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return list(
        dict.fromkeys(line.split("::")[0] for line in done.stdout.splitlines() if "::" in line)
    )


def test_the_slow_files_are_there() -> None:
    """After a move: scripts/durations.py, as CONTRIBUTING.md says."""
    assert [name for name in SLOW if not (ROOT / name).is_file()] == []


def test_the_longest_begin_and_a_quick_run_leaves_them_out() -> None:
    long, short = "tests/test_mutants.py", "tests/test_durations.py"
    assert long in SLOW
    items = [SimpleNamespace(path=ROOT / name) for name in (short, long)]
    order = runpy.run_path(str(ROOT / "tests" / "conftest.py"))["pytest_collection_modifyitems"]
    plain = SimpleNamespace(getoption=lambda _: False)
    order(plain, items)  # a single process takes them as they were asked for
    assert [item.path for item in items] == [ROOT / short, ROOT / long]
    order(SimpleNamespace(workerinput={}, getoption=lambda _: False), items)
    assert [item.path for item in items] == [ROOT / long, ROOT / short]
    order(SimpleNamespace(getoption=lambda name: name == "--backwards"), items)
    assert [item.path for item in items] == [ROOT / short, ROOT / long]
    fast = collected("--quick", "tests/benchmarks")
    assert len(fast) > 2
    assert not set(fast) & set(SLOW)


def test_every_file_is_in_one_part_of_the_tests() -> None:
    """`make check` runs all of them, `make test` those of the code."""
    parts = json.loads((ROOT / "tests" / "parts.json").read_text(encoding="utf-8"))
    places = [place for several in parts.values() for place in several]
    assert [one for one in places if not (ROOT / one).exists()] == []
    ignored = runpy.run_path(str(ROOT / "tests" / "conftest.py"))["pytest_ignore_collect"]

    def runs(part: str | None, name: str) -> bool:
        options = {"--quick": False, "--part": part}
        return ignored(ROOT / name, SimpleNamespace(getoption=options.get)) is None

    for path in (ROOT / "tests").rglob("test_*.py"):
        name = path.relative_to(ROOT).as_posix()
        assert sum(runs(part, name) for part in ("code", *parts)) == 1, name
        assert runs(None, name)
    for part, name in (
        ("docs", "tests/docs/test_blocks.py"),
        ("release", "tests/test_packaging.py"),
        ("code", "tests/twin/physics/test_memory.py"),
    ):
        assert runs(part, name)
    assert runs("docs", "tests")
    assert not runs("code", "tests/docs")


def test_a_report_gives_seconds_of_files(tmp_path: Path) -> None:
    durations = script("durations")
    report = tmp_path / "report.xml"
    case = '<testcase classname="tests.test_{}" name="a" time="{}"/>'
    cases = [("durations", 0.5), ("mutants.TestClass", 2), ("durations", 1)]
    report.write_text(f"<x>{''.join(case.format(*one) for one in cases)}</x>")
    found = durations.seconds(report)
    assert list(found.items()) == [("tests/test_mutants.py", 2.0), ("tests/test_durations.py", 1.5)]
    report.write_text(f"<x>{case.format('gone', 1)}</x>")
    with pytest.raises(ValueError, match=r"tests\.test_gone is in no file"):
        durations.seconds(report)
