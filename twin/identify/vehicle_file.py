"""Vehicle file: a calibration written back into the MJCF text that it started from.

Only the attributes that changed are touched; comments, meshes and cameras of the file stay. What
was fitted, from which store and how surely, goes into a `<text>` element, so that the file says
for itself where its numbers come from.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from twin.errors import InputError, VehicleError
from twin.frames import flip_vector
from twin.identify.calibration import HULL_NUMERIC, PUMP_NUMERIC, SENSOR_NUMERIC, Calibration
from twin.vehicle.vehicle import Vehicle, parse_vehicle

PROVENANCE = "identification"
"""Name of the `<text>` element."""
WRITTEN = {
    "reference_density": lambda v: v.reference_density,
    "hull_compressibility": lambda v: v.hull_compressibility,
    "mass": lambda v: v.mass,
    "drag": lambda v: v.flow_frame.drag,
    "lift": lambda v: v.flow_frame.lift,
    "side_force": lambda v: v.flow_frame.side_force,
    "neutral_x of the battery": lambda v: v.battery.neutral_x,
    "static_cg": lambda v: v.static_cg,
}
"""What identification may change, by name."""
DIGITS = 10
"""Significant digits of a written number: far finer than any parameter is known."""


def vehicle_xml(calibration: Calibration, provenance: Mapping[str, Any]) -> str:
    """MJCF text of the calibrated vehicle; loads as the same `Vehicle`, and in MuJoCo.

    Raises:
      VehicleError: the file has the elements in a form that cannot be edited.
    """
    vehicle = calibration.vehicle
    xml = vehicle.xml
    original = parse_vehicle(xml, vehicle.path)
    xml = _numeric(xml, "reference_density", [vehicle.reference_density], vehicle)
    xml = _numeric(xml, "hull_compressibility", [vehicle.hull_compressibility], vehicle)
    xml = _numeric(xml, "drag", vehicle.flow_frame.drag, vehicle)
    xml = _numeric(xml, "lift", vehicle.flow_frame.lift, vehicle)
    xml = _numeric(xml, "side_force", vehicle.flow_frame.side_force, vehicle)
    if vehicle.mass != original.mass:
        xml = _numeric(xml, "added_mass", vehicle.added_mass.ravel(), vehicle)
        xml = _hull_inertial(xml, vehicle, vehicle.mass / original.mass)
    if vehicle.static_cg[2] != original.static_cg[2]:
        xml = _hull_place(xml, vehicle)
    if vehicle.battery.neutral_x != original.battery.neutral_x:
        xml = _battery_place(xml, vehicle, vehicle.battery.neutral_x - original.battery.neutral_x)
    for name in (HULL_NUMERIC, PUMP_NUMERIC, SENSOR_NUMERIC):
        xml = re.sub(rf"[ \t]*<numeric name={name!r}[^>]*/>\n?".replace("'", '"'), "", xml)
    xml = re.sub(rf'[ \t]*<text name="{PROVENANCE}"[^>]*/>\n?', "", xml)
    hull = [calibration.water_density, calibration.thermal_expansion, calibration.thermal_lag]
    sensors = [
        calibration.pitch_scale,
        calibration.pitch_offset,
        calibration.heading_offset,
        *calibration.heading_cycles,
    ]
    note = quoteattr(json.dumps(dict(provenance), sort_keys=True))
    added = (
        "    <!-- identified: water in a log without CTD [kg/m3], thermal expansion [1/K] and\n"
        "         thermal lag [s] of the hull; read by identification only -->\n"
        f'    <numeric name="{HULL_NUMERIC}" data="{_text(hull)}"/>\n'
        "    <!-- identified: pumped volume forward of the CB [m]; for identification only -->\n"
        f'    <numeric name="{PUMP_NUMERIC}" data="{_text([calibration.pump_position])}"/>\n'
        "    <!-- identified: true pitch = scale * measured + offset [rad]; true less measured\n"
        "         heading [rad]: mean, cos, sin, cos and sin of twice the heading -->\n"
        f'    <numeric name="{SENSOR_NUMERIC}" data="{_text(sensors)}"/>\n'
        f'    <text name="{PROVENANCE}" data={note}/>\n'
    )
    xml = re.sub(r"    <!-- identified: .*?-->\n", "", xml, flags=re.DOTALL)
    if xml.count("</custom>") != 1:
        raise VehicleError(f"vehicle file {vehicle.path}: needs exactly one <custom> element")
    xml = re.sub(r"[ \t]*</custom>", lambda match: added + match.group(0), xml)
    _check(xml, vehicle)
    return xml


def write_vehicle(
    calibration: Calibration,
    path: str | Path,
    provenance: Mapping[str, Any],
    *,
    overwrite: bool = False,
) -> Path:
    """Write the calibrated vehicle.

    Raises:
      InputError: the file exists and `overwrite` is False, or the disk refuses.
    """
    path = Path(path)
    text = vehicle_xml(calibration, provenance)
    if path.exists() and not overwrite:
        raise InputError(f"{path} exists already; use --overwrite or another --out")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error
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
    pattern = rf'(<numeric\s+name="{name}"\s+data=")[^"]*(")'
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


def _check(xml: str, vehicle: Vehicle) -> None:
    """What was written must read back as the vehicle that was meant."""
    again = parse_vehicle(xml, vehicle.path)
    for name, value in WRITTEN.items():
        mine, theirs = (np.atleast_1d(value(v)) for v in (vehicle, again))
        if (np.abs(mine - theirs) > 1e-8 * np.maximum(np.abs(mine), 1.0)).any():
            raise VehicleError(
                f"vehicle file {vehicle.path}: {name} reads back as {theirs}, not {mine}"
            )
