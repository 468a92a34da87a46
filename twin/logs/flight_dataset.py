"""Flight dataset: a flight as netCDF or zarr, at the samples of the store, with CF attributes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.identify.calibration import Calibration
from twin.logs.corrected_track import LINEAR, SMOOTHER
from twin.logs.flight_estimate import Flight, MissionFlight
from twin.logs.track import fixes_of
from twin.records.attributes import (
    COMMENT,
    DEPLOYMENT,
    DIVE,
    HISTORY,
    N_SAMPLES,
    PLATFORM,
    SAMPLE_PERIOD,
    SOURCE,
    START_TIME,
    TITLE,
)
from twin.records.coordinates import DATETIME, padded, sample_variables, unix_milliseconds
from twin.records.logged import start_times
from twin.records.presence import FLIGHT_TITLE, is_derived
from twin.records.reader import MissionStore
from twin.records.schema import MISSION, TIME
from twin.records.storage.whole import (
    check_file_target,
    check_folder_target,
    whole_file,
    whole_folder,
)
from twin.records.store import write_netcdf, write_zarr
from twin.version import __version__

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

W_WATER, GPS_FIX = "w_water", "gps_fix"
POSITIONS = ("latitude", "longitude")
OF_CTD = ("conductivity", "salinity", "density")
ESTIMATED = ("speed_through_water_sd", "angle_of_attack_sd")
BODY = "forward-starboard-down body axes"
FLOWN: dict[str, tuple[str, str, str | None]] = {
    "speed_through_water": (
        "m s-1", "speed through the water by the flight model", "platform_speed_wrt_sea_water"
    ),
    "angle_of_attack": ("degree", "angle of attack by the flight model, atan2(heave, surge)", None),
    "speed_through_water_sd": (
        "m s-1", "standard deviation of the speed through the water",
        "platform_speed_wrt_sea_water standard_error",
    ),
    "angle_of_attack_sd": ("degree", "standard deviation of the angle of attack", None),
    "surge": ("m s-1", f"velocity through the water, forward, {BODY}", None),
    "sway": ("m s-1", f"velocity through the water, starboard, {BODY}", None),
    "heave": ("m s-1", f"velocity through the water, down, {BODY}", None),
    W_WATER: (
        "m s-1", "vertical velocity of the water, positive up", "upward_sea_water_velocity"
    ),
    "north": ("m", "corrected track, north of the mission's origin", None),
    "east": ("m", "corrected track, east of the mission's origin", None),
    "latitude": ("degree_north", "latitude of the corrected track", "latitude"),
    "longitude": ("degree_east", "longitude of the corrected track", "longitude"),
    "position_sd": (
        "m", "standard deviation of the corrected track, north and east each", None
    ),
    "conductivity": ("S m-1", "conductivity as measured", "sea_water_electrical_conductivity"),
    "salinity": (
        "1", "practical salinity, thermal lag of the cell corrected",
        "sea_water_practical_salinity",
    ),
    "density": (
        "kg m-3", "in-situ density, thermal lag of the cell corrected", "sea_water_density"
    ),
}  # fmt: skip
"""Units, meaning and CF standard name of the flight model's variables, (mission, time)"""
COPIED = {
    "measured_depth": "depth",
    "measured_pressure": "pressure",
    "measured_temperature": "temperature",
    "measured_pitch": "pitch",
    "measured_roll": "roll",
    "measured_heading": "heading",
    "measured_phase": "phase",
}
"""Signals copied from the store, and their names in the dataset"""
DEVIATION = (
    "of the errors of the vehicle's and the pitch sensor's numbers, {source}; these do not average "
    "out over a deployment; waves and sensor noise are not in it"
)
COMMENTS = {
    "speed_through_water_sd": DEVIATION,
    "angle_of_attack_sd": DEVIATION,
    W_WATER: "depth rate of the flight model less the observed one, both filtered over 20 s; "
    "missing above 3 m, in gaps of the log and while the model settles; "
    "not to be trusted to better than 0.01 m s-1: w_profile_difference_m_s is the largest "
    "difference of dives and climbs in a bin of depth",
}
SMOOTHED = "dead-reckoned, smoothed with the current by all fixes of the deployment"
SPREAD = "dead-reckoned, the misclosure at each fix spread linearly in time"
TRACK_COMMENTS = {
    SMOOTHER: {
        "position_sd": "of the fix at a fix; elsewhere of the smoother",
        "latitude": SMOOTHED,
        "longitude": SMOOTHED,
    },
    LINEAR: {
        "position_sd": "of the fix at a fix; between two fixes of a random walk that the change of "
        "the depth-averaged current from dive to dive sets",
        "latitude": SPREAD,
        "longitude": SPREAD,
    },
}
"""Comments of variables, by the correction at the fixes"""
PER_DIVE: dict[str, tuple[str, str, str | None]] = {
    "dac_north": (
        "m s-1", "depth-averaged current, northward", "northward_sea_water_velocity"
    ),
    "dac_east": ("m s-1", "depth-averaged current, eastward", "eastward_sea_water_velocity"),
    "dac_sd": ("m s-1", "standard deviation of it, north and east each", None),
    "dac_start": ("s", "time of the fix before the dive, since the mission's start", None),
    "dac_end": ("s", "time of the fix after the dive, since the mission's start", None),
}  # fmt: skip
"""Units, meaning and CF standard name of the variables of dives between two fixes, (dac,)"""
DAC, DAC_MISSION, DAC_TIME = "dac", "dac_mission", "dac_time"
PER_PROFILE: dict[str, tuple[str, str, str | None]] = {
    "profile_depth": ("m", "depth, positive down", "depth"),
    "profile_north": ("m s-1", "current, northward", "northward_sea_water_velocity"),
    "profile_east": ("m s-1", "current, eastward", "eastward_sea_water_velocity"),
    "profile_north_sd": ("m s-1", "standard deviation of profile_north", None),
    "profile_east_sd": ("m s-1", "standard deviation of profile_east", None),
}
"""Units, meaning and CF standard name of current profiles, (dac, node); NaN in dives without"""
EPOCH = {"units": "seconds since 1970-01-01T00:00:00", "calendar": "standard",
         "standard_name": "time"}  # fmt: skip
