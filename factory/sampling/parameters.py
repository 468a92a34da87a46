"""Parameters: table of all random parameters of a mission, with unit, distributions and reason.

`parameters.csv` has the rows that are the same for all vehicle files. This module adds the rows for
a vehicle's law, hull and parts. A vehicle file may replace the distributions of any row. A row has
the parameter's name, unit, its distributions in presets `paper` and `field`, and the reason. Column
`per` marks parameters that are sampled for every segment. Column `of` selects vehicles:

  (empty)    all vehicles
  unturned   vehicles without a part that turns them; replaces the common row of that name
  propelled  vehicles with a propeller, which survey above a sea floor; replaces or adds a row
  level      propelled vehicles that also keep level; adds a row
  posed      ROVs, which thrusters hold in any pose; replaces or adds a row

Preset paper never samples a pitch of 30 deg, nor rotations of 40 and -30 deg, because the mission
of preset paper-test has these. `--set NAME=DISTRIBUTION` and TOML files replace distributions by
name; stores keep the table that was used.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Mapping
from pathlib import Path

from factory.sampling.distribution import Distribution, Parameter, parse_distribution
from factory.sampling.mission_kinds import DEPTHS, keeps_level, kinds_for, propelled
from twin.errors import InputError, VehicleError, nearest, unknown_name
from twin.vehicle.changes import Uncertainty, coefficient
from twin.vehicle.vehicle import SPREAD, Vehicle

Table = Mapping[str, Parameter]
"""Parameters by name, in the order of the table"""
SPREADS = ("paper", "field")
FLOOR_DEPTH = "floor.depth_m"
"""Parameter of surveys only, whose missions have a sea floor"""
BOTTOM = "water.bottom_below_m"
"""Parameter of missions in open water only"""
ADDED: Mapping[str, str] = {"water.longitude": "-121.8", "mission.start_day": "0"}
"""Effective values of newer parameters, for stores of versions before these parameters existed"""

NET_MASS = (0.3, 0.9), (0.5, 0.9)
"""[1] Default range of a segment's net mass in presets paper and field, relative to the largest net
mass that the pump can make"""
ROTATION = 0.75, 0.65
"""[1] Largest rotation of a spiral in presets paper and field, relative to the part's travel"""
STRAIGHT = 0.1
"""[1] Fraction of the rotation's range left out about 0, where a spiral would be nearly straight"""
SPEED = (0.8, 1.1)
"""[1] Default range of speed relative to a propelled vehicle's cruising speed, in both presets"""
WEIGHTS = {"saw-tooth": 6, "transect": 2, "circle": 1, "lawn-mower": 1, "spiral": 1}
"""Relative frequencies of a propelled vehicle's types of segments, for types that it can fly"""
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
"""Meaning and cell of each sampled coefficient of the added-mass matrix"""


def _read_rows() -> dict[str, dict[str, Parameter]]:
    """Read the rows of `parameters.csv` by name, for each word in column `of`."""
    found: dict[str, dict[str, Parameter]] = {}
    with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            per, of = bool(row.pop("per")), row.pop("of")
            found.setdefault(of, {})[row["name"]] = Parameter(**row, per_segment=per)
    return found


ROWS = _read_rows()


def parameter_table(vehicle: Vehicle) -> dict[str, Parameter]:
    """Build the table of a vehicle's parameters, with the distributions that its file replaces.

    Raises:
      VehicleError: a `spread.` entry of the file has an unknown parameter or a bad distribution.
    """
    rows, moving = dict(ROWS[""]), _motion_rows(vehicle)
    if vehicle.steered("heading") is None:
        rows |= ROWS["unturned"]
    if vehicle.holds_pose:
        for name in (*DEPTHS, "yos"):
            rows.pop(f"mission.{name}")
        rows |= ROWS["posed"]
    if propelled(vehicle):
        rows |= ROWS["propelled"]
        del rows[BOTTOM]
        moving.append(rows.pop("mission.min_altitude_m"))
        moving += ROWS["level"].values() if keeps_level(vehicle) else ()
        rows["mission.kind"] = _survey_kinds(rows["mission.kind"], vehicle)
    *mission, stay = (row for row in rows.values() if row.name.startswith("mission."))
    others = (row for row in rows.values() if not row.name.startswith("mission."))
    table = [*mission, *moving, stay, *_vehicle_rows(vehicle), *others]
    rows = {row.name: row for row in table}
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


def _survey_kinds(row: Parameter, vehicle: Vehicle) -> Parameter:
    """Row with the weights of a propelled vehicle's types of segments; unchanged for one type."""
    weights = [f"{kind}: {WEIGHTS[kind]}" for kind in kinds_for(vehicle) if kind in WEIGHTS]
    if len(weights) == 1:
        return row
    text, why = f"choice({', '.join(weights)})", "the paper's first study is of dives and climbs on"
    return dataclasses.replace(row, paper=text, field=text, why=f"{why} a heading")


