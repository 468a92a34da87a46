"""Schema: the names, units and meanings of every variable that a store of missions holds.

Three groups are told apart by prefix and by the attribute `signal_group`: `true_*` is what
happened, `measured_*` what the sensors said, `commanded_*` what was asked for. Angles are degrees
in stores, radians in code.
"""

from twin.records.schema.base import Variable
from twin.records.schema.declared import (
    MISSION,
    SCHEMA_VERSION,
    SIMULATED,
    TIME,
    VARIABLES,
    declare,
    declare_stored,
    variable,
    variables,
)
from twin.records.schema.signals import HYDROGRAPHY, LOGGED_ONLY, SIGNALS, WITH_FLOOR

__all__ = [
    "HYDROGRAPHY",
    "LOGGED_ONLY",
    "MISSION",
    "SCHEMA_VERSION",
    "SIGNALS",
    "SIMULATED",
    "TIME",
    "VARIABLES",
    "WITH_FLOOR",
    "Variable",
    "declare",
    "declare_stored",
    "variable",
    "variables",
]
