"""Table reader: turns mapped columns into signals of the schema, and accounts for each column."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping as Dict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import reference_declination
from factory.importing.cleaning import LIMITS, clean
from factory.importing.columns import stacked, tidy, with_values
from factory.importing.deployment_log import (
    EMPTY,
    NEAR,
    TRUNCATED,
    Channel,
    DeploymentLog,
    LoggedFixes,
    places_for,
)
from factory.importing.formats.base import SHORTEST, TABLES, ReadOptions, sniff
from factory.importing.formats.csv.mapping import (
    HEADINGS,
    LOCKS,
    LOG_ONLY,
    Mapping,
    row_times,
)
from factory.importing.formats.csv.mapping_file import load_mapping, shipped_names
from factory.importing.formats.csv.pieces import KIND, LogPiece, check_track, pieces_of
from factory.importing.pressures import ctd_channels, pressure_of, with_dbar_by_depth
from factory.importing.tally import Tally, note_empty
from twin.errors import InputError
from twin.records.schema.limits import recorded_limits

Array = NDArray[np.float64]


def read_tables(
    paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:  # fmt: skip
    """Make one log for each deployment that the mapping distinguishes.

    Raises:
      InputError: the mapping is missing or does not fit the files, or a velocity is impossible.
    """
    if options.mapping is None:
        kind = sniff(paths[0]) if paths[0].suffix.lower() in TABLES else None
        hint = f". It looks like {kind}: use `factory import {kind}`" if kind else ""
        raise InputError(
            f"{paths[0].name}: csv tables need a --mapping, a TOML file that gives each column's "
            "signal (docs/howto/import_tables.md shows one), or a shipped one "
            f"({', '.join(shipped_names())}){hint}"
        )
    mapping = load_mapping(options.mapping)
    groups: dict[str, list[LogPiece]] = {}
    valued: set[str] = set()
    for path in paths:
        for deployment, piece in pieces_of(path, mapping, tally):
            groups.setdefault(deployment, []).append(piece)
            valued |= {*with_values(piece.columns)}
    note_empty(KIND, (s.column for n, s in mapping.signals.items() if n not in valued), tally)
    return [
        _log(name, pieces, mapping, options.variation_deg, tally) for name, pieces in groups.items()
    ]


def _log(
    deployment: str,
    pieces: Sequence[LogPiece],
    mapping: Mapping,
    variation_deg: float | None,
    tally: Tally,
) -> DeploymentLog:
    """Join the pieces of one deployment into a log."""
    together = stacked([{"time": p.time, **p.columns} for p in pieces], ["time", *mapping.signals])
    time, columns = tidy(together.pop("time"), together, deployment, tally)
    channels = channels_of(deployment, time, columns, mapping, tally)
    return mapped_log(
        deployment, channels, mapping, variation_deg, tally, time=time,
        files=[piece.time for piece in pieces], names=[piece.path.name for piece in pieces],
    )  # fmt: skip


def channels_of(
    deployment: str, time: Array, columns: Dict[str, Array], mapping: Mapping, tally: Tally
) -> dict[str, Channel]:
    """Make channels of columns with one clock, by their signals; values that the mapping or the
    schema excludes are removed and counted.

    Args:
      time: [s] unix, increasing.
      columns: by signal, in the store's units and axes, NaN without a value.
    """
    channels: dict[str, Channel] = {}
    for name, values in columns.items():
        signal = mapping.signals[name]
        low, high = signal.possible or (-np.inf, np.inf)
        if name not in LOG_ONLY and name not in LIMITS:
            least, most = recorded_limits(name)
            low, high = max(low, least), min(high, most)
        bad = np.isfinite(values) & ((values < low) | (values > high))
        kept = tally.removed(values, bad, name, f"outside {low:g} to {high:g}")
        channel = clean(name, time, kept, tally)
        if len(channel):
            channels[name] = channel
        elif np.isfinite(values).any() or not signal.optional:
            tally.add("missing", name, 1, f"{deployment} has no value of it")
    return channels


def mapped_log(
    deployment: str,
    channels: dict[str, Channel],
    mapping: Mapping,
    variation_deg: float | None,
    tally: Tally,
    *,
    time: Array,
    files: Sequence[Array],
    names: Sequence[str],
) -> DeploymentLog:
    """Make a log of mapped channels: turn headings to true north, add fixes, rows and density.

    Args:
      channels: by signal.
      variation_deg: [degree] magnetic variation, instead of the log's own.
      time: [s] every time of the deployment, increasing.
      files: [s] times of each file.
      names: names of the files.

    Raises:
      InputError: a magnetic heading has no variation, or a velocity is impossible.
    """
    if mapping.dvl_lock is not None and "measured_dvl_surge" in channels:
        has = np.isin(time, channels["measured_dvl_surge"].time)
        channels["measured_dvl_mode"] = Channel(time, LOCKS[mapping.dvl_lock] * has.astype(float))
        tally.add("note", "measured_dvl_mode", has, f"{mapping.dvl_lock}, says the mapping")
    channels = with_dbar_by_depth(channels, tally, deployment)
    variation = channels.pop("magnetic_variation", EMPTY)
    latitude, longitude, valid = (
        channels.pop(f"gps_{name}", EMPTY) for name in ("latitude", "longitude", "fix")
    )
    fixes = _fixes(latitude, longitude, valid, tally)
    magnetic = [n for n in HEADINGS & set(channels) if mapping.signals[n].north != "true"]
    if magnetic and variation_deg is None and not len(variation):
        variation = reference_declination(places_for(fixes, channels), deployment, tally)
    for name in magnetic:
        heading = channels[name]
        if variation_deg is None and not len(variation):
            raise InputError(
                f"{deployment}: {name} is from magnetic north, and the log has neither a variation "
                "nor a position from which it follows: give --variation-deg, or map "
                "magnetic_variation, or latitude and longitude"
            )
        turn = variation.at(heading.time) if variation_deg is None else variation_deg
        channels[name] = Channel(heading.time, np.mod(heading.values + turn, 360.0))
        tally.add("note", name, len(heading), "turned from magnetic to true north")
    conductivity = channels.pop("conductivity", None)
    log = DeploymentLog(
        deployment=deployment,
        platform=mapping.vehicle,
        channels={n: c for n, c in channels.items() if n not in LOG_ONLY},
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary={
            **{n: c for n, c in channels.items() if n in LOG_ONLY},
            "awake": Channel(time, np.ones(len(time))),
        },
        files=tuple(names),
        pieces=_within_depth(deployment, row_times(mapping, time, files), channels, tally),
        period=mapping.period_s or _spacing(time),
        held=frozenset(
            n for n, s in mapping.signals.items() if s.held or n.startswith("commanded_")
        ),
        model=mapping.model,
    )
    log = _with_water(log, conductivity, tally)
    check_track(log, tally)
    return log


def _within_depth(
    deployment: str,
    rows: tuple[tuple[float, float], ...] | None,
    channels: Dict[str, Channel],
    tally: Tally,
) -> tuple[tuple[float, float], ...] | None:
    """Cut rows to the time that their depth covers, as a store has no depth with a gap. The time
    cut off is counted; rows without any depth stay."""
    depth = channels.get("measured_pressure") or channels.get("measured_depth")
    if rows is None or depth is None:
        return rows
    kept = []
    for start, end in rows:
        known = depth.within(start, end).time
        first, last = (known[0], known[-1]) if len(known) else (start, end)
        begins = start if first - start <= NEAR else float(first)
        ends = end if end - last <= NEAR else float(last)
        lost = (begins - start) + (end - ends)
        why = f"{lost / 60.0:.0f} min of a row, in which the depth had not begun, or had ended"
        tally.add("left out", deployment, int(lost > 0.0), f"{TRUNCATED}{why}")
        kept.append((begins, ends))
    return tuple(kept)


def _spacing(time: Array) -> float | None:
    """[s] Usual time between rows, to three digits; None for a single row."""
    if len(time) < 2:
        return None
    return max(float(f"{np.median(np.diff(time)):.3g}"), SHORTEST)


def _fixes(latitude: Channel, longitude: Channel, fix: Channel, tally: Tally) -> LoggedFixes:
    """GPS fixes: a repeated position is one fix, at its first row. A position that is repeated from
    the log's start on is old and left out. Positions that the receiver calls no fix are removed."""
    both = np.intersect1d(latitude.time, longitude.time)
    if len(fix) and both.size:
        said = fix.values[np.maximum(np.searchsorted(fix.time, both, side="right") - 1, 0)] > 0.0
        tally.add("removed", "GPS fixes", ~said, "the receiver says that it has none")
        both = both[said]
    north = latitude.values[np.isin(latitude.time, both)]
    east = longitude.values[np.isin(longitude.time, both)]
    fresh = np.ones(len(both), bool)
    fresh[1:] = (np.diff(north) != 0.0) | (np.diff(east) != 0.0)
    if len(both) > 1:
        fresh[0] = fresh[1]
    tally.add("left out", "GPS fixes", ~fresh, "rows that repeat the position before")
    return LoggedFixes(both, north, east).keep(fresh)


def _with_water(log: DeploymentLog, conductivity: Channel | None, tally: Tally) -> DeploymentLog:
    """Add salinity and density if the CTD, a pressure and a position allow it."""
    warm, fresh = log.channel("measured_temperature"), log.channel("measured_salinity")
    pressure, depth = log.channel("measured_pressure"), log.channel("measured_depth")
    have_salt = len(fresh) or conductivity is not None
    if not len(warm) or not have_salt or not (len(pressure) or len(depth)):
        return log
    latitude, longitude = log.fixes.middle if len(log.fixes) else (
        float(np.median(axis.values)) if len(axis) else 0.0
        for axis in (log.channel("latitude"), log.channel("longitude"))
    )  # fmt: skip
    dbar = pressure or Channel(depth.time, pressure_of(depth.values, latitude))
    made = ctd_channels(
        warm.time, temperature=warm.values, pressure=dbar.known(warm.time),
        practical=fresh.known(warm.time) if len(fresh) else None,
        conductivity=None if conductivity is None else conductivity.known(warm.time),
        latitude=latitude, longitude=longitude, tally=tally,
    )  # fmt: skip
    return dataclasses.replace(log, channels={**log.channels, **made})
