"""Native sensors of a Slocum, from tables or binary files, made into a log.

Native units: rad, bar, inch, S/m, LMC metres along MAGNETIC east (x) and north (y); headings are
magnetic. The stored variation is subtracted: true = m_heading - m_gps_mag_var. So the sign of
`magnetic_variation` here (east positive) is the opposite of the vehicle's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.angles import jointly_degrees, reference_declination, to_degrees
from factory.importing.cleaning import clean, positions
from factory.importing.deployment_log import EMPTY, NO_FIXES, Channel, DeploymentLog, LoggedFixes
from factory.importing.formats.slocum.choices import (
    PRESSURES,
    PUMPS,
    SLOCUM_SENSORS,
    SLOCUM_UNITS,
    slocum_batteries,
    slocum_pressure,
    slocum_pump,
)
from factory.importing.payload import PayloadSignal, payload_channels
from factory.importing.pressures import ctd_channels, pressure_by_flight, siemens, to_dbar
from factory.importing.tally import Tally, leave_out
from factory.importing.units import converted, is_declared
from twin.errors import InputError
from twin.geodesy import turn

Array = NDArray[np.float64]
Native = Mapping[str, Channel]

THRUSTERS = ("m_thruster_power", "m_thruster_current", "c_thruster_on")
"""Sensors that show when the thruster runs; the first in the log is used."""
TRACK, PLACE = ("m_x_lmc", "m_y_lmc"), ("m_lat", "m_lon")
CURRENTS = (("m_final_water_vx", "m_final_water_vy"), ("m_water_vx", "m_water_vy"))
"""[m/s] Currents along MAGNETIC east and north: after a dive, and as the vehicle uses them."""
WAYPOINT = ("c_wpt_lat", "c_wpt_lon")
ON_BOARD = (*THRUSTERS, *TRACK, *PLACE, *(n for pair in CURRENTS for n in pair), *WAYPOINT)
"""Sensors of thruster, track, current and waypoint."""

INCH = 0.0254
"""[m] One inch."""
ANGLES = {
    "m_pitch": ("measured_pitch", "pitch"),
    "m_roll": ("measured_roll", "roll"),
    "m_fin": ("measured_fin", "fin"),
    "c_pitch": ("commanded_pitch", "pitch"),
}
"""Schema name and kind of angle, by native name."""
ATTITUDE = {"m_pitch": "pitch", "m_roll": "roll", "m_heading": "heading"}
"""Angles that share a unit in one log."""
FLIGHT = (
    "m_depth", "m_pressure", "m_water_pressure", *ATTITUDE, "m_fin", "m_battpos",
    *(measured for measured, _ in PUMPS),
)  # fmt: skip
"""Sensors that the flight computer logs while it runs; the science computer is another one."""
GOOD_FIX = 0
"""Status of a valid GPS line."""
WANTED = (
    *ANGLES, *PRESSURES, *(name for pair in PUMPS for name in pair),
    "m_depth", "m_heading", "c_heading", "m_battpos", "c_battpos", "sci_water_cond",
    "sci_water_temp", "m_gps_lat", "m_gps_lon", "m_gps_status", "m_gps_mag_var",
    *dict.fromkeys((*ON_BOARD, *SLOCUM_SENSORS)),
)  # fmt: skip
"""Every native sensor that is read, besides the payload's."""

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
"""Units in which a Slocum's software writes its sensors."""


