"""Synthetic missions: a kinematic glider, quasi-steady with lags, in the store's layout."""

import warnings
from pathlib import Path

import numpy as np
import xarray as xr

from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.schema import SCHEMA_VERSION, VARIABLES

PERIOD = 0.5
FLAGS = {"flag_values": [0, 1, 2], "flag_meanings": "train validation test"}


def lagged(target, lag, start):
    values = np.empty_like(target)
    state = start
    for k, wanted in enumerate(target):
        state += (wanted - state) * (1.0 - np.exp(-PERIOD / lag))
        values[k] = state
    return values


def synthetic_mission(samples, seed):
    """Signals by schema name. Speed follows net buoyancy and pitch with a lag of 8 s, from rest."""
    rng = np.random.default_rng(seed)
    time = PERIOD * np.arange(samples)
    half = rng.uniform(150.0, 300.0)
    dive = np.where(np.mod(time, 2 * half) < half, 1.0, -1.0)
    mass = dive * rng.uniform(0.2, 0.45)
    pitch = lagged(-dive * np.deg2rad(rng.uniform(18.0, 40.0)), 6.0, 0.0)
    mass = lagged(mass, 4.0, 0.0)
    turning = np.where(np.mod(time, 500.0) < 250.0, rng.uniform(-40.0, 40.0), 0.0)
    rotation = lagged(np.deg2rad(turning), 3.0, 0.0)
    roll = lagged(-0.3 * rotation, 3.0, 0.0)
    surge = lagged(np.sqrt(1.5 * np.abs(mass * np.sin(pitch))), 8.0, 0.0)
    sway = lagged(0.03 * rotation * surge, 5.0, 0.0)
    heave = 0.05 * surge * dive
    yaw_rate = 0.02 * rotation * surge
    heading = np.mod(np.rad2deg(rng.uniform(0, 2 * np.pi) + np.cumsum(yaw_rate) * PERIOD), 360.0)
    down = -surge * np.sin(pitch) + np.cos(pitch) * (sway * np.sin(roll) + heave * np.cos(roll))
    depth = np.cumsum(down) * PERIOD
    shift = -pitch * 0.04
    signals = {
        "true_surge": surge,
        "true_sway": sway,
        "true_heave": heave,
        "measured_roll": np.rad2deg(roll),
        "measured_pitch": np.rad2deg(pitch),
        "measured_heading": heading,
        "measured_roll_rate": np.gradient(roll, PERIOD),
        "measured_pitch_rate": np.gradient(pitch, PERIOD),
        "measured_yaw_rate": yaw_rate,
        "measured_specific_force_x": 9.81 * np.sin(pitch),
        "measured_specific_force_y": -9.81 * np.cos(pitch) * np.sin(roll),
        "measured_specific_force_z": -9.81 * np.cos(pitch) * np.cos(roll),
        "measured_depth": depth,
        "measured_shift": shift,
        "measured_rotation": np.rad2deg(rotation),
        "measured_pump": -mass * 1000.0,
        "commanded_shift": shift,
        "commanded_rotation": turning,
        "commanded_pump": -mass * 1000.0,
    }
    return signals


def write_synthetic_store(path: Path, lengths, splits=None, drop=(), edit=None):
    """A store with missions of these lengths; `splits` are numbers of FLAGS, None leaves them out.

    `drop` names variables to leave out; `edit(arrays)` may change the arrays before writing.
    """
    missions = [synthetic_mission(n, seed) for seed, n in enumerate(lengths)]
    longest = max(lengths, default=0)
    arrays = {}
    for name in missions[0] if missions else VARIABLES:
        if name in drop:
            continue
        values = np.full((len(missions), longest), np.nan, np.float32)
        for row, signals in zip(values, missions, strict=True):
            row[: len(signals[name])] = signals[name]
        arrays[name] = values
    if edit is not None:
        edit(arrays)
    dataset = xr.Dataset(
        {
            name: (("mission", "time"), values, VARIABLES[name].attributes())
            for name, values in arrays.items()
        },
        {"mission": np.arange(len(missions)), "time": PERIOD * np.arange(longest)},
        {**SIMULATED_ATTRIBUTES, "schema_version": SCHEMA_VERSION},
    )
    dataset["n_samples"] = ("mission", np.array(lengths, np.int32))
    if splits is not None:
        dataset["split"] = ("mission", np.array(splits, np.int8), FLAGS)
    return write_dataset(dataset, path)


def write_dataset(dataset, path):
    """A store with its metadata gathered in one place, as the factory's have."""
    with warnings.catch_warnings():
        # zarr: neither gathered metadata nor text arrays are in the v3 specification yet.
        warnings.simplefilter("ignore")
        dataset.to_zarr(path, mode="w", zarr_format=3, consolidated=True)
    return path
