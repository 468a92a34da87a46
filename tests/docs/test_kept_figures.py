"""A digit of a page is the digit that was measured: docs/results/figures.json has each."""

import json
import re
import shutil
import subprocess

import pytest
import yaml
from examples import ROOT, needs_docs, script

pytestmark = needs_docs

RESULTS = ROOT / "docs" / "results"
ELSEWHERE = {
    "real_logs.md": "tests/docs/test_kept_figures.py",
    "health_real.md": "tests/benchmarks/test_health.py",
    "validation.md": "tests/docs/test_site.py",
    "dead_reckoning.md": "tests/benchmarks/test_dead_reckoning.py",
}
"""Pages of results that another test compares with what was measured or is computed"""
PAGES = [page for page in sorted(RESULTS.glob("*.md")) if page.name not in ELSEWHERE]


@pytest.fixture
def figures(monkeypatch):
    """benchmarks/figures.py"""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import figures

    return figures


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_figure_of_a_page_is_the_one_in_the_file(page, figures):
    """After a measurement: python -m benchmarks.figures, as its docstring says."""
    assert figures.wrong(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_table_with_figures_is_marked(page):
    text = page.read_text(encoding="utf-8")
    blocks = text.split("\n\n")
    for before, block in zip(["", *blocks], blocks, strict=False):
        if re.match(r"\|.*\n\|[-| ]+\|\n(?:.*\n)*.*\d", block):
            assert before.startswith("<!-- figures: "), block.splitlines()[0]


def test_the_file_has_nothing_that_no_page_shows(figures):
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    kept = figures.load()
    assert {key for _, _, key in figures.ONE.findall(text)} == set(kept["measured"])
    assert {key for key, _ in figures.MANY.findall(text)} == set(kept["tables"])
    assert all(
        re.fullmatch(r"20\d\d-\d\d", one["date"]) for k in kept.values() for one in k.values()
    )


def test_every_benchmark_of_the_file_measures_its_figures(figures):
    for key in figures.load()["measured"]:
        benchmark, _, name = key.partition(".")
        code = (ROOT / "benchmarks" / f"{benchmark}.py").read_text(encoding="utf-8")
        assert f'"{benchmark}"' in code, key
        assert name in code or "of_{count}" in code, key


def test_a_changed_digit_shows(figures):
    for page, old, new in [
        ("networks.md", "2.1e-7 (1.7e-7", "2.2e-7 (1.7e-7"),
        (
            "networks.md",
            "The mean error at the end is then 1.05 %",
            "The mean error at the end is then 1.04 %",
        ),
        ("performance.md", "36 000 to 79 000", "36 000 to 79 100"),
        ("performance.md", "3 min 7 s", "3 min 8 s"),
        (
            "truth.md",
            "within the ellipses of 50 and 90 % | 0.51",
            "within the ellipses of 50 and 90 % | 0.52",
        ),
    ]:
        text = (RESULTS / page).read_text(encoding="utf-8")
        assert text.count(old) == 1
        assert len(figures.wrong(text.replace(old, new))) in (1, 2)


def test_what_a_benchmark_measures_is_kept_and_widens_a_range(figures, tmp_path, monkeypatch):
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


# --- The figures of docs/results/real_logs.md are those that the benchmark measured and stored


def test_every_table_of_the_page_is_what_was_measured(monkeypatch):
    """`python -m benchmarks.real_logs FOLDER --keep` wrote what the page shows; `make docs` shows
    the tables of all tasks."""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks.real_logs.row import kept, tables
    from benchmarks.real_logs.truth import table

    rows = kept()
    made = tables(rows)
    assert len(made) >= 20
    kept_tables = {one.strip() for one in made.values()}
    page = (ROOT / "docs" / "results" / "real_logs.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\|[^\n]*\(95 %\)[^\n]*\n(?:\|.*\n)+", page, re.MULTILINE)
    assert len(shown) >= 4
    wrong = [one.splitlines()[0] for one in shown if one.strip() not in kept_tables]
    assert not wrong, f"real_logs.md differs from benchmarks/real_logs/measured.json: {wrong}"
    everything = script("docs_reference").generated_pages()["results/real_logs_tables.md"]
    assert all(one in everything for one in made.values())
    assert table(rows) in (RESULTS / "truth.md").read_text(encoding="utf-8")
    assert table(rows, whole=True) in everything
    assert not re.search("corrected|hindsight", table(rows, whole=True))


# --- What the evidence claims of speed stands in docs/results/performance.md, with its command


PAGE = RESULTS / "performance.md"
BENCH = "physics_step"
"""The benchmark that is also the command `twin bench`"""


def rows(text):
    """What was measured with its figure, and the command, of tables `what | figure | command`."""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and len(cells) == 3 and "`" in cells[2]:
            yield f"{cells[0]}: {cells[1]}", cells[2]


def numbers(figure):
    """The numbers of a text, thousands joined: `36 000` and `36,000` are 36000."""
    joined = re.sub(r"(?<=\d)[ ,](?=\d{3}\b)", "", figure)
    return set(re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", joined))


def program(command):
    """The first command of a cell, without its options and arguments."""
    words = re.search(r"`([^`]+)`", command)
    assert words is not None, command
    found = re.match(r"python -m benchmarks\.\w+|[a-z]+ [a-z]+", words[1])
    assert found is not None, command
    return found[0]


def test_the_evidence_claims_what_the_page_has():
    """Or what the page has that a row links to."""
    page = {}
    for figure, command in rows(PAGE.read_text()):
        page.setdefault(program(command), set()).update(numbers(figure))
    compared = 0
    for figure, command in rows((RESULTS / "truth.md").read_text()):
        linked = re.search(r"\]\(([\w.]+\.md)", command)
        if linked is not None:
            place, there = linked[1], numbers((RESULTS / linked[1]).read_text())
        elif program(command) in page:
            place, there = PAGE.name, page[program(command)]
        else:
            continue
        missing = numbers(figure) - there
        assert not missing, f"{figure} ({command}): {missing} not in {place}"
        compared += 1
    assert compared >= 10


def test_stars_are_what_make_bench_runs():
    makefile = (ROOT / "Makefile").read_text()
    names = re.search(r"^BENCHMARKS := (.*)$", makefile, re.M)
    assert names is not None
    starred = {program(command) for _, command in rows(PAGE.read_text()) if command.endswith("*")}
    assert starred == {
        "twin bench" if name == BENCH else f"python -m benchmarks.{name}"
        for name in names[1].split()
    }


# --- The paper: it builds, cites what it lists, and its figures are those of the documents


FOLDER = ROOT / "paper"
HEAD, TEXT = (FOLDER / "paper.md").read_text().removeprefix("---\n").split("\n---\n", 1)
LIBRARY = (FOLDER / "paper.bib").read_text()


def test_its_head_has_what_the_journal_asks_for():
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


def test_it_has_the_sections_that_the_journal_requires_and_none_is_empty():
    _, *parts = re.split(r"^# (.+)$", TEXT, flags=re.MULTILINE)
    assert parts[::2] == SECTIONS
    for name, text in zip(parts[::2], parts[1::2], strict=True):
        assert name == "References" or len(text.split()) >= 20, name


def test_it_is_as_long_as_the_journal_wants():
    for words in (TEXT.split(), re.findall(r"[A-Za-z]{2,}", TEXT)):  # however they are counted
        assert 750 <= len(words) <= 1750


def test_everything_cited_is_listed_and_everything_listed_is_cited():
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


def test_its_figures_are_those_of_the_documents():
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
def test_it_builds_without_a_warning(tmp_path):
    page = tmp_path / "paper.html"
    command = ["pandoc", "paper.md", "--citeproc", "--fail-if-warnings", "-s", "-o", page]
    subprocess.run(command, cwd=FOLDER, check=True, capture_output=True)
    built = re.sub(r"<[^>]+>|\s+", " ", page.read_text())
    assert "Ocean Engineering 60" in " ".join(built.split())
    assert "???" not in built
