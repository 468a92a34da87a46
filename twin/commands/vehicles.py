"""`twin vehicles`: the vehicles that are shipped."""

from __future__ import annotations

from dataclasses import dataclass

from twin.cli.console import Console, JsonOption


@dataclass(frozen=True, kw_only=True)
class Vehicles(JsonOption):
    """The shipped vehicles and their presets: mass, propeller, pump, usual speed, and the source of
    the numbers.

    Example:

        twin vehicles
    """

    def run(self, console: Console) -> int:
        """Print one line for each, then what each is and where its numbers are from."""
        from dataclasses import asdict

        from twin.mission import shipped_vehicles

        lines = shipped_vehicles()
        console.table(
            [line.cells() for line in lines],
            title="Shipped vehicles in their usual glide, or at their cruise",
        )
        console.say()
        console.pairs({line.name: line.summary for line in lines})
        console.say()
        console.pairs({line.name: line.source for line in lines}, title="Sources")
        console.answer(vehicles=[asdict(line) for line in lines])
        return 0
