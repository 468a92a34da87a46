"""Schema: the names, units and meanings of every variable that a store of missions holds.

Three groups are told apart by prefix and by the attribute `signal_group`: `true_*` is what
happened, `measured_*` what the sensors said, `commanded_*` what was asked for. Angles are degrees
in stores, radians in code.
"""

from twin.records.schema.declared import HYDROGRAPHY as HYDROGRAPHY
from twin.records.schema.declared import LOGGED_ONLY as LOGGED_ONLY
from twin.records.schema.declared import MISSION as MISSION
from twin.records.schema.declared import SCHEMA_VERSION as SCHEMA_VERSION
from twin.records.schema.declared import SIGNALS as SIGNALS
from twin.records.schema.declared import SIMULATED as SIMULATED
from twin.records.schema.declared import TIME as TIME
from twin.records.schema.declared import VARIABLES as VARIABLES
from twin.records.schema.declared import WITH_FLOOR as WITH_FLOOR
from twin.records.schema.declared import Variable as Variable
from twin.records.schema.declared import declare as declare
from twin.records.schema.declared import declare_stored as declare_stored
from twin.records.schema.declared import variable as variable
from twin.records.schema.declared import variables as variables
