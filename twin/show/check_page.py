"""Page of a check against logs: figures by phase, then dives with the twin drawn over the log."""

from __future__ import annotations

from collections.abc import Container
from pathlib import Path

from twin.identify.log_check import LogCheck
from twin.identify.log_flight import legs_flown
from twin.identify.replayed_dive import (
    PHASES,
    RUDDER,
    USUAL_NAMES,
    ReplayedDive,
    log_signal,
)
from twin.records.reader import MissionStore
from twin.records.store import read_trajectory
from twin.records.trajectory import Trajectory
from twin.show.figures.logged_dive import log_figure
from twin.show.figures.page_layout import Page, mission_caption
from twin.vehicle.vehicle import Vehicle

MOST_DIVES = 6
"""Dives drawn, spread evenly over those checked"""
UNITS = {
    "depth_rate_m_s": "depth rate, down [m/s]",
    "speed_m_s": "speed through the water [m/s]",
    "pitch_deg": "pitch [deg]",
    "turn_per_actuator": "turn rate per actuator [deg/s per deg]",
    "turning_deg": "what turns it, mean [deg]",
    "heading_sd_deg": "heading about its target [deg]",
    "heading_bias_deg": "heading less its target, mean [deg]",
}
"""How people read the figures"""


def log_check_rows(found: LogCheck) -> list[dict[str, object]]:
    """A row for each figure of each phase: log, twin, and how they differ."""
    rows: list[dict[str, object]] = []
    for phase in PHASES:
        if phase not in found.phases:
            continue
        said = found.phases[phase].describe()
        for name, label in UNITS.items():
            rows.append(
                {
                    "phase": phase,
                    "figure": label,
                    "log": said["log"][name],
                    "twin": said["twin"][name],
                    "twin/log": said["ratio"].get(name),
                    "twin-log": said["deviation"].get(name),
                }
            )
    return rows


def write_log_check(folder: Path, found: LogCheck, command: str = "") -> Path:
    """Write `index.html` and its figures as PNG into `folder`; returns the page's path.

    Raises:
      InputError: the folder cannot be made.
    """
    page = Page(
        folder,
        f"{found.vehicle.name} beside its logs",
        f"{len(found.dives)} dives of {found.store.name}, flown by the twin in closed loop on the "
        "log's pitch, pump, turning depths and headings",
    )
    page.points(found.beyond or ["All figures are within their limits."])
    page.section("By phase")
    page.table(log_check_rows(found), "Means away from inflections and the surface.", first=False)
    if found.notes:
        page.points(found.notes)
    page.section("Dives")
    pairs = [
        (d, f) for d, f in zip(found.dives, found.flights, strict=True) if isinstance(f, Trajectory)
    ]
    step = max(1, -(-len(pairs) // MOST_DIVES))
    with MissionStore(found.store) as store:
        for dive, flight in pairs[::step]:
            drawn = log_figure(
                read_trajectory(found.store, dive.row),
                as_logged(dive, flight, found.vehicle, store),
            )
            page.figure(f"dive-{dive.row}", drawn, mission_caption(store, dive.row))
    if command:
        page.section("Command")
        page.code(command)
    return page.write()


def as_logged(
    dive: ReplayedDive, flight: Trajectory, vehicle: Vehicle, names: Container[str]
) -> Trajectory:
    """A flight of the twin on the log's clock and under the names of its signals, `names`."""
    begin = dive.period * dive.targets[0].leg.first
    signals = {
        f"measured_{name}": flight[f"true_{name}"] for name in ("depth", "pitch", "roll", "heading")
    }
    for part in vehicle.parts:
        name = log_signal(vehicle, part, names) or log_signal(vehicle, part, USUAL_NAMES)
        sense = part.sense("heading") if name == RUDDER else 1.0
        signals[name or f"measured_{part.name}"] = sense * flight[f"true_{part.name}"]
    flown = legs_flown(dive, flight) >= 0
    return Trajectory(
        time=flight.time[flown] + begin,
        signals={name: values[flown] for name, values in signals.items()},
        states=flight.states[flown, :0],
    )
