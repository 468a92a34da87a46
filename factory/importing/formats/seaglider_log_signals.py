"""Seaglider log signals: attitude, actuators, pressure, CTD and batteries.

The battery's rotation comes from the counts of its roll axis where C_ROLL and ROLL_CNV are missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import FLYING, from_degrees, heading_degrees
from factory.importing.cleaning import clean
from factory.importing.columns import stacked, tidy
from factory.importing.deployment_log import EMPTY, Channel, LoggedFixes
from factory.importing.pressures import SEA_LEVEL, ctd_channels, pressure_channels
from factory.importing.sample_clock import unix_seconds
from factory.importing.tally import Tally, leave_out
from factory.importing.units import to_cm3
from twin.errors import InputError

ROLL_CNV = 0.02827
"""[deg] Rotation per count that basestations and vehicles' files give for most Seagliders."""
LEAST_SAMPLES = 20
"""Minimum number of samples of a descent or climb that give its centre."""
PITCHED = 5.0
"""[deg] Pitch beyond which a sample belongs to a descent or a climb."""


def rotation_from_counts(
    counts: Array, pitch_deg: Array, known: Array | None, subject: str, tally: Tally
) -> Array:
    """Rotation [deg], + to port, (time,): `known` where finite, elsewhere from the counts.

    Args:
      counts: `gc_roll_ad`, (time,), zero or less where missing.
      pitch_deg: [deg], (time,). known: [deg] from files with the calibration, or None.
    """
    rotation = np.full(len(counts), np.nan) if known is None else known.copy()
    wanted = ~np.isfinite(rotation) & (counts > 0.0)
    filled = np.zeros(len(counts), bool)
    for side in (-1.0, 1.0):
        phase = wanted & (side * pitch_deg > PITCHED)
        if phase.sum() >= LEAST_SAMPLES:
            # more counts roll the glider to starboard: the mass has gone there
            rotation[phase] = -ROLL_CNV * (counts[phase] - float(np.median(counts[phase])))
            filled |= phase
    tally.add(
        "note", f"{subject} rotation", filled,
        f"from gc_roll_ad with {ROLL_CNV} deg a count, from the counts at which each phase "
        "rests: the log has no C_ROLL_DIVE, C_ROLL_CLIMB, ROLL_CNV",
    )  # fmt: skip
    return rotation


Array = NDArray[np.float64]
Columns = dict[str, Array]

CM = 0.01
"""[m] One centimetre."""


def signals_of(
    time: Array, samples: Columns, dives: Columns, variation: Channel, name: str, tally: Tally
) -> dict[str, Channel]:
    """Clean channels of attitude, actuators and pressure, by the store's names.

    Raises:
      InputError: the heading is magnetic, and no variation is known.
    """
    channels: dict[str, Channel] = {}

    def put(target: str, values: Array, subject: str) -> None:
        channels[target] = clean(target, time, values, tally, subject=subject)

    depth, counts = samples.get("depth_m"), samples.get("gc_roll_ad")
    if "pitch_deg" in samples:
        flying = depth is not None and bool(np.nanmax(depth, initial=0.0) > FLYING)
        pitch = from_degrees(samples["pitch_deg"], "pitch_deg", tally, flying=flying)
        put("measured_pitch", pitch, "pitch_deg")
    if "roll_deg" in samples:
        roll = samples["roll_deg"]
        if counts is not None and _rolls_in_radian(roll, counts):
            why = "was in radian where degrees are native"
            tally.add("repaired", "roll_deg", np.isfinite(roll), why)
            roll = np.degrees(roll)
        put("measured_roll", roll, "roll_deg")
    if "head_mag_deg" in samples:
        if not len(variation):
            raise InputError(
                f"{name}: head_mag_deg is magnetic and no file gives magnetic_variation (the table "
                "of dives does) or a fix from which it follows; give it with --variation-deg, east "
                "positive"
            )
        magnetic = heading_degrees(samples["head_mag_deg"], "head_mag_deg", tally)
        put("measured_heading", np.mod(magnetic + variation.at(time), 360.0), "measured_heading")
    if counts is not None and "pitch_deg" in samples:
        known = samples.get("rotation_deg")
        rotation = rotation_from_counts(counts, samples["pitch_deg"], known, name, tally)
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
            pump = target == "measured_pump"
            put(target, to_cm3(values, column, tally) if pump else values, column)
    channels |= _shift(time, samples, dives, tally)
    return channels | pressure_channels(
        time, samples.get("pressure_dbar"), depth, "pressure_dbar", tally,
        pitch=channels.get("measured_pitch", EMPTY),
    )  # fmt: skip


