"""A log made of a Slocum's native sensors, whether they came from tables or from binary files.

Native units: rad, bar, inch, S/m, LMC metres along MAGNETIC east (x) and north (y); headings
magnetic. The stored variation is subtracted: true = m_heading - m_gps_mag_var, so that the sign
of `magnetic_variation` here (east positive) is the opposite of the vehicle's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import jointly_degrees, reference_declination, to_degrees
from factory.importing.batteries import SLOCUM_SENSORS, SLOCUM_UNITS, slocum_batteries
from factory.importing.cleaning import clean, positions
from factory.importing.deployment_log import (
    EMPTY,
    NO_FIXES,
    Channel,
    DeploymentLog,
    LoggedFixes,
)
from factory.importing.formats.slocum.choices import PRESSURES, PUMPS, slocum_pressure, slocum_pump
from factory.importing.payload import PayloadSignal, payload_channels
from factory.importing.pressures import pressure_by_flight, to_dbar
from factory.importing.seawater import ctd_channels, siemens
from factory.importing.tally import Tally, leave_out
from factory.importing.units import converted, is_declared
from twin.errors import InputError
from twin.geodesy import turn

Array = NDArray[np.float64]
Native = Mapping[str, Channel]

THRUSTERS = ("m_thruster_power", "m_thruster_current", "c_thruster_on")
"""The first that is there says when the thruster runs."""
TRACK, PLACE = ("m_x_lmc", "m_y_lmc"), ("m_lat", "m_lon")
CURRENTS = (("m_final_water_vx", "m_final_water_vy"), ("m_water_vx", "m_water_vy"))
"""[m/s] along MAGNETIC east and north: after a dive, and as the vehicle uses it."""
WAYPOINT = ("c_wpt_lat", "c_wpt_lon")
ON_BOARD = (*THRUSTERS, *TRACK, *PLACE, *(n for pair in CURRENTS for n in pair), *WAYPOINT)
"""Sensors of thruster, track, current and waypoint"""

INCH = 0.0254
"""[m]"""
ANGLES = {
    "m_pitch": ("measured_pitch", "pitch"),
    "m_roll": ("measured_roll", "roll"),
    "m_fin": ("measured_fin", "fin"),
    "c_pitch": ("commanded_pitch", "pitch"),
}
"""Native name: schema name, kind of angle."""
ATTITUDE = {"m_pitch": "pitch", "m_roll": "roll", "m_heading": "heading"}
"""Angles that share a unit in one log."""
FLIGHT = (
    "m_depth", "m_pressure", "m_water_pressure", *ATTITUDE, "m_fin", "m_battpos",
    *(measured for measured, _ in PUMPS),
)  # fmt: skip
"""What the flight computer logs as long as it runs; the science computer is another one."""
GOOD_FIX = 0
"""Status of a valid GPS line."""
WANTED = (
    *ANGLES, *PRESSURES, *(name for pair in PUMPS for name in pair),
    "m_depth", "m_heading", "c_heading", "m_battpos", "c_battpos", "sci_water_cond",
    "sci_water_temp", "m_gps_lat", "m_gps_lon", "m_gps_status", "m_gps_mag_var",
    *dict.fromkeys((*ON_BOARD, *SLOCUM_SENSORS)),
)  # fmt: skip
"""Every native sensor that is read, beside those of the payload."""

UNITS = {
    **dict.fromkeys((*ANGLES, "m_heading", "c_heading", "m_gps_mag_var"), "rad"),
    **dict.fromkeys(PRESSURES, "bar"),
    **dict.fromkeys((name for pair in PUMPS for name in pair), "cm3"),
    **dict.fromkeys(("m_battpos", "c_battpos"), "inch"),
    **dict.fromkeys(TRACK, "m"),
    **dict.fromkeys((name for pair in CURRENTS for name in pair), "m s-1"),
    "m_depth": "m", "sci_water_cond": "S m-1", "sci_water_temp": "degree_Celsius",
    **SLOCUM_UNITS,
}  # fmt: skip
"""What a Slocum's software writes its sensors in"""


