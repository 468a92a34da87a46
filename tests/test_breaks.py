"""The breaks of docs/project/gates.md can be made: their texts and gates are there."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest
from examples import ROOT, needs_docs, script

pytestmark = needs_docs


@pytest.fixture
def breaks() -> ModuleType:
    """scripts/breaks.py"""
    return script("breaks")


def test_every_text_and_gate_is_there(breaks: ModuleType) -> None:
    assert len(breaks.BREAKS) >= 10
    for one in breaks.BREAKS:
        assert (ROOT / one.file).read_text(encoding="utf-8").count(one.before) == 1, one.name
        assert one.before != one.after
        (place,) = [word for word in one.gate if "/" in word][:1]
        path, _, test = place.partition("::")
        assert test in (ROOT / path).read_text(encoding="utf-8"), one.name


def test_the_page_has_the_table(breaks: ModuleType) -> None:
    page = breaks.PAGE.read_text(encoding="utf-8")
    assert breaks.written(page) == page, "run python scripts/breaks.py --write"


def test_a_break_is_taken_back_and_a_silent_gate_is_told(
    breaks: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr(breaks, "ROOT", tmp_path)
    (tmp_path / "a.py").write_text("x = 1\n")
    gate = ("-c", "import pathlib, sys; sys.exit('2' in pathlib.Path('a.py').read_text())")
    change = breaks.Break("a digit", "a.py", "1", "2", gate)
    monkeypatch.setattr(
        breaks, "BREAKS", (change, breaks.Break("no change", "a.py", "1", "3", gate))
    )
    assert breaks.main([]) == 1
    assert capsys.readouterr().out == "noticed  a digit\nSILENT   no change\n"
    assert breaks.main(["--only", "digit"]) == 0
    assert (tmp_path / "a.py").read_text() == "x = 1\n"
    (tmp_path / "a.py").write_text("x = 1 + 1\n")
    with pytest.raises(ValueError, match="2 times, not once"):
        breaks.noticed(change)
