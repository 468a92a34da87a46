"""Page layout: one HTML file with all its figures inside, which opens anywhere without a network.

Captions name the mission and the store that a figure shows.
"""

from __future__ import annotations

import base64
import datetime
import functools
import html
import io
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from twin.cli.text_table import MISSING, format_number, printable
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
SHORT = 16
"""Letters of a cell of words that stay on one line"""

SHADED = """
/* A shade at an edge beyond which a table goes on: the ground over it goes with the table */
.scroll { overflow-x: auto; --high: calc(100% - 1.4rem) no-repeat; background:
  linear-gradient(to right, var(--ground) 35%, transparent) left / 2.4rem 100% no-repeat local,
  linear-gradient(to left, var(--ground) 35%, transparent) right / 2.4rem 100% no-repeat local,
  linear-gradient(to right, var(--shade), transparent) left top / .8rem var(--high),
  linear-gradient(to left, var(--shade), transparent) right top / .8rem var(--high); }
"""
"""Of what scrolls sideways, on a page that has the colours --ground and --shade"""
STYLE = """
:root { color-scheme: light dark; --ink: #1a1a1a; --dim: #5c6570; --line: #dde1e6;
  --mark: #d55e00; --ground: #fff; --code: #f6f7f9; --shade: #0004; }
* { box-sizing: border-box; }
body { font: 16px/1.55 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: var(--ink);
  background: var(--ground); max-width: 62rem; margin: 0 auto; padding: 2rem 1.25rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .25rem; }
h2 { font-size: 1.2rem; margin: 2.6rem 0 .6rem; padding-top: .6rem;
  border-top: 1px solid var(--line); }
p.lead { color: var(--dim); margin-top: 0; }
dl.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(13rem, 1fr));
  gap: .75rem; margin: 1.5rem 0; }
dl.figures div { border: 1px solid var(--line); border-radius: 6px; padding: .7rem .9rem; }
dl.figures dt { color: var(--dim); font-size: .85rem; }
dl.figures dd { margin: 0; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .8rem .3rem 0; text-align: right; border-bottom: 1px solid var(--line);
  vertical-align: bottom; }
th { font-weight: 600; color: var(--dim); }
th:first-child, td:first-child { text-align: left; white-space: nowrap; }
table { margin: .3rem 0 1.4rem; }
th.words, td.words { text-align: left; padding-left: .4rem; }
td.short { white-space: nowrap; }
tr.first td { font-weight: 600; }
tr.first td:first-child { color: var(--mark); }
dl.facts { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1.2rem;
  font-size: .9rem; }
dl.facts dt { color: var(--dim); }
dl.facts dd { margin: 0; overflow-wrap: anywhere; }
details { border-bottom: 1px solid var(--line); padding: .35rem 0; font-size: .95rem; }
summary { cursor: pointer; overflow-wrap: anywhere; }
figure { margin: 1.2rem 0; }
figure img { max-width: 100%; height: auto; display: block; }
figcaption { color: var(--dim); font-size: .9rem; max-width: 46rem; }
.pair { display: flex; flex-wrap: wrap; gap: 1.5rem; }
.pair figure { flex: 1 1 24rem; margin: .5rem 0; }
code, pre { font: .85rem/1.5 ui-monospace, "DejaVu Sans Mono", monospace; }
pre { background: var(--code); padding: .8rem 1rem; border-radius: 6px; white-space: pre-wrap;
  overflow-wrap: anywhere; }
@media (max-width: 40rem) { body { padding: 1rem .75rem 2rem; }
  .scroll th, .scroll td { white-space: nowrap; }
  .scroll td.words { white-space: normal; min-width: 9rem; }
  dl.figures { grid-template-columns: 1fr 1fr; }
  figure { overflow-x: auto; } figure img { max-width: none; width: max(100%, 36rem); }
  .pair figure img { width: 100%; } }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e6e8; --dim: #9aa4af; --line: #3a4048;
  --mark: #ff9a4d; --ground: #15181c; --code: #22262c; --shade: #fff6; }
  figure img { border-radius: 4px; filter: brightness(.85); } }
@media print { h2 { break-after: avoid; } figure, table { break-inside: avoid; } }
"""


