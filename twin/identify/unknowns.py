"""Unknowns: which parameters can be estimated from a log, in which unit, and what is known before.

Each parameter has a nominal value (the vehicle file's) and a spread, the standard deviation of
what such vehicles are known to differ by. Drag is the size of all coefficients: lift and induced
drag are given as ratios to it, because a glide at one pitch shows the size only, and because the
ratios belong to the shape of a vehicle while its drag changes with every sensor and barnacle.

`twin identify` writes into its vehicle file how surely each parameter is known, and how their
errors go together: `draw_vehicles` samples the vehicles that this leaves possible.
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
    """Standard deviation known beforehand, in `unit`; of the logarithm where `logarithmic`."""
    get: Callable[[Calibration], float]
    set: Callable[[Calibration, float], Calibration]
    logarithmic: bool = False
    """Positive, known up to a factor."""
    least: float | None = None
    """Smallest value there can be, in `unit`, of one that is not logarithmic."""
    channel: str | None = None
    """Needs: "temperature" or "fixes" in the log, "pressure" enough to tell hulls apart,
    the position of a part ("rotation", "fin"), "dives" that are predicted better with it when they
    are left out, or the user's "request". Lift, induced drag and pitch offset all turn into drag
    and trim when a log holds one pitch, and then take up what the model lacks. With a current
    between fixes lift can be told; left-out dives tell a pitch offset. They do not tell lift and
    induced drag: what predicts depth rates better made the speed worse where a Doppler log told it
    (docs/howto/identify.md)."""

    def at(self, calibration: Calibration, nominal: float, offset: float) -> Calibration:
        """The calibration with this parameter `offset` spreads away from `nominal`."""
        return self.set(calibration, self.value(nominal, offset))

    def value(self, nominal: float, offset: float) -> float:
        """The value that lies `offset` spreads from `nominal`."""
        if self.logarithmic:
            return nominal * math.exp(self.spread * offset)
        return nominal + self.spread * offset

    def deviation(self, value: float, scaled: float) -> float:
        """Standard deviation in `unit` at `value`, from one in spreads."""
        return scaled * self.spread * (value if self.logarithmic else 1.0)


def of_law(
    name: str, unit: str, meaning: str, spread: float, field: str, place: int = 0,
    scale: Callable[[Calibration], float] = lambda c: 1.0, **about: Any,
) -> UnknownParameter:  # fmt: skip
    """A coefficient of a glider's hull law, `field`[place], over a scale of the vehicle's own."""

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
    """The calibration's own figure of this name, `scale` of whose units make one of `unit`."""
    return UnknownParameter(
        name, unit, meaning, spread, lambda c: getattr(c, name) / scale,
        lambda c, x: c.replace(**{name: x * scale}), **about,
    )  # fmt: skip


def _drag(calibration: Calibration) -> float:
    return calibration.vehicle.flow_frame.drag[0]


def _set_drag(calibration: Calibration, value: float) -> Calibration:
    """All forces grow together (see the module), so that a bank's sideslip stays what it was."""
    law = calibration.vehicle.flow_frame
    scale = value / law.drag[0]
    return calibration.with_vehicle(
        drag=(value, law.drag[1] * scale),
        lift=(law.lift[0] * scale, law.lift[1] * scale),
        side_force=(law.side_force[0] * scale,),
    )


def _set_mass(calibration: Calibration, value: float) -> Calibration:
    """The static block takes the change; inertia and added mass grow with it."""
    vehicle = calibration.vehicle
    scale = value / vehicle.mass
    return calibration.with_vehicle(
        static_mass=value - vehicle.battery.mass,
        static_inertia=vehicle.static_inertia * scale,
        added_mass=vehicle.added_mass * scale,
    )


def _cycle(index: int, text: str) -> UnknownParameter:
    """One part of a compass's deviation."""

    def put(calibration: Calibration, value: float) -> Calibration:
        cycles = list(calibration.heading_cycles)
        cycles[index] = value * DEGREE
        return calibration.replace(heading_cycles=tuple(cycles))

    return UnknownParameter(
        CYCLES[index], "degree", f"compass deviation with the {text}", _COMPASS_SPREAD,
        lambda c: c.heading_cycles[index] / DEGREE, put, channel="fixes",
    )  # fmt: skip


