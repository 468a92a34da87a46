"""Command `twin hindcast`: forecasts of a deployment's surfacings, scored at its fixes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from twin.cli import Console, JsonOption, counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from glider_twin_ops.forecast import DeploymentHindcast, Scores


@dataclass(frozen=True, kw_only=True)
class HindcastSurfacings(JsonOption):
    """Forecast every surfacing of deployments from the data before its dive, and score it beside
    rivals: over ground as the last three dives, or along the waypoints with no current, that of the
    last dive (persistence), mean and tide by least squares, and the vehicle's own. Example:

        twin hindcast real.zarr --out hindcast
    """

    stores: Annotated[
        tuple[Path, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="STORE [STORE ...]", help_behavior_hint="(required)"),
    ]
    """stores of logs that `factory import` wrote; several are also scored together"""
    train_fraction: float = 0.0
    """fraction of each deployment, at its beginning, that teaches and is not scored, such as the
    dives that --vehicle was identified on"""
    vehicle: str | None = None
    """flight model for the velocity through the water: file of `twin identify`, or a shipped name;
    default: depth rate and pitch, and without a logged pitch the current that the vehicle reported
    after each dive"""
    current: str | None = None
    """forecast of the current that is known ahead: a file (CF netCDF or zarr) that covers the
    deployments, or any other text that `twin simulate --current` takes; its weight is learned from
    dive to dive. Default: none"""
    members: int | None = None
    """number of members to fly and score for every scored surfacing, as in `twin forecast`, by
    --vehicle or the shipped one of the log's type; default: none"""
    engine: Literal["lanes", "mujoco"] = "lanes"
    """engine of --members; with lanes one member is compared with MuJoCo"""
    out: Path | None = None
    """folder for a page with a map, index.html, that opens without a network"""

    def run(self, console: Console) -> int:
        """Walk through the deployments, print scores, write the page."""
        from glider_twin_ops.forecast import hindcast
        from twin.errors import InputError
        from twin.records import LogStore
        from twin.water.current import parse_field

        if self.out is not None:
            from twin.show.figures import check_page_target

            check_page_target(self.out)
        if self.engine != "lanes" and self.members is None:
            raise InputError("--engine is for --members, which is not given: leave it out")
        field = None if self.current is None else parse_field(self.current)
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
                members=self.members,
                engine=self.engine,
                advance=progress.update,
            )
        for which, title in (
            ("surfacing", "where it surfaced: mean error, m per hour under way"),
            ("current", "current alone, way through the water and duration given: the same"),
            ("members", "where it surfaced, the forecast by members flown: the same"),
        ):
            if rows := found.rows(which, least=1):
                rival = getattr(found, which).rival
                title += f"; best rival over all: {(rival or 'none').replace('_', ' ')}"
                console.table(_lines(rows), title=title, digits=3)
        for one in found.deployments:
            console.note(f"{one.name}: {_told(one)}")
            for mission, why in one.unflown.items():
                console.warn(f"{one.name}: members tell nothing of row {mission}: {why}")
            if one.beside_mujoco is not None:
                console.note(f"{one.name}: last dive, first member: {one.beside_mujoco.text}")
        if self.out is not None:
            from glider_twin_ops.pages import write_hindcast

            command = " ".join(["twin hindcast", *map(str, self.stores)])
            for option in ("train_fraction", "current", "members"):
                if value := getattr(self, option):
                    said = f"{value:g}" if isinstance(value, float) else value
                    command += f" --{option.replace('_', '-')} {said}"
            console.say(str(write_hindcast(self.out, found, command)))
        console.answer(
            **found.describe(),
            deployments=[
                {"name": one.name, "store": one.store, "dives": one.dives, "legs": len(one.legs)}
                | one.describe()
                for one in found.deployments
            ],
        )
        return 0


def _lines(rows: Sequence[tuple[str, Scores]]) -> list[dict[str, object]]:
    """Table row of each deployment."""
    from glider_twin_ops.forecast.walk import METHODS

    partial = {method for _, scores in rows for method in scores.partial}
    return [
        {
            "deployment": name,
            "scored": scores.segments,
            **{m.replace("_", " "): scores.mean[m] for m in METHODS},
            **{f"{m.replace('_', ' ')} scored": scores.segments_of[m] for m in sorted(partial)},
            "forecast / best rival": scores.ratio,
            "inside 50 %": scores.coverage_50,
            "inside 90 %": scores.coverage_90,
        }
        for name, scores in rows
    ]


def _told(one: DeploymentHindcast) -> str:
    """Number of dives and the models' weights, or the reason why nothing is scored, in words."""
    dives = counted(len(one.legs), "dive")
    if not one.surfacing.segments:
        said = (
            "a dive is scored beside the current of one before it, and after those that only teach"
        )
        return f"{dives} between fixes: too few to score: {said}"
    weights = sorted(one.walked.pool.pool.weights.items(), key=lambda item: -item[1])
    said = ", ".join(f"{name} {weight:.2f}" for name, weight in weights)
    taught = f", the first {one.train} not scored" if one.train else ""
    return f"{dives}{taught}; weights after the last: {said}"
