"""A log made of a Slocum's native sensors, whether they came from tables or from binary files.

Native units: rad, bar, inch, S/m, LMC metres along MAGNETIC east (x) and north (y); headings
magnetic. The stored variation is subtracted: true = m_heading - m_gps_mag_var, so that the sign
of `magnetic_variation` here (east positive) is the opposite of the vehicle's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.formats.slocum.pressure_choice import PRESSURES, slocum_pressure
from factory.importing.reading.deployment_log import EMPTY, NO_FIXES, Channel, DeploymentLog, Fixes
from factory.importing.reading.tally import Tally
from factory.importing.repairs.angles import jointly_degrees, to_degrees
from factory.importing.repairs.cleaning import (
    clean,
    positions,
    pressure_by_flight,
    to_cm3,
    to_dbar,
)
from factory.importing.repairs.seawater import ctd_channels, siemens
from twin.errors import InputError
from twin.geodesy import turn

Array = NDArray[np.float64]
Native = Mapping[str, Channel]

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
PUMPS = (("m_ballast_pumped", "c_ballast_pumped"), ("m_de_oil_vol", "c_de_oil_vol"))
"""[cm3] Shallow gliders have a ballast pump, deep ones an oil bladder; both + = lighter."""
THRUSTERS = ("m_thruster_power", "m_thruster_current", "c_thruster_on")
GOOD_FIX = 0
"""Status of a valid GPS line."""
WANTED = (
    *ANGLES, *PRESSURES, *THRUSTERS, *(name for pair in PUMPS for name in pair),
    "m_depth", "m_heading", "c_heading", "m_battpos", "c_battpos", "sci_water_cond",
    "sci_water_temp", "m_x_lmc", "m_y_lmc", "m_lat", "m_lon", "m_water_vx", "m_water_vy",
    "m_final_water_vx", "m_final_water_vy", "m_gps_lat", "m_gps_lon", "m_gps_status",
    "m_gps_mag_var",
)  # fmt: skip
"""Every native sensor that is read."""


def slocum_log(
    deployment: str,
    native: Native,
    *,
    fixes: Fixes,
    variation: Channel,
    truth_speed: Channel = EMPTY,
    files: Sequence[str] = (),
    tally: Tally,
) -> DeploymentLog:
    """A log from native sensors.

    Args:
      native: finite values at increasing times, native units.
      fixes: from elsewhere; those in `m_gps_lat`, `m_gps_lon` are used when it is empty.
      variation: [degree] east positive; from `m_gps_mag_var` when empty.
      truth_speed: [m/s] through the water, by a DVL.

    Raises:
      InputError: pressure and depth do not belong together, or there is a heading but no
        magnetic variation.
    """
    if not len(fixes):
        fixes = gps_fixes(*_common(native, ("m_gps_lat", "m_gps_lon", "m_gps_status")), tally=tally)
    if not len(variation):
        variation = native_variation(native.get("m_gps_mag_var", EMPTY), tally)
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
                    "(m_gps_mag_var, mag_var_rad); give it with --variation-deg, east positive"
                )
            magnetic = to_degrees(channel.values, name, tally, kind="heading", likely=likely)
            true = np.mod(magnetic + variation.at(channel.time), 360.0)
            channels[target] = clean(target, channel.time, true, tally, subject=name)
    # a vehicle with an oil bladder logs a lone 0 of the ballast pump that it does not have
    pumps = [pair for pair in PUMPS if pair[0] in native]
    for name, target in zip(
        max(pumps, key=lambda pair: len(native[pair[0]]), default=()),
        ("measured_pump", "commanded_pump"),
        strict=False,
    ):
        if name in native and len(native[name]):
            one = native[name]
            volume = to_cm3(one.values, name, tally)
            channels[target] = clean(target, one.time, volume, tally, subject=name)
    batteries = (("m_battpos", "measured_shift"), ("c_battpos", "commanded_shift"))
    unit = _shift_unit([native[name].values for name, _ in batteries if name in native], tally)
    for name, target in batteries:
        if name in native:
            one = native[name]
            channels[target] = clean(target, one.time, unit * one.values, tally, subject=name)
    channels |= slocum_pressure(native, tally)
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
    channels |= _ctd(native, channels, fixes, tally)
    if len(truth_speed):
        channels["true_speed"] = truth_speed
    return DeploymentLog(
        deployment=deployment,
        platform="Slocum glider",
        channels={name: c for name, c in channels.items() if len(c)},
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary=_auxiliary(native, variation),
        files=tuple(files),
    )


def native_variation(channel: Channel, tally: Tally) -> Channel:
    """[degree] east positive, from the vehicle's rad with the opposite sign."""
    values = to_degrees(channel.values, "magnetic variation", tally, kind="variation")
    there = np.isfinite(values)
    return Channel(channel.time[there], -values[there])


