"""PD0 reader: logs of Doppler instruments of RDI, alone or beside the log of their vehicle."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from factory.importing.deployment_log import (
    EMPTY,
    NO_FIXES,
    TRUNCATED,
    Channel,
    DeploymentLog,
    each_file,
)
from factory.importing.doppler.hull_velocity import HullVelocity, hull_velocity
from factory.importing.doppler.joining import find_offsets
from factory.importing.doppler.pd0 import NAMES, Array, Ensembles, read_pd0
from factory.importing.doppler.screens import Thresholds
from factory.importing.formats.base import SHORTEST, ReadOptions
from factory.importing.pressures import with_depth
from factory.importing.tally import Tally, note_unread, summarise
from twin.errors import InputError
from twin.sensors import DVL_MODES

GAP = 60.0
"""[s] Longest time between ensembles of one row."""
SHALLOW, BIN, LEAST_SHARE = 2.0, 50.0, 0.6
"""SHALLOW: [m] depth below which the report counts kept ensembles. BIN: [m] size of its bins.
LEAST_SHARE: share of kept ensembles below which it names a bin."""
STEEP, FEW = np.radians(10.0), 30
"""STEEP: [rad] pitch of a hull that dives or climbs. FEW: minimum number of ensembles of a mean."""
SUBJECT = "Doppler log"
"""Subject of the report's lines."""


