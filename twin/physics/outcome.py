"""Outcome: how a simulation ended, and its log as a trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from twin.errors import SimulationUnstable
from twin.mission import Mission, guidance
from twin.physics.log_signals import from_log
from twin.physics.mujoco_model import parameter_block
from twin.physics.native import block as b
from twin.records.trajectory import Trajectory

if TYPE_CHECKING:
    from twin.physics.simulation import Simulation

Array = NDArray[np.float64]

_MUST_BE_FINITE = np.r_[: b.R_PITCH_SETPOINT, b.R_ACCELERATION : b.ROW]
"""Log columns that are never NaN in a sound run; setpoints are NaN where a segment has none."""


def collect(simulation: Simulation, userdata: Array, mission: int | None = None) -> Trajectory:
    """Read a simulation's log, given its `userdata` row.

    Args:
      simulation: what was stepped.
      userdata: its state beside MuJoCo's, shape (model.nuserdata,); a fleet keeps it elsewhere.
      mission: index that an error names beside the mission's name.

    Raises:
      SimulationUnstable: the run went unstable; `partial` holds the finite samples.
    """
    scenario = simulation.scenario
    rows = simulation.rows[: int(userdata[b.U_LOGGED])]
    finite = np.isfinite(rows[:, _MUST_BE_FINITE]).all(axis=1)
    failed = bool(userdata[b.U_FAILED]) or not finite.all()
    if failed:
        rows = rows[: int(np.argmin(finite))] if not finite.all() else rows
    centred = parameter_block(simulation.model)[b.P_CENTRED]
    timestep = simulation.model.opt.timestep
    trajectory = from_log(
        rows,
        scenario.vehicle,
        half_step=0.5 * centred * timestep,
        sample_period=scenario.sample_period,
        complete=not failed,
        provenance={"ended": _ending(simulation, userdata, failed)},
    )
    if failed:
        time = float(userdata[b.U_FAIL_TIME])
        raise SimulationUnstable(
            f"{_label(simulation, mission)} went unstable at {time:.1f} s (vehicle "
            f"{scenario.vehicle.name!r}, hydrodynamics {scenario.hydrodynamics}, timestep "
            f"{timestep:g} s); try a smaller timestep or check the parameters",
            mission=mission or 0,
            time_s=time,
            partial=trajectory,
        )
    return trajectory


def _ending(simulation: Simulation, userdata: Array, failed: bool) -> str:
    """How a run ended: unstable, aborted, flown, or at its duration or time limit."""
    if failed:
        return "unstable"
    if not isinstance(simulation.scenario.plan, Mission):
        return "duration"
    if userdata[b.U_GUIDANCE + guidance.ABORTED]:
        return "aborted"
    if userdata[b.U_GUIDANCE + guidance.DONE]:
        return "flown"
    return "time limit" if simulation.scenario.open_ended else "duration"


def _label(simulation: Simulation, mission: int | None) -> str:
    """What an error calls a run: its mission's name, its index among others, or both."""
    plan = simulation.scenario.plan
    name = repr(plan.name) if isinstance(plan, Mission) else ""
    if mission is None:
        return f"mission {name}" if name else "the run"
    return f"mission {mission} ({name})" if name else f"mission {mission}"