OF_FLIGHTS: Mapping[str, Mapping[str, str]] = {
    MISSION: {"long_name": "row of the store"},
    TIME: {"units": "s", "long_name": "time since the start of the mission"},
    N_SAMPLES: {"units": "1", "long_name": "samples; later ones are padding"},
    DEPLOYMENT: {"long_name": "deployment that the mission belongs to"},
    DIVE: {"long_name": "number of the dive: the vehicle's own, or counted from 0"},
    START_TIME: {**EPOCH, "long_name": "UTC time of the mission's first sample"},
}
"""CF attributes of the axes and of the variables with one value per mission"""
OF_DIVES: Mapping[str, Mapping[str, str]] = {
    DAC_MISSION: {"long_name": "row of the store that the dive is in"},
    DAC_TIME: {**EPOCH, "long_name": "UTC time of the middle between the two fixes"},
    **{
        f"{DAC}_{name}": {
            "units": units, "standard_name": name,
            "long_name": f"{name} of the corrected track in the middle of the dive",
        }
        for name, units in (("latitude", "degree_north"), ("longitude", "degree_east"))
    },
}  # fmt: skip
"""CF attributes of the time and place of each dive"""


def flight_dataset(flight: Flight) -> xr.Dataset:
    """Dataset of a flight: the store's samples, (mission, time), and its currents, (dac,)."""
    import xarray as xr

    store = flight.store
    chosen = [one.dive.mission for one in flight.missions]
    lengths = np.array([len(one.dive.depth) for one in flight.missions], np.int32)
    longest = int(lengths.max())
    arrays = {name: np.full((len(chosen), longest), np.nan) for name in FLOWN}
    arrays |= {n: np.full((len(chosen), longest), np.nan) for s, n in COPIED.items() if s in store}
    for k, one in enumerate(flight.missions):
        for name, series in _series(one, store).items():
            arrays[name][k, : lengths[k]] = series
    absent = () if any(one.dive.ctd is not None for one in flight.missions) else OF_CTD
    if not any(np.isfinite(one.dive.speed_deviation).any() for one in flight.missions):
        absent = (*absent, *ESTIMATED)  # an estimator that does not know its errors
    if not any(one.place.known for one in flight.missions):
        absent = (*absent, *POSITIONS)
    arrays = {name: values for name, values in arrays.items() if name not in absent}
    variables: dict[str, Any] = {}
    for name, values in arrays.items():
        kind = np.float64 if name in POSITIONS else np.float32
        variables[name] = ((MISSION, TIME), values.astype(kind), _attributes(flight, name))
    fixed = np.zeros((len(chosen), longest), np.int8)
    for k, mission in enumerate(chosen):
        fixed[k, fixes_of(store, mission).sample] = 1
    variables[GPS_FIX] = ((MISSION, TIME), fixed, FIX_ATTRIBUTES)
    variables |= _per_dive(flight) | _per_profile(flight)
    variables[N_SAMPLES] = (MISSION, lengths, dict(OF_FLIGHTS[N_SAMPLES]))
    for name in (DEPLOYMENT, DIVE):
        if name in store:
            values = np.asarray(store.array(name))[chosen]
            values = values.astype(object) if name == DEPLOYMENT else values
            variables[name] = (MISSION, values, dict(OF_FLIGHTS[name]))
    starts = start_times(store)[chosen]
    if np.isfinite(starts).any():
        variables[START_TIME] = (MISSION, starts, dict(OF_FLIGHTS[START_TIME]))
    period = store.period
    coordinates: dict[str, Any] = {
        MISSION: (MISSION, np.array(chosen), dict(OF_FLIGHTS[MISSION])),
        TIME: (TIME, period * np.arange(longest), dict(OF_FLIGHTS[TIME])),
    }
    if np.isfinite(starts).any():
        moments = [
            unix_milliseconds(float(start), period * np.arange(count))
            for start, count in zip(starts, lengths, strict=True)
        ]
        whole = {DATETIME: padded(DATETIME, moments, longest)}
        coordinates |= sample_variables(whole, {}, (MISSION, TIME))
    return xr.Dataset(variables, coordinates, _about(flight))