def read_pd0_logs(
    paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:  # fmt: skip
    """Read one log from each file: attitude and depth of the file, and the hull's velocity.

    Raises:
      InputError: a file is no PD0, or shows no sound velocity through the water.
    """
    return [log for _, log in each_file(paths, lambda path: _alone(path, options, tally), tally)]


def _alone(path: Path, options: ReadOptions, tally: Tally) -> DeploymentLog:
    found = _measured(path.name, _layouts(path, tally), None, tally)
    log, variation = found.log, options.variation_deg
    if variation is None:
        why = "as the file has it: magnetic, unless the instrument was given the variation"
        tally.add("note", "measured_heading", len(log), why)
    own = {
        "measured_depth": log.depth,
        "measured_pitch": log.pitch,
        "measured_roll": log.roll,
        "measured_heading": np.mod(log.heading + (variation or 0.0), 360.0),
    }
    if np.ptp(log.depth) == 0.0:
        del own["measured_depth"]
        tally.add("missing", "measured_depth", 1, f"{path.name} has one depth throughout")
    time = np.unique(log.time)
    rows = np.split(time, np.flatnonzero(np.diff(time) > GAP) + 1)
    step = float(np.median(np.diff(time))) if len(time) > 1 else None
    return DeploymentLog(
        deployment=path.stem,
        platform=SUBJECT,
        channels=_channels(found, own),
        cells=_cells(found),
        fixes=NO_FIXES,
        magnetic_variation=EMPTY,
        files=(path.name,),
        pieces=tuple((float(row[0]), float(row[-1])) for row in rows),
        period=None if step is None else max(float(f"{step:.3g}"), SHORTEST),
    )


def with_doppler(
    logs: Sequence[DeploymentLog], paths: Sequence[Path], tally: Tally
) -> list[DeploymentLog]:
    """Add the hull's velocity by Doppler logs to the logs of the vehicles that carried them.

    Each file has offsets of its own; the tilt of the mount is one for all files of a log.

    Raises:
      InputError: no file can be used; the message names the reason.
    """
    joined: dict[int, list[Ensembles]] = {}
    names: dict[int, list[str]] = {}

    def join(path: Path) -> None:
        layouts = _layouts(path, tally)
        times = np.concatenate([one["time"] for one in layouts])
        ends = np.nanmin(times), np.nanmax(times)
        shared = {
            k: min(ends[1], log.span[1]) - max(ends[0], log.span[0])
            for k, log in enumerate(logs)
            if log.channels
        }
        which = max(shared, key=lambda k: shared[k])
        by = find_offsets(path.name, layouts, with_depth(logs[which], Tally()))
        turned = f"{by.heading:+.2f} degree (one ensemble: +- {by.heading_deviation:.2f})"
        tally.add(
            "note", SUBJECT, len(times),
            f"{path.name}: clock {by.seconds:+.1f} +- {by.seconds_deviation:.1f} s, heading "
            f"{turned if np.isfinite(by.heading) else 'unknown'} to {logs[which].deployment}",
        )  # fmt: skip
        moved = [{**one, "time": one["time"] + by.seconds} for one in layouts]
        joined.setdefault(which, []).extend(moved)
        names.setdefault(which, []).append(path.name)

    if any(log.channels for log in logs):
        each_file(paths, join, tally)
    found = list(logs)
    for which, layouts in joined.items():
        log = logs[which]
        taken = [name for name in log.channels if name.startswith("measured_dvl_")]
        if taken:
            raise InputError(
                f"{log.deployment} has {taken[0]} already: leave its column out, or --doppler"
            )
        words = summarise(names[which], 2)
        velocity = _measured(words, layouts, with_depth(log, Tally()), tally)
        channels = {**_channels(velocity, {}), **log.channels}  # its own altimeter stays
        files = (*log.files, *names[which])
        cells = _cells(velocity)
        found[which] = dataclasses.replace(log, channels=channels, cells=cells, files=files)
    return found


def _layouts(path: Path, tally: Tally) -> tuple[Ensembles, ...]:
    """Read a file; count what is damaged, cut or of other types."""
    file = read_pd0(path)
    tally.add("removed", path.name, file.damaged, "ensembles with a wrong checksum or layout")
    if file.cut:
        tally.add("note", path.name, 1, f"{TRUNCATED}its last ensemble is not whole")
    present = [NAMES.get(kind, f"type {kind:04x}") for kind in sorted(file.blocks)]
    note_unread("PD0 ensemble", present, NAMES.values(), tally)
    return file.layouts


def _channels(found: HullVelocity, more: dict[str, Array]) -> dict[str, Channel]:
    """Signals of a hull's velocity, and more arrays, at the times of the ensembles."""
    mode = np.where(found.kept, DVL_MODES["water"], DVL_MODES["none"]).astype(float)
    signals = {**more, "measured_dvl_mode": mode, "measured_altitude": found.log.altitude}
    for k, axis in enumerate(("surge", "sway", "heave")):
        signals[f"measured_dvl_{axis}"] = found.water[:, k]
        signals[f"measured_dvl_{axis}_deviation"] = found.deviation[:, k]
        signals[f"measured_bottom_{axis}"] = found.bottom[:, k]
    time, first = np.unique(found.log.time, return_index=True)
    channels = {name: Channel.finite(time, values[first]) for name, values in signals.items()}
    return {name: one for name, one in channels.items() if len(one)}


def _cells(found: HullVelocity) -> Channel:
    """Cells at the times of the ensembles that have any, (ensembles, cells, 3)."""
    time, first = np.unique(found.log.time, return_index=True)
    some = np.isfinite(found.cells[first, :, 0]).any(axis=1)
    return Channel(time[some], found.cells[first][some])


def _measured(
    name: str, layouts: Sequence[Ensembles], vehicle: DeploymentLog | None, tally: Tally
) -> HullVelocity:
    """Find a hull's velocity, and report how it was found."""

    def note(count: int, words: str) -> None:
        tally.add("note", SUBJECT, count, f"{name}: {words}")

    limits = Thresholds()
    found = hull_velocity(name, layouts, vehicle, limits)
    count, fit = len(found.log), found.closure
    for screen, number in found.dropped.items():
        tally.add("removed", SUBJECT, number, f"{name}: ensembles, by {screen}")
    top = np.floor(found.depth / BIN) * BIN
    inside = {float(t): found.kept[(top == t) & (found.depth > SHALLOW)] for t in np.unique(top)}
    shares = {t: float(kept.mean()) for t, kept in inside.items() if len(kept)}
    each = ", ".join(f"{t:.0f} m {share:.0%}" for t, share in shares.items())
    note(int(found.kept.sum()), f"kept of {count}, by {BIN:.0f} m of depth: {each}")
    low = [f"{t:.0f}" for t, share in shares.items() if share < LEAST_SHARE]
    if low:
        note(len(low), f"fewer than {LEAST_SHARE:.0%} of ensembles kept from {', '.join(low)} m")
    note(
        fit.ensembles,
        f"mount tilted {np.degrees(fit.tilt):+.2f} +- {np.degrees(fit.tilt_deviation):.2f} degree "
        f"nose up, taken out; vertical velocity is {fit.scale:.3f} +- {fit.scale_deviation:.3f} of "
        "the depth rate, which the deviations hold",
    )
    if found.swapped:
        level = "level" if found.log.turned.any() else "the hull's"
        note(count, f"ship axes are {level}, against the file's word: so the depth rate closes")
    by_ctd = f"by the CTD, velocities times {found.sound:.4f}"
    note(count, f"speed of sound {'of the instrument' if found.sound == 1.0 else by_ctd}")
    for word, factor in (("as set", 1.0), ("half", 0.5), ("twice", 2.0)):
        varied = found
        try:
            if factor != 1.0:
                varied = hull_velocity(name, layouts, vehicle, limits.scaled(factor))
            note(int(varied.kept.sum()), f"thresholds {word}: {_summary(varied)}")
        except InputError as error:
            note(1, f"thresholds {word}: {error}")
    return found


def _summary(found: HullVelocity) -> str:
    """Mean surge and angle of attack, nose down, nose up and level."""
    words = []
    for phase, inside in (
        ("nose down", found.pitch < -STEEP),
        ("nose up", found.pitch > STEEP),
        ("level", np.abs(found.pitch) <= STEEP),
    ):
        use = found.kept & inside
        if use.sum() >= FEW:
            surge, _, heave = found.water[use].mean(axis=0)
            attack = np.degrees(np.arctan2(heave, surge))
            words.append(f"{phase} {surge:.3f} m/s, angle of attack {attack:+.2f} degree")
    return "; ".join(words) or "too few ensembles for a mean"
