"""Registry of the estimators: names for the command line, and the kinds."""

from __future__ import annotations

from twin.errors import InputError
from twin.flight.estimators.base import FlightEstimator
from twin.registry import Registry, missing_method, self_named


def _lacks(kind: type[FlightEstimator]) -> str:
    """What a kind lacks."""
    if not getattr(kind, "summary", ""):
        return "a `summary`"
    return missing_method(kind)


ESTIMATORS: Registry[type[FlightEstimator]] = Registry(
    "flight estimator",
    group="glider_twin.flight_estimators",
    shipped={
        "flight": "twin.flight.estimators.flight_model:FlightModel",
        "steady": "twin.flight.estimators.steady_model:SteadyModel",
    },
    check=self_named(
        "flight estimator",
        FlightEstimator,  # type: ignore[type-abstract]
        _lacks,
        InputError,
    ),
    name="kind",
)
"""Every way to the velocity through the water, by name."""

register = ESTIMATORS.add
"""Add a kind of one's own; usable as a decorator."""


def open_estimator(text: str) -> FlightEstimator:
    """The estimator that a text such as "flight" or "network:runs/mine" names.

    Raises:
      InputError: an unknown kind, or an argument that it does not take.
    """
    kind, _, argument = text.partition(":")
    return ESTIMATORS[kind].open(argument)
