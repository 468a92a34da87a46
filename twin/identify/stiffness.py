"""Stiffness: the physics step that a vehicle's yaw damping allows.

The damping of a rate about its own axis is taken implicitly and is stable at any step. At an angle
of attack the yaw damping, which is identified in flow axes, also rolls the hull; that part is
explicit, and the hull's small roll inertia bounds the step that holds it.
"""

from __future__ import annotations

import re

from twin.vehicle.vehicle import Vehicle

FASTEST = 0.55
"""[m/s] of a steep start"""
ANGLE = 0.2
"""[rad] of attack at an inflection"""
MOST = 1.5
"""Of the roll rate that a yaw rate may raise in one step: at 1.6 a Seaglider's twin is stable, at 3
it is not."""
MUJOCO_STEP = 0.002
"""[s] MuJoCo's default"""
STEPS = (0.02, 0.01, 0.005, 0.002)
"""[s] that are taken in place of a file's own"""


def file_step(vehicle: Vehicle) -> float:
    """[s] `<option timestep>` of the vehicle's file, MuJoCo's own where it has none."""
    found = re.search(r'<option\b[^>]*\btimestep="([^"]+)"', vehicle.xml)
    return MUJOCO_STEP if found is None else float(found.group(1))


def largest_step(vehicle: Vehicle) -> float:
    """[s] physics step: the file's own where the vehicle's yaw damping allows it, else shorter."""
    own = file_step(vehicle)
    damping = abs(vehicle.flow_frame.yaw_moment[1]) * FASTEST**2 * ANGLE
    inertia = float(vehicle.static_inertia[0, 0] + vehicle.added_mass[3, 3])
    allowed = MOST * inertia / damping if damping > 0.0 else own
    if own <= allowed:
        return own
    return next((step for step in STEPS if step <= min(allowed, own)), STEPS[-1])
