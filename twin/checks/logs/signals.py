"""Signals: what a store of logs must hold to be compared, and what is said of what it lacks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twin.checks.logs.dive import Dive
from twin.checks.logs.steering import Turning
from twin.errors import StoreError
from twin.records.logs import LogStore
from twin.records.reader import MissionStore
from twin.vehicle.vehicle import Vehicle


class Present:
    """The signals of a store that have a value."""

    def __init__(self, logs: LogStore) -> None:
        self._logs = logs

    def __contains__(self, name: object) -> bool:
        return str(name) in self._logs and bool(np.isfinite(self._logs.array(str(name))).any())


def check_logged(store: str | Path) -> None:
    """Refuse a store of simulated missions."""
    with MissionStore(store) as found:
        if not found.logged:
            raise StoreError(
                f"store {store} is simulated: its missions were flown by the twin already; give a "
                "store of logs (`factory import`), or judge the twin by `twin check` alone"
            )


def check_signals(logs: LogStore, rows: Sequence[int]) -> None:
    """Refuse a log without what a glide needs, by the names of signals."""
    there = Present(logs)
    for names, why in (
        (("measured_depth",), "depth: nothing says when it dived"),
        (("measured_pitch",), "pitch: nothing says how it glided"),
        (("measured_pump", "commanded_pump"), "pumped volume: nothing says what drove it"),
    ):
        if not any(name in there for name in names):
            raise StoreError(
                f"store {logs.path}: the log has no {why} ({' nor '.join(names)}); check another "
                "log of this vehicle"
            )


def notes_of(
    logs: LogStore, dives: Sequence[Dive], turning: Turning | None, vehicle: Vehicle
) -> list[str]:
    """What the log lacks, and what stands in for it."""
    there = Present(logs)
    notes = []
    if logs.simulated:
        notes.append("the log says itself that it is of a simulation")
    names = list(dict.fromkeys(logs.deployments[dive.row] for dive in dives))
    if len(names) > 1:
        notes.append(
            f"the dives are of {len(names)} deployments ({', '.join(names)}): one vehicle file "
            "fits them only if one vehicle made them; choose with --missions"
        )
    if "measured_heading" not in there:
        notes.append("the log has no heading: the twin holds its own, and turns are not compared")
    elif "commanded_heading" not in there:
        notes.append(
            "the log has no heading setpoint: the target is the running mean of its heading over "
            "15 min"
        )
    if "measured_density" not in there:
        notes.append(
            "the log has no density: the water is the vehicle file's, which decides the depth rate"
        )
    if "measured_pump" not in there:
        notes.append("the log has no measured pump position: the commanded one stands for it")
    if turning is None:
        notes.append(f"vehicle {vehicle.name!r} has no part that turns it")
    elif turning.signal is None:
        notes.append("the log has no position of what turned it: turns per position are not known")
    elif not turning.same:
        notes.append(
            f"the log turned by {turning.signal.removeprefix('measured_')}, vehicle "
            f"{vehicle.name!r} turns by its {turning.part}: their effects cannot be compared"
        )
    return notes
