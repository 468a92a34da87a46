"""The paper: it builds, cites what it lists, and its figures are those of the documents."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "paper"
HEAD, TEXT = (FOLDER / "paper.md").read_text().removeprefix("---\n").split("\n---\n", 1)
LIBRARY = (FOLDER / "paper.bib").read_text()


def test_its_head_has_what_the_journal_asks_for() -> None:
    head = yaml.safe_load(HEAD)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(head)
    indices = {entry["index"] for entry in head["affiliations"]}
    assert all(author["affiliation"] in indices for author in head["authors"])
    assert head["bibliography"] == "paper.bib"


def test_it_is_as_long_as_the_journal_wants_and_has_its_sections() -> None:
    sections = re.findall(r"^# (.+)$", TEXT, re.MULTILINE)
    assert sections[:2] == ["Summary", "Statement of need"]
    assert sections[-1] == "References"
    assert 250 < len(re.findall(r"[A-Za-z]{2,}", TEXT)) < 1000


def test_everything_cited_is_listed_and_everything_listed_is_cited() -> None:
    cited = set(re.findall(r"@([A-Za-z]+\d{4})", TEXT))
    listed = re.findall(r"^@\w+\{(\w+),$", LIBRARY, re.MULTILINE)
    assert sorted(cited) == sorted(listed)


def test_its_figures_are_those_of_the_documents() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs" / "results").glob("*.md")]
    documents = "\n".join(page.read_text() for page in pages)
    rows = re.findall(r"^\| (.+?) \| (.+?) \| `(.+?)` \|$", TEXT, re.MULTILINE)
    assert len(rows) >= 5
    for what, figure, command in rows:
        assert command in documents, what
        for number in re.findall(r"\d[\d.]*(?:e-?\d+)?", figure):
            assert re.search(rf"(?<![\d.]){re.escape(number)}(?!\d)", documents), (what, number)
    for picture in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", TEXT):
        assert (FOLDER / picture).is_file()


@pytest.mark.skipif(shutil.which("pandoc") is None, reason="pandoc is not installed")
def test_it_builds_without_a_warning(tmp_path: Path) -> None:
    page = tmp_path / "paper.html"
    command = ["pandoc", "paper.md", "--citeproc", "--fail-if-warnings", "-s", "-o", page]
    subprocess.run(command, cwd=FOLDER, check=True, capture_output=True)
    built = re.sub(r"<[^>]+>|\s+", " ", page.read_text())
    assert "Ocean Engineering 60" in " ".join(built.split())
    assert "???" not in built
