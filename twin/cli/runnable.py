"""Runnable: what every subcommand is to the program that runs it."""

from __future__ import annotations

from typing import Protocol

from twin.cli.console import Console


class Runnable(Protocol):
    """An instance of a subcommand's dataclass."""

    def run(self, console: Console) -> int:
        """Do the work and return the exit code."""
        ...
