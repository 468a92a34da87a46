"""`twin vehicles`: the vehicles that are shipped."""

from __future__ import annotations

from dataclasses import dataclass

from twin.cli.console import Console, JsonOption


@dataclass(frozen=True, kw_only=True)
class Vehicles(JsonOption):
    """The shipped vehicles: mass, pump, speed in the usual glide, and the source of the numbers."""

    def run(self, console: Console) -> int:
        """Print one line for each, then what each is and where its numbers are from."""
        from dataclasses import asdict

        from twin.mission.vehicle_table import shipped_vehicles

        lines = shipped_vehicles()
        console.table(
            [
                {
                    "vehicle": line.name,
                    "mass kg": f"{line.mass_kg:.1f}",
                    "pump cm3": f"{line.pump_low_cm3:.0f} to {line.pump_high_cm3:.0f}",
                    "cm3/s": f"{line.pump_rate_cm3_s:g}",
                    "turned by": line.turns_by,
                    "usual pitch deg": f"{line.pitch_deg:.0f}",
                    "net kg": f"{line.net_mass_kg:.2f}",
                    "speed m/s": f"{line.speed_m_s:.2f}",
                    "vertical m/s": f"{line.vertical_speed_m_s:.2f}",
                }
                for line in lines
            ]
        )
        console.say()
        console.pairs({line.name: line.summary for line in lines})
        console.say()
        console.pairs({line.name: line.source for line in lines}, title="Sources")
        console.answer(vehicles=[asdict(line) for line in lines])
        return 0
