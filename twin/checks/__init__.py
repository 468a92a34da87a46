"""Checks: the twin against the Fossen model and published numbers, its energy, and its cost."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.checks.agreement import ATTITUDE_LIMIT as ATTITUDE_LIMIT
    from twin.checks.agreement import DURATION as DURATION
    from twin.checks.agreement import POSITION_LIMIT as POSITION_LIMIT
    from twin.checks.agreement import SPEED_LIMIT as SPEED_LIMIT
    from twin.checks.agreement import EndsApart as EndsApart
    from twin.checks.agreement import ends_apart as ends_apart
    from twin.checks.agreement import flown_in_mujoco as flown_in_mujoco
    from twin.checks.agreement import state_at as state_at
    from twin.checks.engines import FINER as FINER
    from twin.checks.engines import WITHIN as WITHIN
    from twin.checks.engines import check_engines as check_engines
    from twin.checks.passivity import LARGEST_GAIN as LARGEST_GAIN
    from twin.checks.passivity import check_still_water as check_still_water
    from twin.checks.published import ANGLES as ANGLES
    from twin.checks.step_cost import bench as bench
    from twin.checks.step_cost import bench_lanes as bench_lanes

__getattr__, __dir__ = attach(__name__, places(__name__))
