"""Missions whose tracks are known in closed form, and stores of them, for the navigation tests."""

import warnings
from pathlib import Path

import numpy as np
import xarray as xr

from twin.fossen import FossenModel
from twin.records.attributes import SIMULATED_ATTRIBUTES
from twin.records.schema import SCHEMA_VERSION, VARIABLES
from twin.vehicle.steady_motion import STRAIGHT_TURN_RATE
from twin.vehicle.vehicle import load_vehicle

PERIOD = 0.5
FLAGS = {"flag_values": [0, 1, 2], "flag_meanings": "train validation test"}


def steady_mission(
    samples: int,
    *,
    velocity=(0.5, 0.0, 0.02),
    roll=0.0,
    pitch=-0.5,
    turn_rate=0.0,
    heading=0.4,
    current=(0.0, 0.0),
    depth=50.0,
    pump=-300.0,
    shift=0.02,
    rotation=0.0,
) -> dict[str, np.ndarray]:
    """Signals of a steady glide or spiral with ideal sensors; positions are exact integrals.

    velocity: surge, sway, heave [m/s]; roll, pitch, heading [rad]; turn_rate [rad/s] about the
    vertical; current: north, east [m/s].
    """
    time = PERIOD * np.arange(samples)
    u, v, w = velocity
    angle = heading + turn_rate * time
    # In the frame that turns with the heading the velocity is constant: R_y(pitch) R_x(roll) v.
    across = v * np.cos(roll) - w * np.sin(roll)
    lower = v * np.sin(roll) + w * np.cos(roll)
    ahead = u * np.cos(pitch) + lower * np.sin(pitch)
    down = -u * np.sin(pitch) + lower * np.cos(pitch)
    north_rate = ahead * np.cos(angle) - across * np.sin(angle)
    east_rate = ahead * np.sin(angle) + across * np.cos(angle)
    if abs(turn_rate) < STRAIGHT_TURN_RATE:
        north, east = north_rate * time, east_rate * time
    else:
        north = (east_rate - east_rate[0]) / turn_rate
        east = -(north_rate - north_rate[0]) / turn_rate
    ones = np.ones(samples)
    rates = (
        -turn_rate * np.sin(pitch) * ones,
        turn_rate * np.cos(pitch) * np.sin(roll) * ones,
        turn_rate * np.cos(pitch) * np.cos(roll) * ones,
    )
    degrees = {
        "roll": np.rad2deg(roll) * ones,
        "pitch": np.rad2deg(pitch) * ones,
        "heading": np.mod(np.rad2deg(angle), 360.0),
    }
    signals = {
        "true_north": north + current[0] * time,
        "true_east": east + current[1] * time,
        "true_depth": depth + down * time,
        "true_surge": u * ones,
        "true_sway": v * ones,
        "true_heave": w * ones,
        "true_velocity_north": north_rate + current[0],
        "true_velocity_east": east_rate + current[1],
        "true_velocity_down": down * ones,
        "true_current_north": current[0] * ones,
        "true_current_east": current[1] * ones,
    }
    felt = (np.sin(pitch), -np.cos(pitch) * np.sin(roll), -np.cos(pitch) * np.cos(roll))
    for group in ("true", "measured"):
        signals |= {f"{group}_{name}": values for name, values in degrees.items()}
        for name, values in zip(("roll", "pitch", "yaw"), rates, strict=True):
            signals[f"{group}_{name}_rate"] = values
        for name, value in zip("xyz", felt, strict=True):
            signals[f"{group}_specific_force_{name}"] = 9.81 * value * ones
        signals[f"{group}_shift"] = shift * ones
        signals[f"{group}_rotation"] = np.rad2deg(rotation) * ones
        signals[f"{group}_pump"] = pump * ones
    signals["measured_depth"] = signals["true_depth"].copy()
    for name in ("gps_north", "gps_east", "dvl_surge", "dvl_sway", "dvl_heave"):
        signals[f"measured_{name}"] = np.full(samples, np.nan)
    signals["measured_dvl_mode"] = np.zeros(samples)
    signals["measured_onboard_north"] = north.copy()
    signals["measured_onboard_east"] = east.copy()
    return signals


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
        # as if by the flight filter
        "estimated_surge": lagged(surge, 5.0, 0.0),
        "estimated_sway": lagged(sway, 5.0, 0.0),
        "estimated_attack": 0.05 * np.sign(dive) + 0.1 * pitch,
        "estimated_steady": (np.abs(np.gradient(pitch)) < 1e-3).astype(float),
    }
    return signals


