"""Summary: the figures of one mission that a pilot looks at first."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from twin.records.schema import variable
from twin.records.trajectory import Trajectory
from twin.vehicle.consumption import ENERGY

KILO = 1e3
UNDER_WATER_M, UNDER_WAY_M_S = 1.0, 0.05
"""Depth and speed above which a vehicle flies: at the surface it lies in the water as it floats"""


def summarise(trajectory: Trajectory) -> dict[str, Any]:
    """Figures of a trajectory: SI units and degrees, as the names say; parts in stored units.

    The angle of attack is that under way under water, NaN where it never was.
    """
    t = trajectory
    position, v_rel = t.position, t.v_rel
    speed = np.linalg.norm(v_rel, axis=1)
    horizontal = np.hypot(*np.diff(position[:, :2], axis=0).T).sum()
    flying = (position[:, 2] > UNDER_WATER_M) & (speed > UNDER_WAY_M_S)
    alpha = np.rad2deg(np.arctan2(v_rel[flying, 2], v_rel[flying, 0]))
    return {
        "ended": str(t.provenance.get("ended", "unknown")),
        "last_segment": int(t["commanded_segment"][-1]),
        "samples": len(t.time),
        "duration_s": float(t.time[-1]),
        "distance_through_water_m": float(t.distance_through_water()[-1]),
        "horizontal_distance_m": float(horizontal),
        "end_north_m": float(position[-1, 0]),
        "end_east_m": float(position[-1, 1]),
        "end_depth_m": float(position[-1, 2]),
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
                "min": float(t[f"true_{part}"].min()),
                "max": float(t[f"true_{part}"].max()),
                "units": variable(f"true_{part}").units,
            }
            for part in t.actuators
        },
        **_energy(t, float(horizontal)),
        **_onboard(t),
    }


def _onboard(trajectory: Trajectory) -> dict[str, float]:
    """How far the on-board position was off [m], where a vehicle reckoned one."""
    if "measured_onboard_north" not in trajectory:
        return {}
    error = np.hypot(
        *(trajectory[f"measured_onboard_{n}"] - trajectory[f"true_{n}"] for n in ("north", "east"))
    )
    return {
        "onboard_error_end_m": float(error[-1]),
        "onboard_error_max_m": float(np.nanmax(error)),
    }


def _energy(trajectory: Trajectory, horizontal: float) -> dict[str, Any]:
    """Energy of the electronics and of each part, in all, and per way over ground; NaN without."""
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
    """Of missions with a sea floor or obstacles: how near it came, and whether it touched."""
    figures: dict[str, Any] = {}
    if "true_altitude" in t:
        figures["min_altitude_m"] = float(t["true_altitude"].min())
    if "true_contact" in t:
        touched = np.flatnonzero(t["true_contact"])
        figures["grounded"] = bool(len(touched))
        figures["first_contact_s"] = float(t.time[touched[0]]) if len(touched) else None
    return figures
