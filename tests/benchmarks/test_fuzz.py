"""Damaged logs of every importer: sound, or refused in one line; and what counts as a failure."""

import dataclasses
import json
import warnings

import numpy as np
import pytest

import factory.importing
from benchmarks import fuzz
from benchmarks.damage import COLUMNS, OPERATIONS, read_columns, write_columns
from benchmarks.fuzz import UNDAMAGED, Mutant, Verdict, judge
from factory.importing import IMPORTERS
from factory.importing.tally import Entry
from twin.errors import InputError

pytest.importorskip("dbdreader")
pytest.importorskip("rosbags")
pytest.importorskip("pymavlink")
pytest.importorskip("imcpy")

FRESH = 40
"""Mutants that no list has"""
KEPT = json.loads(fuzz.CORPUS.read_text())
"""Names of mutants that failed once"""


@pytest.fixture(scope="module")
def verdicts():
    """Verdicts by name: undamaged logs of every layout, fresh mutants, and those that are kept."""
    given = [*fuzz.drawn(FRESH, 3), *map(Mutant.parse, KEPT)]
    found = {one.mutant.name: one for one in fuzz.run(given)}
    assert set(found) == {mutant.name for mutant in given}
    return found


def test_no_mutant_fails(verdicts):
    assert {name: one.failures for name, one in verdicts.items() if one.failures} == {}


def test_undamaged_logs_of_every_importer_are_read(verdicts):
    sound = [one for one in verdicts.values() if one.mutant.operation == UNDAMAGED]
    assert {one.outcome for one in sound} == {"read"}
    logs = {kind for kind, one in IMPORTERS.items() if not one.takes_camera}
    assert {one.mutant.kind for one in sound} == logs


def test_every_operation_reaches_every_layout_that_it_can():
    every = {(one.layout, one.operation) for one in fuzz.drawn(len(OPERATIONS) * 20, 1)}
    for layout in fuzz.LAYOUTS:
        done = {operation for name, operation in every if name == layout}
        assert set(OPERATIONS) - done <= set(COLUMNS)


def test_a_name_makes_its_mutant_again(tmp_path):
    mutant = Mutant.parse("og1:0/values/7")
    assert mutant.name == "og1:0/values/7"
    made = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        assert fuzz.prepare(mutant, tmp_path / name, None) == "deployment.nc"
        columns = read_columns(tmp_path / name / "deployment.nc")
        made.append({key: column.values.tobytes() for key, column in columns.items()})
    assert made[0] == made[1]
    sound = Mutant("og1:0", UNDAMAGED, 0)
    (tmp_path / "c").mkdir()
    fuzz.prepare(sound, tmp_path / "c", None)
    columns = read_columns(tmp_path / "c" / "deployment.nc")
    assert {key: column.values.tobytes() for key, column in columns.items()} != made[0]


@pytest.mark.parametrize("layout", ["slocum:0", "og1:0", "lrauv:0"])
def test_columns_that_are_not_damaged_are_written_as_they_were(layout, tmp_path):
    fuzz.prepare(Mutant(layout, UNDAMAGED, 0), tmp_path, None)
    path = sorted(tmp_path.iterdir())[0]
    before, again = read_columns(path), read_columns(path)
    write_columns(path, again)
    after = read_columns(path)
    assert set(after) == set(before)
    for name, column in before.items():
        np.testing.assert_array_equal(column.values, after[name].values)
        assert column.attributes.keys() == after[name].attributes.keys()


def judged(import_logs, folder, monkeypatch, operation="bits"):
    """Failures of an importer that does as it is told with a sound log."""
    mutant = Mutant("seaexplorer:0", operation, 0)
    (folder / "logs").mkdir()
    fuzz.prepare(Mutant(mutant.layout, UNDAMAGED, 0), folder / "logs", None)
    monkeypatch.setattr(factory.importing, "import_logs", import_logs)
    verdict = Verdict(mutant)
    judge(mutant, verdict, folder, [])
    return verdict.failures


def test_what_an_import_may_not_do_is_a_failure(tmp_path, monkeypatch):
    right = factory.importing.import_logs

    def raises(error):
        def import_logs(*words, **options):
            raise error

        return import_logs

    def warns(*words, **options):
        warnings.warn("of a library", stacklevel=1)
        return right(*words, **options)

    def writes(kind, paths, **options):
        (paths[0] / "new").touch()
        return right(kind, paths, **options)

    def far(*words, **options):
        dataset, report = right(*words, **options)
        dataset["start_latitude"] += 100.0
        return dataset, report

    for k, (wrong, said) in enumerate(
        [
            (raises(KeyError("x")), "KeyError: 'x'"),
            (raises(InputError("two\nlines")), "message of 9 characters"),
            (raises(InputError(" ")), "message of 1 characters"),
            (warns, "UserWarning: of a library"),
            (writes, "the folder of the logs was changed"),
            (far, "not told: fixes"),
        ]
    ):
        folder = tmp_path / str(k)
        folder.mkdir()
        assert said in " ".join(judged(wrong, folder, monkeypatch)), said
    (tmp_path / "right").mkdir()
    assert judged(right, tmp_path / "right", monkeypatch) == []
    (tmp_path / "refused").mkdir()
    assert judged(raises(InputError("a is damaged")), tmp_path / "refused", monkeypatch) == []


def test_what_an_undamaged_log_loses_is_a_failure(tmp_path, monkeypatch):
    right = factory.importing.import_logs

    def worse(*words, **options):
        dataset, report = right(*words, **options)
        odd = Entry("suspect", "measured_roll", 1, "rolls")
        return dataset, dataclasses.replace(report, rows=1, entries=(*report.entries, odd))

    found = judged(worse, tmp_path, monkeypatch, UNDAMAGED)
    assert "1 dives of undamaged logs, not 2" in found
    assert "suspect undamaged logs: measured_roll: rolls" in found


def test_the_end_of_its_process_is_a_failure():
    (one,) = fuzz.run([Mutant("og1:0", UNDAMAGED, 0)], target=print)
    assert one.failures == ["its process ended with 0"]


def test_names_that_are_kept_are_of_layouts_that_there_are():
    assert sorted(set(KEPT)) == KEPT
    assert {Mutant.parse(name).layout for name in KEPT} <= set(fuzz.LAYOUTS)