def in_native_units(
    native: Native, units: Mapping[str, str], deployment: str, tally: Tally
) -> dict[str, Channel]:
    """Convert channels to the native units, by the units in the files' sensor lists."""
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
    """Make a log from native sensors.

    Args:
      native: finite values at increasing times, native units.
      fixes: from elsewhere; if empty, those in `m_gps_lat`, `m_gps_lon` are used.
      variation: [degree] east positive; if empty, from `m_gps_mag_var`, else by the reference field
        at the log's positions.
      truth_speed: [m/s] through the water, by a DVL.
      payload: the user's mappings; `units` are those that the files declare.

    Raises:
      InputError: pressure and depth do not belong together, or there is a heading but no magnetic
        variation.
    """
    units = units or {}
    native = in_native_units(native, units, deployment, tally)
    sure = {name for name in units if is_declared(units[name])}
    if not len(fixes):
        found = at_common_times(native, ("m_gps_lat", "m_gps_lon", "m_gps_status"))
        fixes = gps_fixes(*found, tally=tally)
    variation = variation or native_variation(native.get("m_gps_mag_var", EMPTY), tally)
    if not len(variation):
        places = fixes if len(fixes) else on_board_places(native)
        variation = reference_declination(places, deployment, tally)
    channels: dict[str, Channel] = {}

    def put(target: str, name: str, values: Array) -> None:
        channels[target] = clean(target, native[name].time, values, tally, subject=name)

    likely = jointly_degrees(native, ATTITUDE)
    for name in [name for name in ANGLES if name in native]:
        target, kind = ANGLES[name]
        put(target, name, to_degrees(native[name].values, name, tally, kind=kind, likely=likely))
    for name, target in (("m_heading", "measured_heading"), ("c_heading", "commanded_heading")):
        if name in native:
            if not len(variation):
                raise InputError(
                    f"{deployment}: {name} is magnetic and no file gives the magnetic variation "
                    "(m_gps_mag_var, mag_var_rad) or a position from which it follows; give it "
                    "with --variation-deg, east positive"
                )
            one = native[name]
            magnetic = to_degrees(one.values, name, tally, kind="heading", likely=likely)
            put(target, name, np.mod(magnetic + variation.at(one.time), 360.0))
    channels |= slocum_pump(native, tally, sure)
    batteries = {"m_battpos": "measured_shift", "c_battpos": "commanded_shift"}
    there = [name for name in batteries if name in native]
    unit = _shift_unit([native[n].values for n in there], tally, declared="m_battpos" in sure)
    for name in there:
        put(batteries[name], name, unit * native[name].values)
    channels |= slocum_pressure(native, tally, latitude=fixes.middle[0])
    pressure = channels.get("measured_pressure")
    if pressure is not None and not len(native.get("m_depth", EMPTY)):
        pitch = channels.get("measured_pitch", EMPTY)
        channels["measured_pressure"] = pressure_by_flight(pressure, pitch, "pressure", tally)
    if pressure is None and "m_depth" in native:
        put("measured_depth", "m_depth", native["m_depth"].values)
    channels |= slocum_batteries(native, tally)
    channels |= _ctd(native, channels, fixes, tally)
    channels |= payload_channels(native, payload, tally, units=units)
    if len(truth_speed):
        channels["true_speed"] = truth_speed
    auxiliary, reported = on_board(native, variation, tally)
    flown = [native[name].time for name in FLIGHT if len(native.get(name, EMPTY))]
    if flown:
        awake = np.unique(np.concatenate(flown))
        auxiliary["awake"] = Channel(awake, np.ones(len(awake)))
    return DeploymentLog(
        deployment=deployment,
        platform="Slocum glider",
        channels=channels | reported,
        fixes=fixes,
        magnetic_variation=variation,
        auxiliary=auxiliary,
        files=tuple(files),
    )


def native_variation(channel: Channel, tally: Tally) -> Channel:
    """[degree] Variation, east positive, from the vehicle's rad with the opposite sign."""
    values = to_degrees(channel.values, "magnetic variation", tally, kind="variation")
    return Channel.finite(channel.time, -values)


def gps_fixes(
    time: Array, latitude: Array, longitude: Array, status: Array, *, tally: Tally
) -> LoggedFixes:
    """Valid fixes; fixes with a status that is not 0, and impossible ones, are counted."""
    if not time.size:
        return NO_FIXES
    bad = np.isfinite(status) & (status != GOOD_FIX)
    tally.add("removed", "GPS fixes", bad, "status is not valid")
    latitude, longitude = positions(latitude, longitude, "GPS fixes", tally)
    return LoggedFixes.finite(time, np.where(bad, np.nan, latitude), longitude)


_TRAVELS = (
    (1e-3, 0.06, 1.0, "metres"),
    (0.06, 4.0, INCH, "inches"),
    (4.0, 12.0, 0.01, "cm"),
    (12.0, 120.0, 1e-3, "mm"),
)
"""Limits of the battery's travel in a unit, the unit's size [m] and name. A Slocum's battery
travels 2 to 10 cm; less than 4 cm given in cm cannot be distinguished from inches."""


def _shift_unit(positions_: Sequence[Array], tally: Tally, *, declared: bool) -> float:
    """[m] Size of the unit of the battery's positions, by its travel; counted if not inches.

    If inches are declared, a battery that hardly moves is at rest.
    """
    long = [good for values in positions_ if (good := values[np.isfinite(values)]).size > 100]
    if not long:
        return INCH
    good, travel = long[0], float(np.ptp(np.percentile(long[0], [2.0, 98.0])))
    for low, high, factor, unit in _TRAVELS:
        if low < travel <= high and not (declared and unit == "metres"):
            if unit != "inches":
                why = f"was in {unit} where inches are native: travels {travel:.3g}"
                tally.add("repaired", "m_battpos", good.size, why)
            return factor
    if travel > _TRAVELS[-1][1]:
        why = f"the battery travels {travel:.3g}, in no unit that of a glider"
        tally.doubt("measured_shift", why, good.size)
    return INCH