def in_native_units(
    native: Native, units: Mapping[str, str], deployment: str, tally: Tally
) -> dict[str, Channel]:
    """Channels in the native units by what the files' sensor lists say."""
    columns = converted(
        {name: one.values for name, one in native.items()}, units,
        {name: unit for name, unit in UNITS.items() if name in units}, tally,
        deployment=deployment,
    )  # fmt: skip
    return {
        name: Channel(one.time, columns[name]) if name in columns else EMPTY
        for name, one in native.items()
    }


def slocum_log(
    deployment: str,
    native: Native,
    *,
    fixes: LoggedFixes,
    variation: Channel,
    truth_speed: Channel = EMPTY,
    payload: Sequence[PayloadSignal] = (),
    units: Mapping[str, str] | None = None,
    files: Sequence[str] = (),
    tally: Tally,
) -> DeploymentLog:
    """A log from native sensors.

    Args:
      native: finite values at increasing times, native units.
      fixes: from elsewhere; those in `m_gps_lat`, `m_gps_lon` are used when it is empty.
      variation: [degree] east positive; from `m_gps_mag_var` when empty, else by the reference
        field where the log says where it was.
      truth_speed: [m/s] through the water, by a DVL.
      payload: what the user maps; `units` are those that the files name.

    Raises:
      InputError: pressure and depth do not belong together, or there is a heading but no
        magnetic variation.
    """
    units = units or {}
    native = in_native_units(native, units, deployment, tally)
    sure = {name for name in units if is_declared(units[name])}
    if not len(fixes):
        fixes = gps_fixes(
            *at_common_times(native, ("m_gps_lat", "m_gps_lon", "m_gps_status")), tally=tally
        )
    if not len(variation):
        variation = native_variation(native.get("m_gps_mag_var", EMPTY), tally)
    if not len(variation):
        variation = reference_declination(
            fixes if len(fixes) else on_board_places(native), deployment, tally
        )
    channels: dict[str, Channel] = {}
    likely = jointly_degrees(native, ATTITUDE)
    for name, (target, kind) in ANGLES.items():
        if name in native:
            values = to_degrees(native[name].values, name, tally, kind=kind, likely=likely)
            channels[target] = clean(target, native[name].time, values, tally, subject=name)
    for name, target in (("m_heading", "measured_heading"), ("c_heading", "commanded_heading")):
        if name in native:
            channel = native[name]
            if not len(variation):
                raise InputError(
                    f"{deployment}: {name} is magnetic and no file gives the magnetic variation "
                    "(m_gps_mag_var, mag_var_rad) or a position from which it follows; give it "
                    "with --variation-deg, east positive"
                )
            magnetic = to_degrees(channel.values, name, tally, kind="heading", likely=likely)
            true = np.mod(magnetic + variation.at(channel.time), 360.0)
            channels[target] = clean(target, channel.time, true, tally, subject=name)
    channels |= slocum_pump(native, tally, sure)
    batteries = (("m_battpos", "measured_shift"), ("c_battpos", "commanded_shift"))
    unit = _shift_unit(
        [native[name].values for name, _ in batteries if name in native], tally,
        declared="m_battpos" in sure,
    )  # fmt: skip
    for name, target in batteries:
        if name in native:
            one = native[name]
            channels[target] = clean(target, one.time, unit * one.values, tally, subject=name)
    middle = float(np.median(fixes.latitude)) if len(fixes) else 0.0
    channels |= slocum_pressure(native, tally, latitude=middle)
    if "measured_pressure" in channels and not len(native.get("m_depth", EMPTY)):
        pitch = channels.get("measured_pitch", EMPTY)
        channels["measured_pressure"] = pressure_by_flight(
            channels["measured_pressure"], pitch, "pressure", tally
        )
    if "measured_pressure" not in channels and "m_depth" in native:
        one = native["m_depth"]
        channels["measured_depth"] = clean(
            "measured_depth", one.time, one.values, tally, subject="m_depth"
        )
    channels |= slocum_batteries(native, tally)
    channels |= _ctd(native, channels, fixes, tally)
    channels |= payload_channels(native, payload, tally, units=units)
    if len(truth_speed):
        channels["true_speed"] = truth_speed
    auxiliary, reported = on_board(native, variation, tally)
    channels |= reported
    flown = [native[name].time for name in FLIGHT if len(native.get(name, EMPTY))]
    if flown:
        awake = np.unique(np.concatenate(flown))
        auxiliary["awake"] = Channel(awake, np.ones(len(awake)))
    return DeploymentLog(
        deployment=deployment,
        platform="Slocum glider",
        channels={name: c for name, c in channels.items() if len(c)},
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary=auxiliary,
        files=tuple(files),
    )


