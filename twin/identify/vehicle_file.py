"""Vehicle file: a calibration written back into the MJCF text that it started from.

Only the attributes that changed are touched; comments, meshes and cameras of the file stay. What
was fitted, from which store and how surely, goes into a `<text>` element, so that the file says
for itself where its numbers come from.

The file's physics step is the longest that is accurate at the vehicle's usual speed.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable, Mapping
from operator import attrgetter
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from twin.errors import VehicleError
from twin.frames import flip_vector
from twin.identify.calibration import (
    HULL_NUMERIC,
    PROVENANCE,
    PUMP_NUMERIC,
    REFERENCE_TEMPERATURE,
    SENSOR_NUMERIC,
    Calibration,
)
from twin.identify.driven_unknowns import driven
from twin.physics.stiffness import file_timestep, stiffness_of
from twin.records.storage.whole import whole_file
from twin.vehicle.consumption import Consumption
from twin.vehicle.laws import BodyAxes
from twin.vehicle.parts import BatteryHinge, Fin, Pump
from twin.vehicle.vehicle import Vehicle, parse_vehicle

STEPS = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
"""[s] that are written; 0.2 s, stable and accurate too for most gliders, does not divide the usual
sample period of 0.5 s"""


def largest_step(vehicle: Vehicle) -> float:
    """[s] of STEPS that is stable and accurate on the vehicle's usual way, see
    `twin.physics.stiffness`."""
    found = stiffness_of(vehicle)
    allowed = STEPS[-1] if found is None else found.longest
    return next((step for step in STEPS if step <= allowed), STEPS[-1])


def driven_step(vehicle: Vehicle) -> float:
    """[s] of a propelled vehicle's file, which stays unless it is too long for the vehicle."""
    found, own = stiffness_of(vehicle), file_timestep(vehicle)
    return own if found is None or own <= found.longest else largest_step(vehicle)


CYLINDER = 1.1
"""Drag coefficient of a cylinder across the flow below the drag crisis (Hoerner 1965, page 3-9)"""
COEFFICIENTS = (
    "drag", "lift", "side_force", "side_force_lift", "roll_moment", "roll_moment_lift",
    "pitch_moment", "yaw_moment", "yaw_moment_lift", "yaw_moment_offset", "roll_from_yaw",
    "yaw_from_roll",
)  # fmt: skip
"""Of the hull law, each a `<numeric>` of its name."""
LOOPS = ("pitch_pid", "heading_pid")
SWELLING = ("hull_thermal_expansion", "hull_thermal_lag", "hull_reference_temperature")
GUIDANCE = (*LOOPS, "usual_glide")
WRITTEN: dict[str, Callable[[Vehicle], Any]] = {
    "reference_density": lambda v: v.reference_density,
    "hull_compressibility": lambda v: v.hull_compressibility,
    "mass": lambda v: v.mass,
    **{name: attrgetter(f"law.{name}") for name in COEFFICIENTS},
    **{name: attrgetter(name) for name in (*GUIDANCE, *SWELLING)},
    "neutral_x of the battery": lambda v: v.battery.neutral_x,
    "eccentricity of the battery": lambda v: v.battery.eccentricity,
    "static_cg": lambda v: v.static_cg,
    "travel of the parts": lambda v: [(part.low, part.high) for part in v.parts],
    "place of the pump": lambda v: _pump(v).position,
    "neutral positions": lambda v: [
        part.neutral for part in v.parts if isinstance(part, Fin | BatteryHinge)
    ],
    "lift slope of the rudder": lambda v: [p.lift_slope for p in v.parts if isinstance(p, Fin)],
}
"""What identification may change, by name."""
DRIVEN_WRITTEN: dict[str, Callable[[Vehicle], Any]] = {
    "reference_density": lambda v: v.reference_density,
    "hull law": lambda v: v.law.values(),
    "added_mass": lambda v: v.added_mass,
    "static_cg": lambda v: v.static_cg,
    "parts": lambda v: np.concatenate([np.asarray(part.values()) for part in v.parts]),
}
"""The same of a vehicle under a propeller"""
DIGITS = 10
"""Significant digits of a written number: far finer than any parameter is known."""


