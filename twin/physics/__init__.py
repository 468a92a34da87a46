"""Physics: scenarios flown in MuJoCo or the batched Fossen engine, one or many at once."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.physics.condition import BODY as BODY
    from twin.physics.condition import differs as differs
    from twin.physics.condition import electric_signals as electric_signals
    from twin.physics.condition import healthy as healthy
    from twin.physics.fleet import Fleet as Fleet
    from twin.physics.lanes import Lane as Lane
    from twin.physics.lanes import flown_abreast as flown_abreast
    from twin.physics.lanes import fly_in_lanes as fly_in_lanes
    from twin.physics.model_block import floor_table as floor_table
    from twin.physics.mujoco_model import quiet_mujoco as quiet_mujoco
    from twin.physics.start import parse_place as parse_place
    from twin.physics.start import utc_text as utc_text
    from twin.physics.stiffness import file_timestep as file_timestep
    from twin.physics.stiffness import stiffness_of as stiffness_of
    from twin.physics.true_signals import ENGINES as ENGINES
    from twin.physics.true_signals import declare_parts as declare_parts

__getattr__, __dir__ = attach(__name__, places(__name__))