def _motion_rows(vehicle: Vehicle) -> list[Parameter]:
    """Rows for net mass, speed and turns of segments, if the vehicle has parts for them."""
    rows: list[Parameter] = []
    pump, turning = vehicle.steered("buoyancy"), vehicle.steered("heading")

    def add(name: str, unit: str, spreads: tuple[str, str], long_name: str, why: str) -> None:
        rows.append(Parameter(f"mission.{name}", unit, *spreads, long_name, why, per_segment=True))

    if pump is not None and not propelled(vehicle):  # a propelled vehicle flies neutral
        for name, end, motion, why in (
            ("net_mass_kg", pump.low, "dive", "positive heavy"),
            ("climb_net_mass_kg", pump.high, "climb", "magnitude, light"),
        ):
            reach = abs(vehicle.net_mass_for_pump(end))
            paper, field = (_uniform(low * reach, high * reach) for low, high in NET_MASS)
            why += "; it sets the pumped volume"
            add(name, "kg", (paper, field), f"net mass of the {motion}", why)
    if propelled(vehicle):
        speed = _uniform(*(share * vehicle.cruise_speed for share in SPEED))
        why = "the propeller turns as fast as that takes"
        add("speed_m_s", "m s-1", (speed, speed), "speed through the water", why)
    if turning is not None:
        travel = turning.quantity.scale * min(-turning.low, turning.high)
        paper, field = (
            f"{_uniform(-share * travel, share * travel)} "
            f"except ({-STRAIGHT * share * travel:.4g}, {STRAIGHT * share * travel:.4g})"
            for share in ROTATION
        )
        changes, why = ("uniform(-180, 180)", "uniform(-120, 120)"), "about 0 it is no spiral"
        add("heading_change_deg", "degree", changes, "change of heading",
            "of a saw-tooth, from the heading before")  # fmt: skip
        add("rotation_deg", "degree", (paper, field), f"{turning.name} of a spiral", why)
    return rows


def _uniform(low: float, high: float) -> str:
    return f"uniform({low:.4g}, {high:.4g})"


def _vehicle_rows(vehicle: Vehicle) -> list[Parameter]:
    """Rows unknown to guidance: law, added mass, encoders, hull, then the parts' fields."""
    named = [(f"{part.name}_", u) for part in vehicle.parts for u in part.uncertainties()]
    fields = list(dict.fromkeys(u.field for _, u in named if u.field is not None))
    return [
        *(_row("", u) for u in vehicle.law.uncertainties()),
        *(_row("", coefficient(f"added_mass_{n}", what)) for n, (what, _) in ADDED_MASS.items()),
        *(_row(prefix, u) for prefix, u in named if u.field is None),
        *_hull_rows(vehicle),
        *(_row(prefix, u) for field in fields for prefix, u in named if u.field == field),
    ]


def _row(prefix: str, u: Uncertainty) -> Parameter:
    name = f"vehicle.{prefix}{u.name}"
    return Parameter(name, u.unit, f"{u.certain:g}", u.spread, u.long_name, u.why)


def _hull_rows(vehicle: Vehicle) -> list[Parameter]:
    spread, why = "uniform(3e-10, 7e-10)", "5e-10 is typical"
    if vehicle.hull_compressibility:
        why = f"beyond the file's {vehicle.hull_compressibility:g}; +-5e-11 is what logs tell apart"
        spread = "uniform(-5e-11, 5e-11)"
    rows = [
        ("cg_y_mm", "mm", "0", "uniform(-0.05, 0.05)",
         "offset of the centre of gravity to starboard",
         "of the fixed block; 0.05 mm lists the Sea-Wing by 0.5 deg"),
        ("cg_z_mm", "mm", "0", "uniform(-0.3, 0.3)", "offset of the centre of gravity downward",
         f"of the fixed block, beyond the {1e3 * vehicle.static_cg[2]:.2g} mm of the file"),
        ("compressibility", "Pa-1", "0", spread, "compressibility of the hull",
         f"part of the volume lost per pressure: {why}; sea water has 4.4e-10"),
    ]  # fmt: skip
    if vehicle.steered("buoyancy") is not None:
        why = "too heavy is positive, at the density that it was ballasted for"
        rows.insert(0, ("ballast_g", "g", "0", "uniform(-20, 20)", "ballasting error", why))
    return [Parameter(f"vehicle.{row[0]}", *row[1:]) for row in rows]


def declared(spread: str, table: Table) -> dict[str, Distribution]:
    """Return the table's distributions of one column: "paper" or "field"."""
    return {p.name: parse_distribution(getattr(p, spread), p.name) for p in table.values()}


def override(
    distributions: Mapping[str, Distribution], changes: Mapping[str, str | float]
) -> dict[str, Distribution]:
    """Return the distributions with the ones in `changes` replaced.

    Raises:
      InputError: an unknown name (the error offers the nearest), or a bad text.
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
