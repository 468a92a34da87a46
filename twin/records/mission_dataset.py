"""Mission dataset: convert trajectories to one xarray dataset of the schema.

Signals are (mission, time) in float32 with NaN padding; `simulation_state` holds MuJoCo's exact
state in float64.

`summarise` gives the key numbers of one mission: duration, distance, depth, speed and energy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.errors import StoreError
from twin.records.attributes import AXES, N_SAMPLES, OF_MISSIONS, SIMULATED_ATTRIBUTES
from twin.records.coordinates import (
    COORDINATES,
    FLOWN,
    NOMINAL,
    PLACE,
    flown_coordinates,
    nominal_array,
    padded,
    place_arrays,
    sample_variables,
)
from twin.records.schema import MISSION, TIME, VARIABLES, variable
from twin.records.trajectory import INNOVATIONS, Trajectory
from twin.vehicle.consumption import ENERGY

if TYPE_CHECKING:
    import xarray as xr


STATE, STATES = "state", "simulation_state"
COLUMNS = "columns"
"""Attribute of `simulation_state` with the names of the state's columns: qpos, qvel, act, ctrl (x
north, y west, z up; SI, rad, cm3)"""
STATE_ATTRIBUTES = {"units": "1", "long_name": "exact MuJoCo state, for replay and rendering"}


def dataset_of(
    trajectories: Sequence[Trajectory],
    *,
    parameters: Sequence[Mapping[str, float]] | None = None,
    attributes: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Join trajectories to one dataset of the schema, padded with NaN to the longest."""
    import xarray as xr

    longest = max(len(t.time) for t in trajectories)
    provenances = [t.provenance for t in trajectories]
    coordinates: dict[str, Any] = {
        MISSION: (MISSION, np.arange(len(trajectories)), dict(AXES[MISSION])),
        TIME: (TIME, max((t.time for t in trajectories), key=len), dict(AXES[TIME])),
    }
    samples = np.array([len(t.time) for t in trajectories], np.int32)
    variables: dict[str, Any] = {N_SAMPLES: (MISSION, samples, dict(OF_MISSIONS[N_SAMPLES]))}
    variables |= nominal_array(provenances)
    if places := place_arrays(provenances):
        positions = []
        for t in trajectories:  # NaN for a logged trajectory without a track
            unknown = np.full(len(t.time), np.nan)
            north, east = (t.signals.get(f"true_{name}", unknown) for name in ("north", "east"))
            positions.append(flown_coordinates(t.time, north, east, t.provenance))
        found = {n: padded(n, [one[n] for one in positions], longest) for n in COORDINATES}
        coordinates |= sample_variables(found, FLOWN, (MISSION, TIME)) | places
    for name, entry in VARIABLES.items():
        if not any(name in t.signals for t in trajectories):
            continue
        values = np.full((len(trajectories), longest), np.nan, np.float32)
        for i, trajectory in enumerate(trajectories):
            if name in trajectory.signals:
                values[i, : len(trajectory.time)] = trajectory.signals[name]
        variables[name] = ((MISSION, TIME), values, entry.attributes())
    width = _state_width(trajectories)
    states = np.full((len(trajectories), longest, width), np.nan)
    for i, trajectory in enumerate(trajectories):
        states[i, : len(trajectory.time)] = trajectory.states
    about = {**STATE_ATTRIBUTES, COLUMNS: " ".join(trajectories[0].state_columns)}
    variables[STATES] = ((MISSION, TIME, STATE), states, about)
    said = {n: value for n, value in (attributes or {}).items() if n not in (*PLACE, NOMINAL)}
    dataset = xr.Dataset(variables, coordinates, {**SIMULATED_ATTRIBUTES, **said})
    for name in sorted({key for row in parameters or () for key in row}):
        values = np.array([row.get(name, np.nan) for row in parameters or ()])
        dataset[name] = (MISSION, values)
    return dataset


def _state_width(trajectories: Sequence[Trajectory]) -> int:
    """Number of state columns; raises StoreError if the columns of trajectories differ."""
    first = trajectories[0]
    for index, other in enumerate(trajectories):
        alike = other.state_columns == first.state_columns
        if not (alike and other.states.shape[1:] == first.states.shape[1:]):
            raise StoreError(
                f"a store holds the missions of one kind of vehicle: trajectory {index} has the "
                f"parts {', '.join(other.actuators) or 'none'}, trajectory 0 has "
                f"{', '.join(first.actuators) or 'none'}; write a store for each"
            )
    return int(first.states.shape[1])


def stored_columns(one: xr.Dataset) -> tuple[str, ...]:
    """Names of the columns of a dataset's `simulation_state`; empty without states."""
    return tuple(str(one[STATES].attrs.get(COLUMNS, "")).split()) if STATES in one else ()