def native_variation(channel: Channel, tally: Tally) -> Channel:
    """[degree] east positive, from the vehicle's rad with the opposite sign."""
    values = to_degrees(channel.values, "magnetic variation", tally, kind="variation")
    there = np.isfinite(values)
    return Channel(channel.time[there], -values[there])


def gps_fixes(
    time: Array, latitude: Array, longitude: Array, status: Array, *, tally: Tally
) -> LoggedFixes:
    """Valid fixes; those with a status that is not 0 and impossible ones are counted."""
    if not time.size:
        return NO_FIXES
    bad = np.isfinite(status) & (status != GOOD_FIX)
    tally.add("removed", "GPS fixes", int(bad.sum()), "status is not valid")
    latitude, longitude = positions(latitude, longitude, "GPS fixes", tally)
    good = ~bad & np.isfinite(latitude) & np.isfinite(longitude)
    return LoggedFixes(time[good], latitude[good], longitude[good])


_TRAVELS = (
    (1e-3, 0.06, 1.0, "metres"),
    (0.06, 4.0, INCH, "inches"),
    (4.0, 12.0, 0.01, "cm"),
    (12.0, 120.0, 1e-3, "mm"),
)
"""Range of a battery's positions from..to, metres in its unit, and the unit. A Slocum's battery
travels 2 to 10 cm; less than 4 cm given in cm cannot be told from inches."""


def _shift_unit(positions_: Sequence[Array], tally: Tally, *, declared: bool) -> float:
    """[m] in the unit of the battery's positions, by how far it travels; counted if not inches.

    Where inches are declared, a battery that hardly moves is one that stands.
    """
    for values in positions_:
        good = values[np.isfinite(values)]
        if good.size <= 100:
            continue
        travel = float(np.ptp(np.percentile(good, [2.0, 98.0])))
        for low, high, factor, unit in _TRAVELS:
            if low < travel <= high and not (declared and unit == "metres"):
                if unit != "inches":
                    tally.add(
                        "repaired", "m_battpos", good.size,
                        f"was in {unit} where inches are native: travels {travel:.3g}",
                    )  # fmt: skip
                return factor
        if travel > _TRAVELS[-1][1]:
            tally.doubt(
                "measured_shift",
                f"the battery travels {travel:.3g}, in no unit that of a glider",
                good.size,
            )
        return INCH
    return INCH


def _ctd(
    native: Native, channels: Mapping[str, Channel], fixes: LoggedFixes, tally: Tally
) -> dict[str, Channel]:
    conductivity = native.get("sci_water_cond", EMPTY)
    temperature = native.get("sci_water_temp", EMPTY)
    pressure = native.get("sci_water_pressure", EMPTY)
    if not len(temperature):
        return {}
    if len(pressure):
        at = pressure.known(temperature.time)
        depth = native.get("m_depth", EMPTY)
        beside = depth.at(temperature.time) if len(depth) else None
        at = to_dbar(at, beside, "sci_water_pressure", Tally(), native="bar")
    elif "measured_pressure" in channels:
        at = channels["measured_pressure"].known(temperature.time)
    else:
        return {}
    same = np.full(len(temperature), np.nan)
    if len(conductivity):
        _, mine, its = np.intersect1d(temperature.time, conductivity.time, return_indices=True)
        same[mine] = siemens(conductivity.values, "sci_water_cond", tally)[its]
    return ctd_channels(
        temperature.time,
        temperature=temperature.values,
        pressure=at,
        conductivity=same if len(conductivity) else None,
        latitude=float(np.median(fixes.latitude)) if len(fixes) else 0.0,
        longitude=float(np.median(fixes.longitude)) if len(fixes) else 0.0,
        tally=tally,
    )