def _ctd(
    native: Native, channels: Mapping[str, Channel], fixes: LoggedFixes, tally: Tally
) -> dict[str, Channel]:
    warm, conductivity, pressure, depth = (
        native.get(name, EMPTY)
        for name in ("sci_water_temp", "sci_water_cond", "sci_water_pressure", "m_depth")
    )
    if not len(warm) or not (len(pressure) or "measured_pressure" in channels):
        return {}
    if len(pressure):
        beside = depth.at(warm.time) if len(depth) else None
        at = pressure.known(warm.time)
        at = to_dbar(at, beside, "sci_water_pressure", Tally(), native="bar")
    else:
        at = channels["measured_pressure"].known(warm.time)
    same = None
    if len(conductivity):
        own = siemens(conductivity.values, "sci_water_cond", tally)
        same = _at_samples(Channel(conductivity.time, own), warm.time)
    latitude, longitude = fixes.middle
    return ctd_channels(
        warm.time, temperature=warm.values, pressure=at, conductivity=same, latitude=latitude,
        longitude=longitude, tally=tally,
    )  # fmt: skip


def at_common_times(native: Mapping[str, Channel], names: Sequence[str]) -> list[Array]:
    """Times of the first sensor, and values of all sensors at these times; NaN without a sample."""
    first = native.get(names[0], EMPTY)
    others = [_at_samples(native.get(name, EMPTY), first.time) for name in names[1:]]
    return [first.time, first.values, *others]


def _at_samples(channel: Channel, times: Array) -> Array:
    """Samples of a channel at exactly these times; NaN where it has none."""
    values = np.full(len(times), np.nan)
    _, mine, its = np.intersect1d(times, channel.time, return_indices=True)
    values[mine] = channel.values[its]
    return values


def on_board(
    native: Native, variation: Channel, tally: Tally
) -> tuple[dict[str, Channel], dict[str, Channel]]:
    """Auxiliary channels (see `DeploymentLog`), and signals: the current that the vehicle uses."""
    found: dict[str, Channel] = {}
    signals: dict[str, Channel] = {}

    def present(names: Sequence[str]) -> list[str]:
        return [name for name in names if len(native.get(name, ()))]

    for names, target in ((TRACK, "onboard"), *((pair, "dac") for pair in CURRENTS)):
        time, east, north = at_common_times(native, names)
        both = np.isfinite(east) & np.isfinite(north)
        if not len(variation) or not both.any():
            axes = "along magnetic axes, and no variation is known"
            why = "without the other component" if len(variation) else axes
            leave_out(present(names), why, tally)
            continue
        true = turn(east[both], north[both], variation.at(time[both]))
        pair = {
            axis: Channel(time[both], values)
            for axis, values in zip(("north", "east"), true, strict=True)
        }
        for axis, channel in pair.items():
            found.setdefault(f"{target}_{axis}", channel)
        if names == CURRENTS[1]:  # the current that the vehicle steers by
            signals = {f"measured_current_{axis}": channel for axis, channel in pair.items()}
    if not signals and "dac_north" in found:
        signals = {f"measured_current_{n}": found[f"dac_{n}"] for n in ("north", "east")}
    running = present(THRUSTERS)
    if running:
        found["thruster"] = native[running[0]]
        leave_out(running[1:], f"{running[0]} says when the thruster runs", tally)
    here = on_board_places(native)
    if "onboard_north" in found:
        why = f"the on-board track is that of {TRACK[0]}, {TRACK[1]}"
        leave_out(present(PLACE), why, tally)
    elif len(here):
        found |= here.channels()
    time, latitude, longitude = at_common_times(native, WAYPOINT)
    unset = (latitude == 0.0) & (longitude == 0.0)
    latitude = tally.removed(latitude, unset, ", ".join(WAYPOINT), "no waypoint yet (0, 0)")
    places = positions(latitude, longitude, ", ".join(WAYPOINT), Tally())
    waypoints = LoggedFixes.finite(time, *places)
    return found | (waypoints.channels("waypoint_") if len(waypoints) else {}), signals


def on_board_places(native: Native) -> LoggedFixes:
    """Positions [degree] that the vehicle itself dead-reckons."""
    time, latitude, longitude = at_common_times(native, PLACE)
    return LoggedFixes.finite(time, *positions(latitude, longitude, "m_lat, m_lon", Tally()))