def _series(one: MissionFlight, store: MissionStore) -> dict[str, Array]:
    """Variables of one mission, each (time,)."""
    dive, count = one.dive, len(one.dive.depth)
    latitude, longitude = one.place.degrees(*one.position.T)
    found: dict[str, Array] = {
        "north": one.position[:, 0],
        "east": one.position[:, 1],
        "latitude": latitude,
        "longitude": longitude,
        "position_sd": one.deviation,
        W_WATER: dive.water_up,
    }
    if dive.motion is not None:
        speed, alpha = dive.motion.speed, np.degrees(dive.motion.angle_of_attack)
        found |= {name: getattr(dive.motion, name) for name in ("surge", "sway", "heave")}
        found["speed_through_water"] = speed
        found["angle_of_attack"] = np.where(speed > LEAST_SPEED, alpha, np.nan)
        found["speed_through_water_sd"] = dive.speed_deviation
        attack = np.degrees(dive.attack_deviation)
        found["angle_of_attack_sd"] = np.where(speed > LEAST_SPEED, attack, np.nan)
    if dive.ctd is not None:
        found |= {name: getattr(dive.ctd, name) for name in OF_CTD}
    copied = {name: stored for stored, name in COPIED.items() if stored in store}
    for name, stored in copied.items():
        found[name] = np.asarray(store.row(stored, dive.mission)[:count])
    return found


FIX_ATTRIBUTES = {
    "long_name": "whether the track was corrected at a fix of this sample",
    "flag_values": np.array([0, 1], np.int8),
    "flag_meanings": "no_fix fix",
}
LEAST_SPEED = 0.05
"""[m/s] Speed; at less, no angle of attack is written"""


def write_flight(flight: Flight, path: Path, *, overwrite: bool = False) -> None:
    """Write a flight as netCDF (.nc) or zarr (.zarr).

    Raises:
      InputError: another ending, a file that exists already, or a disk that refuses to write.
    """
    check_target(path, overwrite=overwrite)
    dataset = flight_dataset(flight)
    if path.suffix == ".zarr":
        with whole_folder(path, overwrite=overwrite, ours=is_derived) as folder:
            write_zarr(dataset, folder)
        return
    encoding: dict[str, Any] = {
        str(name): {"zlib": True, "complevel": 4}
        for name, array in dataset.data_vars.items()
        if array.dtype.kind == "f" and array.ndim == 2
    }
    with whole_file(path, overwrite=overwrite) as place:
        write_netcdf(dataset, place, encoding)


def check_target(path: Path, *, overwrite: bool) -> None:
    """Raise InputError unless a flight can be written to `path`."""
    if path.suffix not in (".nc", ".zarr"):
        raise InputError(f"--out {str(path)!r} must end in .nc (netCDF) or .zarr")
    if path.suffix == ".zarr":
        check_folder_target(path, overwrite=overwrite, ours=is_derived)
    else:
        check_file_target(path, overwrite=overwrite)


def _attributes(flight: Flight, name: str) -> dict[str, Any]:
    if name in COPIED.values():
        stored = next(s for s, n in COPIED.items() if n == name)
        kept = ("units", "long_name", "standard_name", "positive", "flag_values", "flag_meanings")
        given = flight.store.dataset[stored].attrs
        kept_ones = {key: given[key] for key in kept if key in given}
        return kept_ones | _as_logged(flight.calibration).get(name, {})
    attributes = _described(FLOWN[name])
    comments = COMMENTS | TRACK_COMMENTS[flight.track]
    if name in comments:
        known = flight.calibration.errors is not None
        source = "by its identification" if known else "of an unidentified vehicle"
        attributes["comment"] = comments[name].format(source=source)
    if f"{name}_sd" in ESTIMATED:
        attributes["ancillary_variables"] = f"{name}_sd"
    if name not in ("latitude", "longitude") and any(one.place.known for one in flight.missions):
        attributes["coordinates"] = "latitude longitude"
    return attributes


