"""MkDocs hooks of the documentation: generated pages, code blocks and formulas for the site."""

from __future__ import annotations

import html
import logging
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from math_core import LatexError, LatexToMathML
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
for _place in (ROOT, ROOT / "scripts"):
    if str(_place) not in sys.path:
        sys.path.insert(0, str(_place))

from docs_markdown import dead_links, repository_pages  # noqa: E402
from docs_reference import generated_pages  # noqa: E402

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

COMMAND = re.compile(
    r"^ {4}(#!|cat |cd |cmake|export |git |kubectl|make |mkdir |pip |python |sbatch |sudo |ssh "
    r"|twin |factory |learn |[A-Z_]+=\S+ )"
)
PYTHON = re.compile(r"^ {4}(import |from |# \w+\.py$|\w+ = )")
TOML = re.compile(r"^ {4}(# \w+\.toml$|\[)")
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', flags=re.DOTALL)
"""HTML that pymdownx.arithmatex makes of `$...$` and `$$...$$`"""


def on_config(config: MkDocsConfig) -> None:
    """Omit 404.html: its links start at a server's root, but the site opens from a folder."""
    config.theme.static_templates.discard("404.html")


def on_pre_build(**_: Any) -> None:
    """Warn of dead links in pages outside the site; a warning fails a strict build."""
    log = logging.getLogger("mkdocs.hooks.docs")
    for page in repository_pages(ROOT):
        for link in dead_links(page):
            log.warning("%s: dead link %s", page.relative_to(ROOT), link)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are generated from the code."""
    for place, text in generated_pages().items():
        files.append(File.generated(config, place, content=text))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Give every code block of the page a language, for syntax colours."""
    return with_languages(with_titles(markdown))


def on_page_content(content: str, page: Page, **_: Any) -> str:
    """Convert the page's formulas to MathML, which browsers show without a script."""
    try:
        return with_formulas(content)
    except LatexError as error:
        raise PluginError(f"docs/{page.file.src_uri}: {error}") from None


def with_formulas(content: str) -> str:
    """Convert LaTeX to MathML; LatexError for a command that the converter does not know."""
    converter = LatexToMathML(fancy_error=False)

    def formula(found: re.Match[str]) -> str:
        tag, bracket, latex = found.groups()
        latex = html.unescape(latex).strip()
        try:
            made = converter.convert_with_local_state(latex, displaystyle=bracket == "[")
        except LatexError as error:
            raise LatexError(f"formula {latex!r}: {error}") from None
        return f'<{tag} class="formula">{made}</{tag}>'

    return FORMULA.sub(formula, content)


def with_titles(markdown: str) -> str:
    """Use a fence's file name as its title, and remove the words that only tests read."""
    named = re.sub(r"^```(\w+) file=(\S+)$", r'```\1 title="\2"', markdown, flags=re.MULTILINE)
    return re.sub(r"^```(\w+) (?!title=)[\w ]+$", r"```\1", named, flags=re.MULTILINE)


def with_languages(markdown: str) -> str:
    """Convert indented blocks to fences, with the language of their first line."""
    out: list[str] = []
    lines = markdown.split("\n")
    k, fenced = 0, False
    while k < len(lines):
        line = lines[k]
        fenced ^= line.startswith("```")
        if fenced or not _begins(lines, k):
            out.append(line)
            k += 1
            continue
        end = k
        while end < len(lines) and (lines[end].startswith("    ") or not lines[end].strip()):
            end += 1
        block = "\n".join(lines[k:end]).rstrip()
        out += [f"```{_language(block)}", *(row[4:] for row in block.split("\n")), "```", ""]
        k = end
    return "\n".join(out)


def _begins(lines: list[str], k: int) -> bool:
    """True if line k starts an indented code block, and not a list item's text."""
    if not lines[k].startswith("    ") or (k and lines[k - 1].strip()):
        return False
    before = next((row for row in reversed(lines[:k]) if row.strip()), "")
    return not re.match(r"[-*:] |\d+\. |\s|!!! |\?\?\? ", before)


def _language(block: str) -> str:
    first = block.split("\n", 1)[0]
    for language, pattern in (("sh", COMMAND), ("python", PYTHON), ("toml", TOML)):
        if pattern.match(first):
            return language
    return "text"