def vehicle_xml(calibration: Calibration, provenance: Mapping[str, Any]) -> str:
    """MJCF text of the calibrated vehicle; loads as the same `Vehicle`, and in MuJoCo.

    Raises:
      VehicleError: the file has the elements in a form that cannot be edited.
    """
    if driven(calibration.vehicle):
        vehicle, measured = calibration.vehicle, ""
        xml = _with_changes(vehicle)
    else:
        vehicle, measured = _swelling(calibration), _measured(calibration)
        xml = _with_glide(vehicle)
    for name in (HULL_NUMERIC, PUMP_NUMERIC, SENSOR_NUMERIC):
        xml = re.sub(rf"[ \t]*<numeric name={name!r}[^>]*/>\n?".replace("'", '"'), "", xml)
    xml = re.sub(rf'[ \t]*<text name="{PROVENANCE}"[^>]*/>\n?', "", xml)
    note = quoteattr(json.dumps(dict(provenance), sort_keys=True))
    added = f'{measured}    <text name="{PROVENANCE}" data={note}/>\n'
    xml = re.sub(r"    <!-- identified: .*?-->\n", "", xml, flags=re.DOTALL)
    if xml.count("</custom>") != 1:
        raise VehicleError(f"vehicle file {vehicle.path}: needs exactly one <custom> element")
    xml = re.sub(r"[ \t]*</custom>", lambda match: added + match.group(0), xml)
    _check(xml, vehicle)
    return xml


def _swelling(calibration: Calibration) -> Vehicle:
    """The hull that is flown swells as the one that was identified."""
    return calibration.vehicle.replace(
        hull_thermal_expansion=calibration.thermal_expansion,
        hull_thermal_lag=calibration.thermal_lag,
        hull_reference_temperature=REFERENCE_TEMPERATURE,
    )


def _measured(calibration: Calibration) -> str:
    """What identification reads of the water and the sensors again."""
    hull = [calibration.water_density, calibration.thermal_expansion, calibration.thermal_lag]
    sensors = [
        calibration.pitch_scale,
        calibration.pitch_offset,
        calibration.heading_offset,
        *calibration.heading_cycles,
    ]
    return (
        "    <!-- identified: water in a log without CTD [kg/m3], thermal expansion [1/K] and\n"
        "         thermal lag [s] of the hull, as identification reads them -->\n"
        f'    <numeric name="{HULL_NUMERIC}" data="{_text(hull)}"/>\n'
        "    <!-- identified: true pitch = scale * measured + offset [rad]; true less measured\n"
        "         heading [rad]: mean, cos, sin, cos and sin of twice the heading -->\n"
        f'    <numeric name="{SENSOR_NUMERIC}" data="{_text(sensors)}"/>\n'
    )


def _with_changes(vehicle: Vehicle) -> str:
    """Text of a propelled vehicle's file with the numbers that differ from it."""
    xml, changes = vehicle.xml, vehicle.changes()
    original = parse_vehicle(xml, vehicle.path)
    step = driven_step(vehicle)
    if step != file_timestep(vehicle):
        xml = _with_step(xml, vehicle, step)
    for name, value in changes.items():
        if name == "static_cg":
            xml = _hull_place(xml, vehicle)
        elif name == "derivatives":
            assert isinstance(vehicle.law, BodyAxes)
            assert isinstance(original.law, BodyAxes)
            for (own, mine), (_, before) in zip(
                vehicle.law.derivatives, original.law.derivatives, strict=True
            ):
                if mine != before:
                    xml = _numeric(xml, own, [mine], vehicle)
        elif name in vehicle.part_names:
            for field, number in value.items():
                xml = _numeric(xml, f"{name}.{field}", [number], vehicle)
        elif name != "coupling":  # which follows from the added mass
            xml = _numeric(xml, name, np.ravel(value), vehicle)
    return xml


def _with_step(xml: str, vehicle: Vehicle, step: float) -> str:
    head = r'(<option\b[^>]*\btimestep=")[^"]*(")'
    return _substitute(xml, head, _text([step]), "<option timestep>", vehicle)


