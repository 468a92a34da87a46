"""Morning: the daily report of a deployment: health, energy, currents and the next surfacings.

A section without support in the log is left out, with the reason. Health needs no fixes. Without
attitude, the currents are those that the vehicle reported. An empty folder has no section.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from glider_twin_ops.forecast import (
    Forecast,
    Known,
    LoggedLeg,
    Request,
    RoutePlan,
    begun,
    forecast,
    known_from_logs,
    legs_of,
    plan_routes,
)
from glider_twin_ops.forecast.logged_leg import dive_times
from glider_twin_ops.health import CHANNELS, Beliefs, DeploymentHealth, assess, follow_parameters
from glider_twin_ops.watching.arrived_files import folder_of
from glider_twin_ops.watching.deployment_folder import WatchedDeployment
from glider_twin_ops.watching.dive_table import DiveRow, Reading, dive_rows, newest_readings
from glider_twin_ops.watching.energy_outlook import EnergyOutlook, energy_outlook
from glider_twin_ops.watching.expected_plan import (
    Arrival,
    ExpectedPlan,
    LastFix,
    ProposedFiles,
    arrival,
    expected_plan,
    flown_files,
    newest_fix,
    proposed_files,
)
from glider_twin_ops.watching.log_of_files import LogOfFiles
from glider_twin_ops.watching.sources import SurfaceDialogue
from twin import Origin, Vehicle, Waypoint
from twin.cli import counted
from twin.errors import TwinError
from twin.identify import (
    identified,
    load_calibration,
    load_logs,
    other_kind,
    with_consumption,
)
from twin.logs import Endurance, EnergyUse, counted_energy, endurance_of
from twin.physics import utc_text
from twin.records import LogStore
from twin.records.attributes import DIVE
from twin.records.coordinates import utc_minute
from twin.show.style import moment_of
from twin.water.current import parse_field

Told = TypeVar("Told")
KILO, HOUR = 1e3, 3600.0
NEWER = 60.0
"""[s] Smallest time between two fixes of which one counts as newer"""
FORECAST = "forecast"
"""Name of the forecast; if it is missing, its reason is the first in `Morning.missing`"""
MOST_FOLLOWED = 30
"""Last dives over which parameters are tracked, from the vehicle file's values; 0.4 s a dive"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Morning:
    """Daily report. A section that the log does not support is empty or None, see `lacking`."""

    title: str
    """Name of the folder"""
    log: LogOfFiles
    dialogue: SurfaceDialogue | None = None
    """Dialogue of the last surfacing"""
    deployment: str = ""
    """Name of the deployment in the log; of several, the one that began last"""
    dives: tuple[int, ...] = ()
    """Numbers of its dives in the log, in order of time"""
    vehicle: Vehicle | None = None
    health: DeploymentHealth | None = None
    followed: Beliefs | None = None
    """Parameters of the vehicle over its last dives"""
    followed_dives: tuple[int, ...] = ()
    """Numbers of these last dives"""
    table: tuple[DiveRow, ...] = ()
    """Last dives, in order of time"""
    readings: tuple[Reading, ...] = ()
    """Newest readings of battery and vacuum"""
    legs: tuple[LoggedLeg, ...] = ()
    """Legs between fixes, in order of time"""
    came_up: LastFix | None = None
    """Newest fix after a dive of the log; the path of that dive may be unknown"""
    used: EnergyUse | None = None
    energy_left_kwh: float | None = None
    lasts: Endurance | None = None
    """Endurance by the use so far, where the energy left is known"""
    outlook: EnergyOutlook | None = None
    """Days left for changes of the plan, and the turn home"""
    surfacings: Forecast | None = None
    plan: str = ""
    """Plan that the forecast flies, in words"""
    arrival: Arrival | None = None
    """Arrival at the next waypoint, where one is known"""
    changes: tuple[Mapping[str, str], ...] = ()
    """Rows of a table: what the last dives did, and what the plan asks"""
    routes: RoutePlan | None = None
    """Routes to the next place, where a pilot gave one"""
    proposed: ProposedFiles | None = None
    """Files with the plan, where a pilot gave its places"""
    lacking: tuple[str, ...] = ()
    """Reasons for missing sections, and remedies"""

    @property
    def verdict(self) -> str:
        """Verdict in one line."""
        if self.health is None:
            return f"{self.title}: nothing can be judged yet"
        said = self.health.verdict()
        if self.health.alarm and self.vehicle is not None and not identified(self.vehicle):
            said += f"; judged by {self.vehicle.name}, not by a vehicle identified from its logs"
        return said

    @property
    def last_fix(self) -> LastFix | None:
        """Newest fix, of the dialogue or of the log."""
        before = -np.inf if self.came_up is None else self.came_up.time
        said = self.dialogue
        if said is not None and said.fix and said.fix_time and said.fix_time > before:
            return LastFix(latitude=said.fix[0], longitude=said.fix[1], time=said.fix_time)
        return self.came_up

    @property
    def missing(self) -> tuple[str, ...]:
        """Sentences on all that is missing: the forecast, files cut or left out, other sections, in
        this order."""
        first = self.lacking[:1] if self.surfacings is None else ()
        return tuple(dict.fromkeys([*first, *self.log.cut_or_left_out, *self.lacking]))

    def parameters(self) -> list[dict[str, Any]]:
        """Rows of a table: each parameter by the vehicle's file, and after the last dive."""
        if self.followed is None:
            return []
        return [
            {
                "parameter": one.name,
                "what it is": one.meaning,
                "file": start,
                "after the last dive": float(self.followed.value(one.name)[-1]),
                "deviation": float(self.followed.deviation(one.name)[-1]),
                "unit": one.unit,
            }
            for one, start in zip(self.followed.parameters, self.followed.nominal, strict=True)
        ]

    def describe(self) -> dict[str, Any]:
        """Values for JSON, as in `latest.json`."""
        levels: dict[str, Any] = {}
        if self.health is not None and self.dives:
            last = self.health.levels.level[-1], self.health.levels.deviation[-1]
            levels = {
                one.name: {"level": float(level), "deviation": float(deviation), "unit": one.unit}
                for one, level, deviation in zip(CHANNELS, *last, strict=True)
                if one.name not in self.health.lacking
            }
        parts = {
            "last_fix": self.last_fix,
            "health": self.health,
            "energy": self.used,
            "outlook": self.outlook,
            "routes": self.routes,
            "forecast": self.surfacings,
            "waypoint": self.arrival,
        }
        same = ("title", "deployment", "verdict", "energy_left_kwh", "plan")
        return {
            **{name: getattr(self, name) for name in same},
            **{name: list(getattr(self, name)) for name in ("dives", "changes", "lacking")},
            **{name: list(getattr(self.log, name)) for name in ("unreadable", "short")},
            **{name: None if one is None else one.describe() for name, one in parts.items()},
            "vehicle": None if self.vehicle is None else self.vehicle.name,
            "dialogue": None if self.dialogue is None else dataclasses.asdict(self.dialogue),
            "current": self.legs[-1].leg.current.tolist() if self.legs else None,
            "dive_table": [one.describe() for one in self.table],
            "readings": [one._asdict() for one in self.readings],
            "levels": levels,
            "parameters": self.parameters(),
            "days_left": None if self.lasts is None else self.lasts.days,
            "days_left_90": None if self.lasts is None else self.lasts.interval(),
            "proposed": {} if self.proposed is None else dict(self.proposed.changes),
        }


