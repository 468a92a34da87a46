"""`twin energy`: what electronics, pump, drives, payload and thruster of a deployment take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.console import Console, JsonOption

if TYPE_CHECKING:
    from twin.logs import EnergyUse


@dataclass(frozen=True, kw_only=True)
class AccountEnergy(JsonOption):
    """Share out the charge that a vehicle has counted: electronics, surface, pump by depth and
    direction, drives, payload, thruster; and try it: the second half of the dives by the first.

    Example:

        twin energy real.zarr --vehicle slocum-1000 --out mine.xml --energy-left-kwh 2.5
    """

    store: Annotated[Path, tyro.conf.Positional]
    """store of logs, as `factory import` writes it, with a counter of charge and a voltage"""
    vehicle: str | None = None
    """the vehicle that made them: what `twin identify` wrote, or a shipped name; default: the
    shipped one of the log's kind"""
    missions: str = "all"
    """missions of the store, such as 0-11,14"""
    energy_left_kwh: float | None = None
    """energy left in the batteries [kW h], for the days left"""
    out: Path | None = None
    """write the vehicle with these figures here (.xml): simulations and forecasts take them"""
    overwrite: bool = False
    """replace an existing --out"""

    def run(self, console: Console) -> int:
        """Fit, try, say, write."""
        from twin.cli.options import parse_rows
        from twin.errors import InputError
        from twin.identify import write_consumption
        from twin.logs import endurance_of, energy_used, second_half

        if self.out is not None and self.out.suffix.lower() != ".xml":
            raise InputError(f"--out {str(self.out)!r} must end in .xml")
        if self.out is not None and self.out.exists() and not self.overwrite:
            raise InputError(f"{self.out} exists already; use --overwrite or another --out")
        rows = parse_rows(self.missions)
        found = energy_used(self.store, self.vehicle, missions=rows)
        left = self.energy_left_kwh
        days = None if left is None else found.days_left(left)
        _say(console, found)
        lasts = None if left is None else endurance_of(found, left)
        if days is not None:
            console.say(f"{days:.1f} days left at this power")
        if lasts is not None:
            low, high = lasts.interval()
            console.say(
                f"{lasts.days:.1f} days left as the last dives go on (90 %: {low:.1f} to "
                f"{high:.1f})"
            )
        tried = second_half(self.store, found.vehicle, missions=rows)
        if tried is None:
            console.note("too few dives to try the first half of them on the second")
        else:
            errors = tried.errors()
            console.pairs(
                {
                    "later dives": f"charge of {len(tried.dives)} by the {tried.taught} before",
                    "error of a dive, mean": f"{100 * errors['model_per_dive']:.1f} %; by their "
                    f"charge per hour {100 * errors['per_hour_per_dive']:.1f} %, per dive "
                    f"{100 * errors['each_per_dive']:.1f} %",
                    "error of the sum": f"{100 * errors['model_sum']:+.1f} %; by their charge per "
                    f"hour {100 * errors['per_hour_sum']:+.1f} %, per dive "
                    f"{100 * errors['each_sum']:+.1f} %",
                }
            )
        if self.out is not None:
            write_consumption(found.vehicle, found.consumption, self.out, overwrite=self.overwrite)
            console.say(f"vehicle: {self.out}")
        console.answer(
            store=self.store,
            vehicle=found.vehicle.name,
            out=self.out,
            days_left=days,
            days_left_90=None if lasts is None else lasts.interval(),
            later_dives=None if tried is None else {"dives": len(tried.dives), **tried.errors()},
            **found.describe(),
        )
        return 0


def _say(console: Console, found: EnergyUse) -> None:
    whole = sum(one.energy for one in found.terms)
    console.table(
        [
            {
                "what": one.name,
                "factor": one.value,
                "deviation": "the vehicle's" if one.deviation != one.deviation else one.deviation,
                "unit": "" if one.unit == "1" else one.unit,
                "of the energy": f"{100 * one.energy / whole:.1f} %",
            }
            for one in found.terms
            if one.energy > 0.0
        ],
        title=f"{found.vehicle.name}: {len(found.dives)} dives",
        digits=3,
    )
    console.pairs(
        {
            "counted": f"{found.charge:.2f} A h in {found.hours:.1f} h at {found.voltage:.2f} V",
            "power": f"{found.power:.2f} W, {24 * found.charge / found.hours:.1f} A h a day",
        }
    )
    if found.resets:
        console.warn(f"the counter ran backwards in {found.resets} intervals: left out")
