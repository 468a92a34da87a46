"""Words: how much there is to read, folder by folder, as a person reads it.

Who needs more words takes them from another row of the table, in the same commit, with the reason;
a row that has fewer is lowered to what it has. `python -m tests.docs.test_words` prints today's
table, with `--pages` that of each page. Code blocks and tables count; front matter, comments and
addresses of links do not. Pages that `make docs` makes whole are not in the checkout and do not
count; tables that scripts write into a page (CONTRIBUTING.md lists them) do.
"""

import re
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MOST = 50_000
"""Words of all pages together"""
SLACK = 300
"""Words that a row may have less than it says before it is lowered"""
WORDS = {
    "CHANGELOG.md": 1064,
    "CONTRIBUTING.md": 667,
    "README.md": 622,
    "docs": 1079,
    "docs/howto": 14449,
    "docs/physics": 4798,
    "docs/project": 2463,
    "docs/reference": 10064,
    "docs/results": 10445,
    "docs/tutorials": 3717,
    "examples": 196,
    "plugins": 432,
}
"""Most words of each folder's pages"""
PLACES = ("*.md", "docs/**/*.md", "examples/**/*.md", "plugins/**/*.md")
NOT_READ = re.compile(
    r"\A---\n.*?\n---\n|<!--.*?-->|</?(?:div|br|img|a|span)\b[^<>\n]*>|(?<=\])\([^)\s]*\)"
    r"|^\|[-:| ]+\|$|^ *```\w*",
    re.MULTILINE | re.DOTALL,
)
"""Front matter, comments, tags, addresses of links, rules of tables and marks of code blocks"""


def words(text: str) -> int:
    """Number of words that a page shows; a sign alone is none."""
    return sum(bool(re.search(r"\w", word)) for word in NOT_READ.sub(" ", text).split())


@cache
def pages() -> dict[str, int]:
    """Words of each page of the checkout, by its path."""
    found = sorted({path for place in PLACES for path in ROOT.glob(place)})
    return {
        path.relative_to(ROOT).as_posix(): words(path.read_text("utf-8"))
        for path in found
        if not {"build", "dist"} & set(path.parts)
    }


def folders() -> dict[str, int]:
    """Words by folder; all plugins are one, and each page of the root is one by itself."""
    found = Counter[str]()
    for name, number in pages().items():
        parts = name.split("/")[:-1]
        found["/".join(parts[:1] if parts[:1] == ["plugins"] else parts) or name] += number
    return dict(found)


@pytest.mark.parametrize("folder", sorted({*WORDS, *folders()}))
def test_no_folder_grows(folder: str) -> None:
    most, number = WORDS.get(folder, 0), folders().get(folder, 0)
    assert number <= most, f"{folder} has {number} words: take them from another row of the table"
    assert number > most - SLACK, f"{folder} has {number} words: lower its row"


def test_the_table_is_within_what_a_reader_is_asked() -> None:
    assert sum(WORDS.values()) <= MOST


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("---\ntitle: A page\n---\n# Two words\n", 2),
        ("| a cell | 3 m |\n|---|:-:|\n| - | `twin check` |\n", 6),
        ("see [one thing](https://a.b/c.md#d) and ![a picture](p.png)\n", 6),
        ("<!-- figures: a.b -->\n\n```sh gallery\ntwin bench\n```\n\n    twin fly   # now\n", 6),
        ('<div class="grid" markdown>\n\nw < v<br>u\n\n</div>\n', 3),
        ('write `<numeric name="drag" data="9.3"/>`\n', 4),
    ],
)
def test_words_are_what_a_person_reads(text: str, number: int) -> None:
    assert words(text) == number


if __name__ == "__main__":
    table = pages() if "--pages" in sys.argv[1:] else folders()
    for name, number in sorted(table.items()):
        print(f'    "{name}": {number},')
    print("all:", sum(table.values()), "of", MOST)