class Page:
    """Collects a page piece by piece; each figure is embedded and written as PNG beside it.

    The folder appears, or takes the place of an earlier page, when the page is written.

    Args:
      beside: names of other files that such a page has in its folder, see `attach`.

    Raises:
      WriteError: something that is no page is in the way.
    """

    def __init__(self, folder: Path, title: str, lead: str, *, beside: Sequence[str] = ()) -> None:
        self._folder = folder
        self._ours = functools.partial(_is_page, beside=beside)
        self._attached: dict[str, str] = {}
        self._title = title
        self._body = [f"<h1>{_text(title)}</h1>", f'<p class="lead">{_text(lead)}</p>']
        self._pictures: dict[str, bytes] = {}
        check_folder_target(folder, overwrite=True, ours=self._ours)

    def section(self, title: str) -> None:
        """A heading."""
        self._body.append(f"<h2>{_text(title)}</h2>")

    def say(self, text: str) -> None:
        """A paragraph."""
        self._body.append(f"<p>{_words(text)}</p>")

    def points(self, texts: Sequence[str]) -> None:
        """A list of sentences."""
        self._body.append(f"<ul>{''.join(f'<li>{_words(text)}</li>' for text in texts)}</ul>")

    def numbers(self, figures: Mapping[str, str]) -> None:
        """The few figures that matter, large."""
        cells = "".join(
            f"<div><dt>{_text(name)}</dt><dd>{_text(value)}</dd></div>"
            for name, value in figures.items()
        )
        self._body.append(f'<dl class="figures">{cells}</dl>')

    def facts(self, facts: Mapping[str, object]) -> None:
        """Names and values as text."""
        entries = "".join(
            f"<dt>{_text(name)}</dt><dd>{_text(str(value))}</dd>" for name, value in facts.items()
        )
        self._body.append(f'<dl class="facts">{entries}</dl>')

    def details(self, summary: str, facts: Mapping[str, object], *, shown: bool = False) -> None:
        """A line that opens to show facts, or is open."""
        self._body.append(f"<details{' open' if shown else ''}><summary>{_text(summary)}</summary>")
        self.facts(facts)
        self._body.append("</details>")

    def table(
        self, rows: Sequence[Mapping[str, object]], caption: str = "", *, first: bool = True
    ) -> None:
        """Rows with one column per key; with `first` the first row stands out."""
        columns = list(dict.fromkeys(key for row in rows for key in row))
        shown = {c: [_cell(row.get(c)) for row in rows] for c in columns}
        kinds = {c: "words" if c in columns[1:] and _is_words(shown[c]) else "" for c in columns}
        head = "".join(f"<th{_class(kinds[c])}>{_text(c)}</th>" for c in columns)
        lines = [f"<tr>{head}</tr>"]
        for place in range(len(rows)):
            texts = [(shown[c][place], kinds[c]) for c in columns]
            cells = "".join(
                f"<td{_class(kind and ('short' if len(text) <= SHORT else kind), kind)}>"
                f"{_text(text)}</td>"
                for text, kind in texts
            )
            lines.append(
                f'<tr class="first">{cells}</tr>' if first and place == 0 else f"<tr>{cells}</tr>"
            )
        note = f'<p class="lead">{_words(caption)}</p>' if caption else ""
        self._body.append(f'{note}<div class="scroll"><table>{"".join(lines)}</table></div>')

    def figure(self, name: str, drawn: Figure, caption: str) -> None:
        """A figure with what it shows."""
        self._body.append(self._figure(name, drawn, caption))

    def pair(self, figures: Sequence[tuple[str, Figure, str]]) -> None:
        """Figures side by side where the window is wide enough."""
        self._body.append(
            f'<div class="pair">{"".join(self._figure(*entry) for entry in figures)}</div>'
        )

    def picture(self, name: str, drawn: Figure) -> None:
        """A PNG beside the page that the page itself does not show."""
        self._figure(name, drawn, "")

    def code(self, text: str) -> None:
        """Text as it is."""
        self._body.append(f"<pre>{_text(text)}</pre>")

    def attach(self, name: str, text: str) -> None:
        """A file beside the page, of a name that the page was made with."""
        self._attached[name] = printable(text)

    def write(self) -> Path:
        """Write `index.html`, the figures and what is attached.

        Raises:
          WriteError: the disk refuses.
        """
        body = "\n".join(self._body)
        text = (
            f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{_text(self._title)}</title>\n<style>{STYLE}{SHADED}</style></head>\n"
            f"<body>\n{body}\n</body></html>\n"
        )
        with whole_folder(self._folder, overwrite=True, ours=self._ours) as folder:
            for name, content in {**self._attached, INDEX: text}.items():
                (folder / name).write_text(content, encoding="utf-8")
            for name, data in self._pictures.items():
                (folder / f"{name}{PICTURE}").write_bytes(data)
        return self._folder / INDEX

    def _figure(self, name: str, drawn: Figure, caption: str) -> str:
        buffer = io.BytesIO()
        drawn.savefig(buffer, format="png", dpi=DPI)
        self._pictures[name] = buffer.getvalue()
        data = base64.b64encode(buffer.getvalue()).decode()
        width = round(drawn.get_size_inches()[0] * 118)
        return (
            f'<figure><img width="{width}" alt="{_text(caption)}" '
            f'src="data:image/png;base64,{data}"><figcaption>{_text(caption)}</figcaption></figure>'
        )


