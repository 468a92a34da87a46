"""Vehicle file: a calibration written back into the MJCF text that it started from.

Only the attributes that changed are touched; comments, meshes and cameras of the file stay. A
`<text>` element records the fitted parameters, their standard deviations and the store.

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
    driven,
)
from twin.physics.stiffness import file_timestep, stiffness_of
from twin.records.storage.whole import whole_file
from twin.vehicle.consumption import Consumption
from twin.vehicle.laws import BodyAxes
from twin.vehicle.parts import Part
from twin.vehicle.vehicle import Vehicle, parse_vehicle

STEPS = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
"""[s] Physics steps that a file may get. 0.2 s, also stable and accurate for most gliders, does not
divide the usual sample period of 0.5 s."""


def largest_step(vehicle: Vehicle) -> float:
    """Longest of STEPS [s] that is stable and accurate at the vehicle's usual speed, see
    `twin.physics.stiffness`."""
    found = stiffness_of(vehicle)
    allowed = STEPS[-1] if found is None else found.longest
    return next((step for step in STEPS if step <= allowed), STEPS[-1])


def driven_step(vehicle: Vehicle) -> float:
    """Physics step [s] of a propelled vehicle: the file's, unless the vehicle needs a shorter."""
    found, own = stiffness_of(vehicle), file_timestep(vehicle)
    return own if found is None or own <= found.longest else largest_step(vehicle)


CYLINDER = 1.1
"""Drag coefficient of a cylinder across the flow below the drag crisis (Hoerner 1965, page 3-9)"""
GUIDANCE = ("pitch_pid", "heading_pid", "usual_glide")
SWELLING = ("hull_thermal_expansion", "hull_thermal_lag", "hull_reference_temperature")
NUMBERS = ("reference_density", "hull_compressibility", "mass", "added_mass", "static_cg")
WRITTEN: dict[str, Callable[[Vehicle], Any]] = {
    **{name: attrgetter(name) for name in (*NUMBERS, *GUIDANCE, *SWELLING)},
    "hull law": lambda v: v.law.values(),
    "parts": lambda v: [x for p in v.parts for x in (p.low, p.high, *p.position, *p.values())],
    "battery": lambda v: [(mass.neutral_x, mass.eccentricity) for mass in v.masses],
}
"""Numbers that identification may change, as functions of the vehicle, by name"""
DIGITS = 10
"""Significant digits of a written number, far finer than any standard deviation"""
SOURCES: Mapping[str, tuple[str, ...]] = {
    "reference_density": ("neutral_density",),
    "hull_compressibility": ("compressibility",),
    "hull_thermal_expansion": ("thermal_expansion",),
    "hull_thermal_lag": ("thermal_lag",),
    "drag": ("drag", "induced_ratio"),
    "lift": ("drag", "lift_ratio"),
    "side_force": ("drag", "side_force"),
    "yaw_moment": ("yaw_moment", "yaw_damping"),
    "rudder.lift_slope": ("rudder",),
    "pump": ("pump_position",),
    "battery": ("shift_offset", "roll_authority"),
}
"""Parameters that change an element of the file, by the element's name, where the names differ"""


def vehicle_xml(calibration: Calibration, provenance: Mapping[str, Any]) -> str:
    """MJCF text of the calibrated vehicle; loads as the same `Vehicle`, and in MuJoCo.

    Raises:
      VehicleError: the file has the elements in a form that cannot be edited.
    """
    vehicle, measured = calibration.vehicle, ""
    if driven(vehicle):
        step = driven_step(vehicle)
    else:
        vehicle, measured = _as_flown(calibration), _measured(calibration)
        step = largest_step(vehicle)
    xml = _with_sources(_with_changes(vehicle), vehicle, provenance)
    if step != file_timestep(vehicle):
        head = r'(<option\b[^>]*\btimestep=")[^"]*(")'
        xml = _substitute(xml, head, _text([step]), "<option timestep>", vehicle)
    for name in (HULL_NUMERIC, PUMP_NUMERIC, SENSOR_NUMERIC):
        xml = re.sub(rf'[ \t]*<numeric name="{name}"[^>]*/>\n?', "", xml)
    xml = re.sub(rf'[ \t]*<text name="{PROVENANCE}"[^>]*/>\n?', "", xml)
    note = quoteattr(json.dumps(dict(provenance), sort_keys=True))
    added = f'{measured}    <text name="{PROVENANCE}" data={note}/>\n'
    xml = re.sub(r"    <!-- identified: .*?-->\n", "", xml, flags=re.DOTALL)
    if xml.count("</custom>") != 1:
        raise VehicleError(f"vehicle file {vehicle.path}: needs exactly one <custom> element")
    xml = re.sub(r"[ \t]*</custom>", lambda match: added + match.group(0), xml)
    _check(xml, vehicle)
    return xml


