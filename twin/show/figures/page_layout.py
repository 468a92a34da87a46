"""Page layout: reports as one HTML file with embedded figures, which opens without a network.

Functions for captions of figures name the mission and the store.
"""

from __future__ import annotations

import base64
import datetime
import functools
import io
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path

import numpy as np
from markupsafe import Markup, escape
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from twin.cli.text_table import format_number, printable
from twin.records.attributes import DIVE, PRESET, SCENARIO, SEED, SETTINGS, says_simulated
from twin.records.coordinates import (
    NOMINAL,
    START_LATITUDE,
    START_LONGITUDE,
    START_TIME,
    read_place,
)
from twin.records.logged import log_rows, numbers
from twin.records.reader import MissionStore
from twin.records.schema import MISSION
from twin.records.storage.checksums import LIST
from twin.records.storage.whole import check_folder_target, whole_folder

DPI = 200
INDEX, PICTURE = "index.html", ".png"
SHORT = 16  # most characters of a text cell that stays on one line
LETTERS_PER_INCH, LINE_HEIGHT, FONT_SIZE = 13.0, 0.16, 7.5
"""Captions. LETTERS_PER_INCH: a low estimate. LINE_HEIGHT: [in]. FONT_SIZE: [point]"""
MINUTES = "%Y-%m-%d %H:%M"  # format of a date and time in figures


class Page:
    """Builder of a page, block by block; each figure is embedded, and written as PNG beside it.

    Writing the page creates the folder, or replaces an earlier page.

    Args:
      beside: names of other files that such a page has in its folder, see `attach`.

    Raises:
      WriteError: the folder holds something other than a page.
    """

    def __init__(self, folder: Path, title: str, lead: str, *, beside: Sequence[str] = ()) -> None:
        self._folder = folder
        self._ours = functools.partial(_is_page, beside=beside)
        self._attached: dict[str, str] = {}
        self._title = title
        self._body: list[str] = []
        self._pictures: dict[str, bytes] = {}
        check_folder_target(folder, overwrite=True, ours=self._ours)
        self._add('<h1>{}</h1>\n<p class="lead">{}</p>', title, lead)

    def section(self, title: str) -> None:
        """Add a heading."""
        self._add("<h2>{}</h2>", title)

    def say(self, text: str) -> None:
        """Add a paragraph."""
        self._add("<p>{}</p>", _words(text))

    def points(self, texts: Sequence[str]) -> None:
        """Add a list of sentences."""
        self._add("<ul>{}</ul>", _each("<li>{}</li>", ((_words(text),) for text in texts)))

    def numbers(self, figures: Mapping[str, str]) -> None:
        """Add the few most important numbers in large type."""
        cells = _each("<div><dt>{}</dt><dd>{}</dd></div>", figures.items())
        self._add('<dl class="figures">{}</dl>', cells)

    def facts(self, facts: Mapping[str, object]) -> None:
        """Add names and values as text."""
        self._add('<dl class="facts">{}</dl>', _each("<dt>{}</dt><dd>{}</dd>", facts.items()))

    def details(self, summary: str, facts: Mapping[str, object], *, shown: bool = False) -> None:
        """Add a line that opens to show facts; with `shown` the line is open at first."""
        self._add(f"<details{' open' if shown else ''}><summary>{{}}</summary>", summary)
        self.facts(facts)
        self._add("</details>")

    def table(
        self, rows: Sequence[Mapping[str, object]], caption: str = "", *, first: bool = True
    ) -> None:
        """Add a table with one column per key; with `first` the first row is emphasised."""
        columns = list(dict.fromkeys(key for row in rows for key in row))
        lines = [columns, *([format_number(row.get(name), 3) for name in columns] for row in rows)]
        words = [_is_words(column[1:]) for column in zip(*lines, strict=True)]
        table = Markup()
        for k, line in enumerate(lines):
            cells = []
            for place, text in enumerate(line):
                kind = "short words" if k and len(text) <= SHORT else "words"
                cells.append((Markup(f' class="{kind}"' * (place > 0 and words[place])), text))
            row = _each("<td{}>{}</td>" if k else "<th{}>{}</th>", cells)
            table += _html("<tr class='first'>{}</tr>" if first and k == 1 else "<tr>{}</tr>", row)
        note = _html('<p class="lead">{}</p>', _words(caption)) if caption else ""
        self._add('{}<div class="scroll"><table>{}</table></div>', note, table)

    def figure(self, name: str, drawn: Figure, caption: str) -> None:
        """Add a figure with its caption."""
        self._body.append(self._figure(name, drawn, caption))

    def pair(self, figures: Sequence[tuple[str, Figure, str]]) -> None:
        """Add figures side by side if the window is wide enough."""
        self._add('<div class="pair">{}</div>', Markup("").join(self._figure(*f) for f in figures))

    def picture(self, name: str, drawn: Figure) -> None:
        """Add a PNG beside the page that the page itself does not show."""
        self._figure(name, drawn, "")

    def code(self, text: str) -> None:
        """Add text verbatim, such as a command."""
        self._add("<pre>{}</pre>", text)

    def attach(self, name: str, text: str) -> None:
        """Add a file beside the page; its name must be one of `beside`."""
        self._attached[name] = printable(text)

    def write(self) -> Path:
        """Write `index.html`, the figures and the attached files.

        Raises:
          WriteError: the disk refuses.
        """
        text = html_page(self._title, "\n".join(self._body))
        with whole_folder(self._folder, overwrite=True, ours=self._ours) as folder:
            for name, content in {**self._attached, INDEX: text}.items():
                (folder / name).write_text(content, encoding="utf-8")
            for name, data in self._pictures.items():
                (folder / f"{name}{PICTURE}").write_bytes(data)
        return self._folder / INDEX

    def _add(self, form: str, *values: object) -> None:
        self._body.append(_html(form, *values))

    def _figure(self, name: str, drawn: Figure, caption: str) -> str:
        buffer = io.BytesIO()
        drawn.savefig(buffer, format="png", dpi=DPI)
        self._pictures[name] = buffer.getvalue()
        data = base64.b64encode(buffer.getvalue()).decode()
        width = round(drawn.get_size_inches()[0] * 118)
        form = '<figure><img width="{}" alt="{}" src="data:image/png;base64,{}">'
        return _html(form + "<figcaption>{}</figcaption></figure>", width, caption, data, caption)


