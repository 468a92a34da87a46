"""Seaglider dive files: reads one basestation file (p*.nc) into the columns of the tables.

The row of a dive holds its numbers, its three fixes and its waypoint.
"""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import degrees_minutes
from factory.importing.deployment_log import EMPTY, Channel
from factory.importing.formats.base import WrongFormat
from factory.importing.formats.seaglider_log_signals import (
    GAUGES,
    PUMPED,
    RECKONED,
    voltage_and_charge,
)
from factory.importing.netcdf import (
    as_array,
    attributes_of,
    open_netcdf,
    text_of,
    unit_in,
    values_in,
)
from factory.importing.sample_clock import expect_going
from factory.importing.tally import Tally, note_empty, note_unread
from factory.importing.units import PRACTICAL
from twin.errors import InputError

Array = NDArray[np.float64]
Columns = dict[str, Array]

SAMPLES = {
    "pressure": "pressure_dbar",
    "depth": "depth_m",
    "eng_pitchAng": "pitch_deg",
    "eng_rollAng": "roll_deg",
    "eng_head": "head_mag_deg",
    "eng_vbdCC": "vbd_cc",
}
"""Variables of the file at `time`, and their columns in the tables."""
UNITS = {
    "pressure": "dbar", "depth": "m", "eng_pitchAng": "degree", "eng_rollAng": "degree",
    "eng_head": "degree", "eng_vbdCC": "cm3", "temperature": "degree_Celsius",
    "salinity": PRACTICAL, "depth_avg_curr_north": "m s-1", "depth_avg_curr_east": "m s-1",
    "magnetic_variation": "degree", "ad2cp_inv_glider_depth": "m",
    **{f"ad2cp_inv_glider_{n}": "m s-1" for n in ("uttw", "vttw", "wttw", "uocn", "vocn")},
    "log_gps_lat": "degree", "log_gps_lon": "degree",
}  # fmt: skip
"""Units that variables are converted to, from the declared ones. Variables of moves (`MOVES`) are
not converted: basestations call cm3 of the bladder cm."""
MOVES = {
    "gc_pitch_ctl": "gc_pitch_ctl_cm",
    "gc_vbd_ctl": "gc_vbd_ctl_cc",
    "gc_pitch_ad": "gc_pitch_ad",
    "gc_roll_ad": "gc_roll_ad",
}
"""Actuator states after each move, held from `gc_end_secs` on."""
NUMBERS = (
    "magnetic_variation", "depth_avg_curr_north", "depth_avg_curr_east", "log_C_PITCH",
    "log_PITCH_CNV", "log_INTERNAL_PRESSURE", *GAUGES,
)  # fmt: skip
ADCP = {
    "ad2cp_inv_glider_time": "time",
    "ad2cp_inv_glider_depth": "depth_m",
    "ad2cp_inv_glider_uttw": "u_ttw",
    "ad2cp_inv_glider_vttw": "v_ttw",
    "ad2cp_inv_glider_wttw": "w_ttw",
    "ad2cp_inv_glider_uocn": "u_ocn",
    "ad2cp_inv_glider_vocn": "v_ocn",
}
_FIXES = ("gps1", "gps2", "gpsE")
WAYPOINT = "log_TGT_LATLONG"
"""Commanded waypoint: latitude and longitude as ddmm.mmm in one text."""
_CALIBRATION = ("log_C_ROLL_DIVE", "log_C_ROLL_CLIMB", "log_ROLL_CNV")
_FIX_FLAGS = {fix: f"{fix.replace('gps', 'GPS')}_qc" for fix in _FIXES}
_FIX_PARTS = {part: f"log_gps_{part}" for part in ("time", "lat", "lon")}
DILUTION, FLAGS = "log_gps_hdop", "log_gps_qc"
"""Quality of the three fixes. DILUTION: by the receiver. FLAGS: by the basestation, if given."""
READ = (
    "time", *SAMPLES, "gc_end_secs", *MOVES, *PUMPED, *RECKONED, *NUMBERS, *ADCP,
    *_CALIBRATION, "start_of_climb_time", "trajectory", WAYPOINT,
    *_FIX_PARTS.values(), *_FIX_FLAGS.values(), DILUTION, FLAGS, "ctd_time", "temperature",
    "temperature_qc", "salinity", "salinity_qc",
)  # fmt: skip
"""Variables that are read, besides the payload's."""
_BAD_QC = frozenset("348")
"""Basestation flags: 3 probably bad, 4 bad, 8 interpolated."""
_NO_FIX_QC = _BAD_QC | frozenset("69")
"""Flags of a bad fix; besides the above, 6 is not sampled and 9 missing."""