def _as_flown(calibration: Calibration) -> Vehicle:
    """Glider with the identified hull's thermal expansion, and with drag across the flow."""
    vehicle = calibration.vehicle.replace(
        hull_thermal_expansion=calibration.thermal_expansion,
        hull_thermal_lag=calibration.thermal_lag,
        hull_reference_temperature=REFERENCE_TEMPERATURE,
    )
    law = vehicle.flow_frame
    original = parse_vehicle(vehicle.xml, vehicle.path).law
    if np.array_equal(law.values(), original.values()) or law.cross_flow_drag:
        return vehicle
    return vehicle.replace(cross_flow_drag=max(law.drag[1], cylinder_drag(vehicle)))


def _measured(calibration: Calibration) -> str:
    """Elements with the numbers of water, hull and sensors that identification reads again."""
    c = calibration
    hull = [c.water_density, c.thermal_expansion, c.thermal_lag]
    sensors = [c.pitch_scale, c.pitch_offset, c.heading_offset, *c.heading_cycles]
    return (
        "    <!-- identified: water in a log without CTD [kg/m3], thermal expansion [1/K] and\n"
        "         thermal lag [s] of the hull, as identification reads them -->\n"
        f'    <numeric name="{HULL_NUMERIC}" data="{_text(hull)}"/>\n'
        "    <!-- identified: true pitch = scale * measured + offset [rad]; true less measured\n"
        "         heading [rad]: mean, cos, sin, cos and sin of twice the heading -->\n"
        f'    <numeric name="{SENSOR_NUMERIC}" data="{_text(sensors)}"/>\n'
    )


def _with_sources(xml: str, vehicle: Vehicle, provenance: Mapping[str, Any]) -> str:
    """Text whose changed elements say log, dates and standard deviations in place of comments."""
    log = str(provenance.get("store", "a log"))
    if dates := provenance.get("dates"):
        log += ", " + " to ".join(dates)
    estimates = provenance.get("parameters", {})

    def source(name: str) -> str:
        found = [
            "{} {:.4g} +- {:.2g} [{}]".format(own, one["value"], one["deviation"], one["unit"])
            for own in SOURCES.get(name, (name,))
            if (one := estimates.get(own, {})).get("deviation")
        ]
        return f"identified from {log}" + ": " * bool(found) + ", ".join(found)

    return _commented(vehicle.xml, xml, source)


def _commented(before: str, after: str, source: Callable[[str], str]) -> str:
    """Text `after` with the units and `source(name)` as the comment of each changed element.

    An element is changed where `before` lacks it. Only the last element of a line has a comment.
    """
    pattern = re.compile(r"^([ \t]*<(?!!)[^\n]*?>)([ \t]*)(?:<!--(.*?)-->)?[ \t]*$", re.M | re.S)
    known = {match.group(1).strip() for match in pattern.finditer(before)}

    def replaced(match: re.Match[str]) -> str:
        element, gap, comment = match.groups()
        if element.strip() in known:
            return match.group(0)
        name = re.search(r'\bname="([^"]*)"', element)
        words = re.split("[:;]", re.sub(r" \([^)]*\)", "", comment or ""))[0].split(", ")
        units = ", ".join(found.group(0) for w in words if (found := re.match(r".*\]", w)))
        text = units.strip() + " " * bool(units) + source(name.group(1) if name else "")
        return f"{element}{gap or '  '}<!-- {text.replace('--', '-')} -->"

    return pattern.sub(replaced, after)


def _with_changes(vehicle: Vehicle) -> str:
    """Text of the vehicle's file with its changed numbers in place."""
    xml, original = vehicle.xml, parse_vehicle(vehicle.xml, vehicle.path)
    for name, value in vehicle.changes().items():
        if name == "static_cg":  # MJCF's axes are forward-port-up
            place, what = flip_vector(vehicle.static_cg), "the hull's centre of gravity"
            xml = _inertial(xml, vehicle, "hull", "pos", place, what)
        elif name == "static_mass":
            xml = _hull_inertial(xml, vehicle, vehicle.mass / original.mass)
        elif name == "derivatives" and isinstance(vehicle.law, BodyAxes):
            before = dict(getattr(original.law, name))
            for own, number in vehicle.law.derivatives:
                if number != before[own]:
                    xml = _numeric(xml, own, [number], vehicle)
        elif name == "battery":
            if "neutral_x" in value:
                moved = vehicle.battery.neutral_x - original.battery.neutral_x
                xml = _battery_place(xml, vehicle, moved)
            if "eccentricity" in value:  # below its body's origin
                below = [0.0, 0.0, -vehicle.battery.eccentricity]
                what = "the battery's centre of gravity"
                xml = _inertial(xml, vehicle, vehicle.battery.name, "pos", below, what)
        elif name in vehicle.part_names:
            xml = _with_part(xml, vehicle, vehicle.part(name), value)
        elif name not in ("coupling", "static_inertia"):  # both follow from added mass and mass
            xml = _numeric(xml, name, np.ravel(value), vehicle)
    return xml


