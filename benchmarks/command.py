"""Command lines of the benchmarks: a function's arguments are the options.

An argument `Positional[...]` has no option name, and a `bool` is a flag. Lines after "Args:" in the
function's docstring are the options' help texts.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from json import dumps
from pathlib import Path
from typing import Any

import tyro
from tyro.conf import OmitArgPrefixes as OmitArgPrefixes
from tyro.conf import Positional as Positional

from twin.cli.text_table import format_table
from twin.errors import TwinError


def run(main: Callable[..., object], words: Sequence[str] | None = None) -> int:
    """Run a benchmark with the words of its command line; return its exit code."""
    module = sys.modules[main.__module__]
    about, config = module.__doc__, (tyro.conf.FlagCreatePairsOff,)
    try:
        code = tyro.cli(main, args=words, description=about, config=config)
    except TwinError as error:
        place = Path(module.__file__ or "")
        name = place.parent.name if place.stem == "__main__" else place.stem
        print(f"{name}: error: {error}", file=sys.stderr)
        return error.exit_code
    return code if isinstance(code, int) else 0


def say(found: object, *tables: Sequence[Mapping[str, Any]], json: bool, digits: int = 4) -> None:
    """Print figures as one JSON object, or their rows as tables."""
    if json:
        print(dumps(found), flush=True)
        return
    print("\n\n".join(format_table(list(rows), digits=digits) for rows in tables), flush=True)


def markdown(head: Sequence[object], rows: Sequence[Sequence[object]]) -> str:
    """Make a Markdown table as in the documentation."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)