_COMPASS_SPREAD = 3.0
"""[deg] deviation of a glider's compass after its own calibration, with 10 deg not unheard of."""

# fmt: off
PARAMETERS: tuple[UnknownParameter, ...] = (
    # 0.5 % of the volume, more than the pump of any glider: in effect free
    UnknownParameter(
        "neutral_density", "kg m-3", "density in which the vehicle is neutral at pump 0: the trim",
        5.0, lambda c: c.vehicle.reference_density,
        lambda c, x: c.with_vehicle(reference_density=x)),
    # a factor of 2.7 either way: in effect free
    UnknownParameter(
        "drag", "kg m-1",
        "parasite drag K_D0; lift, side force and induced drag keep their ratios to it",
        1.0, _drag, _set_drag, logarithmic=True),
    # one vehicle file stands for hulls of 50 to 75 kg
    UnknownParameter(
        "mass", "kg", "mass, and with it the volume whose buoyancy follows the water's density",
        0.3, lambda c: c.vehicle.mass, _set_mass, logarithmic=True, channel="request"),
    # published Slocum models: 48 and 62
    of_law(
        "lift_ratio", "rad-1", "lift slope over parasite drag, K_alpha / K_D0: the angle of attack",
        0.25, "lift", 1, _drag, logarithmic=True, channel="fixes"),
    # published Slocum models: 12 and 70
    of_law(
        "induced_ratio", "rad-2", "induced over parasite drag, K_D / K_D0",
        0.7, "drag", 1, _drag, logarithmic=True, channel="request"),
    # metal hulls: 4 to 7
    UnknownParameter(
        "compressibility", "1e-10 Pa-1", "relative volume that the hull loses per pressure",
        6.0, lambda c: 1e10 * c.vehicle.hull_compressibility,
        lambda c, x: c.with_vehicle(hull_compressibility=1e-10 * x), least=0.0, channel="pressure"),
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
    # a Slocum's sensor read 1.16 times its pitch (Merckelbach et al. 2019)
    of_sensor("pitch_scale", "1", "true pitch over the sensor's", 0.1, channel="dives"),
    of_sensor(
        "heading_offset", "degree", "true heading less the compass', mean over all headings",
        _COMPASS_SPREAD, DEGREE, channel="fixes"),
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
    """The parameters of these names, in the order of `among`.

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
    """The calibration with these values, in the parameters' units.

    Raises:
      InputError: an unknown name, or a value that there cannot be.
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
"""Parameters that decide the speed: where logs tell the speed, their filter's scale stands for
them"""


def identified(vehicle: Vehicle) -> Mapping[str, Any]:
    """Record of its identification in a vehicle's file; empty where it has none."""
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
    """True heading less the compass's [rad] as an identification found it, and its deviation [rad].

    (0, None) where it did not. Deviations that turn with the heading are left out.
    """
    entry = identified(vehicle).get("parameters", {}).get("heading_offset", {})
    if not (entry.get("determined") and entry.get("deviation")):
        return 0.0, None
    return load_calibration(vehicle).heading_offset, math.radians(float(entry["deviation"]))


def draw_vehicles(
    vehicle: Vehicle, count: int, rng: np.random.Generator, *, speed: bool
) -> tuple[list[Vehicle], tuple[str, ...]]:
    """Possible vehicles, the first of them as its file says, and the parameters that were drawn.

    Drawn is what changes how the vehicle flies, and not only how its sensors read.

    Args:
      speed: whether to draw what decides the speed, too.

    Raises:
      VehicleError: what the file says of its identification cannot be read.
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
    """Of the drawn parameters; files of earlier versions do not say it: then none."""
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
    """Draws of mean 0, (count, size); the covariance (size, size) may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(
        rng.standard_normal((count, len(values))) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    )
