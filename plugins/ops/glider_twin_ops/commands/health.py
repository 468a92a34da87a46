"""`twin health`: faults of a vehicle, by its logs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli import Console, JsonOption

if TYPE_CHECKING:
    from glider_twin_ops.health import Answers

FEW = 4
"""Maximum number of deployments for which answers are given by default"""


@dataclass(frozen=True, kw_only=True)
class JudgeHealth(JsonOption):
    """Judge every deployment of a store of logs: a fault or none, which, since when and how sure.

    Each dive's depth rates, trim, roll, turns, pump, power, vacuum and sensors are followed, and
    compared with flights of the twin with each fault. docs/howto/health.md lists the faults.

    Examples:

        twin health real.zarr --vehicle mine.xml --page health
        factory generate --preset faulty --vehicle slocum-200 --hours 500 --out faulty.zarr
        twin health faulty.zarr --json
    """

    store: Annotated[Path, tyro.conf.Positional]
    """store of logs, as `factory import` or `factory generate --preset faulty` writes it"""
    vehicle: str | None = None
    """the vehicle that made them: what `twin identify` wrote, or a shipped name; default: the
    shipped one of the log's kind"""
    false_alarm_days: float = 30.0
    """days of sound vehicles in which one false alarm is accepted, from 3 to 300"""
    deployment: tuple[str, ...] = ()
    """names of the deployments to judge; default: all"""
    answers: bool | None = None
    """answer for compass, drag, pump and energy too, some seconds for ten hours of log; default:
    for up to four deployments"""
    page: Path | None = None
    """folder for a page with every channel over the deployments, index.html, which opens without a
    network"""

    def run(self, console: Console) -> int:
        """Judge, print, write the page."""
        from glider_twin_ops.health import answer_for, assess
        from twin import load_vehicle
        from twin.identify import other_kind, start_vehicle
        from twin.records import LogStore

        if self.page is not None:
            from twin.show.figures import check_page_target

            check_page_target(self.page)
        with LogStore(self.store) as logs:
            total = len(self.deployment or set(logs.deployments))
            shipped = self.vehicle is None and not logs.says_vehicle
        vehicle = start_vehicle(self.store) if self.vehicle is None else load_vehicle(self.vehicle)
        with console.progress(total=total, label="health", unit="deployment") as progress:
            found = assess(
                self.store,
                vehicle,
                false_alarm_days=self.false_alarm_days,
                deployments=self.deployment or None,
                advance=progress.update,
            )
        answered: dict[str, Answers] = {}
        if len(found) <= FEW if self.answers is None else self.answers:
            answered = {
                one.name: answer_for(self.store, one.name, self.vehicle)
                for one in found
                if one.dives
            }
        if shipped:
            console.note(
                f"judged by the shipped {vehicle.name}; its own file, as `twin "
                "identify` writes it, judges better: --vehicle"
            )
        if self.vehicle is not None and (odd := other_kind(self.store, vehicle)):
            console.warn(odd)
        for one in found:
            console.say(one.verdict())
            for remark in one.remarks:
                console.note(f"{one.name}: {remark}")
        for one in (each for each in found if each.alarm):
            console.table(one.likeliest(), title=f"{one.name}: what it may be", digits=3)
            console.note(f"{one.name}, to find out: {one.kinds[0].find_out}")
            console.note(f"{one.name}, what else looks like it: {one.kinds[0].otherwise}")
        if self.page is not None:
            from glider_twin_ops.pages import write_health

            command = f"twin health {self.store}"
            command += "" if self.vehicle is None else f" --vehicle {self.vehicle}"
            console.say(str(write_health(self.page, found, command, answered)))
        console.answer(
            store=self.store,
            vehicle=vehicle.name if self.vehicle is None else self.vehicle,
            false_alarm_days=self.false_alarm_days,
            deployments=[
                one.describe() | (answered[one.name].describe() if one.name in answered else {})
                for one in found
            ],
        )
        return 0
