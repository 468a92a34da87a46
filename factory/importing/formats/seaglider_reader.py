"""Seaglider reader: one log for each glider, from basestation netCDF files or tables made of them.

Native units: degrees, magnetic heading, cm of pitch mass (+ lifts the nose), cm3 of bladder (+ =
lighter), dbar. A dive has three GPS fixes: GPS1 after the dive before, GPS2 before this dive, GPSE
after it. Both sources are brought to the columns of the tables.

`adcp_truth` gives velocity and current that the on-board current profiler (ADCP) measured.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import reference_declination
from factory.importing.cleaning import positions
from factory.importing.columns import Table, read_table, stacked, tidy, with_values
from factory.importing.deployment_log import (
    EMPTY,
    NO_FIXES,
    Channel,
    DeploymentLog,
    LoggedFixes,
    each_file,
    joined,
)
from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.formats.seaglider_dive_files import GliderPieces, read_dive
from factory.importing.formats.seaglider_log_signals import (
    GAUGES,
    PUMPED,
    first_time,
    seaglider_batteries,
    signals_of,
    water_of,
)
from factory.importing.gps_fixes import NO_DILUTION
from factory.importing.netcdf import holds_arrays
from factory.importing.payload import payload_channels, payload_names
from factory.importing.sample_clock import expect_going, unix_seconds
from factory.importing.tally import Tally, leave_out, note_empty, note_unread
from twin.bounded import LONGEST_NAME
from twin.errors import InputError

ADCP_DEPTH = 1.5
"""[m] Depth above which the inverse solution is no measurement, but the constraint that a drifting
glider moves with the water."""


def adcp_truth(glider: str, pieces: Sequence[Columns], tally: Tally) -> dict[str, Channel]:
    """Velocity through the water and current [m/s], from the on-board ADCP's inverse solution."""
    if not pieces:
        return {}
    columns = stacked(pieces, _READ["adcp"][2:])
    subject = f"{glider} ADCP"
    time = unix_seconds(columns.pop("time"), subject, tally)
    time, columns = tidy(time, columns, subject, tally)
    good = np.all([np.isfinite(columns[n]) for n in ("u_ttw", "v_ttw", "w_ttw")], axis=0)
    if "depth_m" in columns:
        shallow = good & ~(columns["depth_m"] > ADCP_DEPTH)
        why = f"shallower than {ADCP_DEPTH:g} m: a constraint of the inverse, no measurement"
        tally.add("left out", subject, shallow, why)
        good &= ~shallow
    tally.add("read", subject, good, "truth samples")
    return {
        target: Channel.finite(time[good], sign * columns[column][good])
        for target, column, sign in (
            ("velocity_east", "u_ttw", 1.0),
            ("velocity_north", "v_ttw", 1.0),
            ("velocity_down", "w_ttw", -1.0),  # w_ttw is positive upward
            ("current_east", "u_ocn", 1.0),
            ("current_north", "v_ocn", 1.0),
        )
        if column in columns
    }


Array = NDArray[np.float64]
Columns = dict[str, Array]

SAMPLE_COLUMNS = (
    "time", "dive", "depth_m", "pressure_dbar", "pitch_deg", "roll_deg", "head_mag_deg", "vbd_cc",
    "gc_pitch_ctl_cm", "gc_vbd_ctl_cc", "gc_pitch_ad", "gc_roll_ad", "rotation_deg", "temp_c",
    "sal_psu", "rho_insitu",
)  # fmt: skip
"""Columns of a table of samples that are read; `rotation_deg` comes from netCDF files only."""
_READ = {
    "samples": (*SAMPLE_COLUMNS, "glider"),
    "dives": (
        *(f"{fix}_{part}" for fix in ("gps1", "gps2", "gpsE")
          for part in ("time", "lat", "lon", "hdop")),
        "glider", "dive", "magnetic_variation", "depth_avg_curr_north", "depth_avg_curr_east",
        "log_C_PITCH", "log_PITCH_CNV", "log_INTERNAL_PRESSURE", *GAUGES,
    ),
    "adcp": ("glider", "dive", "time", "depth_m", "u_ttw", "v_ttw", "w_ttw", "u_ocn", "v_ocn"),
}  # fmt: skip
"""Columns that are read, by kind of table."""


