"""Reference pages of the documentation, generated from the code: commands and Python names.

`python scripts/docs_reference.py` prints the names of the pages. mkdocs makes them by
scripts/docs_hooks.py, and tests compare them with the programs. scripts/docs_dictionary.py makes
the data dictionary.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import re
import sys
import warnings
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from docs_dictionary import dictionary_page  # noqa: E402
from docs_examples import examples_page  # noqa: E402
from docs_markdown import escaped  # noqa: E402
from docs_settings import settings_page  # noqa: E402

from twin.cli.program import Program, ProgramCommand  # noqa: E402

PROGRAMS = ("twin", "factory", "learn")
FACES = {"twin": "twin", "control": "twin.control", "factory": "factory", "learn": "learn"}
"""Page and package of each public interface"""
AREAS = {
    "twin.facade": "Simulate",
    "twin.physics": "Simulate",
    "twin.mission": "Missions",
    "twin.water": "Water",
    "twin.vehicle": "Vehicles",
    "twin.faults": "Vehicles",
    "twin.sensors": "Sensors and navigation",
    "twin.navigation": "Sensors and navigation",
    "twin.logs": "Logs",
    "twin.records": "Records",
    "twin.show.figures": "Figures",
    "twin.checks": "Checks",
    "twin.errors": "Errors",
    "twin.bounded": "For plugins",
    "twin.frames": "For plugins",
    "twin.geodesy": "For plugins",
    "twin.lazy": "For plugins",
    "twin.numbers": "For plugins",
    "twin.registry": "For plugins",
    "twin.seams": "Types of your own",
    "twin.control.registry": "Tasks",
    "twin.control": "Environments",
    "factory": "Data factory",
    "learn.api": "Train and judge",
    "learn.adaptation": "Train and judge",
    "learn.run": "Train and judge",
    "learn.training.fit_config": "Train and judge",
    "learn": "Types of your own",
}
"""Headings of names, by the module that defines them; the first match counts"""


def generated_pages() -> dict[str, str]:
    """Make every generated page: Markdown by its path in docs/."""
    pages = {f"reference/commands/{name}.md": command_page(name) for name in PROGRAMS}
    pages |= {f"reference/python/{page}.md": python_page(face) for page, face in FACES.items()}
    pages["reference/signals.md"] = dictionary_page()
    pages["reference/settings.md"] = settings_page()
    pages["examples.md"] = examples_page()
    pages["results/real_logs_tables.md"] = measured_page()
    for name in ("CHANGELOG", "CONTRIBUTING"):
        pages[f"project/{name.lower()}.md"] = root_page(name)
    return pages


# --- commands -----------------------------------------------------------------------------------


def program(name: str) -> Program:
    """Return the program of that name."""
    found: Program = importlib.import_module(f"{name}.__main__").PROGRAM
    return found


def command_page(name: str) -> str:
    """Make the page of a program's commands with all options, from their parsers."""
    found = program(name)
    listing = "\n".join(
        f"| [`{name} {one.name}`](#{name}-{one.name}) | {escaped(one.summary)} |"
        for one in found.commands
    )
    sections = "\n".join(command_section(name, one) for one in found.commands)
    return (
        f"# `{name}`\n\n{found.summary} `{name} COMMAND --help` prints what stands here.\n\n"
        f"| command | |\n|---|---|\n{listing}\n\n"
        f"Exit codes: 0 done, 1 failed, 2 bad input, 130 interrupted. With `--json` a command "
        f"prints one JSON object on standard output.\n\n{sections}"
    )


def command_section(name: str, command: ProgramCommand) -> str:
    """Section with description, usage and options of one command."""
    parser = parser_of(name, command)
    actions = [action for action in parser._actions if action.dest != "help"]
    words = [word for action in actions if (word := _usage_word(action))]
    usage = " ".join([name, command.name, "[OPTIONS]", *words])
    options = "\n".join(option(action) for action in actions)
    description = "\n".join(
        line if line.startswith("    ") else linked(escaped(line))
        for line in (parser.description or command.summary).split("\n")
    )
    return f"## {name} {command.name}\n\n{description}\n\n```sh\n{usage}\n```\n\n{options}\n"


def parser_of(name: str, command: ProgramCommand) -> argparse.ArgumentParser:
    """Parser of a command, as its `--help` shows it."""
    import tyro

    from twin.cli.parsing import MARKERS, description

    form = command.load()
    with warnings.catch_warnings():  # tyro's own help texts have no list of options
        warnings.simplefilter("ignore", DeprecationWarning)
        prog = f"{name} {command.name}"
        return tyro.extras.get_parser(
            form, prog=prog, description=description(form), config=MARKERS
        )