def signal_names(one: xr.Dataset) -> tuple[str, ...]:
    """Signals of a dataset in the schema's order, with parts in the vehicle's order.

    The order must not depend on the vehicle whose parts this process declared first.
    """
    names = [name for name in VARIABLES if name in one]
    parts = [c.removeprefix("act_") for c in stored_columns(one) if c.startswith("act_")]
    for prefix in ("true", "commanded"):
        ordered = [f"{prefix}_{part}" for part in parts if f"{prefix}_{part}" in names]
        places = sorted(map(names.index, ordered))
        for place, name in zip(places, ordered, strict=True):
            names[place] = name
    return tuple(names)


KILO = 1e3
PLACES = ("north", "east", "depth")
UNDER_WATER_M, UNDER_WAY_M_S = 1.0, 0.05
"""A vehicle flies below UNDER_WATER_M [m] if faster than UNDER_WAY_M_S [m/s]; else it floats."""


def summarise(trajectory: Trajectory) -> dict[str, Any]:
    """Compute the key numbers of a trajectory; each name ends in its unit, parts name theirs.

    The angle of attack counts samples in flight only (UNDER_WATER_M, UNDER_WAY_M_S), else is NaN.
    """
    t = trajectory
    position, v_rel = t.position, t.v_rel
    speed = np.linalg.norm(v_rel, axis=1)
    horizontal = float(np.hypot(*np.diff(position[:, :2], axis=0).T).sum())
    flying = (position[:, 2] > UNDER_WATER_M) & (speed > UNDER_WAY_M_S)
    alpha = np.rad2deg(np.arctan2(v_rel[flying, 2], v_rel[flying, 0]))
    return {
        "ended": str(t.provenance.get("ended", "unknown")),
        "last_segment": int(t["commanded_segment"][-1]),
        "samples": len(t.time),
        "duration_s": float(t.time[-1]),
        "distance_through_water_m": float(t.distance_through_water()[-1]),
        "horizontal_distance_m": horizontal,
        **{f"end_{n}_m": float(x) for n, x in zip(PLACES, position[-1], strict=True)},
        "max_depth_m": float(position[:, 2].max()),
        **_bottom(t),
        "mean_speed_m_s": float(speed.mean()),
        "max_speed_m_s": float(speed.max()),
        "min_pitch_deg": float(t["true_pitch"].min()),
        "max_pitch_deg": float(t["true_pitch"].max()),
        "max_roll_deg": float(np.abs(t["true_roll"]).max()),
        "angle_of_attack_p98_deg": (
            float(np.percentile(np.abs(alpha), 98)) if alpha.size else math.nan
        ),
        "mean_current_north_m_s": float(t["true_current_north"].mean()),
        "mean_current_east_m_s": float(t["true_current_east"].mean()),
        "parts": {
            part: {
                "min": float(t[name].min()),
                "max": float(t[name].max()),
                "units": variable(name).units,
            }
            for part, name in ((part, f"true_{part}") for part in t.actuators)
        },
        **_energy(t, horizontal),
        **_onboard(t),
    }


def _onboard(trajectory: Trajectory) -> dict[str, float]:
    """Errors [m] of the on-board position; empty for a vehicle without on-board navigation.

    `nis` is the mean squared innovation of fixes after dives, normalised by the navigator's
    covariances; 2 means that errors and covariances agree.
    """
    if "measured_onboard_north" not in trajectory:
        return {}
    said = [float(one) for one in trajectory.provenance.get(INNOVATIONS, ())]
    error = np.hypot(
        *(trajectory[f"measured_onboard_{n}"] - trajectory[f"true_{n}"] for n in ("north", "east"))
    )
    return {
        "onboard_error_end_m": float(error[-1]),
        "onboard_error_max_m": float(np.nanmax(error)),
        **({"fixes_after_dives": len(said), "nis": float(np.mean(said))} if said else {}),
    }


def _energy(trajectory: Trajectory, horizontal: float) -> dict[str, Any]:
    """Energy [kJ] of electronics and each part, their total, and energy per km over ground."""
    taken = {
        name.removeprefix(ENERGY): float(values[-1]) / KILO
        for name, values in trajectory.items()
        if name.startswith(ENERGY)
    }
    total = sum(taken.values())
    return {
        "energy_kJ": taken,
        "total_energy_kJ": total,
        "energy_per_km_kJ": total / (horizontal / KILO) if taken and horizontal > 0.0 else math.nan,
    }


def _bottom(t: Trajectory) -> dict[str, Any]:
    """Smallest altitude and first contact, for missions with a sea floor or obstacles."""
    figures: dict[str, Any] = {}
    if "true_altitude" in t:
        figures["min_altitude_m"] = float(t["true_altitude"].min())
    if "true_contact" in t:
        touched = np.flatnonzero(t["true_contact"])
        figures["grounded"] = bool(len(touched))
        figures["first_contact_s"] = float(t.time[touched[0]]) if len(touched) else None
    return figures
