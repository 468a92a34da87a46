"""The table of mutants stands: every text is there once, and the changes are all over the tree."""

from __future__ import annotations

import ast
import json
import subprocess
from pathlib import Path

import pytest
from examples import ROOT, script

mutate, place_mutants = script("mutate"), script("place_mutants")

SOURCE = '''
"""A law."""

import math

SLOPE = 2.0

def lift(angle, speed):
    """[N]"""
    if speed < 0.0:
        raise ValueError("no")
    return SLOPE * math.sin(angle) + 0.5 * speed
'''
TEST = "def test_lift():\n    pass\n"
FILES = {"twin/__init__.py": "", "twin/wing.py": SOURCE, "tests/test_wing.py": TEST}


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A small tree with one module and one test; it returns the exit code and what is printed."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(mutate, "ROOT", tmp_path)
    monkeypatch.setattr(place_mutants, "ROOT", tmp_path)
    return tmp_path


def listed(tree, capsys, *mutants):
    """Exit code and last line of `--list` for a table of these mutants."""
    text = "".join(place_mutants.entry(mutant) for mutant in mutants)
    (tree / "mutants.toml").write_text(text)
    code = mutate.main(["--table", str(tree / "mutants.toml"), "--list"])
    return code, capsys.readouterr().out.splitlines()[-1]


def mutant(old="math.sin(angle)", file="twin/wing.py", test="tests/test_wing.py"):
    return {"file": file, "old": old, "new": "0.0", "tests": [test]}


def test_every_text_and_test_of_the_table_is_there(capsys):
    code = mutate.main(["--list"])
    said = capsys.readouterr().out
    assert code == 0, said
    assert said.splitlines()[-1].endswith("; 0 are gone")


def test_placed_mutants_change_what_python_runs():
    tree = mutate.Tree(ROOT)
    for one in mutate.read_table(mutate.TABLE):
        path = tree.find(one)
        if isinstance(path, Path) and path.suffix == ".py":
            whole = path.read_text()
            changed = whole.replace(one.old, one.new)
            assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(whole)), one.label


def test_a_text_that_is_gone_or_stands_twice_is_counted(tree, capsys):
    assert listed(tree, capsys, mutant()) == (0, "1 mutants, 0 of them equivalent; 0 are gone")
    for lost in (mutant(old="math.tan(angle)"), mutant(old="speed"), mutant(file="factory/a.py")):
        assert listed(tree, capsys, mutant(), lost) == (
            1,
            "2 mutants, 0 of them equivalent; 1 are gone",
        )


def test_a_lost_text_is_named_with_its_files_or_the_nearest_line(tree, capsys):
    def said(*mutants):
        (tree / "mutants.toml").write_text("".join(map(place_mutants.entry, mutants)))
        mutate.main(["--table", str(tree / "mutants.toml"), "--list"])
        return capsys.readouterr().out

    assert "nearest: twin/wing.py:6: SLOPE = 2.0" in said(mutant(old="SLOPES = 2.0"))
    assert "stands 2 times in twin/wing.py" in said(mutant(old="SLOPE "))
    (tree / "twin" / "copy.py").write_text(SOURCE)
    elsewhere = mutant(file="twin/gone.py")
    assert "stands 2 times: in twin/copy.py, twin/wing.py" in said(elsewhere)
    (tree / "twin" / "wing.py").unlink()
    assert "now in twin/copy.py" in said(elsewhere)


def test_a_test_that_is_gone_is_counted(tree, capsys):
    there, gone = "tests/test_wing.py::test_lift", "tests/test_wing.py::test_drag"
    assert listed(tree, capsys, mutant(test=there))[0] == 0
    assert listed(tree, capsys, mutant(test=gone))[0] == 1
    assert listed(tree, capsys, mutant(test="tests/test_fin.py"))[0] == 1


def test_a_text_is_found_in_the_file_that_it_was_moved_to(tree, capsys):
    (tree / "twin" / "laws").mkdir()
    (tree / "twin" / "wing.py").rename(tree / "twin" / "laws" / "lift.py")
    assert listed(tree, capsys, mutant())[0] == 0
    (tree / "twin" / "copy.py").write_text(SOURCE)
    assert listed(tree, capsys, mutant())[0] == 1