def read_seaglider(
    paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:
    """Make one log for each glider among the files.

    Raises:
      WrongFormat: a file is of another kind.
      InputError: a glider has no samples.
    """
    extra = payload_names(options.payload)
    gliders: dict[str, GliderPieces] = {}

    def read(path: Path) -> GliderPieces | Table:
        if path.suffix.lower() == ".nc" or holds_arrays(path):
            return read_dive(path, extra, tally)
        table = read_table(path)
        _kind_of(table)
        return table

    for path, found in each_file(paths, read, tally):
        if isinstance(found, Table):
            _table(found, gliders, extra, tally)
            continue
        glider = gliders.setdefault(found.name, GliderPieces(found.name))
        glider.add(path.name, found.tables)
        glider.payload += found.payload
        glider.units |= found.units
    sampled = [glider for glider in gliders.values() if glider.tables.get("samples")]
    files = {name for glider in sampled for name in glider.files}
    for glider in [one for one in gliders.values() if not one.tables.get("samples")]:
        if not set(glider.files) <= files:
            raise InputError(
                f"{', '.join(glider.files)}: dives of {glider.name} without its table of samples; "
                f"samples are there of {', '.join(g.name for g in sampled) or 'no glider'}"
            )
        tally.add("left out", glider.name, 1, f"in {glider.files[0]}: no samples of that name")
    if not sampled:
        raise InputError("no row of the tables names its glider")
    return [_log(glider, options, extra, tally) for glider in sampled]


def _kind_of(table: Table) -> str:
    """Kind of a table, a key of `_READ`, by its columns.

    Raises:
      WrongFormat: the table is no Seaglider's.
      InputError: the table has no rows.
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
    if what == "samples" and "glider" not in table.texts:
        measured = {n: v for n, v in table.columns.items() if n != "time"}
        expect_going("time", table.columns["time"], measured, table.path.name)
    return what


def _table(
    table: Table, gliders: dict[str, GliderPieces], extra: Sequence[str], tally: Tally
) -> None:
    """Assign a table's rows to their gliders."""
    subject = table.path.name
    what = _kind_of(table)
    tally.add("read", subject, len(table), f"rows of {what}")
    kind, wanted = f"table of {what}", (*_READ[what], *(extra if what == "samples" else ()))
    note_unread(kind, [*table.columns, *table.texts], wanted, tally)
    note_empty(kind, [n for n, v in table.columns.items() if not np.isfinite(v).any()], tally)
    fallback = subject.split("_")[0].split(".")[0].upper()
    owners = np.array([str(one) for one in table.texts.get("glider", [fallback] * len(table))])
    for owner in dict.fromkeys(owners.tolist()):
        rows = owners == owner
        if len(owner) > LONGEST_NAME:
            why = f"the name of their glider has more than {LONGEST_NAME} characters"
            tally.add("left out", subject, rows, why)
            continue
        glider = gliders.setdefault(owner, GliderPieces(owner))
        glider.add(subject, {what: [{n: v[rows] for n, v in table.columns.items()}]})


def _log(
    glider: GliderPieces, options: ReadOptions, extra: Sequence[str], tally: Tally
) -> DeploymentLog:
    name, pieces = glider.name, defaultdict(list, glider.tables)
    samples = stacked(pieces["samples"], (*SAMPLE_COLUMNS, *extra))
    time = unix_seconds(samples.pop("time"), f"{name} samples", tally)
    time, samples = tidy(time, samples, f"{name} samples", tally)
    samples = with_values(samples)
    if not time.size:
        raise InputError(f"{name}: no sample has a time")
    dives = stacked(pieces["dives"], sorted({n for piece in pieces["dives"] for n in piece}))
    variation = per_dive(dives, "magnetic_variation")
    fixes = dive_fixes(dives, name, tally)
    if options.variation_deg is not None:
        if len(variation):
            leave_out(["magnetic_variation"], "the user gives the variation", tally)
        variation = Channel(time[:1], np.array([options.variation_deg]))
    elif not len(variation):
        variation = reference_declination(fixes, name, tally)
    channels = signals_of(time, samples, dives, variation, name, tally)
    moves = [one for one in pieces["moves"] if set(PUMPED) <= set(one)]
    channels |= seaglider_batteries(dives, stacked(moves, PUMPED), tally)
    channels |= water_of(name, pieces["ctd"], time, samples, channels, fixes, tally)
    carried = {}
    for one in extra:
        found = [piece[one] for piece in glider.payload if one in piece]
        if one in samples:
            found.append(Channel.finite(time, samples[one]))
        carried[one] = joined(found)
    channels |= payload_channels(carried, options.payload, tally, units=glider.units)
    auxiliary: dict[str, Channel] = {}
    flown = samples.get("dive", np.zeros(0))
    if flown.size:
        auxiliary["dive"] = Channel.finite(time, flown)
    for axis in ("north", "east"):
        auxiliary[f"dac_{axis}"] = per_dive(dives, f"depth_avg_curr_{axis}", at="gpsE_time")
    for axis in ("latitude", "longitude"):
        auxiliary[f"waypoint_{axis}"] = per_dive(dives, f"waypoint_{axis}", at="gps2_time")
    auxiliary |= adcp_truth(name, pieces["adcp"], tally)
    if np.isfinite(flown).any():
        numbers = dives.get("dive", flown)
        lacking = np.isfinite(numbers) & ~np.isin(numbers, flown)
        tally.add("missing", f"{name} samples", lacking, "dives without any sample")
    return DeploymentLog(
        deployment=name,
        platform="Seaglider",
        channels=channels,
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary={key: channel for key, channel in auxiliary.items() if len(channel)},
        files=tuple(glider.files),
        station=True,
    )


def per_dive(dives: Columns, name: str, *, at: str | None = None) -> Channel:
    """Channel with a number of each dive, at the time of the dive's fix."""
    if name not in dives:
        return EMPTY
    known = at is not None and np.isfinite(dives.get(at, np.zeros(0))).any()
    time = dives[str(at)] if known else first_time(dives)
    there = np.isfinite(time) & np.isfinite(dives[name])
    unique, first = np.unique(time[there], return_index=True)
    return Channel(unique, dives[name][there][first])


def dive_fixes(dives: Columns, name: str, tally: Tally) -> LoggedFixes:
    """Three fixes of each dive, in time order."""
    parts: list[tuple[Array, Array, Array]] = []
    for fix in ("gps1", "gps2", "gpsE"):
        if all(f"{fix}_{part}" in dives for part in ("time", "lat", "lon")):
            time, latitude, longitude = (dives[f"{fix}_{part}"] for part in ("time", "lat", "lon"))
            none = dives.get(f"{fix}_hdop", np.zeros_like(latitude)) >= NO_DILUTION
            why = "the receiver says that it has none"
            parts.append((time, tally.removed(latitude, none, "GPS fixes", why), longitude))
    if not parts:
        return NO_FIXES
    time, latitude, longitude = (np.concatenate(every) for every in zip(*parts, strict=True))
    latitude, longitude = positions(latitude, longitude, f"{name} GPS fixes", tally)
    fixes = LoggedFixes.finite(time, latitude, longitude)
    lacking = len(time) - len(fixes)
    tally.add("missing", f"{name} GPS fixes", lacking, "fixes without time or position")
    return fixes.once()  # the fix after a dive is also the first fix of the next dive
