"""Conventions: a glider's numbers converted to and from the names of other flight models.

Seaglider basestation (Eriksen et al. 2001, IEEE J. Oceanic Eng. 26(4); basestation3): with the
dynamic pressure q = rho0 V^2 / 2, the glider's length l and the angle of attack a in degrees,

    lift = q l^2 hd_a a,    drag = q l^2 (hd_b q^hd_s + hd_c a^2),
    volume = (volmax - vbd at volmax + vbd - vbdbias) exp(therm_expan (T - temp_ref)
        - abs_compress P),

volumes in cm3, pressure in dbar. The basestation's drag coefficient falls with speed, and ours does
not: both agree at the speed in the file. `volmax` is the volume with all oil outside.

gliderflight (Merckelbach et al. 2010, 2019): q = rho U^2 / 2, area S = 0.1 m2, a in radian,

    lift = q S (aw + ah) a,    drag = q S (Cd0 + Cd1 a^2),
    volume = Vg (1 - epsilon P) + pumped volume,

with epsilon in 1e-10 / Pa, and the lift slope aw of the wings alone, 3.7 per radian by their shape.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path

from twin.bounded import parse_json, read_text
from twin.errors import InputError, unknown_name
from twin.identify.calibration import REFERENCE_TEMPERATURE, Calibration
from twin.identify.pitch import pump_of
from twin.identify.unknowns import choose
from twin.records.storage.whole import whole_file
from twin.vehicle.parts.pump import CUBIC_CM

DEGREE = math.pi / 180.0
DBAR = 1e4
"""[Pa] Pressure of 1 dbar"""
HD_S, TEMP_REF = -0.25, 15.0
"""Defaults of the basestation. HD_S: power of the dynamic pressure in the drag. TEMP_REF:
[degree_Celsius] reference temperature"""
SPEED = 0.3
"""[m/s] Default speed at which both drags agree"""
AREA = 0.1
"""[m2] Reference area S of gliderflight"""
ASPECT, SWEEP = 7.0, 43.0 * DEGREE
"""ASPECT: aspect ratio of a Slocum's wings in gliderflight. SWEEP: [rad] their sweep"""
WING = 2.0 * math.pi * ASPECT / (2.0 + math.sqrt(ASPECT**2 * (1.0 + math.tan(SWEEP) ** 2) + 4.0))
"""[1/rad] aw: lift slope of these wings (Merckelbach et al. 2010)"""

Figures = dict[str, float]


def to_basestation(calibration: Calibration, speed: float = SPEED) -> Figures:
    """Numbers by their names in `sg_calib_constants.m`; the drag agrees at `speed` [m/s]."""
    vehicle = calibration.vehicle
    density, length = vehicle.reference_density, vehicle.hull_length
    law = vehicle.flow_frame
    pressure = 0.5 * density * speed**2
    size = 0.5 * density * length**2
    warmer = 1.0 + calibration.thermal_expansion * (TEMP_REF - REFERENCE_TEMPERATURE)
    pump = pump_of(calibration)
    neutral = (vehicle.neutral_volume / CUBIC_CM - pump.neutral) * warmer
    return {
        "mass": vehicle.mass,
        "rho0": density,
        "glider_length": length,
        "hd_a": law.lift[1] * DEGREE / size,
        "hd_b": law.drag[0] / (size * pressure**HD_S),
        "hd_c": law.drag[1] * DEGREE**2 / size,
        "hd_s": HD_S,
        "volmax": neutral + pump.high,
        "vbdbias": 0.0,
        "abs_compress": vehicle.hull_compressibility * DBAR,
        "therm_expan": calibration.thermal_expansion,
        "temp_ref": TEMP_REF,
        "vbd_at_volmax": pump.high,
        "speed": speed,
    }


def from_basestation(figures: Mapping[str, float], calibration: Calibration) -> Calibration:
    """Return the calibration with a basestation's figures; figures that are not given stay."""
    mine = {**to_basestation(calibration, figures.get("speed", SPEED)), **figures}
    density, length = mine["rho0"], mine["glider_length"]
    size = 0.5 * density * length**2
    pressure = 0.5 * density * mine["speed"] ** 2
    warmer = 1.0 + mine["therm_expan"] * (mine["temp_ref"] - REFERENCE_TEMPERATURE)
    pump = pump_of(calibration)
    volume = (mine["volmax"] - mine["vbd_at_volmax"] - mine["vbdbias"]) / warmer + pump.neutral
    drag = mine["hd_b"] * size * pressure ** mine["hd_s"], mine["hd_c"] * size / DEGREE**2
    lift, compressibility = mine["hd_a"] * size / DEGREE, mine["abs_compress"] / DBAR
    made = _with(calibration, mine["mass"], volume * CUBIC_CM, drag, lift, compressibility)
    return made.replace(thermal_expansion=mine["therm_expan"])


