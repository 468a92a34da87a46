"""`factory repair`: a damaged store made whole again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument

SHOWN = 10
"""Damaged files that are named; the others are counted"""


@dataclass(frozen=True, kw_only=True)
class Repair(JsonOption):
    """Make a damaged store whole again: what the list of checksums finds damaged is made again from
    the recipe, bit for bit, and only the damaged missions are flown. Logs cannot be made
    again: what is lost is reported.

    Example:

        factory repair data/missions.zarr
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""

    def run(self, console: Console) -> int:
        """Repair; exit code 1 when something of a log is lost."""
        from factory.commands.generate import import_numpy_with_one_thread

        import_numpy_with_one_thread()
        from factory.generation import lost, repair

        damage = lost(self.store)
        if damage is not None:
            for one in damage:
                console.say(one)
            console.answer(store=self.store, repaired=[], lost=damage, flown=[])
            if damage:
                console.say(
                    f"{self.store} holds logs, which cannot be made again: import them again"
                )
            else:
                console.say(f"{self.store} is sound")
            return 1 if damage else 0
        done = repair(self.store)
        for name in done.damaged[:SHOWN]:
            console.say(f"made again: {name}")
        if len(done.damaged) > SHOWN:
            console.say(f"made again: {len(done.damaged) - SHOWN} more")
        flown = len(done.flown)
        console.say(
            f"{self.store} is sound again: {len(done.damaged)} files, {flown} missions flown"
            if done.damaged
            else f"{self.store} is sound"
        )
        console.answer(
            store=self.store, repaired=list(done.damaged), lost=[], flown=list(done.flown)
        )
        return 0