@dataclasses.dataclass
class GliderPieces:
    """Tables of one glider: of a single dive file, or of all files read so far."""

    name: str
    tables: dict[str, list[Columns]] = dataclasses.field(default_factory=dict)
    """Chunks by kind: samples, dives, moves (of the pump), adcp and ctd. The ctd has temperature
    and salinity with their own times; tables have both in samples."""
    payload: list[dict[str, Channel]] = dataclasses.field(default_factory=list)
    """Channels by the files' own names (netCDF); tables have the payload in samples."""
    units: dict[str, str] = dataclasses.field(default_factory=dict)
    """Units of the payload, as the files declare."""
    files: list[str] = dataclasses.field(default_factory=list)

    def add(self, file: str, tables: Mapping[str, Sequence[Columns]]) -> None:
        """Add the chunks of a file."""
        for kind, pieces in tables.items():
            self.tables.setdefault(kind, []).extend(pieces)
        if file not in self.files:
            self.files.append(file)


def read_dive(path: Path, payload: Sequence[str], tally: Tally) -> GliderPieces:
    """Read a file into the columns of the tables.

    Args:
      payload: names that payloads may have.

    Raises:
      WrongFormat: the file is of another kind.
      InputError: the file is truncated, or has no samples.
    """
    with open_netcdf(path) as file:
        variables = file.variables
        if "time" not in variables or not set(variables) & {"eng_pitchAng", "eng_head"}:
            raise WrongFormat(path, [*variables, *file.groups])
        try:
            found = GliderPieces(_glider(file, path), files=[path.name])
            time = as_array(variables["time"][:])
            if not time.size:
                raise InputError(f"{path.name} holds a dive without samples")
            measured = _known_columns(variables, SAMPLES, tally)
            for source, column in SAMPLES.items():
                values = measured.get(column, time)
                if len(values) != len(time):
                    raise InputError(
                        f"{path.name}: {source} has {len(values)} values, time {len(time)}"
                    )
            expect_going("time", time, measured, path.name)
            dive = _number(file)
            samples = {"time": time, **measured, "dive": np.full(len(time), dive)}
            _moves(variables, samples)
            row: Columns = {"dive": np.array([dive])}
            row |= {n: _number_in(variables[n], tally) for n in NUMBERS if n in variables}
            row |= _fixes(variables, tally) | _waypoint(variables)
            for words in RECKONED:
                row |= voltage_and_charge(text_of(variables.get(words)), words)
            moves = {n: as_array(variables[n][:]) for n in PUMPED if n in variables}
            found.tables = {"samples": [samples], "dives": [row], "moves": [moves]}
            adcp = _known_columns(variables, ADCP, tally)
            found.tables["adcp"] = [adcp] if "u_ttw" in adcp and "time" in adcp else []
            ctd = _ctd(variables, path, tally)
            found.tables["ctd"] = [ctd] if ctd else []
            carried = {n: _payload_channel(variables, n) for n in payload if n in variables}
            found.payload = [carried]
            found.units = {n: unit_in(attributes_of(variables[n])) for n in carried}
            clocks = [str(_clock(variables, n)) for n in carried]
            note_unread("basestation file", variables, (*READ, *payload, *clocks), tally)
            empty = [
                n for n in (*READ, *payload)
                if n in variables and variables[n].size and variables[n].dtype.kind in "fiu"
                and not np.isfinite(as_array(variables[n][...])).any()
            ]  # fmt: skip
        except IndexError as error:
            raise InputError(f"{path.name} is damaged: {' '.join(str(error).split())}") from error
    note_empty("basestation file", empty, tally)
    tally.add("read", path.name, len(time), "samples of a dive")
    return found


def _known_columns(variables: Any, names: Mapping[str, str], tally: Tally) -> Columns:
    """Columns of the named variables, without those of another quantity than expected."""
    return {
        column: values
        for name, column in names.items()
        if name in variables and (values := values_in(variables[name], UNITS, tally)) is not None
    }


def _clock(variables: Any, name: str) -> str | None:
    """Name of the time variable along the dimension of a variable; None without one."""
    dimensions = variables[name].dimensions
    return next(
        (n for n, v in variables.items() if v.dimensions == dimensions and n.endswith("time")), None
    )


def _payload_channel(variables: Any, name: str) -> Channel:
    """Samples of a payload's variable; empty if no times belong to it."""
    clock = _clock(variables, name)
    if clock is None or len(variables[name].dimensions) != 1:
        return EMPTY
    time, values = as_array(variables[clock][:]), as_array(variables[name][:])
    there = np.isfinite(time) & np.isfinite(values)
    time, first = np.unique(time[there], return_index=True)
    return Channel(time, values[there][first])


def _number_in(variable: Any, tally: Tally) -> Array:
    """Number of a variable, (1,); older basestations write some numbers letter by letter."""
    if variable.dtype == str or variable.dtype.kind not in "fiu":
        with contextlib.suppress(ValueError):
            return np.array([float(text_of(variable))])
        return np.array([np.nan])
    values = values_in(variable, UNITS, tally)
    return np.array([np.nan]) if values is None else values[:1]


