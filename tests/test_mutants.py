"""Changes of the code at places drawn by chance: they change it, and tests that prove notice."""

import ast
import json
from itertools import islice

import pytest
from examples import script

mutate = script("mutate")

SOURCE = '''
"""A law."""

SLOPE: float = 2.0

def lift(angle, speed, table):
    """[N]"""
    if speed < 0.0 and angle is not None:
        raise ValueError(f"no {speed * 2}")
    return SLOPE * angle + max(table[0], speed)
'''
TEST = """
from twin.wing import lift

def test_lift():
    assert lift(3.0, 1.0, [5.0, 7.0]) == 11.0
"""
CHANGES = {
    "2.0 -> 2.2", "speed < 0.0 -> (speed <= 0.0)", "0.0 -> 1.0", "0 -> 1",
    "angle is not None -> (angle is None)", "SLOPE * angle -> (SLOPE / angle)",
    "speed < 0.0 and angle is not None -> (speed < 0.0 or angle is not None)",
    "SLOPE * angle + max(table[0], speed) -> (SLOPE * angle - max(table[0], speed))",
    "max(table[0], speed) -> max(speed, table[0])",
}  # fmt: skip
"""All that can be changed: no annotation, no text of an error, no docstring"""


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A small tree with one module and one test."""
    files = {"twin/__init__.py": "", "twin/wing.py": SOURCE, "tests/twin/test_wing.py": TEST}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(mutate, "ROOT", tmp_path)
    return tmp_path


def drawn(seed):
    return iter(mutate.drawn(seed, ""))


def test_every_place_is_drawn_once_in_an_order_of_the_seed(tree):
    names = [one.name.partition(": ")[2] for one in drawn(1)]
    assert sorted(names) == sorted(CHANGES)
    assert names == [one.name.partition(": ")[2] for one in drawn(1)]
    assert names != [one.name.partition(": ")[2] for one in drawn(2)]


def test_the_tests_of_the_area_notice(tree, capsys):
    assert mutate.tests_of("twin/wing.py") == (["tests/twin/test_wing.py"], [])
    code = mutate.main(["--seed", "1", "--count", "9"])
    said = capsys.readouterr().out.splitlines()
    unnoticed = {line.partition(": ")[2] for line in said if "UNNOTICED" in line}
    assert unnoticed == {  # which no values of this test tell
        "max(table[0], speed) -> max(speed, table[0])",
        "speed < 0.0 -> (speed <= 0.0)",
        "0.0 -> 1.0",
        "angle is not None -> (angle is None)",
    }
    assert code == 1
    assert (tree / "twin" / "wing.py").read_text() == SOURCE
    kept = (tree / "build" / "mutants" / "1.jsonl").read_text().splitlines()
    assert len(kept) == 9
    assert mutate.main(["--seed", "1", "--count", "9"]) == 1  # nothing runs again
    assert (tree / "build" / "mutants" / "1.jsonl").read_text().splitlines() == kept
    assert all(json.loads(line)["by"] for line in kept if json.loads(line)["noticed"])


def test_changes_of_the_product_are_code():
    for one in islice(mutate.drawn(5, "twin/sensors"), 40):
        whole = (mutate.ROOT / one.file).read_text()
        changed = whole[: one.first] + one.new + whole[one.first + len(one.old) :]
        assert whole[one.first :].startswith(one.old)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(whole))
