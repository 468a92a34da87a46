"""Vehicle draws: vehicles as an identification leaves them possible.

`twin identify` writes into its vehicle file how surely each parameter is known, and how their
errors go together.

Normal draws: random draws of several numbers that vary together.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError
from twin.identify.calibration import PROVENANCE, load_calibration
from twin.identify.unknowns import PARAMETERS
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

SPEED = ("drag", "lift_ratio", "induced_ratio")
"""Parameters that decide the speed: where logs tell the speed, their filter's scale stands for
them"""


def identified(vehicle: Vehicle) -> Mapping[str, Any]:
    """What a vehicle file says about its identification; empty where it says nothing."""
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

    Args:
      speed: whether to draw what decides the speed, too.

    Raises:
      VehicleError: what the file says of its identification cannot be read.
    """
    said = identified(vehicle).get("parameters", {})
    known = {p.name: p for p in PARAMETERS}
    names = [
        name
        for name, entry in said.items()
        if name in known and entry.get("determined") and entry.get("deviation")
    ]
    drawn = [name for name in names if _flown(name) and (speed or name not in SPEED)]
    if not drawn:
        return [vehicle] * count, ()
    calibration = load_calibration(vehicle)
    deviation = np.array([float(said[name]["deviation"]) for name in drawn])
    covariance = _correlation(vehicle, drawn) * np.outer(deviation, deviation)
    draws = normal_draws(covariance, count, rng)
    draws[0] = 0.0
    vehicles = []
    for row in draws:
        one = calibration
        for name, error in zip(drawn, row.tolist(), strict=True):
            one = known[name].set(one, _moved(known[name].get(one), error, known[name].logarithmic))
        vehicles.append(one.vehicle)
    vehicles[0] = vehicle
    return vehicles, tuple(drawn)


def _flown(name: str) -> bool:
    """Whether a parameter changes how the vehicle flies, and not only how its sensors read."""
    return not name.startswith(("pitch_", "heading_", "water_density", "thermal_"))


def _moved(value: float, error: float, logarithmic: bool) -> float:
    if logarithmic and value > 0.0:
        return value * math.exp(error / value)
    return value + error


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
