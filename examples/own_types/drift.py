"""Drift: a mission segment in which the current carries the vehicle."""

import dataclasses

from twin.mission import mission_file
from twin.mission.segments import Segment, register
from twin.mission.segments.base import blank_row, command_of


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class Drift(Segment):
    """Neutral, with the battery in the middle: the current carries the vehicle."""

    kind = "drift"

    duration_s: float
    """Time [s]."""

    def __post_init__(self):
        mission_file.limit(self.kind, "duration_s", self.duration_s, "s")

    def row(self, vehicle, label):
        row = blank_row(vehicle)
        row[mission_file.KIND] = mission_file.HOLD
        row[mission_file.DURATION] = self.duration_s
        pump = vehicle.steered_index("buoyancy")
        if pump is not None:
            command_of(vehicle, row, mission_file.REST_COMMAND)[pump] = vehicle.pump_for_net_mass(
                0.0
            )
        return row

    def expected(self, vehicle, depth, label):
        return self.duration_s, depth
