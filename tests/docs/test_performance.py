"""What the evidence claims of speed stands in docs/results/performance.md, with its command."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"
PAGE = RESULTS / "performance.md"
BENCH = "physics_step"
"""The benchmark that is also the command `twin bench`"""


def rows(text: str) -> Iterator[tuple[str, str]]:
    """What was measured with its figure, and the command, of tables `what | figure | command`."""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and len(cells) == 3 and "`" in cells[2]:
            yield f"{cells[0]}: {cells[1]}", cells[2]


def numbers(figure: str) -> set[str]:
    """The numbers of a text, thousands joined: `36 000` and `36,000` are 36000."""
    joined = re.sub(r"(?<=\d)[ ,](?=\d{3}\b)", "", figure)
    return set(re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", joined))


def program(command: str) -> str:
    """The first command of a cell, without its options and arguments."""
    words = re.search(r"`([^`]+)`", command)
    assert words is not None, command
    found = re.match(r"python -m benchmarks\.\w+|[a-z]+ [a-z]+", words[1])
    assert found is not None, command
    return found[0]


def test_the_evidence_claims_what_the_page_has():
    """Or what the page has that a row links to."""
    page: dict[str, set[str]] = {}
    for figure, command in rows(PAGE.read_text()):
        page.setdefault(program(command), set()).update(numbers(figure))
    compared = 0
    for figure, command in rows((RESULTS / "evidence.md").read_text()):
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