def water_of(
    name: str,
    ctd: Sequence[Columns],
    time: Array,
    samples: Columns,
    channels: Mapping[str, Channel],
    fixes: LoggedFixes,
    tally: Tally,
) -> dict[str, Channel]:
    """Temperature, salinity and density from the samples and from CTDs with their own times."""
    pieces = list(ctd)
    if "temp_c" in samples:
        pieces.append({"time": time, **{n: samples[n] for n in _CTD if n in samples}})
    columns = stacked(pieces, ("time", *_CTD))
    at = channels.get("measured_pressure") or channels.get("measured_depth")
    if "temp_c" in columns and at:
        there = np.isfinite(columns["temp_c"])
        subject = f"{name} CTD"
        own = unix_seconds(columns.pop("time")[there], subject, tally)
        own, columns = tidy(
            own, {n: values[there] for n, values in columns.items()}, subject, tally
        )
        latitude, longitude = fixes.middle
        return ctd_channels(
            own, temperature=columns["temp_c"], pressure=at.known(own),
            practical=columns.get("sal_psu"), latitude=latitude, longitude=longitude, tally=tally,
        )  # fmt: skip
    if "rho_insitu" in samples:
        dense = clean("measured_density", time, samples["rho_insitu"], tally, subject="rho_insitu")
        return {"measured_density": dense}
    return {}


_CTD = ("temp_c", "sal_psu")
_TURNS, _ROLLS = 500.0, 1.5
"""[counts, degree] A roll mass that moves over `_TURNS` rolls the glider by more than `_ROLLS`."""


def _rolls_in_radian(roll: Array, counts: Array) -> bool:
    both = np.isfinite(roll) & np.isfinite(counts) & (counts > 0.0)
    if both.sum() < 100:
        return False
    moved = np.ptp(np.percentile(counts[both], [5.0, 95.0]))
    return bool(moved > _TURNS and np.ptp(np.percentile(roll[both], [5.0, 95.0])) < _ROLLS)


def _shift(time: Array, samples: Columns, dives: Columns, tally: Tally) -> dict[str, Channel]:
    """Battery position [m] forward, from the encoder and each dive's calibration."""
    centre, scale = (dives.get(name) for name in ("log_C_PITCH", "log_PITCH_CNV"))
    if "gc_pitch_ad" not in samples or "dive" not in dives or centre is None or scale is None:
        return {}
    start = first_time(dives)
    known = np.flatnonzero(np.isfinite(centre) & np.isfinite(scale) & np.isfinite(start))
    if not known.size:
        return {}
    known = known[np.argsort(start[known])]
    row = known[np.maximum(np.searchsorted(start[known], time, side="right") - 1, 0)]
    moved = np.where(samples["gc_pitch_ad"] > 0.0, samples["gc_pitch_ad"], np.nan)
    forward = -CM * ((moved - centre[row]) * scale[row])
    return {"measured_shift": clean("measured_shift", time, forward, tally, subject="gc_pitch_ad")}


