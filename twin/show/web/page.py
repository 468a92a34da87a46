"""Page: a mission as one HTML file that holds all it needs and loads nothing."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from markupsafe import Markup

from twin.cli.text_table import printable
from twin.errors import InputError
from twin.records.storage.whole import check_file_target, whole_file
from twin.show.render.shot import Shot, Subject
from twin.show.web.scene import describe

ENDINGS = (".html", ".htm")
LARGEST = 5_000_000
"""[byte] of a page"""
ROWS = 80_000
"""Samples that a page holds at most: what a phone still draws"""
SCRIPTS = tuple(
    f"{name}.js"
    for name in (
        *("record", "format", "marks", "flat", "strip", "space", "shaders", "renderer", "track"),
        *("water", "bodies", "hand", "labels", "scene", "share", "controls", "page"),
    )
)
"""In this order: each uses names of those before it when it is loaded"""


def save_page(path: Path, subject: Subject, shot: Shot, at: float | None = None) -> int:
    """Write the page and return its size [byte].

    Args:
      at: [s] mission time that is shown first.

    Raises:
      InputError: the name does not end in .html, or the shot does not fit the mission.
      WriteError: something is in the way, or the disk refuses.
    """
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"page {path.name}: the ending must be {ENDINGS[0]}")
    check_file_target(path)
    content = page_text(subject, shot, at).encode()
    with whole_file(path) as place:
        place.write_bytes(content)
    return len(content)


def page_text(subject: Subject, shot: Shot, at: float | None = None, largest: int = LARGEST) -> str:
    """The HTML text, thinned until it has at most `largest` bytes; see `channels.thin`.

    Raises:
      InputError: the shot does not fit the mission.
    """
    rows = ROWS
    while True:
        text = assemble(describe(subject, shot, rows, at))
        size = len(text.encode())
        if size <= largest or rows < 4:
            return text
        rows = int(0.95 * rows * largest / size)


def assemble(mission: Mapping[str, Any], *, connect: str = "'none'") -> str:
    """The template with its style, its scripts and a mission.

    Args:
      connect: where the page's script may fetch from, as a content security policy says it.
    """
    # "</script" would end the element; JSON may hold each "<" by its number.
    data = json.dumps(mission, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    whole = {
        "connect": connect,
        "style": _file("page.css"),
        "script": "\n".join(_file(name) for name in SCRIPTS),
        "mission": data,
    }
    form, title = Markup(_file("page.html")), printable(str(mission["title"]))
    return form.format(title=title, **{name: Markup(text) for name, text in whole.items()})


def _file(name: str) -> str:
    return (files("twin.show.web") / name).read_text(encoding="utf-8").rstrip("\n")
