"""Reader of Seaglider logs, from basestation netCDF files and from tables made of them.

Native: degrees, magnetic heading, cm of pitch mass (+ lifts the nose), cm3 of bladder (+ =
lighter), dbar; three GPS fixes a dive: GPS1 after the dive before, GPS2 before this one, GPSE
after it. Both sources are brought to the columns of the tables, then to one log a glider.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.formats.seaglider.adcp import adcp_truth
from factory.importing.formats.seaglider.rotation import rotation_from_counts
from factory.importing.reading.columns import Table, read_table, stacked, tidy, unix_seconds
from factory.importing.reading.deployment_log import (
    EMPTY,
    NO_FIXES,
    Channel,
    DeploymentLog,
    Fixes,
    joined,
)
from factory.importing.reading.each_file import each_file
from factory.importing.reading.netcdf import holds_arrays
from factory.importing.reading.payload import payload_channels, payload_names
from factory.importing.reading.tally import Tally
from factory.importing.reading.unread_names import leave_out, note_empty, note_unread
from factory.importing.repairs.cleaning import (
    clean,
    from_degrees,
    heading_degrees,
    positions,
    pressure_by_flight,
    to_cm3,
    to_dbar,
)
from factory.importing.repairs.declination import reference_declination
from factory.importing.repairs.seawater import ctd_channels
from twin.errors import InputError

Array = NDArray[np.float64]
Columns = dict[str, Array]

CM = 0.01
"""[m]"""
SAMPLE_COLUMNS = (
    "time", "dive", "depth_m", "pressure_dbar", "pitch_deg", "roll_deg", "head_mag_deg", "vbd_cc",
    "gc_pitch_ctl_cm", "gc_vbd_ctl_cc", "gc_pitch_ad", "gc_roll_ad", "rotation_deg", "temp_c",
    "sal_psu", "rho_insitu",
)  # fmt: skip
"""Columns of a table of samples that are read; `rotation_deg` comes from netCDF files only."""


_READ = {
    "samples": (*SAMPLE_COLUMNS, "glider"),
    "dives": (
        *(f"{fix}_{part}" for fix in ("gps1", "gps2", "gpsE") for part in ("time", "lat", "lon")),
        "glider", "dive", "magnetic_variation", "depth_avg_curr_north", "depth_avg_curr_east",
        "log_C_PITCH", "log_PITCH_CNV",
    ),
    "adcp": ("glider", "dive", "time", "depth_m", "u_ttw", "v_ttw", "w_ttw", "u_ocn", "v_ocn"),
}  # fmt: skip
"""Columns that each kind of table is read for."""


@dataclasses.dataclass
class GliderTables:
    """Pieces of one glider while they are collected."""

    name: str
    samples: list[Columns] = dataclasses.field(default_factory=list)
    dives: list[Columns] = dataclasses.field(default_factory=list)
    adcp: list[Columns] = dataclasses.field(default_factory=list)
    ctd: list[Columns] = dataclasses.field(default_factory=list)
    """Temperature and salinity with times of their own (netCDF); tables have them in samples."""
    payload: list[dict[str, Channel]] = dataclasses.field(default_factory=list)
    """By the files' own names (netCDF); tables have it in samples."""
    units: dict[str, str] = dataclasses.field(default_factory=dict)
    files: list[str] = dataclasses.field(default_factory=list)


