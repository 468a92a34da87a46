"""Reader of Seaglider logs, from basestation netCDF files and from tables made of them.

Native: degrees, magnetic heading, cm of pitch mass (+ lifts the nose), cm3 of bladder (+ =
lighter), dbar; three GPS fixes a dive: GPS1 after the dive before, GPS2 before this one, GPSE
after it. Both sources are brought to the columns of the tables, then to one log a glider.

Velocity and current that a Seaglider's on-board current profiler (ADCP) measured.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import reference_declination
from factory.importing.batteries import GAUGES, PUMPED, seaglider_batteries
from factory.importing.columns import Table, read_table, stacked, tidy, with_values
from factory.importing.deployment_log import (
    Channel,
    DeploymentLog,
    each_file,
    joined,
)
from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.formats.seaglider_dive_files import dive_fixes, per_dive
from factory.importing.formats.seaglider_log_signals import signals_of, water_of
from factory.importing.netcdf import holds_arrays
from factory.importing.payload import payload_channels, payload_names
from factory.importing.sample_clock import expect_going, unix_seconds
from factory.importing.tally import Tally, leave_out, note_empty, note_unread
from twin.bounded import LONGEST_NAME
from twin.errors import InputError

ADCP_DEPTH = 1.5
"""[m] Shallower the inverse solution is the constraint that a drifting glider moves with the
water, not a measurement."""


def adcp_truth(
    glider: str, pieces: Sequence[Mapping[str, Array]], tally: Tally
) -> dict[str, Channel]:
    """Velocity through the water and current of the on-board ADCP's inverse solution [m/s]."""
    if not pieces:
        return {}
    names = ("time", "depth_m", "u_ttw", "v_ttw", "w_ttw", "u_ocn", "v_ocn")
    columns = stacked(pieces, names)
    subject = f"{glider} ADCP"
    time = unix_seconds(columns.pop("time"), subject, tally)
    time, columns = tidy(time, columns, subject, tally)
    good = np.all([np.isfinite(columns[n]) for n in ("u_ttw", "v_ttw", "w_ttw")], axis=0)
    if "depth_m" in columns:
        shallow = good & ~(columns["depth_m"] > ADCP_DEPTH)
        tally.add(
            "left out", subject, int(shallow.sum()),
            f"shallower than {ADCP_DEPTH:g} m: a constraint of the inverse, no measurement",
        )  # fmt: skip
        good &= ~shallow
    tally.add("read", subject, int(good.sum()), "truth samples")
    found = {
        "velocity_east": Channel(time[good], columns["u_ttw"][good]),
        "velocity_north": Channel(time[good], columns["v_ttw"][good]),
        # w_ttw is upward: it is opposite to the depth rate
        "velocity_down": Channel(time[good], -columns["w_ttw"][good]),
    }
    for column, target in (("u_ocn", "current_east"), ("v_ocn", "current_north")):
        if column in columns:
            there = good & np.isfinite(columns[column])
            found[target] = Channel(time[there], columns[column][there])
    return found


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
"""Columns that each kind of table is read for."""


@dataclasses.dataclass
class GliderTables:
    """Pieces of one glider while they are collected."""

    name: str
    samples: list[Columns] = dataclasses.field(default_factory=list)
    dives: list[Columns] = dataclasses.field(default_factory=list)
    moves: list[Columns] = dataclasses.field(default_factory=list)
    """Of the pump (netCDF)."""
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
    from factory.importing.formats.seaglider_dive_files import DiveFile, read_dive

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
        glider.moves.append(found.moves)
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
    if not gliders:
        raise InputError("no row of the tables names its glider")
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
    if what == "samples" and "glider" not in table.texts:
        measured = {n: v for n, v in table.columns.items() if n != "time"}
        expect_going("time", table.columns["time"], measured, table.path.name)
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
        if len(owner) > LONGEST_NAME:
            why = f"the name of their glider has more than {LONGEST_NAME} characters"
            tally.add("left out", subject, int(rows.sum()), why)
            continue
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
    samples = with_values(samples)
    if not time.size:
        raise InputError(f"{glider.name}: no sample has a time")
    every = sorted({name for piece in glider.dives for name in piece})
    dives = stacked(glider.dives, every)
    variation = per_dive(dives, "magnetic_variation")
    fixes = dive_fixes(dives, glider.name, tally)
    if options.variation_deg is not None:
        if len(variation):
            leave_out(["magnetic_variation"], "the user gives the variation", tally)
        variation = Channel(time[:1], np.array([options.variation_deg]))
    elif not len(variation):
        variation = reference_declination(fixes, glider.name, tally)
    channels = signals_of(time, samples, dives, variation, fixes, glider.name, tally)
    moves = [one for one in glider.moves if set(PUMPED) <= set(one)]
    channels |= seaglider_batteries(dives, stacked(moves, PUMPED) if moves else {}, tally)
    channels |= water_of(glider.name, glider.ctd, time, samples, channels, fixes, tally)
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
        auxiliary[f"dac_{axis}"] = per_dive(dives, f"depth_avg_curr_{axis}", at="gpsE_time")
    for axis in ("latitude", "longitude"):
        auxiliary[f"waypoint_{axis}"] = per_dive(dives, f"waypoint_{axis}", at="gps2_time")
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