def at_common_times(native: Mapping[str, Channel], names: Sequence[str]) -> list[Array]:
    """Times of the first sensor, and all the sensors at them; NaN where one has no sample."""
    first = native.get(names[0], EMPTY)
    columns = [first.time, first.values]
    for name in names[1:]:
        values = np.full(len(first), np.nan)
        other = native.get(name, EMPTY)
        _, mine, its = np.intersect1d(first.time, other.time, return_indices=True)
        values[mine] = other.values[its]
        columns.append(values)
    return columns


def on_board(
    native: Native, variation: Channel, tally: Tally
) -> tuple[dict[str, Channel], dict[str, Channel]]:
    """Auxiliary channels (see `DeploymentLog`), and signals: the current that the vehicle uses."""
    found: dict[str, Channel] = {}
    signals: dict[str, Channel] = {}
    for names, target in ((TRACK, "onboard"), *((pair, "dac") for pair in CURRENTS)):
        there = [name for name in names if len(native.get(name, ()))]
        if not len(variation):
            leave_out(there, "along magnetic axes, and no variation is known", tally)
            continue
        time, east, north = at_common_times(native, names)
        both = np.isfinite(east) & np.isfinite(north)
        if not both.any():
            leave_out(there, "without the other component", tally)
            continue
        true = turn(east[both], north[both], variation.at(time[both]))
        pair = {
            f"{target}_{axis}": Channel(time[both], values)
            for axis, values in zip(("north", "east"), true, strict=True)
        }
        found |= {name: channel for name, channel in pair.items() if name not in found}
        if names == CURRENTS[1]:  # the better record of what the vehicle steers by
            signals = {f"measured_current_{n[4:]}": channel for n, channel in pair.items()}
    if not signals and "dac_north" in found:
        signals = {f"measured_current_{n}": found[f"dac_{n}"] for n in ("north", "east")}
    running = [name for name in THRUSTERS if len(native.get(name, ()))]
    if running:
        found["thruster"] = native[running[0]]
        leave_out(running[1:], f"{running[0]} says when the thruster runs", tally)
    here = on_board_places(native)
    if "onboard_north" in found:
        there = [name for name in PLACE if len(native.get(name, ()))]
        leave_out(there, f"the on-board track is that of {TRACK[0]}, {TRACK[1]}", tally)
    elif len(here):
        found["latitude"] = Channel(here.time, here.latitude)
        found["longitude"] = Channel(here.time, here.longitude)
    time, latitude, longitude = at_common_times(native, WAYPOINT)
    if time.size:
        unset = (latitude == 0.0) & (longitude == 0.0)
        tally.add("removed", "c_wpt_lat, c_wpt_lon", int(unset.sum()), "no waypoint yet (0, 0)")
        latitude, longitude = positions(
            np.where(unset, np.nan, latitude), np.where(unset, np.nan, longitude),
            "c_wpt_lat, c_wpt_lon", Tally(),
        )  # fmt: skip
        good = np.isfinite(latitude) & np.isfinite(longitude)
        if good.any():
            found["waypoint_latitude"] = Channel(time[good], latitude[good])
            found["waypoint_longitude"] = Channel(time[good], longitude[good])
    return found, signals


def on_board_places(native: Native) -> LoggedFixes:
    """Positions [degree] that the vehicle itself reckons."""
    time, latitude, longitude = at_common_times(native, PLACE)
    if not time.size:
        return LoggedFixes(time, latitude, longitude)
    latitude, longitude = positions(latitude, longitude, "m_lat, m_lon", Tally())
    both = np.isfinite(latitude) & np.isfinite(longitude)
    return LoggedFixes(time[both], latitude[both], longitude[both])