def gps_fixes(
    time: Array, latitude: Array, longitude: Array, status: Array, *, tally: Tally
) -> Fixes:
    """Valid fixes; those with a status that is not 0 and impossible ones are counted."""
    if not time.size:
        return NO_FIXES
    bad = np.isfinite(status) & (status != GOOD_FIX)
    tally.add("removed", "GPS fixes", int(bad.sum()), "status is not valid")
    latitude, longitude = positions(latitude, longitude, "GPS fixes", tally)
    good = ~bad & np.isfinite(latitude) & np.isfinite(longitude)
    return Fixes(time[good], latitude[good], longitude[good])


def _common(native: Native, names: Sequence[str]) -> list[Array]:
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


_TRAVELS = (
    (1e-3, 0.06, 1.0, "metres"),
    (0.06, 4.0, INCH, "inches"),
    (4.0, 12.0, 0.01, "cm"),
    (12.0, 120.0, 1e-3, "mm"),
)
"""Range of a battery's positions from..to, metres in its unit, and the unit. A Slocum's battery
travels 2 to 10 cm; less than 4 cm given in cm cannot be told from inches."""


def _shift_unit(positions_: Sequence[Array], tally: Tally) -> float:
    """[m] in the unit of the battery's positions, by how far it travels; counted if not inches."""
    for values in positions_:
        good = values[np.isfinite(values)]
        if good.size <= 100:
            continue
        travel = float(np.ptp(np.percentile(good, [2.0, 98.0])))
        for low, high, factor, unit in _TRAVELS:
            if low < travel <= high:
                if unit != "inches":
                    tally.add(
                        "repaired", "m_battpos", good.size,
                        f"was in {unit} where inches are native: travels {travel:.3g}",
                    )  # fmt: skip
                return factor
        if travel > _TRAVELS[-1][1]:
            tally.add(
                "suspect", "measured_shift", good.size,
                f"the battery travels {travel:.3g}, in no unit that of a glider",
            )  # fmt: skip
        return INCH
    return INCH


def _ctd(
    native: Native, channels: Mapping[str, Channel], fixes: Fixes, tally: Tally
) -> dict[str, Channel]:
    conductivity = native.get("sci_water_cond", EMPTY)
    temperature = native.get("sci_water_temp", EMPTY)
    pressure = native.get("sci_water_pressure", EMPTY)
    if not len(temperature):
        return {}
    if len(pressure):
        at = pressure.at(temperature.time)
        depth = native.get("m_depth", EMPTY)
        beside = depth.at(temperature.time) if len(depth) else None
        at = to_dbar(at, beside, "sci_water_pressure", Tally(), native="bar")
    elif "measured_pressure" in channels:
        at = channels["measured_pressure"].at(temperature.time)
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


def _auxiliary(native: Native, variation: Channel) -> dict[str, Channel]:
    """On-board track, reported currents and thruster."""
    found: dict[str, Channel] = {}
    for x, y, target in (
        ("m_x_lmc", "m_y_lmc", "onboard"),
        ("m_final_water_vx", "m_final_water_vy", "dac"),
        ("m_water_vx", "m_water_vy", "dac"),
    ):
        if f"{target}_north" in found or not len(variation):
            continue
        time, east, north = _common(native, (x, y))
        both = np.isfinite(east) & np.isfinite(north)
        if both.any():
            true = turn(east[both], north[both], variation.at(time[both]))
            found[f"{target}_north"] = Channel(time[both], true[0])
            found[f"{target}_east"] = Channel(time[both], true[1])
    for name in THRUSTERS:
        if name in native and len(native[name]):
            found["thruster"] = native[name]
            break
    if "onboard_north" not in found and "m_lat" in native and "m_lon" in native:
        time, latitude, longitude = _common(native, ("m_lat", "m_lon"))
        latitude, longitude = positions(latitude, longitude, "m_lat, m_lon", Tally())
        both = np.isfinite(latitude) & np.isfinite(longitude)
        found["latitude"] = Channel(time[both], latitude[both])
        found["longitude"] = Channel(time[both], longitude[both])
    return found
