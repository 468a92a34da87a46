"""Markdown helpers: plain text and tables of generated pages, and dead links of any page."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

CODE = re.compile(r"^(```+).*?^\1$|`[^`\n]*`", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#{1,6} +(.+?) *#*$", re.MULTILINE)
LINK = re.compile(
    r"\]\(\s*<?([^)\s>]+)|^\[[^\]]+\]:\s*(\S+)|\b(?:href|src)=\"([^\"]+)\"", re.MULTILINE
)
"""Patterns of a link or picture in a line, a link defined below the text, and one in HTML"""


def escaped(text: str) -> str:
    """Escape plain text for Markdown, except for text in backticks."""
    parts = text.split("`")
    for k in range(0, len(parts), 2):
        parts[k] = re.sub(r"([*_\[\]|])", r"\\\1", parts[k].replace("<", "&lt;"))
    return "`".join(parts)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Make a table; cells are Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def anchors(text: str) -> set[str]:
    """Anchors of a page's headings, as a forge makes them."""
    found: dict[str, int] = {}
    for heading in HEADING.findall(re.sub(r"^(```+).*?^\1$", "", text, flags=re.M | re.S)):
        words = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        name = re.sub(r"[^\w\- ]", "", words).strip().lower().replace(" ", "-")
        found[name] = found.get(name, -1) + 1
        if found[name]:
            found[f"{name}-{found[name]}"] = 0
    return {*found, *re.findall(r"\b(?:id|name)=\"([^\"]+)\"", text)}


def dead_links(page: Path) -> list[str]:
    """Links of a repository page to missing files or headings."""
    dead = []
    for link in ("".join(one) for one in LINK.findall(CODE.sub("", page.read_text("utf-8")))):
        if re.match(r"[a-z+]+:|//", link):
            continue
        place, _, anchor = link.partition("#")
        target = page.parent / place if place else page
        if not target.exists() or (
            anchor and target.suffix == ".md" and anchor not in anchors(target.read_text("utf-8"))
        ):
            dead.append(link)
    return dead


def repository_pages(root: Path) -> list[Path]:
    """Pages outside docs/, which a forge shows and no site builds."""
    folders = ("examples", "packaging", "paper")
    beside = (page for folder in folders for page in sorted((root / folder).rglob("*.md")))
    return [*sorted(root.glob("*.md")), *beside]