def html_page(title: str, body: str, *, style: str | None = None, head: str = "") -> str:
    """Make one HTML document.

    Args:
      body: HTML of the body.
      style: CSS in place of that of reports; the style of horizontally scrolling `.scroll` is
        always added, in the colours --ground and --shade.
      head: further HTML of the head.
    """
    style = (_file("page.css") if style is None else style) + _file("shade.css")
    whole = {"body": Markup(body), "style": Markup(style), "head": Markup(head)}
    return Markup(_file("page.html")).format(title=printable(title), **whole)


def _html(form: str, *values: object) -> Markup:
    """Fill values into HTML; values that are no `Markup` are escaped."""
    return Markup(form).format(*(v if isinstance(v, Markup) else printable(str(v)) for v in values))


def _each(form: str, rows: Iterable[Sequence[object]]) -> Markup:
    return Markup("").join(_html(form, *row) for row in rows)


def _words(text: str) -> Markup:
    """Convert text to HTML; parts in backticks become code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(printable(text)))))


def _file(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text("utf-8")


def check_page_target(folder: Path) -> None:
    """Check before long work that a page can be written to a folder.

    Raises:
      WriteError: the folder holds something other than a page.
    """
    check_folder_target(folder, overwrite=True, ours=_is_page)


def _is_page(folder: Path, beside: Sequence[str] = ()) -> bool:
    """Return True if a folder holds a page and files that belong beside a page, nothing else."""
    names = {path.name for path in folder.iterdir()}
    others = {name for name in names if not name.endswith(PICTURE)}
    return not others.isdisjoint({INDEX, *beside}) and others <= {INDEX, LIST, *beside}


def _is_words(cells: Sequence[str]) -> bool:
    """Return True if a column has more letters than digits."""
    letters, digits = (sum(map(kind, "".join(cells))) for kind in (str.isalpha, str.isdigit))
    return letters > digits


def mission_caption(store: MissionStore, mission: int) -> str:
    """Caption of one line that names a mission: for a log its deployment, dive, time (UTC) and
    place; for a simulation its store, preset, seed, place and time.
    """
    if store.logged:
        return _logged(store, mission)
    settings, scenario = (
        store.json(name) if name in store.attributes else {} for name in (SETTINGS, SCENARIO)
    )
    parts = [f"{store.path.name}, mission {mission}"]
    if PRESET in settings:
        parts.append(f"preset {settings[PRESET]}")
    if scenario.get("name"):
        parts.append(str(scenario["name"]))
    seed = settings.get(SEED, scenario.get(SEED))
    if seed is not None:
        parts.append(f"seed {seed}")
    began = read_place(store.dataset.isel({MISSION: mission}, missing_dims="ignore"))
    nominal = str(began.get(NOMINAL, ""))
    if START_LATITUDE in began and "place" not in nominal:
        parts.append(place(float(began[START_LATITUDE]), float(began[START_LONGITUDE])))
    if START_TIME in began and "date" not in nominal:
        moment = datetime.datetime.fromisoformat(str(began[START_TIME]))
        parts.append(f"{moment:{MINUTES}} UTC")
    return ", ".join([*parts, "simulated"])


def _logged(store: MissionStore, mission: int) -> str:
    row = log_rows(store)[mission]
    parts = [row.deployment, f"mission {mission}"]
    dive = numbers(store, DIVE)[mission]
    if np.isfinite(dive):
        parts.append(f"dive {dive:.0f}")
    if np.isfinite(row.start):
        parts.append(f"{_moment(row.start)} UTC")
    began = [float(numbers(store, name)[mission]) for name in (START_LATITUDE, START_LONGITUDE)]
    if np.isfinite(began).all():
        parts.append(place(*began))
    if says_simulated(store.attributes):
        parts.append("simulated")
    return ", ".join(parts)


def _moment(unix: float) -> str:
    return f"{datetime.datetime.fromtimestamp(unix, datetime.UTC):{MINUTES}}"


def missions_caption(store: MissionStore, missions: Sequence[int], vehicle: str | None) -> str:
    """Caption of several dives of a log; `vehicle` is that of the flight model of velocities."""
    first, last = missions[0], missions[-1]
    text = mission_caption(store, first)
    if last != first:
        rows = log_rows(store)
        text = f"{rows[first].deployment}, missions {first} to {last}"
        ends = [rows[k].start + rows[k].duration for k in missions]
        moments = [rows[first].start, max(ends) if np.isfinite(ends).all() else rows[last].start]
        if np.isfinite(moments).all():
            text += f", {' to '.join(map(_moment, moments))} UTC"
    return text if vehicle is None else f"{text}, flight model {vehicle}"


def place(latitude: float, longitude: float) -> str:
    """Text of a latitude and longitude [degree], such as 36.800°N 122.400°W."""
    north = "N" if latitude >= 0.0 else "S"
    turned = (longitude + 180.0) % 360.0 - 180.0
    east = "E" if turned >= 0.0 else "W"
    return f"{abs(latitude):.3f}°{north} {abs(turned):.3f}°{east}"


def add_caption(figure: Figure, text: str) -> None:
    """Write a caption above a figure, and increase the figure's height by the caption's."""
    width, height = figure.get_size_inches()
    lines = textwrap.wrap(text, max(20, int(width * LETTERS_PER_INCH)))
    room = LINE_HEIGHT * len(lines) + 0.08
    figure.set_size_inches(width, height + room)
    kept = height / (height + room)
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        rows = 0.0  # height of the legends, for which the layout keeps no room once they are moved
        for legend in figure.legends:
            legend.set_bbox_to_anchor((0.0, 0.0, 1.0, kept), transform=figure.transFigure)
            rows = max(rows, legend.get_window_extent().height / figure.bbox.height)
        engine.set(rect=(0.0, 0.0, 1.0, kept - rows))
    else:  # axes placed by hand: keep them where they were
        for axes in figure.axes:
            box = axes.get_position()
            axes.set_position((box.x0, box.y0 * kept, box.width, box.height * kept))
        for legend in figure.legends:
            legend.set_bbox_to_anchor((0.02, 0.99 * kept), transform=figure.transFigure)
    figure.text(
        0.02, 1.0 - 0.04 / (height + room), "\n".join(lines),
        va="top", ha="left", fontsize=FONT_SIZE, color="#444444",
    )  # fmt: skip
