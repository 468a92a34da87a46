"""`factory distributions`: the table of everything that is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from twin.cli.console import Console, JsonOption


@dataclass(frozen=True, kw_only=True)
class Distributions(JsonOption):
    """Every parameter with its distribution, unit and reason.

    Examples:

        factory distributions --preset field
        factory distributions --set mission.pitch_deg="uniform(15,35)"
    """

    preset: Literal["paper", "field", "family", "paper-test"] = "paper"
    """whose distributions to show"""
    set: tuple[str, ...] = ()
    """replacements to apply first, as in `factory generate`"""
    vehicle: str = "glider"
    """shipped vehicle name, or the path of an MJCF file; :PRESET behind it takes a preset of it"""
    config: Path | None = None
    """TOML file with replacements"""

    def run(self, console: Console) -> int:
        """Print the table."""
        from factory.sampling import PRESETS, override, parameter_table, read_changes
        from twin import load_vehicle

        changes = read_changes(self.config, self.set)
        table = parameter_table(load_vehicle(self.vehicle))
        distributions = override(PRESETS[self.preset].distributions(table), changes)
        console.table(
            [
                {
                    "parameter": name,
                    "distribution": distribution.text(),
                    "unit": table[name].unit,
                    "what": table[name].long_name,
                    "why": table[name].why,
                }
                for name, distribution in distributions.items()
            ]
        )
        console.answer(
            preset=self.preset,
            vehicle=self.vehicle,
            distributions={n: d.text() for n, d in distributions.items()},
        )
        return 0
