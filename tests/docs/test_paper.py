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


SECTIONS = [
    "Summary",
    "Statement of need",
    "State of the field",
    "Software design",
    "Research impact statement",
    "AI usage disclosure",
    "Acknowledgements",
    "References",
]
"""That the journal requires, https://joss.readthedocs.io/en/latest/paper.html"""


def test_it_has_the_sections_that_the_journal_requires_and_none_is_empty() -> None:
    _, *parts = re.split(r"^# (.+)$", TEXT, flags=re.MULTILINE)
    assert parts[::2] == SECTIONS
    for name, text in zip(parts[::2], parts[1::2], strict=True):
        assert name == "References" or len(text.split()) >= 20, name


def test_it_is_as_long_as_the_journal_wants() -> None:
    for words in (TEXT.split(), re.findall(r"[A-Za-z]{2,}", TEXT)):  # however they are counted
        assert 750 <= len(words) <= 1750


def test_everything_cited_is_listed_and_everything_listed_is_cited() -> None:
    cited = set(re.findall(r"@([A-Za-z]+\d{4})", TEXT))
    listed = re.findall(r"^@\w+\{(\w+),$", LIBRARY, re.MULTILINE)
    assert sorted(cited) == sorted(listed)
    for entry in LIBRARY.strip().split("\n\n"):
        fields = dict(re.findall(r"^  (\w+) = \{(.+)\},?$", entry, re.MULTILINE))
        assert {"author", "title", "year"} <= set(fields), entry
        key = re.match(r"@\w+\{(\w+),", entry)
        assert key is not None
        assert key[1].endswith(fields["year"])
        if not entry.startswith("@misc"):  # programs go by their own names
            letters = re.sub(r"[^A-Za-z]", "", fields["author"].partition(",")[0])
            assert key[1][:-4] == letters


def test_its_figures_are_those_of_the_documents() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    documents = "\n".join(page.read_text() for page in pages)
    rows = re.findall(r"^\| (.+?) \| (.+?) \| `(.+?)` \|$", TEXT, re.MULTILINE)
    assert len(rows) >= 5
    for what, _, command in rows:
        assert command in documents, what
    prose = re.sub(
        r"\]\([^)]*\)(?:\{[^}]*\})?|@\w+", "", TEXT
    )  # no paths, widths, keys of citations
    numbers = re.findall(r"(?<![\w.])\d+(?: \d{3})*(?:\.\d+)?(?:e-?\d+)?", prose)
    assert len(numbers) > 20
    for number in numbers:
        assert re.search(rf"(?<![\d.]){re.escape(number)}(?!\d)", documents), number
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