def _with_glide(vehicle: Vehicle) -> str:
    """Text of a glider's file with what identification changes in it."""
    xml = vehicle.xml
    original = parse_vehicle(xml, vehicle.path)
    xml = _numeric(xml, "reference_density", [vehicle.reference_density], vehicle)
    xml = _numeric(xml, "hull_compressibility", [vehicle.hull_compressibility], vehicle)
    step = largest_step(vehicle)
    if step != file_timestep(vehicle):
        xml = _with_step(xml, vehicle, step)
    for name in SWELLING:
        if getattr(vehicle, name) != getattr(original, name):
            xml = _numeric(xml, name, [getattr(vehicle, name)], vehicle)
    changed = [c for c in COEFFICIENTS if _law(vehicle, c) != _law(original, c)]
    for name in changed:
        xml = _numeric(xml, name, _law(vehicle, name), vehicle)
    if changed and not vehicle.flow_frame.cross_flow_drag:
        across = max(vehicle.flow_frame.drag[1], cylinder_drag(vehicle))
        xml = _numeric(xml, "cross_flow_drag", [across], vehicle)
    for name in GUIDANCE:
        if getattr(vehicle, name) != getattr(original, name):
            xml = _numeric(xml, name, getattr(vehicle, name), vehicle)
    if vehicle.mass != original.mass:
        xml = _numeric(xml, "added_mass", vehicle.added_mass.ravel(), vehicle)
        xml = _hull_inertial(xml, vehicle, vehicle.mass / original.mass)
    if vehicle.static_cg[2] != original.static_cg[2]:
        xml = _hull_place(xml, vehicle)
    if vehicle.battery.neutral_x != original.battery.neutral_x:
        xml = _battery_place(xml, vehicle, vehicle.battery.neutral_x - original.battery.neutral_x)
    if vehicle.battery.eccentricity != original.battery.eccentricity:
        xml = _battery_hangs(xml, vehicle)
    if _pump(vehicle).position != _pump(original).position:
        xml = _pump_place(xml, vehicle)
    for part, before in zip(vehicle.parts, original.parts, strict=True):
        if (part.low, part.high) != (before.low, before.high):
            xml = _travel(xml, vehicle, part.name, part.low, part.high)
        if isinstance(part, Fin | BatteryHinge) and part.neutral != getattr(before, "neutral", 0.0):
            xml = _numeric(xml, f"{part.name}.neutral", [part.neutral], vehicle)
        if isinstance(part, Fin) and part.lift_slope != getattr(before, "lift_slope", None):
            xml = _numeric(xml, f"{part.name}.lift_slope", [part.lift_slope], vehicle)
    return xml


def _law(vehicle: Vehicle, name: str) -> tuple[float, ...]:
    """A coefficient of the hull law."""
    return tuple(getattr(vehicle.flow_frame, name))


def cylinder_drag(vehicle: Vehicle) -> float:
    """[kg/m] of a hull of this length and diameter across the flow.

    A log of glides tells K_D at small angles. That much alone, broadside on, may be less than what
    the fitted moments take from still water, which then drives the hull.
    """
    area = vehicle.hull_length * vehicle.hull_diameter
    return 0.5 * vehicle.reference_density * CYLINDER * area


def with_consumption(vehicle: Vehicle, consumption: Consumption) -> Vehicle:
    """The vehicle with these losses and powers in its file's text."""
    xml, mine = vehicle.xml, Consumption.of(vehicle)
    for field in dataclasses.fields(Consumption):
        value = getattr(consumption, field.name)
        if value != getattr(mine, field.name):
            xml = _numeric(xml, field.name, [value], vehicle)
    return parse_vehicle(xml, vehicle.path)


def write_consumption(
    vehicle: Vehicle, consumption: Consumption, path: Path, *, overwrite: bool = False
) -> Path:
    """Write a vehicle's file with these losses and powers.

    Raises:
      WriteError: the file exists and `overwrite` is False, or the disk refuses.
    """
    with whole_file(path, overwrite=overwrite) as place:
        place.write_text(with_consumption(vehicle, consumption).xml, encoding="utf-8")
    return path


def write_vehicle(
    calibration: Calibration,
    path: str | Path,
    provenance: Mapping[str, Any],
    *,
    consumption: Consumption | None = None,
    overwrite: bool = False,
) -> Path:
    """Write the calibrated vehicle, with losses and powers that a log told where there are some.

    Raises:
      WriteError: the file exists and `overwrite` is False, or the disk refuses.
    """
    path = Path(path)
    text = vehicle_xml(calibration, provenance)
    if consumption is not None:
        text = with_consumption(parse_vehicle(text, path), consumption).xml
    with whole_file(path, overwrite=overwrite) as place:
        place.write_text(text, encoding="utf-8")
    return path


def _text(values: Any) -> str:
    return " ".join(f"{float(value):.{DIGITS}g}" for value in values)


def _substitute(xml: str, pattern: str, replacement: str, what: str, vehicle: Vehicle) -> str:
    found, count = re.subn(
        pattern, lambda m: m.group(1) + replacement + m.group(2), xml, flags=re.DOTALL
    )
    if count != 1:
        raise VehicleError(
            f"vehicle file {vehicle.path}: found {count} places to write {what}, needs exactly 1"
        )
    return found


def _numeric(xml: str, name: str, values: Any, vehicle: Vehicle) -> str:
    """A `<numeric>` with other numbers; one that the file leaves at its default is added."""
    if not re.search(rf'<numeric\s+name="{re.escape(name)}"', xml):
        line = f'    <numeric name="{name}" data="{_text(values)}"/>\n'
        return re.sub(r"[ \t]*</custom>", lambda match: line + match.group(0), xml)
    pattern = rf'(<numeric\s+name="{re.escape(name)}"\s+data=")[^"]*(")'
    return _substitute(xml, pattern, _text(values), f"<numeric name={name!r}>", vehicle)