def test_a_lost_mutant_counts_as_survived(tree, capsys):
    listed(tree, capsys, mutant(old="math.tan(angle)"))
    assert mutate.main(["--table", str(tree / "mutants.toml")]) == 1
    said = capsys.readouterr().out.splitlines()[-1]
    assert said.startswith("0 of 1 mutants killed (0.0%); 0 survived, 1 gone")


@pytest.mark.parametrize(
    ("assertion", "word", "why"),
    [
        ("lift(0.5, 0.0) == 2.0 * math.sin(0.5)", "killed", "by tests/test_wing.py::test_lift"),
        ("lift(0.0, 2.0) == 1.0", "SURVIVED", "no test fails"),
        ("lift(0.5, 0.0) == 7.0", "SURVIVED", "test_lift fails without any change"),
    ],
)
def test_a_mutant_is_killed_by_a_test_that_fails_with_it_alone(tree, capsys, assertion, word, why):
    """The change takes the lift away: a test of drag alone lets it live."""
    (tree / "tests" / "test_wing.py").write_text(
        f"import math\nfrom twin.wing import lift\n\ndef test_lift():\n    assert {assertion}\n"
    )
    subprocess.run(["git", "init", "-q"], cwd=tree, check=True)
    listed(tree, capsys, mutant())
    code = mutate.main(["--table", str(tree / "mutants.toml"), "--jobs", "1"])
    said = capsys.readouterr().out.splitlines()
    assert code == (0 if word == "killed" else 1)
    assert any(line.startswith(word) and why in line for line in said), said


@pytest.mark.parametrize("killers", [["tests/test_wing.py::test_lift"], []])
@pytest.mark.parametrize("changed", ["twin/wing.py", "tests/test_wing.py"])
def test_what_ran_is_kept_until_its_file_or_its_tests_change(tree, killers, changed):
    (tree / "mutants.toml").write_text(place_mutants.entry(mutant()))
    (one,) = mutate.read_table(tree / "mutants.toml")

    def kept():
        return mutate.Kept(tree / "ran.jsonl", mutate.Tree(tree), [one])

    kept().add(one, killers)
    with (tree / "ran.jsonl").open("a") as file:
        file.write('{"mutant": "tw')  # and then it was killed
    assert kept().killers == {one: killers}
    with (tree / changed).open("a") as file:
        file.write("# changed\n")
    assert kept().killers == {}


def test_the_placer_draws_the_same_mutants_from_the_same_seed(tree, monkeypatch):
    (tree / "mutants.toml").write_text("mutant = []\n")
    monkeypatch.setattr(place_mutants, "TABLE", tree / "mutants.toml")
    reached = tree / "reached"
    reached.mkdir()
    what = {"seconds": 0.1, "lines": {"twin/wing.py": [10, 12]}}
    (reached / "a.json").write_text(json.dumps({"tests/test_wing.py::test_lift": what}))
    drawn = [list(place_mutants.place(3, seed, reached)) for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
    assert len(drawn[0]) == 3
    for one in drawn[0]:
        assert SOURCE.count(one["old"]) == 1
        assert one["tests"] == ["tests/test_wing.py"]


def test_the_operators_make_the_slips_of_the_field(tree):
    source = place_mutants.Source(tree / "twin" / "wing.py")
    made = {
        (site.operator, place_mutants.texts(source, site)[1].strip())
        for site in place_mutants.sites(source)
    }
    assert made >= {
        ("factor 2", "SLOPE = 4.0"),
        ("no refusal", "if False:"),
        ("turned comparison", "if speed > 0.0:"),
        ("other function", "return SLOPE * math.cos(angle) + 0.5 * speed"),
        ("plus for minus", "return SLOPE * math.sin(angle) - 0.5 * speed"),
        ("times for over", "return SLOPE / math.sin(angle) + 0.5 * speed"),
        ("dropped term", "return (SLOPE * math.sin(angle))"),
        ("dropped term", "return SLOPE + 0.5 * speed"),
    }
