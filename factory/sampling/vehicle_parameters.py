"""Vehicle parameters: the rows of the table that a vehicle's law, hull and parts bring.

What drives and turns the vehicle says which of a mission's values are drawn; coefficients, encoder
zeros, lags and rates are what guidance does not know.

Survey parameters: what is drawn for vehicles that a propeller drives.
"""

from __future__ import annotations

import dataclasses

from factory.sampling.distribution import Parameter
from factory.sampling.mission_kind import propelled, survey_row
from factory.sampling.profiles import MISSION_KINDS, kinds_for
from factory.sampling.surveys import SHALLOWEST_FLOOR_M
from twin.vehicle.changes import Uncertainty, coefficient
from twin.vehicle.vehicle import Vehicle

NET_MASS = {"paper": (0.3, 0.9), "field": (0.5, 0.9)}
"""Share of the pump's reach that dives and climbs draw when the vehicle file does not say"""
ROTATION = {"paper": 0.75, "field": 0.65}
"""Share of the travel of what turns the vehicle, likewise"""
STRAIGHT = 0.1
"""Share of that range about the middle that makes no spiral"""
SPEED = (0.8, 1.1)
"""Share of a propelled vehicle's cruising speed, likewise"""

ADDED_MASS = {
    "surge": ("added mass (1,1)", (0, 0)),
    "sway": ("added mass (2,2)", (1, 1)),
    "heave": ("added mass (3,3)", (2, 2)),
    "roll": ("added inertia (4,4)", (3, 3)),
    "pitch": ("added inertia (5,5)", (4, 4)),
    "yaw": ("added inertia (6,6)", (5, 5)),
    "sway_yaw": ("added coupling (2,6)", (1, 5)),
    "heave_pitch": ("added coupling (3,5)", (2, 4)),
}
"""Meaning and cell of each coefficient of the added-mass matrix that is drawn"""


def motion_rows(vehicle: Vehicle) -> list[Parameter]:
    """What segments draw of weight, speed and turns, as far as the vehicle has parts for them."""
    rows: list[Parameter] = []
    pump, turning = vehicle.steered("buoyancy"), vehicle.steered("heading")
    if pump is not None and not propelled(vehicle):  # which is neutral while its propeller turns
        for name, end, long_name, why in (
            (
                "net_mass_kg",
                pump.low,
                "net mass of the dive",
                "positive heavy; it sets the pumped volume",
            ),
            (
                "climb_net_mass_kg",
                pump.high,
                "net mass of the climb",
                "magnitude, light; it sets the pumped volume",
            ),
        ):
            reach = abs(vehicle.net_mass_for_pump(end))
            paper, field = (_uniform(low * reach, high * reach) for low, high in NET_MASS.values())
            rows.append(_segment(name, "kg", paper, field, long_name, why))
    if propelled(vehicle):
        speed = _uniform(*(share * vehicle.cruise_speed for share in SPEED))
        why = "the propeller turns as fast as that takes"
        rows.append(_segment("speed_m_s", "m s-1", speed, speed, "speed through the water", why))
    if turning is not None:
        travel = turning.quantity.scale * min(-turning.low, turning.high)
        paper, field = (
            f"{_uniform(-share * travel, share * travel)} "
            f"except ({-STRAIGHT * share * travel:.4g}, {STRAIGHT * share * travel:.4g})"
            for share in ROTATION.values()
        )
        rows.append(
            _segment("heading_change_deg", "degree", "uniform(-180, 180)", "uniform(-120, 120)",
                     "change of heading", "of a saw-tooth, from the heading before")
        )  # fmt: skip
        rows.append(
            _segment("rotation_deg", "degree", paper, field,
                     f"{turning.name} of a spiral", "about 0 it is no spiral")
        )  # fmt: skip
    return rows


def _segment(name: str, unit: str, paper: str, field: str, long_name: str, why: str) -> Parameter:
    return Parameter(f"mission.{name}", unit, paper, field, long_name, why, per_segment=True)


def _uniform(low: float, high: float) -> str:
    return f"uniform({low:.4g}, {high:.4g})"


def vehicle_rows(vehicle: Vehicle) -> list[Parameter]:
    """What the guidance does not know: law, added mass, encoders, hull, then the parts' fields."""
    named = [(f"{part.name}_", u) for part in vehicle.parts for u in part.uncertainties()]
    fields = list(dict.fromkeys(u.field for _, u in named if u.field is not None))
    return [
        *(_row("", u) for u in vehicle.law.uncertainties()),
        *(_row("", coefficient(f"added_mass_{n}", what)) for n, (what, _) in ADDED_MASS.items()),
        *(_row(prefix, u) for prefix, u in named if u.field is None),
        *_hull_rows(vehicle),
        *(_row(prefix, u) for field in fields for prefix, u in named if u.field == field),
    ]


def _row(prefix: str, uncertain: Uncertainty) -> Parameter:
    return Parameter(
        f"vehicle.{prefix}{uncertain.name}",
        uncertain.unit,
        f"{uncertain.certain:g}",
        uncertain.spread,
        uncertain.long_name,
        uncertain.why,
    )


def _hull_rows(vehicle: Vehicle) -> list[Parameter]:
    spread, why = "uniform(3e-10, 7e-10)", "5e-10 is typical"
    if vehicle.hull_compressibility:
        why = f"beyond the file's {vehicle.hull_compressibility:g}; +-5e-11 is what logs tell apart"
        spread = "uniform(-5e-11, 5e-11)"
    height = 1e3 * vehicle.static_cg[2]
    rows = [
        Parameter("vehicle.cg_y_mm", "mm", "0", "uniform(-0.05, 0.05)",
                  "offset of the centre of gravity to starboard",
                  "of the fixed block; 0.05 mm lists the Sea-Wing by 0.5 deg"),
        Parameter("vehicle.cg_z_mm", "mm", "0", "uniform(-0.3, 0.3)",
                  "offset of the centre of gravity downward",
                  f"of the fixed block, beyond the {height:.2g} mm of the file"),
        Parameter("vehicle.compressibility", "Pa-1", "0", spread, "compressibility of the hull",
                  f"part of the volume lost per pressure: {why}; sea water has 4.4e-10"),
    ]  # fmt: skip
    if vehicle.steered("buoyancy") is not None:
        why = "too heavy is positive, at the density that it was ballasted for"
        ballast = ("vehicle.ballast_g", "g", "0", "uniform(-20, 20)")
        rows.insert(0, Parameter(*ballast, "ballasting error", why))
    return rows


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
