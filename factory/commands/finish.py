"""`factory finish`: complete a store whose parts were made by many commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument


@dataclass(frozen=True, kw_only=True)
class Finish(JsonOption):
    """Complete a store that `factory generate --shard` made in parts: the same bytes as those of a
    single run. Lists missing parts as Slurm's --array takes them.

    Example:

        factory finish big.zarr
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""

    def run(self, console: Console) -> int:
        """Finish and summarise."""
        from factory.commands.generate import import_numpy_with_one_thread, show_summary

        import_numpy_with_one_thread()
        from factory.generation import finish

        summary, recipe = finish(self.store)
        show_summary(recipe, summary, console)
        return 0
