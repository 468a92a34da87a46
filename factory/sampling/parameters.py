"""Parameters: everything that the factory draws for a mission, with unit, spread and reason.

This is the one table of distributions. A row gives the parameter's name, its unit, what preset
`paper` and preset `field` draw it from, and why. The rows below depend on no vehicle; those that
do are in `factory.sampling.vehicle_parameters`, those of vehicles with a propeller in
`factory.sampling.vehicle_parameters` and with the kinds of segments, and a vehicle file may replace
what any row draws for it. `--set NAME=DISTRIBUTION` and TOML files replace entries by name; stores
keep the table that was used, and every drawn value under the name with an underscore for the dot.

Rows of the group `mission` that are marked per segment are drawn for every segment of a mission.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from factory.sampling.distribution import Distribution, Parameter, parse_distribution
from factory.sampling.mission_kind import propelled
from factory.sampling.vehicle_parameters import (
    FLOOR,
    as_survey,
    motion_rows,
    survey_rows,
    vehicle_rows,
)
from twin.errors import InputError, VehicleError, nearest, unknown_name
from twin.vehicle.vehicle import SPREAD, Vehicle

FLOWN_BY_TEST_LEVEL = "(28, 32)"
"""Exclusion zone of preset paper: its training missions never command the pitch of the wings-level
part of preset paper-test (30 deg). The rotations of its two spirals (40 and -30 deg) are excluded
in the files of the gliders that fly it."""

Table = Mapping[str, Parameter]
"""Rows by name, in their order."""

_MISSION: tuple[Parameter, ...] = (
    Parameter("mission.duration_h", "h", "uniform(0.5, 1)", "uniform(1, 3)",
              "length of the mission", "field missions hold several dives between GPS fixes"),
    Parameter("mission.start_heading_deg", "degree", "uniform(0, 360)", "uniform(0, 360)",
              "heading at launch", "the vehicle starts at rest in the water"),
    Parameter("mission.start_depth_m", "m", "0", "0",
              "depth at launch",
              "at the surface, so that every mission begins with surge from rest"),
    Parameter("mission.surface_every", "1", "none", "1",
              "number of dives between stays at the surface",
              "stays are for GPS fixes; none: never surfaces"),
    Parameter("mission.start_day", "d", "0", "uniform(0, 366)",
              "day of the start",
              "days since the beginning of 2020, UTC; any day of that year, for the coordinates "
              "only"),
    # SEGMENT: drawn for every segment
    Parameter("mission.kind", "1", "choice(saw-tooth, spiral)", "choice(saw-tooth: 2, spiral: 1)",
              "kind of the segment",
              "the paper combines wings-level and spiral motion; field work is mostly transects",
              per_segment=True),
    Parameter("mission.segment_duration_s", "s", "uniform(600, 1800)", "none",
              "time limit of the segment", "one to three of them in a mission", per_segment=True),
    Parameter("mission.yos", "1", "none", "choice(1, 2)",
              "number of dives in the segment",
              "each with its climb; field gliders surface after one or a few",
              per_segment=True),
    Parameter("mission.max_depth_m", "m", "loguniform(40, 500)", "uniform(60, 300)",
              "lower turning depth", "paper: logarithmic, so that inflections are frequent",
              per_segment=True),
    Parameter("mission.min_depth_m", "m", "uniform(5, 25)", "uniform(5, 25)",
              "upper turning depth", "below the overshoot of an inflection", per_segment=True),
    Parameter("mission.pitch_deg", "degree", f"uniform(15, 45) except {FLOWN_BY_TEST_LEVEL}",
              "uniform(18, 42)", "pitch magnitude of the dive", "the range that gliders use",
              per_segment=True),
    Parameter("mission.climb_pitch_deg", "degree", f"uniform(15, 45) except {FLOWN_BY_TEST_LEVEL}",
              "uniform(18, 42)", "pitch magnitude of the climb", "the range that gliders use",
              per_segment=True),
    Parameter("mission.surface_duration_s", "s", "none", "uniform(180, 600)",
              "length of the stay at the surface", "a first fix takes 30 to 120 s",
              per_segment=True),
)  # fmt: skip
_LEVEL = Parameter("mission.kind", "1", "saw-tooth", "saw-tooth",
                   "kind of the segment", "nothing turns the vehicle: it cannot spiral",
                   per_segment=True)  # fmt: skip
"""In place of the row of that name"""
_MOTION = len(_MISSION) - 1
"""Place of the rows that depend on how the vehicle moves: before the stay at the surface"""

_WATER: tuple[Parameter, ...] = (
    # --- current: its speed is shared out by the weights, so that it never exceeds the speed ----
    Parameter("current.speed", "m s-1", "uniform(0, 0.3)", "uniform(0, 0.3)",
              "largest speed of the current",
              "sum of all amplitudes; mid-latitude rms is 0.14 m/s at the surface, 0.3 is strong"),
    Parameter("current.steady", "1", "1", "uniform(0, 1)", "weight of the steady current",
              "the part without structure"),
    Parameter("current.steady_direction_deg", "degree", "uniform(0, 360)", "uniform(0, 360)",
              "direction of the steady current",
              "toward which it flows"),
    Parameter("current.shear", "1", "0", "uniform(0, 1)",
              "weight of the sheared current", "the geostrophic part, which decays with depth"),
    Parameter("current.shear_direction_deg", "degree", "0", "uniform(0, 360)",
              "direction of the sheared current",
              "toward which it flows"),
    Parameter("current.shear_scale_m", "m", "200", "loguniform(50, 800)",
              "decay depth of the sheared current",
              "300 to 1000 m in the open ocean, less on shelves"),
    Parameter("current.tide", "1", "0", "uniform(0, 1)", "weight of the barotropic tide"),
    Parameter("current.tide_constituent", "1", "M2", "choice(M2: 3, S2: 1, K1: 2, O1: 1)",
              "constituent of the tide", "it sets the period; weights follow usual amplitudes"),
    Parameter("current.tide_direction_deg", "degree", "0", "uniform(0, 360)",
              "direction of the tidal ellipse's major axis"),
    Parameter("current.tide_ratio", "1", "0", "uniform(-0.6, 0.6)",
              "axis ratio of the tidal ellipse",
              "minor over major; positive turns counterclockwise"),
    Parameter("current.tide_phase_deg", "degree", "0", "uniform(0, 360)",
              "phase of the tide at launch"),
    Parameter("current.inertial", "1", "0", "uniform(0, 1)",
              "weight of the near-inertial oscillation", "of the mixed layer"),
    Parameter("current.inertial_direction_deg", "degree", "0", "uniform(0, 360)",
              "direction of the near-inertial current at launch"),
    Parameter("current.inertial_layer_m", "m", "40", "uniform(20, 80)", "depth of the mixed layer"),
    Parameter("current.ekman", "1", "0", "uniform(0, 0.5)",
              "weight of the Ekman spiral", "driven by wind; thin, so it gets less"),
    Parameter("current.ekman_direction_deg", "degree", "0", "uniform(0, 360)",
              "direction of the wind", "toward which it blows"),
    Parameter("current.ekman_depth_m", "m", "25", "uniform(12, 40)",
              "e-folding depth of the Ekman spiral"),
    Parameter("current.bottom", "1", "0", "uniform(0, 0.5)",
              "weight of the bottom boundary layer", "where there is a bottom"),
    Parameter("current.bottom_direction_deg", "degree", "0", "uniform(0, 360)",
              "direction of the bottom boundary layer",
              "toward which it flows"),
    Parameter("current.bottom_layer_m", "m", "20", "uniform(20, 100)",
              "height of the bottom boundary layer", "logarithmic below and constant above"),
    Parameter("current.wander", "1", "0", "uniform(0, 0.5)",
              "weight of the wandering current",
              "a Gauss-Markov process: submesoscale change over the mission"),
    Parameter("current.wander_direction_deg", "degree", "0", "uniform(0, 360)",
              "mean direction of the wandering current"),
    Parameter("current.wander_time_h", "h", "3", "uniform(1, 6)",
              "correlation time of the wandering current"),
    Parameter("current.wander_seed", "1", "0", "uniform(0, 2147483647)",
              "seed of the wandering current",
              "rounded down"),
    # --- water ---------------------------------------------------------------------------------
    Parameter("water.stratified", "1", "0", "1",
              "stratification of the water",
              "1: density by TEOS-10 from a thermocline; 0: the constant reference density"),
    Parameter("water.surface_temperature", "degC", "16", "uniform(8, 22)",
              "temperature of the mixed layer"),
    Parameter("water.deep_temperature", "degC", "4", "uniform(3, 7)",
              "temperature below the thermocline"),
    Parameter("water.surface_salinity", "1", "33.4", "uniform(33, 35)",
              "practical salinity of the mixed layer"),
    Parameter("water.salinity_increase", "1", "1", "uniform(0, 0.8)",
              "increase of practical salinity with depth",
              "deep minus surface; positive keeps the column stable"),
    Parameter("water.mixed_layer_m", "m", "30", "uniform(10, 60)", "depth of the mixed layer"),
    Parameter("water.thermocline_m", "m", "200", "uniform(60, 250)",
              "decay depth of the thermocline", "below the mixed layer"),
    Parameter("water.latitude", "degree_north", "36.8", "uniform(20, 65)",
              "latitude of the mission",
              "for gravity at the pressure gauge, inertial period, Ekman turning and coordinates"),
    Parameter("water.longitude", "degree_east", "-122.4", "uniform(-38, -32)",
              "longitude of the mission",
              "for coordinates; with any latitude from 20 to 65 it is the open Atlantic, without "
              "land; "
              "paper: off Monterey Bay, in deep water"),
    Parameter("water.bottom_below_m", "m", "none", "loguniform(20, 2000)",
              "depth of the bottom below the deepest turning depth", "the DVL sees 110 m"),
)  # fmt: skip


ADDED: Mapping[str, str] = {"water.longitude": "-121.8", "mission.start_day": "0"}
"""What parameters were, in effect, in stores that were made before they existed"""


def parameter_table(vehicle: Vehicle) -> dict[str, Parameter]:
    """Every parameter of missions of a vehicle, with what its file says they are drawn from.

    Raises:
      VehicleError: the file's `spread.` names no parameter of the vehicle, or no distributions.
    """
    mission = list(_MISSION)
    if vehicle.steered("heading") is None:
        mission = [_LEVEL if row.name == _LEVEL.name else row for row in mission]
    water = list(_WATER)
    moving = motion_rows(vehicle)
    if propelled(vehicle):
        mission = [as_survey(row, vehicle) for row in mission]
        moving += survey_rows(vehicle)
        water = [as_survey(row, vehicle) for row in water if row.name != BOTTOM] + [*FLOOR]
    mission[_MOTION:_MOTION] = moving
    rows = {row.name: row for row in (*mission, *vehicle_rows(vehicle), *water)}
    for name, text in vehicle.spreads.items():
        where = f"vehicle file {vehicle.path}: <text name={SPREAD + name!r}>"
        if name not in rows:
            raise VehicleError(f"{where}: {unknown_name('parameter', name, rows)}")
        columns = [column.strip() for column in text.split(";")]
        if len(columns) != len(SPREADS):
            raise VehicleError(
                f"{where}: data={text!r} must be what preset paper and what preset field draw, "
                "such as 'uniform(0.1, 0.2); uniform(0.1, 0.3)'"
            )
        try:
            for column in columns:
                parse_distribution(column, name)
        except InputError as error:
            raise VehicleError(f"{where}: {error}") from error
        rows[name] = dataclasses.replace(rows[name], paper=columns[0], field=columns[1])
    return rows


SPREADS = ("paper", "field")
BOTTOM = "water.bottom_below_m"
"""Of missions in open water; surveys have a sea floor"""


def declared(spread: str, table: Table) -> dict[str, Distribution]:
    """The table's distributions of one column: "paper" or "field"."""
    return {p.name: parse_distribution(getattr(p, spread), p.name) for p in table.values()}


def override(
    distributions: Mapping[str, Distribution], changes: Mapping[str, str | float]
) -> dict[str, Distribution]:
    """The distributions with some replaced.

    Raises:
      InputError: a name that the table does not have (the nearest is offered), or a bad text.
    """
    result = dict(distributions)
    for name, text in changes.items():
        if name not in distributions:
            near = nearest(name, distributions, close=0.5)
            hint = f": did you mean {near!r}?" if near else ""
            raise InputError(
                f"unknown parameter {name!r}{hint} (`factory distributions` lists them all)"
            )
        result[name] = parse_distribution(text, name)
    return result
