"""Batteries: charge, voltage, current, powers and vacuum of a log, under the store's names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import clean
from factory.importing.deployment_log import EMPTY, Channel
from factory.importing.tally import Tally, leave_out

Array = NDArray[np.float64]

SEA_LEVEL = 101_325.0
"""[Pa] standard pressure of the air, from which a vacuum counts"""
INCH_HG = 3386.389
"""[Pa] in an inch of mercury at 0 degC (NIST SP 811)"""
PSI = 6894.757
"""[Pa] in a pound-force per square inch (NIST SP 811)"""


def slocum_batteries(native: Mapping[str, Channel], tally: Tally) -> dict[str, Channel]:
    """Channels of a Slocum's native sensors; of two with the same meaning the first is taken."""
    found: dict[str, Channel] = {}
    for target, (names, factor) in SLOCUM.items():
        there = [name for name in names if len(native.get(name, ()))]
        if not there:
            continue
        one = native[there[0]]
        found[target] = clean(target, one.time, factor * one.values, tally, subject=there[0])
        leave_out(there[1:], f"{there[0]} says the same", tally)
    return found | _thruster(native, found.get("measured_voltage", EMPTY), tally)


def _thruster(native: Mapping[str, Channel], voltage: Channel, tally: Tally) -> dict[str, Channel]:
    """Power [W] that the thruster takes from the batteries: its current at their voltage.

    `m_thruster_power` is the current at the motor's own, lower voltage; it stands in for it.
    """
    current, power = (native.get(name, EMPTY) for name in THRUSTER)
    if len(current) and len(voltage):
        leave_out(THRUSTER[1:], f"{THRUSTER[0]} at the batteries' voltage is taken", tally)
        power = Channel(current.time, current.values * voltage.at(current.time))
    if not power.values.any():
        return {}  # a vehicle without one writes 0 once
    name = "measured_thruster_power"
    return {name: clean(name, power.time, power.values, tally)}


THRUSTER = ("m_thruster_current", "m_thruster_power")
"""[A], [W] of a Slocum's thruster"""


SLOCUM = {
    "measured_charge": (("m_coulomb_amphr_total", "m_coulomb_amphr"), 1.0),
    "measured_voltage": (("m_battery", "m_battery_inst"), 1.0),
    "measured_battery_current": (("m_coulomb_current",), 1.0),
    "measured_vacuum": (("m_vacuum",), INCH_HG),
}
"""Store's name, a Slocum's sensors by preference, and the store's units in one of theirs."""
SLOCUM_UNITS = {
    **dict.fromkeys(SLOCUM["measured_charge"][0], "A h"),
    **dict.fromkeys(SLOCUM["measured_voltage"][0], "V"),
    "m_coulomb_current": "A", "m_thruster_current": "A", "m_thruster_power": "W",
    "m_vacuum": "inHg",
}  # fmt: skip
"""What these sensors are in"""
SLOCUM_SENSORS = (*(name for names, _ in SLOCUM.values() for name in names), *THRUSTER)


def from_inside(pressure: Array) -> Array:
    """Vacuum [Pa] from the absolute pressure inside the hull [Pa]."""
    return SEA_LEVEL - pressure


def used_of_left(left: Channel) -> Channel:
    """Charge taken [A h] of a counter of what is left [A h]: 0 at its first sample."""
    return Channel(left.time, left.values[:1] - left.values) if len(left) else left


def seaglider_batteries(
    dives: Mapping[str, Array], moves: Mapping[str, Array], tally: Tally
) -> dict[str, Channel]:
    """Channels of a Seaglider: its counters at both ends of each dive, and its pump.

    Args:
      dives: numbers of each dive, (dives,) each: `START` and `END` [s], fuel gauges
        `log_FG_AHR_10V` [A h] and the like, what the vehicle reckons (`10V_AH`), the lowest
        voltage of each battery in the dive (`10V_V`), `log_INTERNAL_PRESSURE` [psi].
      moves: of the guidance and control table, (moves,) each; the pump runs after the pitch.
    """
    found: dict[str, Channel] = {}
    nothing = np.full(len(next(iter(dives.values()), np.zeros(0))), np.nan)
    start, end = (dives.get(name, nothing) for name in (START, END))
    gauges = [[dives[name] for name in both if name in dives] for both in (GAUGES[:2], GAUGES[2:])]
    reckoned = [dives[name] for name in ("10V_AH", "24V_AH") if name in dives]
    parts = []
    if all(gauges):
        parts = [(time, sum(each)) for time, each in zip((start, end), gauges, strict=True)]
        leave_out(["log_10V_AH", "log_24V_AH"], "the fuel gauges measure the charge", tally)
    elif reckoned:
        parts = [(end, sum(reckoned))]
    volts = [dives[name] for name in ("10V_V", "24V_V") if name in dives]
    inside = dives.get("log_INTERNAL_PRESSURE")
    for target, pieces in (
        ("measured_charge", parts),
        ("measured_voltage", [(end, np.mean(volts, axis=0))] if volts else []),
        ("measured_vacuum", [] if inside is None else [(start, from_inside(PSI * inside))]),
    ):
        if pieces:
            time, values = (np.concatenate(both) for both in zip(*pieces, strict=True))
            there = np.isfinite(time) & np.isfinite(values)
            time, first = np.unique(time[there], return_index=True)
            found[target] = clean(target, time, values[there][first], tally)
    if all(name in moves for name in PUMPED):
        begin, pitched, seconds, current, volts_ = (moves[name] for name in PUMPED)
        runs = (seconds > 0.0) & np.isfinite(begin) & np.isfinite(current * volts_)
        begin = (begin + np.nan_to_num(pitched))[runs]
        time = np.concatenate([begin, begin + seconds[runs]])
        power = np.concatenate([(current * volts_)[runs], np.zeros(len(begin))])
        time, first = np.unique(time, return_index=True)
        if len(time):
            time = np.concatenate([[time[0] - 1.0], time])
            power = np.concatenate([[0.0], power[first]])
        found["measured_pump_power"] = clean("measured_pump_power", time, power, tally)
    return found


START, END = "gps2_time", "gpsE_time"
"""Times of the last fix before a dive and the first after it"""
PUMPED = ("gc_st_secs", "gc_pitch_secs", "gc_vbd_secs", "gc_vbd_i", "gc_vbd_volts")
"""Of a move: its begin and the seconds of pitch and pump [s]; current [A] and voltage [V]"""
GAUGES = ("log_FG_AHR_10V", "log_FG_AHR_24V", "log_FG_AHR_10Vo", "log_FG_AHR_24Vo")
"""[A h] A Seaglider's fuel gauges before and after the dive"""
RECKONED = ("log_10V_AH", "log_24V_AH")
"""Texts of the lowest voltage [V] and the charge [A h] that the vehicle reckons it has taken"""


def voltage_and_charge(words: str, name: str) -> dict[str, Array]:
    """Columns of one of `RECKONED`; nothing where the text has another form."""
    try:
        volts, charge = (np.array([float(word)]) for word in words.split(","))
    except ValueError:
        return {}
    battery = name.removeprefix("log_").removesuffix("_AH")
    return {f"{battery}_V": volts, f"{battery}_AH": charge}
