"""Physics: scenarios flown in MuJoCo, one or many."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.physics.lookup_tables import floor_table as floor_table
    from twin.physics.scenario import ENGINES as ENGINES
    from twin.physics.start import parse_place as parse_place
    from twin.physics.start import utc_text as utc_text
    from twin.physics.true_signals import declare_parts as declare_parts

__getattr__, __dir__ = attach(__name__, places(__name__))
