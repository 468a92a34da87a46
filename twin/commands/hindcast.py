"""`twin hindcast`: forecasts of a deployment's surfacings beside where it surfaced."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.text_table import counted

if TYPE_CHECKING:
    from twin.forecast import DeploymentHindcast


@dataclass(frozen=True, kw_only=True)
class HindcastSurfacings(JsonOption):
    """Walk through deployments, forecast every surfacing from what was known before its dive, and
    score the forecasts beside the last dive's current (persistence), no current, and the vehicle's
    own track. Example:

        twin hindcast real.zarr --train-fraction 0.4 --out hindcast
    """

    stores: Annotated[
        tuple[Path, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="STORE [STORE ...]", help_behavior_hint="(required)"),
    ]
    """stores of logs, as `factory import` writes them; several are scored together, too"""
    train_fraction: float = 0.4
    """part of each deployment, at its beginning, that the current's parameters are learned from;
    the rest is scored"""
    vehicle: str | None = None
    """flight model for the way through the water: what `twin identify` wrote, or a shipped name;
    default: depth rate and pitch, and without a logged pitch the current that the vehicle reported
    after each dive"""
    current: str | None = None
    """forecast of the current that is known ahead: a file (CF netCDF or zarr) that covers the
    deployments, or any other text that `twin simulate --current` takes; what of it counts is
    learned from the first part. Default: none"""
    out: Path | None = None
    """folder for a page with a map, index.html, that opens without a network"""

    def run(self, console: Console) -> int:
        """Walk, score, say."""
        from twin.forecast import METHODS, hindcast
        from twin.records.logged import LogStore

        if self.out is not None:
            from twin.show.figures.page_layout import check_page_target

            check_page_target(self.out)
        field = None
        if self.current is not None:
            from twin.water.current.current_text import parse_field

            field = parse_field(self.current)
        total = 0
        for path in self.stores:
            with LogStore(path) as logs:
                total += len(set(logs.deployments))
        with console.progress(total=total, label="hindcast", unit="deployment") as progress:
            found = hindcast(
                self.stores,
                train_fraction=self.train_fraction,
                vehicle=self.vehicle,
                current=field,
                advance=progress.update,
            )
        rows = [(one.name, one.scores) for one in found.deployments if one.scores.segments]
        if len(rows) > 1:
            rows.append(("all", found.scores))
        partial = {method for _, scores in rows for method in scores.partial}
        if rows:
            console.table(
                [
                    {
                        "deployment": name,
                        "scored": scores.segments,
                        **{m.replace("_", " "): scores.mean[m] for m in METHODS},
                        **{
                            f"{m.replace('_', ' ')} scored": scores.segments_of[m]
                            for m in METHODS
                            if m in partial
                        },
                        "forecast/persistence": scores.ratio,
                        "in 50 %": scores.coverage_50,
                        "in 90 %": scores.coverage_90,
                    }
                    for name, scores in rows
                ],
                title="mean error, m per hour under way",
                digits=3,
            )
        for one in found.deployments:
            console.note(f"{one.name}: {_told(one)}")
        pages = []
        if self.out is not None:
            from twin.show.hindcast_page import build_page

            words = " ".join(str(path) for path in self.stores)
            command = f"twin hindcast {words} --train-fraction {self.train_fraction:g}"
            if self.current is not None:
                command += f" --current {self.current}"
            pages.append(build_page(self.out, found, command))
            console.say(str(pages[0]))
        console.answer(
            stores=self.stores,
            train_fraction=self.train_fraction,
            current=self.current,
            **found.scores.describe(),
            deployments=[
                {
                    "name": one.name,
                    "store": one.store,
                    "dives": one.dives,
                    "legs": len(one.legs),
                    "trained_on": one.train,
                    "persistence": one.tuned.parameters.persists,
                    "parameters": one.tuned.parameters,
                    **one.scores.describe(),
                }
                for one in found.deployments
            ],
            pages=pages,
        )
        return 0


def _told(one: DeploymentHindcast) -> str:
    """What its forecasts rest on, or why there are none."""
    dives = counted(len(one.legs), "dive")
    if not one.scores.segments:
        return (
            f"{dives} between fixes: too few to score: a dive is scored beside the current of "
            "one before it, and after those that parameters are learned from"
        )
    kind = "persistence" if one.tuned.parameters.persists else "tide and eddies"
    if any(leg.leg.field is not None for leg in one.legs):
        kind += f", {one.tuned.parameters.field:.2f} of the field"
    if not one.train:
        return f"{kind} by the usual parameters, nothing learned from its {dives}"
    return f"{kind}, learned from {one.train} of {dives}"
