"""Completion: what a shell needs to complete the words of a program, written by tyro."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable
from typing import Annotated, Any, Union

import tyro

from twin.cli.options import MARKERS, prepare
from twin.errors import InputError, unknown_name

SHELLS = ("bash", "zsh", "fish")


def completion(
    program: str, summary: str, commands: Iterable[tuple[str, str, type[Any]]], shell: str
) -> str:
    """The script that a shell sources to complete commands, options, choices and files.

    Args:
      program: its name; summary: what it is for.
      commands: name, summary and dataclass of each.
      shell: one of `SHELLS`.

    Raises:
      InputError: another shell.
    """
    if shell not in SHELLS:
        raise InputError(unknown_name("shell", shell, SHELLS))
    known: list[Any] = []
    for name, told, options in commands:
        prepare(options, texts=True)
        known.append(Annotated[options, tyro.conf.subcommand(name, description=told)])
    words, script = ["--tyro-print-completion", shell], io.StringIO()
    with contextlib.redirect_stdout(script), contextlib.suppress(SystemExit):
        kind: Any = Union[tuple(known)]  # noqa: UP007 - of a tuple
        tyro.cli(kind, prog=program, description=summary, args=words, config=MARKERS)
    # a word that is no option, such as a store's, is a file's
    return script.getvalue().replace("complete -F", "complete -o default -F")
