"""A digit of a page is the digit that was measured: docs/results/figures.json has each."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import ModuleType

import pytest
from examples import ROOT, needs_docs

pytestmark = needs_docs

RESULTS = ROOT / "docs" / "results"
ELSEWHERE = {
    "real_logs.md": "tests/docs/test_real_figures.py",
    "health_real.md": "tests/benchmarks/test_health_real.py",
    "validation.md": "tests/docs/test_site.py",
    "dead_reckoning.md": "tests/benchmarks/test_public_tier.py",
}
"""Pages of results that another test compares with what was measured or is computed"""
PAGES = [page for page in sorted(RESULTS.glob("*.md")) if page.name not in ELSEWHERE]


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """benchmarks/figures.py"""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import figures

    return figures


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_figure_of_a_page_is_the_one_in_the_file(page: Path, figures: ModuleType) -> None:
    """After a measurement: python -m benchmarks.figures, as its docstring says."""
    assert figures.wrong(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_table_with_figures_is_marked(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    blocks = text.split("\n\n")
    for before, block in zip(["", *blocks], blocks, strict=False):
        if re.match(r"\|.*\n\|[-| ]+\|\n(?:.*\n)*.*\d", block):
            assert before.startswith("<!-- figures: "), block.splitlines()[0]


def test_the_file_has_nothing_that_no_page_shows(figures: ModuleType) -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    kept = figures.load()
    assert {key for _, _, key in figures.ONE.findall(text)} == set(kept["measured"])
    assert {key for key, _ in figures.MANY.findall(text)} == set(kept["tables"])
    assert all(
        re.fullmatch(r"20\d\d-\d\d", one["date"]) for k in kept.values() for one in k.values()
    )


def test_every_benchmark_of_the_file_measures_its_figures(figures: ModuleType) -> None:
    for key in figures.load()["measured"]:
        benchmark, _, name = key.partition(".")
        code = (ROOT / "benchmarks" / f"{benchmark}.py").read_text(encoding="utf-8")
        assert f'"{benchmark}"' in code, key
        assert name in code or "of_{count}" in code, key


def test_a_changed_digit_shows(figures: ModuleType) -> None:
    for page, old, new in [
        ("networks.md", "2.1e-7 (1.7e-7", "2.2e-7 (1.7e-7"),
        (
            "networks.md",
            "Single networks without the flight filter have 1.1e-5",
            "Single networks without the flight filter have 9.1e-6",
        ),
        ("performance.md", "36 000 to 79 000", "36 000 to 79 100"),
        ("performance.md", "15 min 50 s", "15 min 51 s"),
        ("evidence.md", "| networks from 200 h | 0.005 %", "| networks from 200 h | 0.006 %"),
    ]:
        text = (RESULTS / page).read_text(encoding="utf-8")
        assert text.count(old) == 1
        assert len(figures.wrong(text.replace(old, new))) in (1, 2)


def test_what_a_benchmark_measures_is_kept_and_widens_a_range(
    figures: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "FILE", tmp_path / "figures.json")
    monkeypatch.setattr(figures, "KEEPING", {"on": False, "fresh": False})
    figures.FILE.write_text('{"measured": {}, "tables": {}}')
    figures.measured("a", speed=1.0)
    assert figures.load()["measured"] == {}
    figures.KEEPING["on"] = True
    figures.measured("a", speed=[1.234567, 1.5])
    figures.measured("a", speed=1.4, other=2.0)
    kept = json.loads(figures.FILE.read_text())["measured"]
    assert kept["a.speed"]["runs"] == [1.235, 1.5]
    assert figures.wrong("1.2 to 1.5 <!-- figure: a.speed -->, 2 <!-- figure: a.other -->") == []
    assert figures.wrong("1.4 <!-- figure: a.speed -->") == []
    assert figures.wrong("1.6 <!-- figure: a.speed -->") != []
    assert figures.wrong("1 <!-- figure: a.gone -->") == ["a.gone is not measured"]
    figures.KEEPING["fresh"] = True
    figures.measured("a", speed=3.0)
    assert figures.load()["measured"]["a.speed"]["runs"] == [3.0]
