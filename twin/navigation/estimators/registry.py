"""Registry of the velocity estimators, and how one is made from its name and argument."""

from __future__ import annotations

from twin.errors import InputError
from twin.navigation.estimator import VelocityEstimator
from twin.registry import Registry, missing_method, self_named
from twin.vehicle.vehicle import Vehicle

USUAL = ("ekf", "steady_flight", "dvl")
"""In the order in which they are tried where none is named."""


def _lacks(kind: type[VelocityEstimator]) -> str:
    if not getattr(kind, "summary", ""):
        return "a `summary`"
    if kind.open.__func__ is VelocityEstimator.open.__func__:  # type: ignore[attr-defined]
        return "the method `open`"
    return missing_method(kind)


VELOCITY_ESTIMATORS: Registry[type[VelocityEstimator]] = Registry(
    "velocity estimator",
    group="glider_twin.velocity_estimators",
    shipped={
        "ekf": "twin.navigation.estimators.baseline:ByEkf",
        "steady_flight": "twin.navigation.estimators.baseline:BySteadyFlight",
        "pitch_plus_alpha": "twin.navigation.estimators.baseline:ByPitchPlusAlpha",
        "dvl": "twin.navigation.estimators.baseline:ByDvl",
    },
    check=self_named(
        "velocity estimator",
        VelocityEstimator,  # type: ignore[type-abstract]
        _lacks,
        InputError,
    ),
    name="kind",
)
"""Every estimator that has a name."""

register = VELOCITY_ESTIMATORS.add
"""Add a kind of one's own; usable as a decorator."""


def open_velocity_estimator(text: str, vehicle: Vehicle, period: float) -> VelocityEstimator:
    """The estimator that a text such as "ekf" or "network:runs/mine" names.

    Args:
      vehicle: as its file says.
      period: [s] between the samples that there are.

    Raises:
      InputError: an unknown kind, an argument that it does not take, or a vehicle that it does not
        suit.
    """
    kind, _, argument = text.partition(":")
    return VELOCITY_ESTIMATORS[kind].open(argument, vehicle, period)


def usual_velocity_estimator(vehicle: Vehicle, period: float) -> VelocityEstimator:
    """The first of `USUAL` that suits a vehicle.

    Raises:
      InputError: none does; what each lacks.
    """
    why = []
    for name in USUAL:
        try:
            return open_velocity_estimator(name, vehicle, period)
        except InputError as error:
            why.append(str(error))
    raise InputError("no velocity estimator suits the vehicle: " + "; ".join(why))
