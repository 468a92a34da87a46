"""Sealed figures: a changed bit is found; older files without a seal are read."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

from factory.__main__ import PROGRAM
from learn.files import read_sealed, write_json, write_sealed
from twin.errors import StoreError
from twin.records.storage.whole import whole_folder

FIGURES = {"run": "runs/a", "mse": 0.012345678901234567, "floor": {"dr": None}, "n": [1, 2.5]}


def test_every_flip_in_a_sealed_file_is_found(tmp_path: Path) -> None:
    path = tmp_path / "evaluation.json"
    write_sealed(path, FIGURES)
    assert read_sealed(path, "again") == FIGURES
    whole = path.read_bytes()
    for bit in random.Random(0).sample(range(8 * len(whole)), 300):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        with pytest.raises(StoreError, match="is damaged") as caught:
            read_sealed(path, "again")
        assert "\n" not in str(caught.value)


def test_a_file_without_a_seal_is_read(tmp_path: Path) -> None:
    path = tmp_path / "evaluation.json"
    write_json(path, FIGURES)
    assert read_sealed(path, "again") == FIGURES


def test_verify_takes_every_folder_with_a_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    with whole_folder(run) as folder:
        (folder / "report").mkdir()
        (folder / "report" / "index.html").write_text("a page")
        (folder / "README.md").write_text("a card")
    assert PROGRAM.main(["verify", str(run)]) == 0
    assert f"{run} is sound: 2 files" in capsys.readouterr().out
    (run / "report" / "index.html").write_text("a pagf")
    assert PROGRAM.main(["verify", str(run), "--json"]) == 1
    (problem,) = json.loads(capsys.readouterr().out)["problems"]["files"]
    assert problem.startswith("report/index.html is changed")