def seaglider_batteries(
    dives: Mapping[str, Array], moves: Mapping[str, Array], tally: Tally
) -> dict[str, Channel]:
    """Channels of charge, voltage and vacuum at the ends of each dive, and of pump power.

    Args:
      dives: numbers of each dive, (dives,) each: `START` and `END` [s], fuel gauges
        `log_FG_AHR_10V` [A h] and the like, the vehicle's own estimate (`10V_AH`), the lowest
        voltage of each battery in the dive (`10V_V`), `log_INTERNAL_PRESSURE` [psi].
      moves: of the guidance and control table, (moves,) each; the pump runs after the pitch.
    """
    found: dict[str, Channel] = {}
    nothing = np.full(len(next(iter(dives.values()), np.zeros(0))), np.nan)
    start, end = (dives.get(name, nothing) for name in (START, END))
    gauges = [[dives[name] for name in both if name in dives] for both in (GAUGES[:2], GAUGES[2:])]
    reckoned = [dives[name] for name in ("10V_AH", "24V_AH") if name in dives]
    volts = [dives[name] for name in ("10V_V", "24V_V") if name in dives]
    series: dict[str, list[tuple[Array, Array]]] = {}
    if all(gauges):
        series["measured_charge"] = [
            (when, np.sum(both, axis=0)) for when, both in zip((start, end), gauges, strict=True)
        ]
        leave_out(["log_10V_AH", "log_24V_AH"], "the fuel gauges measure the charge", tally)
    elif reckoned:
        series["measured_charge"] = [(end, np.sum(reckoned, axis=0))]
    if volts:
        series["measured_voltage"] = [(end, np.mean(volts, axis=0))]
    if "log_INTERNAL_PRESSURE" in dives:
        inside = PSI * dives["log_INTERNAL_PRESSURE"]
        series["measured_vacuum"] = [(start, SEA_LEVEL - inside)]
    for target, pieces in series.items():
        time, values = (np.concatenate(both) for both in zip(*pieces, strict=True))
        there = np.isfinite(time) & np.isfinite(values)
        time, first = np.unique(time[there], return_index=True)
        found[target] = clean(target, time, values[there][first], tally)
    if all(name in moves for name in PUMPED):
        begin, pitched, seconds, current, voltage = (moves[name] for name in PUMPED)
        power = current * voltage
        runs = (seconds > 0.0) & np.isfinite(begin) & np.isfinite(power)
        begin, power = (begin + np.nan_to_num(pitched))[runs], power[runs]
        time = np.concatenate([begin, begin + seconds[runs]])
        time, first = np.unique(time, return_index=True)
        power = np.append(power, np.zeros(len(begin)))[first]
        if len(time):  # off before the first move
            time, power = np.append(time[0] - 1.0, time), np.append(0.0, power)
        found["measured_pump_power"] = clean("measured_pump_power", time, power, tally)
    return found


START, END = "gps2_time", "gpsE_time"
"""Columns of times. START: of the last fix before a dive. END: of the first fix after it."""
PUMPED = ("gc_st_secs", "gc_pitch_secs", "gc_vbd_secs", "gc_vbd_i", "gc_vbd_volts")
"""Columns of a move: its start [s], duration of pitch and pump [s], current [A] and voltage [V]."""
GAUGES = ("log_FG_AHR_10V", "log_FG_AHR_24V", "log_FG_AHR_10Vo", "log_FG_AHR_24Vo")
"""[A h] Fuel gauges of a Seaglider before and after the dive."""
RECKONED = ("log_10V_AH", "log_24V_AH")
"""Texts with the lowest voltage [V] and the charge used [A h] by the vehicle's own estimate."""


def voltage_and_charge(words: str, name: str) -> dict[str, Array]:
    """Parse the text of one of `RECKONED` into columns; empty if it has another form."""
    try:
        volts, charge = (np.array([float(word)]) for word in words.split(","))
    except ValueError:
        return {}
    battery = name.removeprefix("log_").removesuffix("_AH")
    return {f"{battery}_V": volts, f"{battery}_AH": charge}


PSI = 6894.757
"""[Pa] One pound-force per square inch (NIST SP 811)."""


def first_time(dives: Columns) -> Array:
    """[s] Unix time of the last fix before each dive; if no dive has this fix, of another fix."""
    for name in ("gps2_time", "gps1_time", "gpsE_time"):
        if name in dives and np.isfinite(dives[name]).any():
            return dives[name]
    return np.full(len(next(iter(dives.values()))), np.nan)
