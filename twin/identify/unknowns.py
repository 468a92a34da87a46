"""Unknowns: parameters that a log may determine, with their units and prior knowledge.

Each parameter has a nominal value, the vehicle file's, and a spread, the standard deviation between
such vehicles. Drag is the size of all coefficients; lift and induced drag are ratios to it. A glide
at one pitch shows the size only. The ratios belong to the shape of a vehicle, while its drag
changes with every sensor and barnacle.

`twin identify` writes the covariance of the parameters into its vehicle file; `draw_vehicles`
samples vehicles from it.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from twin.errors import InputError, VehicleError, unknown_name
from twin.identify.calibration import CYCLES, PROVENANCE, Array, Calibration, load_calibration
from twin.vehicle.vehicle import Vehicle

DEGREE = math.pi / 180.0


@dataclasses.dataclass(frozen=True)
class UnknownParameter:
    """One quantity that identification can estimate."""

    name: str
    unit: str
    meaning: str
    spread: float
    """Standard deviation known beforehand, in `unit`; of the logarithm where `logarithmic`"""
    get: Callable[[Calibration], float]
    set: Callable[[Calibration, float], Calibration]
    logarithmic: bool = False
    """True: the value is positive, and its logarithm is estimated."""
    least: float | None = None
    """Smallest possible value in `unit`, of a parameter that is not logarithmic"""
    fixed: float | None = None
    """Standard deviation of a value that a fit leaves at nominal, as `spread`; None: `spread`"""
    channel: str | None = None
    """Requirement for an estimate: "temperature" or "fixes" in the log, "pressure" enough to tell
    hulls apart, the position of a part ("rotation", "fin"), "dives" that are predicted better with
    it when they are left out, or the user's "request". Lift, induced drag and pitch offset turn
    into drag and trim when a log holds one pitch, and then take up the model's errors. Currents
    between fixes separate lift; left-out dives separate a pitch offset. They do not separate lift
    and induced drag: where they predicted depth rates better, the speed against a Doppler log was
    worse (docs/howto/identify.md)."""

    @property
    def held(self) -> float:
        """Standard deviation of a value that a fit leaves at nominal, as `spread`."""
        return self.spread if self.fixed is None else self.fixed

    def at(self, calibration: Calibration, nominal: float, offset: float) -> Calibration:
        """Return the calibration with this parameter `offset` spreads away from `nominal`."""
        return self.set(calibration, self.value(nominal, offset))

    def value(self, nominal: float, offset: float) -> float:
        """Value that lies `offset` spreads from `nominal`."""
        if self.logarithmic:
            return nominal * math.exp(self.spread * offset)
        return nominal + self.spread * offset

    def deviation(self, value: float, scaled: float) -> float:
        """Standard deviation in `unit` at `value`; `scaled` is the one in spreads."""
        return scaled * self.spread * (value if self.logarithmic else 1.0)


def of_law(
    name: str, unit: str, meaning: str, spread: float, field: str, place: int = 0,
    scale: Callable[[Calibration], float] = lambda c: 1.0, **about: Any,
) -> UnknownParameter:  # fmt: skip
    """Coefficient of a glider's hull law, `field`[place], over a scale of the vehicle's own."""

    def get(calibration: Calibration) -> float:
        return float(getattr(calibration.vehicle.flow_frame, field)[place]) / scale(calibration)

    def put(calibration: Calibration, value: float) -> Calibration:
        numbers = list(getattr(calibration.vehicle.flow_frame, field))
        numbers[place] = value * scale(calibration)
        return calibration.with_vehicle(**{field: tuple(numbers)})

    return UnknownParameter(name, unit, meaning, spread, get, put, **about)


def of_sensor(
    name: str, unit: str, meaning: str, spread: float, scale: float = 1.0, **about: Any
) -> UnknownParameter:
    """Number of this name in the calibration; `scale` of its own units make one of `unit`."""
    return UnknownParameter(
        name, unit, meaning, spread, lambda c: getattr(c, name) / scale,
        lambda c, x: c.replace(**{name: x * scale}), **about,
    )  # fmt: skip


def _drag(calibration: Calibration) -> float:
    return calibration.vehicle.flow_frame.drag[0]


def _set_drag(calibration: Calibration, value: float) -> Calibration:
    """Scale all forces together (see the module), so that the sideslip of a bank stays equal."""
    law = calibration.vehicle.flow_frame
    scale = value / law.drag[0]
    return calibration.with_vehicle(
        drag=(value, law.drag[1] * scale),
        lift=(law.lift[0] * scale, law.lift[1] * scale),
        side_force=(law.side_force[0] * scale,),
    )


def _set_mass(calibration: Calibration, value: float) -> Calibration:
    """Set the mass by the static block; inertia and added mass grow in proportion."""
    vehicle = calibration.vehicle
    scale = value / vehicle.mass
    return calibration.with_vehicle(
        static_mass=value - vehicle.battery.mass,
        static_inertia=vehicle.static_inertia * scale,
        added_mass=vehicle.added_mass * scale,
    )


def _cycle(index: int, text: str) -> UnknownParameter:
    """Coefficient of one harmonic of the compass deviation."""

    def put(calibration: Calibration, value: float) -> Calibration:
        cycles = list(calibration.heading_cycles)
        cycles[index] = value * DEGREE
        return calibration.replace(heading_cycles=tuple(cycles))

    return UnknownParameter(
        CYCLES[index], "degree", f"compass deviation with the {text}",
        _COMPASS if index < 2 else _SOFT_IRON,
        lambda c: c.heading_cycles[index] / DEGREE, put, channel="fixes",
    )  # fmt: skip


_COMPASS, _SOFT_IRON = 2.0, 1.0
"""[deg] Standard deviations of a compass's offset and each part of its hard iron, and of each of
its soft iron: 3 deg in all after a calibration; 10 deg has been seen."""

# fmt: off
PARAMETERS: tuple[UnknownParameter, ...] = (
    # 0.5 % of the volume, more than the pump of any glider: in effect free
    UnknownParameter(
        "neutral_density", "kg m-3", "density in which the vehicle is neutral at pump 0: the trim",
        5.0, lambda c: c.vehicle.reference_density,
        lambda c, x: c.with_vehicle(reference_density=x), fixed=0.5),
    # a factor of 2.7 either way: in effect free
    UnknownParameter(
        "drag", "kg m-1",
        "parasite drag K_D0; lift, side force and induced drag keep their ratios to it",
        1.0, _drag, _set_drag, logarithmic=True, fixed=0.2),
    # one vehicle file stands for hulls of 50 to 75 kg, those of one type differ by a sixth
    UnknownParameter(
        "mass", "kg", "mass, and with it the volume whose buoyancy follows the water's density",
        0.3, lambda c: c.vehicle.mass, _set_mass, logarithmic=True, fixed=0.05, channel="request"),
    # published Slocum models 48 and 62, a Doppler log 41, their files 34 and 42; spreads of 0.2 and
    # 0.35 predict worse: docs/results/real_logs.md
    of_law(
        "lift_ratio", "rad-1", "lift slope over parasite drag, K_alpha / K_D0: the angle of attack",
        0.25, "lift", 1, _drag, logarithmic=True, channel="fixes"),
    # published Slocum models: 12 and 70
    of_law(
        "induced_ratio", "rad-2", "induced over parasite drag, K_D / K_D0",
        0.7, "drag", 1, _drag, logarithmic=True, fixed=0.3, channel="request"),
    # metal hulls: 4 to 7
    UnknownParameter(
        "compressibility", "1e-10 Pa-1", "relative volume that the hull loses per pressure",
        6.0, lambda c: 1e10 * c.vehicle.hull_compressibility,
        lambda c, x: c.with_vehicle(hull_compressibility=1e-10 * x), least=0.0, fixed=1.0,
        channel="pressure"),
    # aluminium 71, composites less
    of_sensor(
        "thermal_expansion", "1e-6 K-1", "relative volume that the hull gains per temperature",
        20.0, 1e-6, channel="temperature"),
    of_sensor(
        "thermal_lag", "s", "time in which the hull follows the temperature of the water",
        0.7, logarithmic=True, channel="temperature"),
    # alignment of an attitude sensor in the hull
    of_sensor(
        "pitch_offset", "degree", "true pitch less the sensor's", 1.0, DEGREE, channel="dives"),
    # a Slocum's sensor read 1.16 times its pitch (Merckelbach et al. 2019); data sheets: 0.25 deg
    of_sensor("pitch_scale", "1", "true pitch over the sensor's", 0.1, fixed=0.01, channel="dives"),
    of_sensor(
        "heading_offset", "degree", "true heading less the compass', mean over all headings",
        _COMPASS, DEGREE, channel="fixes"),
    _cycle(0, "cosine of the heading"),
    _cycle(1, "sine of the heading"),
    _cycle(2, "cosine of twice the heading"),
    _cycle(3, "sine of twice the heading"),
)
# fmt: on

NAMES = tuple(parameter.name for parameter in PARAMETERS)


def choose(
    names: Mapping[str, object] | Sequence[str],
    among: tuple[UnknownParameter, ...] = PARAMETERS,
) -> tuple[UnknownParameter, ...]:
    """Parameters of these names, in the order of `among`.

    Raises:
      InputError: an unknown name, with the nearest.
    """
    for name in names:
        if name not in (known := [parameter.name for parameter in among]):
            raise InputError(unknown_name("parameter", name, known))
    return tuple(parameter for parameter in among if parameter.name in names)


def with_known(
    calibration: Calibration,
    known: Mapping[str, float],
    among: tuple[UnknownParameter, ...] = PARAMETERS,
) -> Calibration:
    """Return the calibration with these values, in the parameters' units.

    Raises:
      InputError: an unknown name, or an impossible value.
    """
    for parameter in choose(known, among):
        value = known[parameter.name]
        least = 0.0 if parameter.logarithmic else parameter.least
        if least is not None and (value < least or (parameter.logarithmic and value == 0.0)):
            raise InputError(
                f"{parameter.name} = {value:g} {parameter.unit} must be "
                + ("above 0" if parameter.logarithmic else f"at least {least:g}")
            )
        calibration = parameter.set(calibration, value)
    return calibration


SPEED = ("drag", "lift_ratio", "induced_ratio")
"""Parameters that decide the speed. Where a filter of logs estimates a scale of the speed, that
scale replaces them."""


def identified(vehicle: Vehicle) -> Mapping[str, Any]:
    """Record of the identification in a vehicle's file; empty where the file has none."""
    for text in ElementTree.fromstring(vehicle.xml).iter("text"):
        if text.get("name") == PROVENANCE:
            try:
                found = json.loads(text.get("data", ""))
            except json.JSONDecodeError as error:
                raise VehicleError(
                    f"vehicle file {vehicle.path}: <text name={PROVENANCE!r}> is not JSON: {error}"
                ) from None
            return found if isinstance(found, dict) else {}
    return {}