def _with_part(xml: str, vehicle: Vehicle, part: Part, changes: Mapping[str, Any]) -> str:
    """Text with a part's place, the ends of its travel and its other numbers."""
    if "position" in changes:
        xml = _with_site(xml, vehicle, part)
    if "low" in changes or "high" in changes:
        for attribute in ("ctrlrange", "actrange"):
            what = f"{attribute} of actuator {part.name!r}"
            ends = _text([part.low, part.high])
            xml = _substitute(xml, _actuator(part.name, attribute), ends, what, vehicle)
    for field, value in changes.items():
        if field not in ("position", "low", "high"):
            xml = _numeric(xml, f"{part.name}.{field}", [value], vehicle)
    return xml


def cylinder_drag(vehicle: Vehicle) -> float:
    """Drag coefficient [kg/m] of a cylinder of the hull's length and diameter across the flow.

    A log of glides determines K_D at small angles. Broadside on, K_D alone may dissipate less than
    the fitted moments take from still water, and the hull would drive itself.
    """
    area = vehicle.hull_length * vehicle.hull_diameter
    return 0.5 * vehicle.reference_density * CYLINDER * area


def with_consumption(vehicle: Vehicle, consumption: Consumption) -> Vehicle:
    """Return the vehicle with these losses and powers in its file's text."""
    xml, mine = vehicle.xml, Consumption.of(vehicle)
    for field in dataclasses.fields(Consumption):
        value = getattr(consumption, field.name)
        if value != getattr(mine, field.name):
            xml = _numeric(xml, field.name, [value], vehicle)
    xml = _commented(vehicle.xml, xml, lambda name: "identified from a log's counter of charge")
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
    """Write the calibrated vehicle, with the losses and powers of `consumption` where given.

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
    """Text with other numbers in a `<numeric>`, which is added where the file has none."""
    if not re.search(rf'<numeric\s+name="{re.escape(name)}"', xml):
        line = f'    <numeric name="{name}" data="{_text(values)}"/>\n'
        return re.sub(r"[ \t]*</custom>", lambda match: line + match.group(0), xml)
    pattern = rf'(<numeric\s+name="{re.escape(name)}"\s+data=")[^"]*(")'
    return _substitute(xml, pattern, _text(values), f"<numeric name={name!r}>", vehicle)


def _inertial(xml: str, vehicle: Vehicle, body: str, attribute: str, values: Any, what: str) -> str:
    """Text with other values of an attribute of a body's `<inertial>`."""
    name = re.escape(body)
    head = rf'(<body\s+name="{name}".*?<inertial\b[^>]*?\b{attribute}=")[^"]*(")'
    return _substitute(xml, head, _text(values), what, vehicle)


def _hull_inertial(xml: str, vehicle: Vehicle, scale: float) -> str:
    """Text with the hull's mass, and its inertia times `scale`."""
    xml = _inertial(xml, vehicle, "hull", "mass", [vehicle.static_mass], "the hull's mass")
    pattern = re.compile(
        r'(<body\s+name="hull".*?<inertial\b[^>]*?\b(?:diag|full)inertia=")([^"]*)(")', re.DOTALL
    )
    return pattern.sub(
        lambda m: m.group(1) + _text(scale * float(x) for x in m.group(2).split()) + m.group(3),
        xml,
        count=1,
    )


def _battery_place(xml: str, vehicle: Vehicle, moved: float) -> str:
    pattern = re.compile(r'(<body\s+name="battery"\s+pos=")([^"]*)(")')
    found = pattern.search(xml)
    if found is None:
        raise VehicleError(f"vehicle file {vehicle.path}: <body name='battery' pos=...> is missing")
    x, y, z = (float(word) for word in found.group(2).split())
    return pattern.sub(lambda m: m.group(1) + _text([x + moved, y, z]) + m.group(3), xml, count=1)


def _actuator(name: str, attribute: str) -> str:
    """Pattern of an attribute of a part's actuator."""
    return rf'(<general\s+(?=[^>]*\bname="{re.escape(name)}")[^>]*?\b{attribute}=")[^"]*(")'


def _with_site(xml: str, vehicle: Vehicle, part: Part) -> str:
    """Text with a site of its own for a part, at the part's position."""
    site, place = part.name, _text(flip_vector(np.array(part.position)))
    if re.search(rf'<site\s+name="{re.escape(site)}"', xml):
        head = rf'(<site\s+name="{re.escape(site)}"[^>]*?\bpos=")[^"]*(")'
        xml = _substitute(xml, head, place, f"site {site!r}", vehicle)
    else:
        line = f'      <site name="{site}" pos="{place}" size="0.015" group="3"/>\n'
        xml = re.sub(r'[ \t]*<site\s+name="cb"', lambda match: line + match.group(0), xml, count=1)
    return _substitute(xml, _actuator(site, "site"), site, f"the site of the {site}", vehicle)


def _check(xml: str, vehicle: Vehicle) -> None:
    """Raise VehicleError where the text does not read back as the vehicle."""
    again = parse_vehicle(xml, vehicle.path)
    for name, value in WRITTEN.items():
        mine, theirs = (np.atleast_1d(value(v)) for v in (vehicle, again))
        if (np.abs(mine - theirs) > 1e-8 * np.maximum(np.abs(mine), 1.0)).any():
            raise VehicleError(
                f"vehicle file {vehicle.path}: {name} reads back as {theirs}, not {mine}"
            )