def to_gliderflight(calibration: Calibration) -> Figures:
    """Numbers by their names in gliderflight's `define`."""
    vehicle = calibration.vehicle
    law = vehicle.flow_frame
    size = 0.5 * vehicle.reference_density * AREA
    pump = pump_of(calibration)
    return {
        "Cd0": law.drag[0] / size,
        "Vg": vehicle.neutral_volume - CUBIC_CM * pump.neutral,
        "mg": vehicle.mass,
        "epsilon": vehicle.hull_compressibility / 1e-10,
        "ah": law.lift[1] / size - WING,
        "Cd1": law.drag[1] / size,
        "aw": WING,
        "S": AREA,
    }


def from_gliderflight(figures: Mapping[str, float], calibration: Calibration) -> Calibration:
    """Return the calibration with gliderflight's figures; figures that are not given stay."""
    mine = {**to_gliderflight(calibration), **figures}
    volume = mine["Vg"] + CUBIC_CM * pump_of(calibration).neutral
    size = 0.5 * (mine["mg"] / volume) * mine["S"]
    drag, lift = (mine["Cd0"] * size, mine["Cd1"] * size), (mine["aw"] + mine["ah"]) * size
    return _with(calibration, mine["mg"], volume, drag, lift, 1e-10 * mine["epsilon"])


def _with(
    calibration: Calibration, mass: float, volume: float, drag: tuple[float, float], lift: float,
    compressibility: float,
) -> Calibration:  # fmt: skip
    of_mass, of_drag = (choose([name])[0] for name in ("mass", "drag"))
    if mass != calibration.vehicle.mass:
        calibration = of_mass.set(calibration, mass)
    calibration = of_drag.set(calibration, drag[0])
    return calibration.with_vehicle(
        reference_density=calibration.vehicle.mass / volume,
        drag=drag,
        lift=(calibration.vehicle.flow_frame.lift[0], lift),
        hull_compressibility=compressibility,
    )


POSITIVE = ("mass", "rho0", "glider_length", "hd_b", "volmax", "speed", "Cd0", "Vg", "mg", "S")
"""Figures that must be above 0"""


def write_figures(calibration: Calibration, path: Path) -> str:
    """Write figures, `.m` for a basestation, `.json` for gliderflight; return which of the two.

    Raises:
      InputError: another ending. WriteError: the disk refuses.
    """
    if path.suffix == ".m":
        kind, figures = "basestation", to_basestation(calibration)
        lines = ["% identified; drag as at the speed [m/s], volmax with the vbd [cc] at its end"]
        lines += [f"{name} = {value:.10g};" for name, value in figures.items()]
        text = "\n".join(lines) + "\n"
    elif path.suffix == ".json":
        kind, figures = "gliderflight", to_gliderflight(calibration)
        text = json.dumps(figures, indent=2) + "\n"
    else:
        raise InputError(
            f"{path}: figures end in .m (basestation: hd_a, hd_b, hd_c, volmax) or .json "
            "(gliderflight: Cd0, Vg, mg)"
        )
    with whole_file(path) as place:
        place.write_text(text, encoding="utf-8")
    return kind


def read_figures(path: Path, calibration: Calibration) -> Calibration:
    """Return the calibration with the figures of a file of either type.

    A basestation's file may hold any assignments and comments of MATLAB; names that are not in
    `to_basestation` are skipped. A gliderflight file is JSON, and unknown names are refused.

    Raises:
      InputError: no such file, no figure in it, an unknown name in JSON, or a text as a value.
    """
    text = read_text(path, "figures")
    if path.suffix == ".json":
        kind, mark, taken = "gliderflight", "Cd0", from_gliderflight
        known, loaded = to_gliderflight(calibration), parse_json(text, str(path))
        if not isinstance(loaded, dict):
            raise InputError(f"{path} must be a JSON object of numbers")
        for name in loaded:
            if name not in known:
                raise InputError(f"{path}: {unknown_name('figure', name, list(known))}")
    else:
        kind, mark, taken = "basestation", "hd_a", from_basestation
        known = to_basestation(calibration)
        found = re.findall(r"^\s*(\w+)\s*=\s*([-+0-9.eE]+)\s*;?", text, flags=re.MULTILINE)
        loaded = {name: value for name, value in found if name in known}
    if mark not in loaded:
        raise InputError(f"{path} holds no {mark}: it is not {kind}'s ({', '.join(known)})")
    given = {name: _number(path, name, value) for name, value in loaded.items()}
    return taken(given, calibration)


def _number(path: Path, name: str, value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{path}: {name} = {value!r} must be a finite number")
    if name in POSITIVE and not number > 0.0:
        raise InputError(f"{path}: {name} = {number:g} must be above 0")
    return number
