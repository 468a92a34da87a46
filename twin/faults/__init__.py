"""Faults of a vehicle, each a function of time (an extension point).

    twin.Scenario(mission=mission, faults=twin.parse_faults("wing_lost:side=port,from=2h"))

`twin health` finds faults in logs.
"""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.faults.base import DAY as DAY
    from twin.faults.base import FAULTS as FAULTS
    from twin.faults.base import Condition as Condition
    from twin.faults.base import Fault as Fault
    from twin.faults.base import check_fits as check_fits
    from twin.faults.base import condition_at as condition_at
    from twin.faults.base import conditions as conditions
    from twin.faults.base import fault_from_dict as fault_from_dict
    from twin.faults.base import faults_of as faults_of
    from twin.faults.base import parse_faults as parse_faults
    from twin.faults.base import read_by as read_by
    from twin.faults.base import register as register

__getattr__, __dir__ = attach(__name__, places(__name__))