def _hull_inertial(xml: str, vehicle: Vehicle, scale: float) -> str:
    """Mass and inertia of the hull; its inertia grows with the mass."""
    head = r'(<body\s+name="hull".*?<inertial\b[^>]*?\bmass=")[^"]*(")'
    xml = _substitute(xml, head, _text([vehicle.static_mass]), "the hull's mass", vehicle)
    pattern = re.compile(
        r'(<body\s+name="hull".*?<inertial\b[^>]*?\b(?:diag|full)inertia=")([^"]*)(")', re.DOTALL
    )
    return pattern.sub(
        lambda m: m.group(1) + _text(scale * float(x) for x in m.group(2).split()) + m.group(3),
        xml,
        count=1,
    )


def _hull_place(xml: str, vehicle: Vehicle) -> str:
    """Centre of gravity of the hull; MJCF's axes are forward-port-up."""
    head = r'(<body\s+name="hull".*?<inertial\b[^>]*?\bpos=")[^"]*(")'
    place = flip_vector(vehicle.static_cg)
    return _substitute(xml, head, _text(place), "the hull's centre of gravity", vehicle)


def _battery_place(xml: str, vehicle: Vehicle, moved: float) -> str:
    pattern = re.compile(r'(<body\s+name="battery"\s+pos=")([^"]*)(")')
    found = pattern.search(xml)
    if found is None:
        raise VehicleError(f"vehicle file {vehicle.path}: <body name='battery' pos=...> is missing")
    x, y, z = (float(word) for word in found.group(2).split())
    return pattern.sub(lambda m: m.group(1) + _text([x + moved, y, z]) + m.group(3), xml, count=1)


def _battery_hangs(xml: str, vehicle: Vehicle) -> str:
    """Eccentricity of the battery: its centre of gravity below its body's origin."""
    name = re.escape(vehicle.battery.name)
    head = rf'(<body\s+name="{name}".*?<inertial\b[^>]*?\bpos=")[^"]*(")'
    place = [0.0, 0.0, -vehicle.battery.eccentricity]
    return _substitute(xml, head, _text(place), "the battery's centre of gravity", vehicle)


def _actuator(name: str, attribute: str) -> str:
    """Pattern of an attribute of the actuator of a part."""
    return rf'(<general\s+(?=[^>]*\bname="{re.escape(name)}")[^>]*?\b{attribute}=")[^"]*(")'


def _travel(xml: str, vehicle: Vehicle, name: str, low: float, high: float) -> str:
    """Ends of a part's travel: both ranges of its actuator."""
    for attribute in ("ctrlrange", "actrange"):
        what = f"{attribute} of actuator {name!r}"
        xml = _substitute(xml, _actuator(name, attribute), _text([low, high]), what, vehicle)
    return xml


def _pump(vehicle: Vehicle) -> Pump:
    return next(part for part in vehicle.parts if isinstance(part, Pump))


def _pump_place(xml: str, vehicle: Vehicle) -> str:
    """A site of its own for the pump, at its place."""
    pump = _pump(vehicle)
    place = _text(flip_vector(np.array(pump.position)))
    site = pump.name
    if re.search(rf'<site\s+name="{re.escape(site)}"', xml):
        head = rf'(<site\s+name="{re.escape(site)}"[^>]*?\bpos=")[^"]*(")'
        xml = _substitute(xml, head, place, f"site {site!r}", vehicle)
    else:
        line = f'      <site name="{site}" pos="{place}" size="0.015" group="3"/>\n'
        xml = re.sub(r'[ \t]*<site\s+name="cb"', lambda match: line + match.group(0), xml, count=1)
    return _substitute(xml, _actuator(pump.name, "site"), site, "the pump's site", vehicle)


def _check(xml: str, vehicle: Vehicle) -> None:
    """What was written must read back as the vehicle that was meant."""
    again = parse_vehicle(xml, vehicle.path)
    for name, value in (DRIVEN_WRITTEN if driven(vehicle) else WRITTEN).items():
        mine, theirs = (np.atleast_1d(value(v)) for v in (vehicle, again))
        if (np.abs(mine - theirs) > 1e-8 * np.maximum(np.abs(mine), 1.0)).any():
            raise VehicleError(
                f"vehicle file {vehicle.path}: {name} reads back as {theirs}, not {mine}"
            )
