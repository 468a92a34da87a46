"""Completion: what a shell needs to complete the words of a program, written by shtab."""

from __future__ import annotations

import argparse
import dataclasses
import warnings
from collections.abc import Iterable
from typing import Any

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
    import shtab
    import tyro

    from twin.cli.options import MARKERS

    if shell not in SHELLS:
        raise InputError(unknown_name("shell", shell, SHELLS))
    parser = argparse.ArgumentParser(prog=program, description=summary)
    parser.add_argument("--version", action="store_true", help="the version")
    below = parser.add_subparsers()
    for name, told, options in commands:
        with warnings.catch_warnings():  # tyro's range of versions in pyproject.toml has it
            warnings.simplefilter("ignore", DeprecationWarning)
            own = tyro.extras.get_parser(options, config=MARKERS)
        child = below.add_parser(name, help=told, add_help=False)
        files = {
            f.name.replace("_", "-")
            for f in dataclasses.fields(options)
            if "Path" in str(f.type) or "StoreArgument" in str(f.type)
        }
        for action in own._actions:
            action.help = " ".join(str(action.help or "").split())
            child._add_action(action)
            words = {word.lstrip("-") for word in action.option_strings} or {action.dest}
            if action.nargs != 0 and action.choices is None and (
                words & files or not action.option_strings
            ):  # fmt: skip
                action.complete = shtab.FILE
    return str(shtab.complete(parser, shell=shell))
