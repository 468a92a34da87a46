"""What a Slocum reckons on board: its track, the current, the waypoint; and its thruster.

Sensors of a Slocum that belong together: at the times of the first, as columns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.cleaning import positions
from factory.importing.deployment_log import EMPTY, Channel, LoggedFixes
from factory.importing.tally import Tally, leave_out
from twin.geodesy import turn

Array = NDArray[np.float64]


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


Native = Mapping[str, Channel]

THRUSTERS = ("m_thruster_power", "m_thruster_current", "c_thruster_on")
"""The first that is there says when the thruster runs."""
TRACK, PLACE = ("m_x_lmc", "m_y_lmc"), ("m_lat", "m_lon")
CURRENTS = (("m_final_water_vx", "m_final_water_vy"), ("m_water_vx", "m_water_vy"))
"""[m/s] along MAGNETIC east and north: after a dive, and as the vehicle uses it."""
WAYPOINT = ("c_wpt_lat", "c_wpt_lon")
ON_BOARD = (*THRUSTERS, *TRACK, *PLACE, *(n for pair in CURRENTS for n in pair), *WAYPOINT)
"""Every sensor that this module reads."""


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
    """Where the vehicle itself says that it is, in degrees."""
    time, latitude, longitude = at_common_times(native, PLACE)
    if not time.size:
        return LoggedFixes(time, latitude, longitude)
    latitude, longitude = positions(latitude, longitude, "m_lat, m_lon", Tally())
    both = np.isfinite(latitude) & np.isfinite(longitude)
    return LoggedFixes(time[both], latitude[both], longitude[both])