def _as_logged(calibration: Calibration) -> dict[str, dict[str, str]]:
    """Comments that say by which pitch and heading the velocities are."""
    said = "as logged; velocities are by the identified"
    offset, *cycles = np.degrees([calibration.heading_offset, *calibration.heading_cycles])
    names = ("cos(h)", "sin(h)", "cos(2h)", "sin(2h)")
    terms = "".join(f" {c:+.3f} {name}" for c, name in zip(cycles, names, strict=True) if c)
    scale, level = calibration.pitch_scale, np.degrees(calibration.pitch_offset)
    return {
        "pitch": {"comment": f"{said} {scale:.4g} pitch {level:+.3f} degree"},
        "heading": {"comment": f"{said} h {offset:+.3f}{terms} degree, h this heading"},
    }


def _described(about: tuple[str, str, str | None]) -> dict[str, Any]:
    """CF attributes of an entry of FLOWN or PER_DIVE."""
    named = zip(("units", "long_name", "standard_name"), about, strict=True)
    return {name: text for name, text in named if text}


def _per_dive(flight: Flight) -> dict[str, Any]:
    """Variables of the depth-averaged currents; none if no dive has two fixes."""
    found = flight.currents
    if not found:
        return {}
    period = flight.store.period
    values = {
        "dac_north": [one.north for one in found],
        "dac_east": [one.east for one in found],
        "dac_sd": [one.deviation for one in found],
        "dac_start": [period * one.first for one in found],
        "dac_end": [period * one.last for one in found],
    }
    arrays: dict[str, Any] = {}
    for name, about in PER_DIVE.items():
        attributes = _described(about)
        if "standard_name" in attributes:
            attributes["comment"] = "mean over the dive, from fix to fix"
        arrays[name] = (DAC, np.array(values[name]), attributes)
    mission = np.array([one.mission for one in found], np.int32)
    arrays[DAC_MISSION] = (DAC, mission, dict(OF_DIVES[DAC_MISSION]))
    return arrays | _dac_places(flight)


def _per_profile(flight: Flight) -> dict[str, Any]:
    """Variables of the current profiles, padded with NaN to the most nodes; none without any."""
    most = max((len(one.depth) for one in flight.profiles.values()), default=0)
    values = np.full((len(PER_PROFILE), len(flight.currents), most), np.nan)
    for k, one in flight.profiles.items():
        values[:, k, : len(one.depth)] = one.depth, *one.current.T, *one.deviation.T
    named = zip(PER_PROFILE.items(), values, strict=True) if most else ()
    down = {"profile_depth": {"positive": "down"}}
    return {
        name: ((DAC, "node"), array, _described(about) | down.get(name, {}))
        for (name, about), array in named
    }


def _dac_places(flight: Flight) -> dict[str, Any]:
    """Time and place at the middle of each dive, if the store has them."""
    missions = {one.dive.mission: one for one in flight.missions}
    middle = np.array([one.start + 0.5 * one.duration for one in flight.currents])
    where = []
    for one in flight.currents:
        flown = missions[one.mission]
        sample = (one.first + one.last) // 2
        north, east = flown.position[sample]
        where.append(flown.place.degrees(np.array(north), np.array(east)))
    arrays: dict[str, Any] = {}
    if np.isfinite(middle).any():
        arrays[DAC_TIME] = (DAC, middle, dict(OF_DIVES[DAC_TIME]))
    if any(one.place.known for one in flight.missions):
        for k, name in enumerate((f"{DAC}_latitude", f"{DAC}_longitude")):
            values = np.array([float(place[k]) for place in where])
            arrays[name] = (DAC, values, dict(OF_DIVES[name]))
    return arrays


def _about(flight: Flight) -> dict[str, Any]:
    """Global attributes of the dataset."""
    store = flight.store
    lags = "; ".join(
        f"{name}: alpha {lag.amplitude:.3g}, tau {lag.time:.3g} s"
        for name, lag in flight.lags.items()
    )
    kind = "logs" if store.logged else "simulated missions"
    about = {
        "Conventions": "CF-1.11",
        TITLE: f"{FLIGHT_TITLE}, from {kind}",
        COMMENT: "On the samples of the store. NED frame with its origin at each mission's start; "
        "body axes forward, starboard, down.",
        SOURCE: f"flight model of vehicle {flight.calibration.vehicle.name}; velocities by the "
        f"estimator {flight.estimator}; glider-twin {__version__}",
        HISTORY: f"{store.attributes.get(HISTORY, '')}\ntwin flight {store.path.name}".strip(),
        SAMPLE_PERIOD: store.period,
        "vehicle": flight.calibration.vehicle.name,
        "ctd_thermal_lag": lags or "none: no CTD, or dives and climbs agree without",
        **flight.summary().describe(),
    }
    if PLATFORM in store.attributes:
        about[PLATFORM] = str(store.attributes[PLATFORM])
    return about
