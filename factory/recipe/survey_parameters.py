"""Survey parameters: what is drawn for vehicles that a propeller drives.

They fly in shallow water above an uneven sea floor: dives and climbs, transects, circles and
lawn-mowers, in still water (preset `paper`) or in currents (preset `field`).
"""

from __future__ import annotations

import dataclasses

from factory.recipe.kinds import MISSION_KINDS, kinds_for
from factory.recipe.kinds.base import survey_row
from factory.recipe.kinds.level import SHALLOWEST_FLOOR_M
from factory.recipe.parameter import Parameter
from twin.vehicle.vehicle import Vehicle

WEIGHTS = {"saw-tooth": 6, "transect": 2, "circle": 1, "lawn-mower": 1, "spiral": 1}
"""Of the kinds of segments, as far as the vehicle flies them"""

REPLACED = {
    "mission.segment_duration_s": (
        "uniform(600, 1800)", "uniform(900, 2700)",
        "time limit of the segment", "of dives and climbs and of a transect",
    ),
    "mission.yos": ("none", "none", "number of dives in the segment", "surveys go by the clock"),
    "mission.max_depth_m": (
        "loguniform(25, 110)", "loguniform(25, 110)",
        "lower turning depth", "unless the sea floor comes nearer than min_altitude_m",
    ),
    "mission.min_depth_m": (
        "uniform(3, 8)", "uniform(3, 8)", "upper turning depth", "below the overshoot",
    ),
    "mission.pitch_deg": (
        "uniform(8, 20)", "uniform(8, 20)", "pitch magnitude of the dive",
        "as in the LRAUV's yo-yos",
    ),
    "mission.climb_pitch_deg": (
        "uniform(8, 20)", "uniform(8, 20)", "pitch magnitude of the climb",
        "the range that gliders use",
    ),
    "current.speed": (
        "0", "uniform(0, 0.3)",
        "largest speed of the current",
        "sum of all amplitudes; preset paper is still water, where bottom and water track agree",
    ),
}  # fmt: skip
"""Distributions, names and reasons in place of a glider's, by name"""

_MIN_ALTITUDE = survey_row(
    "min_altitude_m", "m", "uniform(5, 8)", "uniform(5, 8)",
    "least height above the sea floor", "dives turn, and level segments rise, this far above it",
)  # fmt: skip

FLOOR: tuple[Parameter, ...] = (
    Parameter("floor.depth_m", "m", "uniform(40, 100)", "uniform(35, 110)",
              "mean depth of the sea floor at launch",
              f"it is cut off at {SHALLOWEST_FLOOR_M:g} and 130 m"),
    Parameter("floor.slope", "1", "uniform(0, 0.004)", "uniform(0, 0.008)",
              "mean slope of the sea floor", "continental shelves have about 0.002"),
    Parameter("floor.slope_direction_deg", "degree", "uniform(0, 360)", "uniform(0, 360)",
              "direction of the sea floor's slope", "toward which it gets deeper"),
    Parameter("floor.roughness_m", "m", "loguniform(0.5, 4)", "loguniform(0.5, 6)",
              "standard deviation of the sea floor's relief"),
    Parameter("floor.correlation_m", "m", "loguniform(200, 1000)", "loguniform(200, 1000)",
              "correlation length of the sea floor's relief"),
    Parameter("floor.seed", "1", "uniform(0, 2147483647)", "uniform(0, 2147483647)",
              "seed of the sea floor's relief", "rounded down"),
)  # fmt: skip
"""In place of `water.bottom_below_m`"""


def survey_rows(vehicle: Vehicle) -> list[Parameter]:
    """Rows of segments that the vehicle's kinds bring beside those of all vehicles."""
    brought = (row for name in kinds_for(vehicle) for row in MISSION_KINDS[name].rows(vehicle))
    return [*{row.name: row for row in (_MIN_ALTITUDE, *brought)}.values()]


def as_survey(row: Parameter, vehicle: Vehicle) -> Parameter:
    """A row of the table of all vehicles as surveys draw it."""
    if row.name == "mission.kind":
        weights = {kind: WEIGHTS[kind] for kind in kinds_for(vehicle) if kind in WEIGHTS}
        if len(weights) == 1:
            return row
        text = f"choice({', '.join(f'{kind}: {weight}' for kind, weight in weights.items())})"
        why = "the paper's first study is of dives and climbs on a heading"
        return dataclasses.replace(row, paper=text, field=text, why=why)
    if row.name not in REPLACED:
        return row
    paper, field, long_name, why = REPLACED[row.name]
    return dataclasses.replace(row, paper=paper, field=field, long_name=long_name, why=why)