def trimmed_mission(samples: int, *, net_mass=0.3, shift=0.02, rotation=0.0, **more):
    """`steady_mission` of the nominal glider at fixed actuators, from the Fossen model's trim."""
    vehicle = load_vehicle("glider")
    steady = FossenModel(vehicle).steady_motion(shift, rotation, net_mass).trim
    alpha, beta = np.deg2rad(steady.angle_of_attack_deg), np.deg2rad(steady.sideslip_deg)
    speed = steady.speed_m_s
    velocity = (
        speed * np.cos(alpha) * np.cos(beta),
        speed * np.sin(beta),
        speed * np.sin(alpha) * np.cos(beta),
    )
    return steady_mission(
        samples,
        velocity=velocity,
        roll=np.deg2rad(steady.roll_deg),
        pitch=np.deg2rad(steady.pitch_deg),
        turn_rate=steady.turn_rate_rad_s,
        pump=vehicle.pump_for_net_mass(net_mass),
        shift=shift,
        rotation=rotation,
        **more,
    )


def add_fixes(signals, samples, error=(0.0, 0.0)) -> None:
    """GPS fixes at these samples: the true position plus `error` [m]."""
    for name, off in zip(("north", "east"), error, strict=True):
        fixes = signals[f"measured_gps_{name}"]
        fixes[samples] = signals[f"true_{name}"][samples] + off


def write_store(path: Path, missions, splits=None, *, drop=(), attributes=None) -> Path:
    """Signals of missions as a store; `splits` are numbers of FLAGS, None leaves them out."""
    longest = max((len(m["true_north"]) for m in missions), default=0)
    names = [n for n in VARIABLES if (not missions or n in missions[0]) and n not in drop]
    arrays = {n: np.full((len(missions), longest), np.nan, np.float64) for n in names}
    for row, signals in enumerate(missions):
        for name in names:
            arrays[name][row, : len(signals[name])] = signals[name]
    dataset = xr.Dataset(
        {n: (("mission", "time"), a, VARIABLES[n].attributes()) for n, a in arrays.items()},
        {"mission": np.arange(len(missions)), "time": PERIOD * np.arange(longest)},
        {**SIMULATED_ATTRIBUTES, "schema_version": SCHEMA_VERSION, **(attributes or {})},
    )
    lengths = [len(m["true_north"]) for m in missions]
    dataset["n_samples"] = ("mission", np.array(lengths, np.int32))
    if splits is not None:
        dataset["split"] = ("mission", np.array(splits, np.int8), FLAGS)
    with warnings.catch_warnings():
        # gathered metadata is not in zarr's v3 specification yet
        warnings.simplefilter("ignore")
        dataset.to_zarr(path, mode="w", zarr_format=3, consolidated=True)
    return path


def write_flown_store(path: Path, splits=(0, 0, 1, 2)) -> Path:
    """Climbs and dives in turn with fixes at start and end, in a store with these splits."""
    rng = np.random.default_rng(5)
    missions = []
    for k in range(len(splits)):
        sign = 1.0 if k % 2 else -1.0
        signals = trimmed_mission(
            900 + 100 * k,
            net_mass=sign * rng.uniform(0.2, 0.4),
            shift=sign * rng.uniform(0.015, 0.025),
            rotation=np.deg2rad(rng.uniform(-40, 40)),
            depth=50.0 if sign > 0 else 500.0,
        )
        add_fixes(signals, [0, 800])
        missions.append(signals)
    return write_store(path, missions, list(splits), attributes={"preset": "test", "seed": 5})
