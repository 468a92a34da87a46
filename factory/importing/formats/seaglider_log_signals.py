"""Signals of a Seaglider: attitude, actuators, pressure and CTD of its samples.

Rotation of a Seaglider's battery from the counts of its roll axis, without C_ROLL and ROLL_CNV.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import FLYING, from_degrees, heading_degrees
from factory.importing.cleaning import clean
from factory.importing.columns import stacked, tidy
from factory.importing.deployment_log import EMPTY, Channel, LoggedFixes
from factory.importing.formats.seaglider_dive_files import first_time
from factory.importing.pressures import pressure_by_flight, to_dbar
from factory.importing.sample_clock import unix_seconds
from factory.importing.seawater import ctd_channels
from factory.importing.tally import Tally
from factory.importing.units import to_cm3
from twin.errors import InputError

ROLL_CNV = 0.02827
"""[deg] per count: the value that basestations and vehicles' files give for most Seagliders."""
LEAST_SAMPLES = 20
"""of a phase, from which its centre is taken"""
PITCHED = 5.0
"""[deg] of pitch from which a sample is of a dive or of a climb"""


def rotation_from_counts(
    counts: Array, pitch_deg: Array, known: Array | None, subject: str, tally: Tally
) -> Array:
    """Rotation [deg], + to port, (time,): `known` where it is, elsewhere from the counts.

    Args:
      counts: `gc_roll_ad`, (time,), zero or less where there was none.
      pitch_deg: [deg], (time,). known: [deg] from files with the calibration, or None.
    """
    rotation = np.full(len(counts), np.nan) if known is None else known.copy()
    moved = np.where(counts > 0.0, counts, np.nan)
    wanted = ~np.isfinite(rotation) & np.isfinite(moved)
    filled = 0
    for side in (-1.0, 1.0):
        phase = wanted & (side * pitch_deg > PITCHED)
        if phase.sum() >= LEAST_SAMPLES:
            centre = float(np.median(moved[phase]))
            # more counts roll the glider to starboard: the mass has gone there
            rotation[phase] = -ROLL_CNV * (moved[phase] - centre)
            filled += int(phase.sum())
    if filled:
        tally.add(
            "note", f"{subject} rotation", filled,
            f"from gc_roll_ad with {ROLL_CNV} deg a count, from the counts at which each phase "
            "rests: the log has no C_ROLL_DIVE, C_ROLL_CLIMB, ROLL_CNV",
        )  # fmt: skip
    return rotation


Array = NDArray[np.float64]
Columns = dict[str, Array]

CM = 0.01
"""[m]"""


def signals_of(
    time: Array,
    samples: Columns,
    dives: Columns,
    variation: Channel,
    fixes: LoggedFixes,
    name: str,
    tally: Tally,
) -> dict[str, Channel]:
    """Attitude, actuators and pressure, clean, by the store's names.

    Raises:
      InputError: a magnetic heading without a variation.
    """
    depth = samples.get("depth_m")
    flying = depth is not None and bool(np.nanmax(depth, initial=0.0) > FLYING)
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
    if depth is not None and not len(channels.get("measured_pressure", ())):
        channels["measured_depth"] = clean("measured_depth", time, depth, tally)
    return channels


def water_of(
    name: str,
    ctd: Sequence[Columns],
    time: Array,
    samples: Columns,
    channels: dict[str, Channel],
    fixes: LoggedFixes,
    tally: Tally,
) -> dict[str, Channel]:
    """Temperature, salinity and density from the samples and from CTDs with their own times."""
    pieces = list(ctd)
    if "temp_c" in samples:
        pieces.append({"time": time, **{n: samples[n] for n in _CTD if n in samples}})
    columns = stacked(pieces, ("time", *_CTD)) if pieces else {}
    at = channels.get("measured_pressure") or channels.get("measured_depth")
    if "temp_c" in columns and at:
        there = np.isfinite(columns["temp_c"])
        own = unix_seconds(columns.pop("time")[there], f"{name} CTD", tally)
        columns = {name: values[there] for name, values in columns.items()}
        own, columns = tidy(own, columns, f"{name} CTD", tally)
        return ctd_channels(
            own,
            temperature=columns["temp_c"],
            pressure=at.known(own),
            practical=columns.get("sal_psu"),
            latitude=float(np.median(fixes.latitude)) if len(fixes) else 0.0,
            longitude=float(np.median(fixes.longitude)) if len(fixes) else 0.0,
            tally=tally,
        )
    if "rho_insitu" in samples:
        dense = clean("measured_density", time, samples["rho_insitu"], tally, subject="rho_insitu")
        return {"measured_density": dense}
    return {}


_CTD = ("temp_c", "sal_psu")
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
    start = first_time(dives)
    known = np.isfinite(dives["log_C_PITCH"]) & np.isfinite(dives["log_PITCH_CNV"])
    known &= np.isfinite(start)
    if not known.any():
        return {}
    order = np.argsort(start[known])
    at = np.searchsorted(start[known][order], time, side="right") - 1
    row = np.flatnonzero(known)[order][np.maximum(at, 0)]
    cm = (moved - dives["log_C_PITCH"][row]) * dives["log_PITCH_CNV"][row]
    return {"measured_shift": clean("measured_shift", time, -CM * cm, tally, subject="gc_pitch_ad")}