def _glider(file: Any, path: Path) -> str:
    identity = getattr(file, "platform_id", None)
    if identity:
        return str(identity)
    number = getattr(file, "glider", None)
    if number is not None:
        return f"SG{int(number):03d}"
    found = re.match(r"p(\d{3})\d{4}", path.name)
    return f"SG{found.group(1)}" if found else path.stem


def _number(file: Any) -> float:
    for source in (getattr(file, "dive_number", None), file.variables.get("trajectory")):
        if source is not None:
            return float(as_array(source[...] if hasattr(source, "dimensions") else source)[0])
    return float("nan")


def _moves(variables: Any, samples: Columns) -> None:
    """Add the actuator states after the last move to the samples, and the battery's rotation."""
    if "gc_end_secs" not in variables:
        return
    time = samples["time"]
    ends = as_array(variables["gc_end_secs"][:])
    order = np.argsort(ends)
    index = np.searchsorted(ends[order], time, side="right") - 1
    for source, column in MOVES.items():
        if source in variables:
            values = as_array(variables[source][:])[order]
            held = values[np.maximum(index, 0)] if len(values) else np.nan
            samples[column] = np.where(index >= 0, held, np.nan)
    if "gc_roll_ad" in samples and all(n in variables for n in _CALIBRATION):
        dive, climb, degrees = (float(as_array(variables[n][...])[0]) for n in _CALIBRATION)
        started = float("inf")
        if "start_of_climb_time" in variables:
            started = time[0] + float(as_array(variables["start_of_climb_time"][...])[0])
        moved = np.where(samples["gc_roll_ad"] > 0.0, samples["gc_roll_ad"], np.nan)
        # more counts roll the glider to starboard: the mass has gone there
        samples["rotation_deg"] = -(moved - np.where(time < started, dive, climb)) * degrees


def _fixes(variables: Any, tally: Tally) -> Columns:
    """Columns of the three fixes of the dive, in the order of the file."""
    row: Columns = {}
    if not set(_FIX_PARTS.values()) <= set(variables):
        return row
    found = _known_columns(
        variables, {n: part for part, n in _FIX_PARTS.items()} | {DILUTION: "hdop"}, tally
    )
    if not set(_FIX_PARTS) <= set(found):
        return row
    for part, values in found.items():
        for fix, value in zip(_FIXES, values, strict=False):
            row[f"{fix}_{part}"] = np.array([value])
    together = _flag_letters(variables.get(FLAGS))
    for k, fix in enumerate(_FIXES):
        flags = _flag_letters(variables.get(_FIX_FLAGS[fix]))[:1] + together[k : k + 1]
        if f"{fix}_time" in row and _NO_FIX_QC & set(flags):
            row[f"{fix}_lat"] = np.array([np.nan])
            tally.add("removed", "GPS fixes", 1, "flagged bad by the basestation")
    return row


def _flag_letters(flags: Any) -> str:
    """Flags as a text, a letter each; empty without the variable."""
    if flags is None:
        return ""
    values = np.ma.filled(flags[...], b"0" if flags.dtype.kind == "S" else 0)
    return "".join(str(one, "latin-1") if isinstance(one, bytes) else str(one)
                   for one in np.ravel(values).tolist())  # fmt: skip


def _waypoint(variables: Any) -> Columns:
    """Latitude and longitude [degree] of the target; empty if the file has none."""
    parts = text_of(variables.get(WAYPOINT)).split(",")
    try:
        latitude, longitude = (degrees_minutes(np.array([float(part)])) for part in parts)
    except ValueError:  # no target, or another form
        return {}
    return {"waypoint_latitude": latitude, "waypoint_longitude": longitude}


def _ctd(variables: Any, path: Path, tally: Tally) -> Columns:
    """Temperature and salinity at the CTD's own times; values flagged bad are left out."""
    if "ctd_time" not in variables or "temperature" not in variables:
        return {}
    columns: Columns = {"time": as_array(variables["ctd_time"][:])}
    for source, column in (("temperature", "temp_c"), ("salinity", "sal_psu")):
        values = _known_columns(variables, {source: column}, tally).get(column)
        if values is None:
            continue
        if len(values) != len(columns["time"]):
            raise InputError(f"{path.name}: {source} and ctd_time have not the same length")
        flags = variables.get(f"{source}_qc")
        if flags is not None and flags.shape == values.shape:
            words = np.ma.filled(flags[:], b"").astype("S1")
            bad = np.isin(words, [b.encode() for b in _BAD_QC]) & np.isfinite(values)
            values = tally.removed(values, bad, source, "flagged bad by the basestation")
        columns[column] = values
    return columns