def option(action: argparse.Action) -> str:
    """Entry of one option in a definition list."""
    text = " ".join((action.help or "").split())
    default = ""
    found = re.search(r" ?\((default: .*|required|optional|repeatable|fixed.*)\)$", text)
    if found:
        text, default = text[: found.start()], found[1].removeprefix("default: ")
    shown = ", ".join(action.option_strings)
    values = _values(action)
    title = " ".join(word for word in (shown, values) if word)
    notes = "" if default in ("", "None", "False") else f" *{_note(default)}*"
    return f"`{title}`\n:   {linked(escaped(text))}{notes}\n"


def _note(text: str) -> str:
    words = ("required", "optional", "repeatable")
    return f"{text.capitalize()}." if text in words else f"Default: `{text}`."


def _values(action: argparse.Action) -> str:
    metavar = action.metavar
    if isinstance(metavar, tuple):
        metavar = " ".join(metavar)
    if not action.option_strings:  # a positional's name says more than its type
        return (
            (metavar or "").replace("STR", action.dest.upper()).replace("PATH", action.dest.upper())
        )
    return metavar or ""


def _usage_word(action: argparse.Action) -> str:
    if not action.option_strings:
        return _values(action)
    needed = (action.help or "").rstrip().endswith("(required)")
    return f"{action.option_strings[0]} {_values(action)}" if needed else ""


def linked(text: str) -> str:
    """Turn the pages that a text names into links, from a page in reference/commands/."""

    def link(found: re.Match[str]) -> str:
        name = found[2].replace("\\", "")
        return f"[{name.replace('_', ' ')}](../../{found[1]}/{name}.md)"

    return re.sub(r"docs/(\w+)/([\w\\]+)\.md", link, text)


# --- Python -------------------------------------------------------------------------------------


def python_page(face: str) -> str:
    """Make the page of a package's public names, grouped by purpose."""
    module = importlib.import_module(face)
    text = (module.__doc__ or "").strip()
    summary, _, example = text.partition("\n\n")
    by_area: dict[str, list[str]] = {}
    for name, place in public_names(face).items():
        by_area.setdefault(area(place), []).append(_directive(face, name, place))
    order = list(dict.fromkeys(AREAS.values()))
    areas = sorted(by_area, key=order.index)
    sections = "\n".join(f"## {title}\n\n" + "\n".join(by_area[title]) for title in areas)
    return f"# `{face}`\n\n{escaped(summary)}\n\n{example}\n\n{sections}"


def public_names(face: str) -> dict[str, str]:
    """Public names of a package, with the dotted path of each."""
    module = importlib.import_module(face)
    places: Mapping[str, str] = module._PLACES
    return {
        name: place.replace(":", ".")
        if ":" in place or inspect.ismodule(getattr(module, name))
        else f"{place}.{name}"
        for name, place in places.items()
    }


def area(place: str) -> str:
    """Heading under which a name is listed."""
    return next(
        title for part, title in AREAS.items() if place == part or place.startswith(f"{part}.")
    )


def _directive(face: str, name: str, place: str) -> str:
    return f"::: {place}\n    options:\n      heading: {face}.{name}\n      toc_label: {name}\n"


# --- results ------------------------------------------------------------------------------------


def measured_page() -> str:
    """Make the page with every table of the benchmark on public logs, from what it kept."""
    from benchmarks.real_logs.row import kept, tables
    from benchmarks.real_logs.truth import table  # loads what it measures

    rows = kept()
    text = f"\n## Every measured velocity\n\nThe simple rival is in italics.\n\n{table(rows, True)}"
    text += "".join(
        f"\n## {task[0].upper()}{task[1:]}\n\n{one}" for task, one in tables(rows).items()
    )
    return (
        "# Public logs, every table\n\n[Public logs](real_logs.md) has rules and words. "
        "Bold is the least error of a line or table.\n" + text
    )


# --- pages beside docs/ -------------------------------------------------------------------------


def root_page(name: str) -> str:
    """Page of the repository's root, with links that work on the site."""
    text = (ROOT / f"{name}.md").read_text(encoding="utf-8")
    return text.replace("](docs/", "](../")


if __name__ == "__main__":
    print("\n".join(generated_pages()))