def morning(
    deployment: WatchedDeployment,
    log: LogOfFiles,
    dialogue: SurfaceDialogue | None = None,
    *,
    say: Callable[[str], object] = lambda _: None,
) -> Morning:
    """Make the daily report from a log.

    Args:
      say: called with the name of each step as it begins.
    """
    title = deployment.folder.resolve().name
    if log.store is None:
        return Morning(title=title, log=log, dialogue=dialogue, lacking=(log.missing,))
    store = log.store
    lacking = [log.missing] if log.missing else []

    def attempt(what: str, ask: Callable[[], Told]) -> Told | None:
        try:
            return ask()
        except TwinError as error:
            first = 0 if what == FORECAST else len(lacking)
            lacking.insert(first, f"{what}: {error}".replace(str(store), store.name))
            return None

    with LogStore(store) as logs:
        name = logs.deployments[int(np.argmax(np.nan_to_num(logs.starts, nan=-np.inf)))]
        rows = logs.missions_of(name)
        numbers = logs.array(DIVE) if DIVE in logs else np.arange(len(logs))
        dives = tuple(int(numbers[row]) for row in rows)
        others = len(set(logs.deployments)) - 1
        legs = tuple(legs_of(logs, name))
        silent = dive_times(logs, name).silent
        came_up = newest_fix(logs, rows)
        source = logs.source
        table = dive_rows(logs, rows, dives, legs)
        own = dialogue if dialogue and dialogue.vehicle.lower() in name.lower() else None
        readings = newest_readings(logs, rows, own)
    if dialogue is not own:
        assert dialogue is not None
        lacking.append(
            f"the newest dialogue in the source is of {dialogue.vehicle}, the log of {name}: it is "
            "left out"
        )
        dialogue = own
    if others:
        lacking.append(f"{others} more deployments in the log than {name}, which began last")
    if silent:
        lacking.append(silent)
    if legs and came_up is not None and came_up.time - legs[-1].leg.end > NEWER:
        late = dives[rows.index(legs[-1].mission) + 1 :]
        span = f"{late[0]} to {late[-1]}" if len(late) > 1 else f"{late[0]}"
        lacking.append(
            f"current: of {counted(len(late), 'dive')} since {utc_minute(legs[-1].leg.end)} UTC "
            f"({span}) the way through the water is not known, such as of one "
            f"that a thruster drove: the current is {(came_up.time - legs[-1].leg.end) / HOUR:.1f} "
            "h older than the last fix"
        )
    vehicle = attempt("vehicle", lambda: deployment.vehicle_of(store))
    sections: dict[str, Any] = {
        "title": title, "log": log, "deployment": name, "dives": dives, "legs": legs,
        "dialogue": dialogue, "came_up": came_up, "vehicle": vehicle, "table": table,
        "readings": readings,
    }  # fmt: skip
    if vehicle is None:
        return Morning(**sections, lacking=tuple(lacking))
    if odd := other_kind(store, vehicle):
        lacking.append(odd.replace(str(store), store.name))
    if not identified(vehicle):
        lacking.append(
            f"vehicle: {vehicle.name} was not identified from logs of this vehicle, so that what "
            "differs between the two may look like a fault: `twin identify` with logs that have "
            "attitude and pump, then vehicle in deployment.toml"
        )
    say("health")
    found = attempt(
        "health",
        lambda: assess(
            store, vehicle, false_alarm_days=deployment.false_alarm_days, deployments=[name]
        ),
    )
    say("parameters")
    followed = attempt(
        "parameters",
        lambda: follow_parameters(
            load_logs(store, rows[-MOST_FOLLOWED:]), load_calibration(vehicle)
        ),
    )
    by_row = dict(zip(rows, dives, strict=True))
    used = attempt("energy", lambda: counted_energy(store, vehicle, newest=True))
    left = None
    if used is None:
        lacking.append("energy: the log has no counter of charge with a voltage")
    elif not deployment.energy_kwh:
        lacking.append("days left: energy_kwh in deployment.toml is 0, not known")
    else:
        left = deployment.energy_kwh - used.charge * used.voltage / KILO
    lasts = None if used is None or left is None else endurance_of(used, left)
    sections |= {
        "health": found[0] if found else None, "followed": followed,
        "followed_dives": tuple(by_row[row] for row in followed.rows) if followed else (),
        "used": used, "energy_left_kwh": left, "lasts": lasts,
    }  # fmt: skip
    if not legs:
        lacking.insert(0, f"{FORECAST}: no dive lies between two fixes and has a known way")
    else:
        say("forecast")
        metered = vehicle if used is None else with_consumption(vehicle, used.consumption)
        expected = attempt(FORECAST, lambda: expected_plan(deployment, store, metered, legs))
        if expected is not None and deployment.goto:
            plan_of, now = expected.mission, flown_files(folder_of(deployment))
            files = sections["proposed"] = attempt(
                "proposal",
                lambda: proposed_files(source, plan_of, metered, now, deployment.samples),
            )
            if files is not None:
                expected = dataclasses.replace(expected, mission=files.mission)
        fix = Morning(**sections).last_fix
        answer = None if expected is None or fix is None else attempt(
            FORECAST, lambda: _forecast(deployment, store, metered, left, fix, expected)
        )  # fmt: skip
        if expected is not None and answer is not None:
            sections["surfacings"], sections["plan"], water = answer
            sections["changes"] = expected.changes
            sections["arrival"] = None if expected.guessed else arrival(answer[0])
            if deployment.goto:
                say("routes")
                request, (first, *_) = answer[0].request, answer[0].request.mission.segments
                assert isinstance(first, Waypoint)
                nearest = dataclasses.replace(first, targets=first.targets[:1])
                mission = dataclasses.replace(request.mission, segments=(nearest,))
                request = dataclasses.replace(request, mission=mission)
                sections["routes"] = attempt(  # planned only: `twin route` flies its routes too
                    "routes", lambda: plan_routes(request, water, fly_them=False, say=say)
                )
            if expected.guessed:
                lacking.append(
                    "where it goes: nobody says it, so the ellipses hold only if it goes on as in "
                    "its last dive; give goto in deployment.toml"
                )
            if used is not None and lasts is not None:
                say("endurance")
                outlook = sections["outlook"] = attempt(
                    "endurance",
                    lambda: energy_outlook(
                        answer[0], used, lasts, legs, deployment.harbour, guessed=expected.guessed
                    ),
                )
                lacking += () if outlook is None else outlook.lacking
    return Morning(**sections, lacking=tuple(lacking))


def _forecast(
    deployment: WatchedDeployment,
    store: Path,
    vehicle: Vehicle,
    left: float | None,
    fix: LastFix,
    plan: ExpectedPlan,
) -> tuple[Forecast, str, Known]:
    """Forecast the next surfacings; return the forecast, the plan in words, the known currents."""
    begin = utc_text(moment_of(float(round(fix.time))))
    place, water, stale = begun(
        Origin(latitude_deg=fix.latitude, longitude_deg=fix.longitude, time=begin),
        known_from_logs(store, str(vehicle.path) if identified(vehicle) else None),
    )
    request = Request(
        vehicle=vehicle,
        mission=plan.mission,
        place=place,
        hours=deployment.hours,
        members=deployment.members,
        energy_left_kwh=left if left and left > 0.0 else None,
        field=parse_field(deployment.field) if deployment.current else None,
    )
    said = ". ".join([plan.words, *request.notes(), *([stale] if stale else [])])
    return forecast(request, water), said, water
