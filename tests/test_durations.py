"""Which tests `make quick` leaves out, and that the longest begin."""

import json
import runpy
from types import SimpleNamespace

import pytest
from examples import ROOT, script

SLOW = json.loads((ROOT / "tests" / "slow.json").read_text(encoding="utf-8"))


def test_the_slow_files_are_there():
    """After a move: scripts/durations.py, as CONTRIBUTING.md says."""
    assert [name for name in SLOW if not (ROOT / name).is_file()] == []


CONFTEST = runpy.run_path(str(ROOT / "tests" / "conftest.py"))


def runs(name, *, quick=False, part=None):
    """Whether a run with these options collects a file."""
    options = {"--quick": quick, "--part": part}
    ignored = CONFTEST["pytest_ignore_collect"]
    return ignored(ROOT / name, SimpleNamespace(getoption=lambda o, _=None: options[o])) is None


def test_the_longest_begin_and_a_quick_run_leaves_them_out():
    long, short = "tests/test_mutants.py", "tests/test_durations.py"
    assert long in SLOW
    items = [SimpleNamespace(path=ROOT / name) for name in (short, long)]
    order = CONFTEST["pytest_collection_modifyitems"]
    plain = SimpleNamespace(getoption=lambda _: False)
    order(plain, items)  # a single process takes them as they were asked for
    assert [item.path for item in items] == [ROOT / short, ROOT / long]
    order(SimpleNamespace(workerinput={}, getoption=lambda _: False), items)
    assert [item.path for item in items] == [ROOT / long, ROOT / short]
    order(SimpleNamespace(getoption=lambda name: name == "--backwards"), items)
    assert [item.path for item in items] == [ROOT / short, ROOT / long]
    files = [path.relative_to(ROOT).as_posix() for path in (ROOT / "tests").rglob("test_*.py")]
    fast = {name for name in files if runs(name, quick=True)}
    assert len(fast) > 2
    assert fast == set(files) - set(SLOW)


def test_every_file_is_in_one_part_of_the_tests():
    """`make check` runs all of them, `make test` those of the code."""
    parts = json.loads((ROOT / "tests" / "parts.json").read_text(encoding="utf-8"))
    places = [place for several in parts.values() for place in several]
    assert [one for one in places if not (ROOT / one).exists()] == []
    for path in (ROOT / "tests").rglob("test_*.py"):
        name = path.relative_to(ROOT).as_posix()
        assert sum(runs(name, part=part) for part in ("code", *parts)) == 1, name
        assert runs(name)
    for part, name in (
        ("docs", "tests/docs/test_blocks.py"),
        ("release", "tests/test_packaging.py"),
        ("code", "tests/twin/physics/test_memory.py"),
    ):
        assert runs(name, part=part)
    assert runs("tests", part="docs")
    assert not runs("tests/docs", part="code")


def test_a_report_gives_seconds_of_files(tmp_path):
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