def known_compass(vehicle: Vehicle) -> tuple[float, float | None]:
    """Identified offset of the compass, true heading less measured, and standard deviation [rad].

    (0, None) without an identified offset. Deviations that vary with the heading are left out.
    """
    entry = identified(vehicle).get("parameters", {}).get("heading_offset", {})
    if not (entry.get("determined") and entry.get("deviation")):
        return 0.0, None
    return load_calibration(vehicle).heading_offset, math.radians(float(entry["deviation"]))


def draw_vehicles(
    vehicle: Vehicle, count: int, rng: np.random.Generator, *, speed: bool
) -> tuple[list[Vehicle], tuple[str, ...]]:
    """Sample vehicles by the covariance in a vehicle's file; return the sampled names beside them.

    The first vehicle is the file's. Parameters of sensors are not sampled: they change no flight.

    Args:
      speed: True: sample the parameters of SPEED too.

    Raises:
      VehicleError: the file's record of its identification cannot be read.
    """
    said = identified(vehicle).get("parameters", {})
    known = {p.name: p for p in PARAMETERS}
    drawn = [
        name
        for name, entry in said.items()
        if name in known and entry.get("determined") and entry.get("deviation")
        if not name.startswith(("pitch_", "heading_", "water_density", "thermal_"))
        if speed or name not in SPEED
    ]
    if not drawn:
        return [vehicle] * count, ()
    calibration = load_calibration(vehicle)
    deviation = np.array([float(said[name]["deviation"]) for name in drawn])
    covariance = _correlation(vehicle, drawn) * np.outer(deviation, deviation)
    vehicles = [vehicle]
    for row in normal_draws(covariance, count, rng)[1:]:
        one = calibration
        for name, error in zip(drawn, row.tolist(), strict=True):
            value, factor = known[name].get(one), known[name].logarithmic
            moved = value * math.exp(error / value) if factor and value > 0.0 else value + error
            one = known[name].set(one, moved)
        vehicles.append(one.vehicle)
    return vehicles, tuple(drawn)


def _correlation(vehicle: Vehicle, drawn: Sequence[str]) -> Array:
    """Correlation of the sampled parameters; the identity for files of earlier versions."""
    said = identified(vehicle).get("correlation")
    if said is None:
        return np.eye(len(drawn))
    try:
        whole, order = np.asarray(said["matrix"], float), said["parameters"]
        places = [order.index(name) for name in drawn]
        return np.asarray(whole[np.ix_(places, places)])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise VehicleError(
            f"vehicle file {vehicle.path}: its identification's correlation cannot be read: {error}"
        ) from None


def normal_draws(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    """Sample normal vectors of mean 0, (count, size); the covariance may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(
        rng.standard_normal((count, len(values))) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    )