def read_seaglider(
    paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:
    """One log for each glider among the files.

    Raises:
      WrongFormat: another kind of file.
      InputError: a glider without samples.
    """
    from factory.importing.formats.seaglider.dive_files import DiveFile, read_dive

    extra = payload_names(options.payload)
    gliders: dict[str, GliderTables] = {}

    def read(path: Path) -> DiveFile | Table:
        if path.suffix.lower() == ".nc" or holds_arrays(path):
            return read_dive(path, extra, tally)
        table = read_table(path)
        _kind_of(table)
        return table

    for path, found in each_file(paths, read, tally):
        if isinstance(found, Table):
            _table(found, gliders, extra, tally)
            continue
        glider = gliders.setdefault(found.glider, GliderTables(found.glider))
        glider.samples.append(found.samples)
        glider.dives.append(found.dive)
        if found.adcp:
            glider.adcp.append(found.adcp)
        if found.ctd:
            glider.ctd.append(found.ctd)
        glider.payload.append(found.payload)
        glider.units |= found.units
        glider.files.append(path.name)
    sampled = {name for glider in gliders.values() if glider.samples for name in glider.files}
    for glider in list(gliders.values()):
        if not glider.samples and set(glider.files) <= sampled:
            tally.add("left out", glider.name, 1, f"in {glider.files[0]}: no samples of that name")
            del gliders[glider.name]
        elif not glider.samples:
            raise InputError(
                f"{', '.join(glider.files)}: dives of {glider.name} without its table of samples; "
                f"samples are there of {_others(gliders) or 'no glider'}"
            )
    return [_log(glider, options, tally) for glider in gliders.values()]


def _others(gliders: dict[str, GliderTables]) -> str:
    return ", ".join(g.name for g in gliders.values() if g.samples)


def _kind_of(table: Table) -> str:
    """A key of `_READ`, by the table's columns.

    Raises:
      WrongFormat: no Seaglider's.
      InputError: it has no rows.
    """
    names = set(table.columns)
    if {"u_ttw", "v_ttw", "w_ttw"} <= names:
        what = "adcp"
    elif names & {"gps2_time", "gpsE_time"}:
        what = "dives"
    elif "time" in names and names & {"pitch_deg", "vbd_cc", "head_mag_deg"}:
        what = "samples"
    else:
        raise WrongFormat(table.path, [*table.columns, *table.texts])
    if not len(table):
        raise InputError(f"{table.path.name} holds column names and no rows")
    return what


def _table(
    table: Table, gliders: dict[str, GliderTables], extra: Sequence[str], tally: Tally
) -> None:
    """Sort a table's rows to the gliders that they are of."""
    subject = table.path.name
    what = _kind_of(table)
    tally.add("read", subject, len(table), f"rows of {what}")
    kind, wanted = f"table of {what}", (*_READ[what], *(extra if what == "samples" else ()))
    note_unread(kind, [*table.columns, *table.texts], wanted, tally)
    note_empty(kind, [n for n, v in table.columns.items() if not np.isfinite(v).any()], tally)
    owners = table.texts.get("glider")
    fallback = subject.split("_")[0].split(".")[0].upper()
    if owners is None:
        owners = np.full(len(table), fallback, dtype=object)
    for owner in dict.fromkeys(str(o) for o in owners):
        rows = np.array([str(o) == owner for o in owners])
        glider = gliders.setdefault(owner, GliderTables(owner))
        columns = {n: v[rows] for n, v in table.columns.items()}
        getattr(glider, what).append(columns)
        if subject not in glider.files:
            glider.files.append(subject)


def _log(glider: GliderTables, options: ReadOptions, tally: Tally) -> DeploymentLog:
    extra = payload_names(options.payload)
    samples = stacked(glider.samples, (*SAMPLE_COLUMNS, *extra))
    time = unix_seconds(samples.pop("time"), f"{glider.name} samples", tally)
    time, samples = tidy(time, samples, f"{glider.name} samples", tally)
    if not time.size:
        raise InputError(f"{glider.name}: no sample has a time")
    every = sorted({name for piece in glider.dives for name in piece})
    dives = stacked(glider.dives, every)
    variation = _per_dive(dives, "magnetic_variation")
    fixes = _fixes(dives, glider.name, tally)
    if options.variation_deg is not None:
        if len(variation):
            leave_out(["magnetic_variation"], "the user gives the variation", tally)
        variation = Channel(time[:1], np.array([options.variation_deg]))
    elif not len(variation):
        variation = reference_declination(fixes, glider.name, tally)
    channels = _channels(time, samples, dives, variation, fixes, glider.name, tally)
    channels |= _ctd(glider, time, samples, channels, fixes, tally)
    carried = {
        name: joined([piece[name] for piece in glider.payload if name in piece]) for name in extra
    }
    for name in extra:
        if name in samples:
            there = np.isfinite(samples[name])
            carried[name] = joined([carried[name], Channel(time[there], samples[name][there])])
    channels |= payload_channels(carried, options.payload, tally, units=glider.units)
    auxiliary: dict[str, Channel] = {}
    if "dive" in samples:
        there = np.isfinite(samples["dive"])
        auxiliary["dive"] = Channel(time[there], samples["dive"][there])
    for axis in ("north", "east"):
        auxiliary[f"dac_{axis}"] = _per_dive(dives, f"depth_avg_curr_{axis}", at="gpsE_time")
    for axis in ("latitude", "longitude"):
        auxiliary[f"waypoint_{axis}"] = _per_dive(dives, f"waypoint_{axis}", at="gps2_time")
    auxiliary |= adcp_truth(glider.name, glider.adcp, tally)
    flown = set(samples["dive"][np.isfinite(samples["dive"])]) if "dive" in samples else set()
    if flown and "dive" in dives:
        lacking = [int(d) for d in dives["dive"] if np.isfinite(d) and d not in flown]
        tally.add("missing", f"{glider.name} samples", len(lacking), "dives without any sample")
    return DeploymentLog(
        deployment=glider.name,
        platform="Seaglider",
        channels={name: c for name, c in channels.items() if len(c)},
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary={name: c for name, c in auxiliary.items() if len(c)},
        files=tuple(glider.files),
        station=True,
    )


def _channels(
    time: Array,
    samples: Columns,
    dives: Columns,
    variation: Channel,
    fixes: Fixes,
    name: str,
    tally: Tally,
) -> dict[str, Channel]:
    depth = samples.get("depth_m")
    flying = depth is not None and bool(np.nanmax(depth, initial=0.0) > _FLYING)
    channels: dict[str, Channel] = {}
    for column, target in (("pitch_deg", "measured_pitch"), ("roll_deg", "measured_roll")):
        if column in samples:
            values = samples[column]
            if column == "pitch_deg":
                values = from_degrees(values, column, tally, flying=flying)
            elif "gc_roll_ad" in samples and _rolls_in_radian(values, samples["gc_roll_ad"]):
                tally.add(
                    "repaired", column, int(np.isfinite(values).sum()),
                    "was in radian where degrees are native",
                )  # fmt: skip
                values = np.degrees(values)
            channels[target] = clean(target, time, values, tally, subject=column)
    if "head_mag_deg" in samples:
        if not len(variation):
            raise InputError(
                f"{name}: head_mag_deg is magnetic and no file gives magnetic_variation (the table "
                "of dives does) or a fix from which it follows; give it with --variation-deg, east "
                "positive"
            )
        magnetic = heading_degrees(samples["head_mag_deg"], "head_mag_deg", tally)
        true = np.mod(magnetic + variation.at(time), 360.0)
        channels["measured_heading"] = clean("measured_heading", time, true, tally)
    if "gc_roll_ad" in samples and "pitch_deg" in samples:
        rotation = rotation_from_counts(
            samples["gc_roll_ad"], samples["pitch_deg"], samples.get("rotation_deg"), name, tally
        )
        if np.isfinite(rotation).any():
            samples = {**samples, "rotation_deg": rotation}
    for column, target, factor in (
        ("vbd_cc", "measured_pump", 1.0),
        ("gc_vbd_ctl_cc", "commanded_pump", 1.0),
        ("gc_pitch_ctl_cm", "commanded_shift", -CM),
        ("rotation_deg", "measured_rotation", 1.0),
    ):
        if column in samples:
            values = factor * samples[column]
            if target == "measured_pump":
                values = to_cm3(values, column, tally)
            channels[target] = clean(target, time, values, tally, subject=column)
    channels |= _shift(time, samples, dives, tally)
    if "pressure_dbar" in samples:
        dbar = to_dbar(samples["pressure_dbar"], depth, "pressure_dbar", tally, native="dbar")
        channels["measured_pressure"] = clean(
            "measured_pressure", time, dbar, tally, subject="pressure_dbar"
        )
        if depth is None:
            pitch = channels.get("measured_pitch", EMPTY)
            channels["measured_pressure"] = pressure_by_flight(
                channels["measured_pressure"], pitch, "pressure_dbar", tally
            )
    elif depth is not None:
        channels["measured_depth"] = clean("measured_depth", time, depth, tally)
    return channels


def _ctd(
    glider: GliderTables,
    time: Array,
    samples: Columns,
    channels: dict[str, Channel],
    fixes: Fixes,
    tally: Tally,
) -> dict[str, Channel]:
    """Temperature, salinity and density from the samples and from CTDs with their own times."""
    pieces = list(glider.ctd)
    if "temp_c" in samples:
        pieces.append({"time": time, **{n: samples[n] for n in _CTD if n in samples}})
    columns = stacked(pieces, ("time", *_CTD)) if pieces else {}
    at = channels.get("measured_pressure") or channels.get("measured_depth")
    if "sal_psu" in columns and at:
        there = np.isfinite(columns["temp_c"])
        own = unix_seconds(columns.pop("time")[there], f"{glider.name} CTD", tally)
        columns = {name: values[there] for name, values in columns.items()}
        own, columns = tidy(own, columns, f"{glider.name} CTD", tally)
        return ctd_channels(
            own,
            temperature=columns["temp_c"],
            pressure=at.at(own),
            practical=columns["sal_psu"],
            latitude=float(np.median(fixes.latitude)) if len(fixes) else 0.0,
            longitude=float(np.median(fixes.longitude)) if len(fixes) else 0.0,
            tally=tally,
        )
    if "rho_insitu" in samples:
        dense = clean("measured_density", time, samples["rho_insitu"], tally, subject="rho_insitu")
        return {"measured_density": dense}
    return {}


_CTD = ("temp_c", "sal_psu")
_FLYING = 20.0
"""[m] A log that goes so deep pitched more than 1.5 degree."""


_TURNS, _ROLLS = 500.0, 1.5
"""[counts, degree] A roll mass that moves so far rolls the glider by more than this."""


def _rolls_in_radian(roll: Array, counts: Array) -> bool:
    both = np.isfinite(roll) & np.isfinite(counts) & (counts > 0.0)
    if both.sum() < 100:
        return False
    moved = np.ptp(np.percentile(counts[both], [5.0, 95.0]))
    return bool(moved > _TURNS and np.ptp(np.percentile(roll[both], [5.0, 95.0])) < _ROLLS)


def _shift(time: Array, samples: Columns, dives: Columns, tally: Tally) -> dict[str, Channel]:
    """Battery position [m] forward, from the encoder and each dive's calibration."""
    needed = ("dive", "log_C_PITCH", "log_PITCH_CNV")
    if "gc_pitch_ad" not in samples or not all(name in dives for name in needed):
        return {}
    moved = np.where(samples["gc_pitch_ad"] > 0.0, samples["gc_pitch_ad"], np.nan)
    start = _first_time(dives)
    known = np.isfinite(dives["log_C_PITCH"]) & np.isfinite(dives["log_PITCH_CNV"])
    known &= np.isfinite(start)
    if not known.any():
        return {}
    order = np.argsort(start[known])
    at = np.searchsorted(start[known][order], time, side="right") - 1
    row = np.flatnonzero(known)[order][np.maximum(at, 0)]
    cm = (moved - dives["log_C_PITCH"][row]) * dives["log_PITCH_CNV"][row]
    return {"measured_shift": clean("measured_shift", time, -CM * cm, tally, subject="gc_pitch_ad")}


def _first_time(dives: Columns) -> Array:
    for name in ("gps2_time", "gps1_time", "gpsE_time"):
        if name in dives:
            return dives[name]
    return np.full(len(next(iter(dives.values()))), np.nan)


def _per_dive(dives: Columns, name: str, *, at: str | None = None) -> Channel:
    """A number of each dive at the dive's fix."""
    if name not in dives:
        return EMPTY
    time = dives[at] if at in dives else _first_time(dives)
    there = np.isfinite(time) & np.isfinite(dives[name])
    unique, first = np.unique(time[there], return_index=True)
    return Channel(unique, dives[name][there][first])


def _fixes(dives: Columns, name: str, tally: Tally) -> Fixes:
    times, latitudes, longitudes = [], [], []
    for fix in ("gps1", "gps2", "gpsE"):
        if all(f"{fix}_{part}" in dives for part in ("time", "lat", "lon")):
            times.append(dives[f"{fix}_time"])
            latitudes.append(dives[f"{fix}_lat"])
            longitudes.append(dives[f"{fix}_lon"])
    if not times:
        return NO_FIXES
    time = np.concatenate(times)
    latitude, longitude = positions(
        np.concatenate(latitudes), np.concatenate(longitudes), f"{name} GPS fixes", tally
    )
    lacking = ~(np.isfinite(time) & np.isfinite(latitude) & np.isfinite(longitude))
    tally.add("missing", f"{name} GPS fixes", int(lacking.sum()), "fixes without time or position")
    time, latitude, longitude = time[~lacking], latitude[~lacking], longitude[~lacking]
    # the fix after a dive is also the first one of the next
    unique, first = np.unique(time, return_index=True)
    return Fixes(unique, latitude[first], longitude[first])