def check_page_target(folder: Path) -> None:
    """Refuse, before long work, a folder that a page cannot be written to.

    Raises:
      WriteError: something that is no page is in the way.
    """
    check_folder_target(folder, overwrite=True, ours=_is_page)


def _is_page(folder: Path, beside: Sequence[str] = ()) -> bool:
    """Whether a folder holds a page or what belongs beside one, and nothing else."""
    names = {path.name for path in folder.iterdir()}
    others = {name for name in names if not name.endswith(PICTURE)}
    return not others.isdisjoint({INDEX, *beside}) and others <= {INDEX, LIST, *beside}


def _cell(value: object) -> str:
    return MISSING if value is None else format_number(value, 3)


def _text(text: str) -> str:
    return html.escape(printable(text), quote=True)


def _words(text: str) -> str:
    """Text whose parts in backticks are what somebody types."""
    return re.sub("`([^`]+)`", r"<code>\1</code>", _text(text))


def _is_words(cells: Sequence[str]) -> bool:
    """Whether a column has words rather than numbers."""
    letters, digits = (sum(map(kind, "".join(cells))) for kind in (str.isalpha, str.isdigit))
    return letters > digits


def _class(*names: str) -> str:
    found = " ".join(dict.fromkeys(name for name in names if name))
    return f' class="{found}"' if found else ""


LETTERS_PER_INCH = 13.0
"""At the caption's size, with room to spare"""
LINE_HEIGHT = 0.16
"""[in]"""
FONT_SIZE = 7.5
MINUTES = "%Y-%m-%d %H:%M"
"""How figures write a moment"""


def mission_caption(store: MissionStore, mission: int) -> str:
    """One line that names a mission: of a log its vehicle, dive, time (UTC) and place; of a
    simulation its store, preset and seed.
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
        moment = datetime.datetime.fromtimestamp(row.start, datetime.UTC)
        parts.append(f"{moment:{MINUTES}} UTC")
    latitude, longitude = (numbers(store, f"start_{n}")[mission] for n in ("latitude", "longitude"))
    if np.isfinite(latitude) and np.isfinite(longitude):
        parts.append(place(latitude, longitude))
    if says_simulated(store.attributes):
        parts.append("simulated")
    return ", ".join(parts)


def missions_caption(store: MissionStore, missions: Sequence[int], vehicle: str | None) -> str:
    """As `mission_caption`, of dives of a log, and whose flight model tells their velocities."""
    first, last = missions[0], missions[-1]
    text = mission_caption(store, first)
    if last != first:
        rows = log_rows(store)
        text = f"{rows[first].deployment}, missions {first} to {last}"
        ends = [rows[k].start + rows[k].duration for k in missions]
        moments = [rows[first].start, max(ends) if np.isfinite(ends).all() else rows[last].start]
        if np.isfinite(moments).all():
            begin, end = (datetime.datetime.fromtimestamp(m, datetime.UTC) for m in moments)
            text += f", {begin:{MINUTES}} to {end:{MINUTES}} UTC"
    return text if vehicle is None else f"{text}, flight model {vehicle}"


def place(latitude: float, longitude: float) -> str:
    """Latitude and longitude [degree] as people write them."""
    north = "N" if latitude >= 0.0 else "S"
    turned = (longitude + 180.0) % 360.0 - 180.0
    east = "E" if turned >= 0.0 else "W"
    return f"{abs(latitude):.3f}°{north} {abs(turned):.3f}°{east}"


def add_caption(figure: Figure, text: str) -> None:
    """Write a caption above everything, and make the figure that much higher."""
    width, height = figure.get_size_inches()
    lines = textwrap.wrap(text, max(20, int(width * LETTERS_PER_INCH)))
    room = LINE_HEIGHT * len(lines) + 0.08
    figure.set_size_inches(width, height + room)
    kept = height / (height + room)
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        rows = 0.0  # of legends, which the layout forgets as soon as they are moved
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
        0.02,
        1.0 - 0.04 / (height + room),
        "\n".join(lines),
        va="top",
        ha="left",
        fontsize=FONT_SIZE,
        color="#444444",
    )
